//! One connected part, simplified to fewer and fewer triangles.
//!
//! The crate `meshopt` collapses edges in the order of quadric errors (Garland and Heckbert 1997), which include texture coordinates and
//! normals (Hoppe 1999).

use glam::{DVec3, Vec2};
use leafcloud::Foliage;
use meshopt::{SimplifyOptions, SimplifyVertex, simplify_with_attributes_and_locks_decoder};

use crate::vertices::{ATTRIBUTES, Vertices};

/// Triangles of a part, each as three corners of the whole trunk.
pub type Part = Vec<[u32; 3]>;

/// Weight of normals: a normal that changes by 1 counts like a move by this share of the part's extent. Larger weights spend triangles on
/// roundness smaller than a pixel.
const NORMAL_WEIGHT: f32 = 0.03;
/// Weight of colors, likewise.
const COLOR_WEIGHT: f32 = 0.05;
/// Weight of texture coordinates: a texture that slides along the surface counts like a move by this share of its way. Weights from 0.03 to
/// 1 hardly differ in pictures of three trees.
const TEXTURE_WEIGHT: f32 = 0.3;
/// A step that keeps more than its target times this ignores texture seams.
const STUCK: f64 = 1.25;

/// Returns the part of `trunk` with these triangles, then simplified ones, each with about half the triangles of the one before. The first
/// simplified one has at most `most` triangles.
pub fn steps(trunk: &Foliage, triangles: &[u32], most: usize) -> Vec<Part> {
    let places: Vec<DVec3> = triangles.iter().flat_map(|&t| trunk.corners(t as usize)).collect();
    let vertices = Vertices::new(trunk, triangles, &places);
    let texture = texture_lengths(trunk, triangles, &places);
    let shape = Shape { triangles, vertices, places, texture };
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
    /// Lengths on the surface of one unit of u and of v, as shares of the part's extent.
    texture: [f32; 2],
}

impl Shape<'_> {
    /// Returns triangles of vertices, about `target` of them. Seams of the texture stay closed as long as that many triangles allow it.
    fn simplified(&self, target: usize) -> Vec<[u32; 3]> {
        let simplified = self.collapsed(target, &self.vertices.on_seam, 1.0);
        if simplified.len() as f64 <= STUCK * target as f64 {
            return simplified;
        }
        self.collapsed(target, &self.vertices.on_border, 0.0)
    }

    /// Returns triangles of vertices, with the seams at `protected` vertices closed. `surface`: factor of the weights of texture coordinates
    /// and colors.
    fn collapsed(&self, target: usize, protected: &[bool], surface: f32) -> Vec<[u32; 3]> {
        let lock = |&protected: &bool| if protected { SimplifyVertex::Protect } else { SimplifyVertex::None };
        let locks: Vec<_> = protected.iter().map(lock).collect();
        let normal = NORMAL_WEIGHT;
        let [u, v] = self.texture.map(|length| surface * TEXTURE_WEIGHT * length);
        let color = surface * COLOR_WEIGHT;
        let indices = simplify_with_attributes_and_locks_decoder(
            &self.vertices.of_corner,
            &self.vertices.places,
            self.vertices.attributes.as_flattened(),
            &[u, v, normal, normal, normal, color, color, color, color],
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

/// Returns the mean lengths on the surface of one unit of u and of v, as shares of the part's extent; 0 without texture coordinates.
/// `places`: the positions of the corners.
fn texture_lengths(trunk: &Foliage, triangles: &[u32], places: &[DVec3]) -> [f32; 2] {
    let (low, high) = places.iter().fold((places[0], places[0]), |(low, high), &p| (low.min(p), high.max(p)));
    let (mut area, mut units) = (0.0, [0.0; 2]);
    for (&triangle, &[a, b, c]) in triangles.iter().zip(places.as_chunks::<3>().0) {
        let Some(uvs) = trunk.attributes().uvs.get(triangle as usize) else { return [0.0; 2] };
        let [first, second] = [uvs[1] - uvs[0], uvs[2] - uvs[0]].map(Vec2::as_dvec2);
        let gradient = |first: f64, second: f64| ((c - a) * first - (b - a) * second).length();
        area += (b - a).cross(c - a).length();
        units[0] += gradient(first.x, second.x);
        units[1] += gradient(first.y, second.y);
    }
    let length = |units: f64| if units > 0.0 { (area / units / (high - low).max_element()) as f32 } else { 0.0 };
    units.map(length)
}
