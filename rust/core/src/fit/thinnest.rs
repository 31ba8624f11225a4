//! The thinnest plane around a piece.
//!
//! One plane can hold a leaf if the leaf's width is small enough: the least distance of two parallel planes that enclose it. The optimum's
//! normal is perpendicular to a hull face or to two hull edges, so it is among the normals perpendicular to two differences of vertices.
//! Leaves of up to [`EXACT_VERTICES`] vertices try all of these. Larger leaves try their triangles' normals and a sample of edge pairs.
//! Known limit: that can split a large curved leaf that a plane could just hold.

use glam::DVec3;

use crate::geometry::Plane;

const EXACT_VERTICES: usize = 12;

/// Greatest number of area vectors to try.
const MOST_DIRECTIONS: usize = 64;

/// Returns the middle plane of a slab around the points: the best along an area vector if that holds them within
/// `bound`, else the thinnest found.
pub fn thin_enough(points: &[DVec3], areas: &[DVec3], bound: f64) -> Plane {
    let stride = areas.len().div_ceil(MOST_DIRECTIONS).max(1);
    let from_areas = areas.iter().step_by(stride).filter_map(|a| a.try_normalize());
    let (mut best, mut half) = (Plane { normal: DVec3::Z, distance: 0.0 }, f64::INFINITY);
    let mut consider = |normal: DVec3| {
        let heights = points.iter().map(|p| normal.dot(*p));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        if (high - low) / 2.0 < half {
            (best, half) = (Plane { normal, distance: low / 2.0 + high / 2.0 }, (high - low) / 2.0);
        }
        half
    };
    let mut reached = f64::INFINITY;
    for normal in from_areas {
        reached = consider(normal);
    }
    if reached > bound {
        let directions = differences(points);
        for (i, a) in directions.iter().enumerate() {
            for b in &directions[i + 1..] {
                if let Some(normal) = a.cross(*b).try_normalize() {
                    reached = consider(normal);
                }
            }
            // A sliver's cross products are rounding noise; a plane along its longest edge holds it.
            if let Some(along) = a.try_normalize() {
                reached = consider(along.any_orthonormal_vector());
            }
        }
    }
    if reached == f64::INFINITY {
        consider(DVec3::Z); // one point
    }
    best
}

/// Returns differences of vertices: all for few vertices, of a regular sample for many.
fn differences(points: &[DVec3]) -> Vec<DVec3> {
    let stride = points.len().div_ceil(EXACT_VERTICES).max(1);
    let chosen: Vec<DVec3> = points.iter().step_by(stride).copied().collect();
    let pairs = chosen.iter().enumerate().flat_map(|(i, a)| chosen[i + 1..].iter().map(move |b| *b - *a));
    pairs.collect()
}
