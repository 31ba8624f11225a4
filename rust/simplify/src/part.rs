//! One connected part, simplified to fewer and fewer triangles.
//!
//! The crate `meshopt` collapses edges in the order of quadric errors (Garland and Heckbert 1997), which include texture coordinates and
//! normals (Hoppe 1999).

use glam::DVec3;
use leafcloud::Foliage;
use meshopt::{SimplifyOptions, SimplifyVertex, simplify_with_attributes_and_locks_decoder};

use crate::vertices::{ATTRIBUTES, Vertices};

/// Triangles of a part, each as three corners of the whole trunk.
pub type Part = Vec<[u32; 3]>;

/// Weight of normals: a normal that changes by 1 counts like a move by this share of the part's extent. Larger weights spend triangles on
/// roundness smaller than a pixel.
const NORMAL_WEIGHT: f32 = 0.03;
/// Weight of texture coordinates and colors, likewise. Of weights from 0.01 to 1, measured on three trees, this one changes the colors of
/// the pictures least.
const TEXTURE_WEIGHT: f32 = 0.05;
/// A step that keeps more than its target times this ignores texture seams.
const STUCK: f64 = 1.25;

/// Returns the part of `trunk` with these triangles, then simplified ones, each with about half the triangles of the one before. The first
/// simplified one has at most `most` triangles.
pub fn steps(trunk: &Foliage, triangles: &[u32], most: usize) -> Vec<Part> {
    let places: Vec<DVec3> = triangles.iter().flat_map(|&t| trunk.corners(t as usize)).collect();
    let vertices = Vertices::new(trunk, triangles, &places);
    let shape = Shape { triangles, vertices, places };
    let mut result = vec![shape.in_trunk(&shape.vertices.of_corner)];
    let mut target = if triangles.len() > most { most } else { triangles.len() / 2 };
    while target >= 2 {
        let simplified = shape.simplified(target);
        if !simplified.is_empty() && simplified.len() < result[result.len() - 1].len() {
            result.push(shape.in_trunk(simplified.as_flattened()));
        }
        target = if target > 2 { target.div_ceil(2) } else { 0 };
    }
    result
}

struct Shape<'a> {
    /// Indices of its triangles in the whole trunk.
    triangles: &'a [u32],
    vertices: Vertices,
    /// Positions of the corners, local frame.
    places: Vec<DVec3>,
}

impl Shape<'_> {
    /// Returns triangles of vertices, about `target` of them. Seams of the texture stay closed as long as that many triangles allow it.
    fn simplified(&self, target: usize) -> Vec<[u32; 3]> {
        let simplified = self.collapsed(target, &self.vertices.on_seam, TEXTURE_WEIGHT);
        if simplified.len() as f64 <= STUCK * target as f64 {
            return simplified;
        }
        self.collapsed(target, &self.vertices.on_border, 0.0)
    }

    /// Returns triangles of vertices, with the seams at `protected` vertices closed. `texture`: weight of texture coordinates and colors.
    fn collapsed(&self, target: usize, protected: &[bool], texture: f32) -> Vec<[u32; 3]> {
        let lock = |&protected: &bool| if protected { SimplifyVertex::Protect } else { SimplifyVertex::None };
        let locks: Vec<_> = protected.iter().map(lock).collect();
        let normal = NORMAL_WEIGHT;
        let indices = simplify_with_attributes_and_locks_decoder(
            &self.vertices.of_corner,
            &self.vertices.places,
            self.vertices.attributes.as_flattened(),
            &[texture, texture, normal, normal, normal, texture, texture, texture, texture],
            ATTRIBUTES * size_of::<f32>(),
            &locks,
            3 * target,
            f32::MAX,
            SimplifyOptions::Permissive,
            None,
        );
        let place = |v: u32| self.places[self.vertices.corners[v as usize] as usize];
        let has_area = |t: &&[u32; 3]| {
            let [a, b, c] = t.map(place);
            (b - a).cross(c - a) != DVec3::ZERO
        };
        indices.as_chunks::<3>().0.iter().filter(has_area).copied().collect()
    }

    /// Returns triangles of the part's vertices as corners of the whole trunk.
    fn in_trunk(&self, indices: &[u32]) -> Part {
        let corner = |v: u32| {
            let corner = self.vertices.corners[v as usize];
            3 * self.triangles[corner as usize / 3] + corner % 3
        };
        indices.as_chunks::<3>().0.iter().map(|t| t.map(corner)).collect()
    }
}
