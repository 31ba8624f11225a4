//! Candidate planes of Lacewell et al. 2006: planes through a piece's vertices, moved along its normal.

use glam::Vec3;

use super::pieces::Pieces;
use crate::geometry::Plane;
use crate::random::Stream;

/// Returns the plane through three of the piece's vertices, each moved along the piece's normal by up to its bound. `None` for a piece
/// without area, or if the moved points are collinear.
pub fn perturbed_plane(pieces: &Pieces, piece: usize, stream: &mut Stream) -> Option<Plane> {
    let areas = pieces.areas(piece);
    let normal = areas.get(stream.below(areas.len().max(1)))?.as_dvec3().try_normalize()?;
    let points = pieces.points(piece);
    let count = points.len();
    if count < 3 {
        return None;
    }
    // Three distinct vertices: a random one, and two different steps from it.
    let first = stream.below(count);
    let second = 1 + stream.below(count - 1);
    let third = 1 + stream.below(count - 2);
    let third = if third >= second { third + 1 } else { third };
    let reach = f64::from(pieces.bound(piece));
    let corners = [first, (first + second) % count, (first + third) % count];
    Plane::through_points(corners.map(|i| points[i].as_dvec3() + normal * (stream.signed() * reach)))
}

/// Returns the normal of a [`perturbed_plane`].
pub fn seeded_normal(pieces: &Pieces, piece: usize, stream: &mut Stream) -> Option<Vec3> {
    perturbed_plane(pieces, piece, stream).map(|plane| plane.normal.as_vec3())
}
