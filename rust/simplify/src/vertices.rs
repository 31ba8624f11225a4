//! Vertices: one for all corners with the same position and attributes.

use glam::{DVec3, Vec3};
use leafcloud::Foliage;
use leafcloud::groups::number_by_appearance;

/// Attribute values of a vertex for the simplifier, beside its position: texture coordinates, normal, color.
pub const ATTRIBUTES: usize = 9;

/// The v vertices of a part with t triangles and 3 t corners.
pub struct Vertices {
    /// (3 t) vertex of each corner.
    pub of_corner: Vec<u32>,
    /// (v) first corner of each vertex.
    pub corners: Vec<u32>,
    /// (v) positions in the local frame.
    pub places: Vec<[f32; 3]>,
    /// (v) texture coordinates, unit normal, color; zeros for missing attributes.
    pub attributes: Vec<[f32; ATTRIBUTES]>,
    /// (v) whether texture coordinates, colors or materials differ at its position.
    pub on_seam: Vec<bool>,
    /// (v) whether materials differ at its position.
    pub on_border: Vec<bool>,
}

/// A corner of the trunk: index of the triangle, and 0 to 2 for its corner.
type TriangleCorner = (usize, usize);

impl Vertices {
    /// Returns the vertices of the `triangles` of `trunk`. `places` are the positions of their corners (3 t).
    pub fn new(trunk: &Foliage, triangles: &[u32], places: &[DVec3]) -> Self {
        let in_trunk = |corner: usize| (triangles[corner / 3] as usize, corner % 3);
        // Adding zero turns −0 into 0.
        let place = |corner: usize| (places[corner].as_vec3() + Vec3::ZERO).to_array();
        let key = |corner: usize| {
            (bits(place(corner)), bits(attributes_of(trunk, in_trunk(corner))), material(trunk, in_trunk(corner)))
        };
        let (of_corner, count) = number_by_appearance((0..places.len()).map(key));
        let corners = first_of_each(&of_corner, count);
        let of_vertex = || corners.iter().map(|&corner| corner as usize);
        let seams: Vec<_> = of_vertex().map(|corner| seam(trunk, in_trunk(corner))).collect();
        let materials: Vec<u32> = of_vertex().map(|corner| material(trunk, in_trunk(corner))).collect();
        let place_bits = || of_vertex().map(|corner| bits(place(corner)));
        Self {
            places: of_vertex().map(place).collect(),
            attributes: of_vertex().map(|corner| attributes_of(trunk, in_trunk(corner))).collect(),
            on_seam: differing(place_bits(), &seams),
            on_border: differing(place_bits(), &materials),
            corners,
            of_corner,
        }
    }
}

/// Returns, for each item, whether another item with the same key has another value.
fn differing<K: std::hash::Hash + Eq, V: PartialEq>(keys: impl Iterator<Item = K>, values: &[V]) -> Vec<bool> {
    let (groups, count) = number_by_appearance(keys);
    let first = first_of_each(&groups, count);
    let mut differ = vec![false; count];
    for (value, &group) in values.iter().zip(&groups) {
        differ[group as usize] |= *value != values[first[group as usize] as usize];
    }
    groups.iter().map(|&group| differ[group as usize]).collect()
}

/// Returns the attributes that make a seam if they differ: texture coordinates, color, material.
fn seam(trunk: &Foliage, corner: TriangleCorner) -> ([u32; 6], u32) {
    let [u, v, _, _, _, r, g, b, a] = attributes_of(trunk, corner);
    (bits([u, v, r, g, b, a]), material(trunk, corner))
}

fn material(trunk: &Foliage, (triangle, _): TriangleCorner) -> u32 {
    trunk.attributes().material_ids.get(triangle).copied().unwrap_or(0)
}

fn attributes_of(trunk: &Foliage, (triangle, k): TriangleCorner) -> [f32; ATTRIBUTES] {
    let attributes = trunk.attributes();
    let [u, v] = attributes.uvs.get(triangle).map_or([0.0; 2], |t| t[k].to_array());
    let [x, y, z] = attributes.normals.get(triangle).map_or([0.0; 3], |t| t[k].normalize_or_zero().to_array());
    let [r, g, b, a] = attributes.colors.get(triangle).map_or([0.0; 4], |t| t[k].to_array());
    [u, v, x, y, z, r, g, b, a].map(|value| value + 0.0)
}

fn bits<const N: usize>(values: [f32; N]) -> [u32; N] {
    values.map(f32::to_bits)
}

/// Returns (count) the first position of each number. Numbers are assigned in order of appearance.
fn first_of_each(numbers: &[u32], count: usize) -> Vec<u32> {
    let mut first = Vec::with_capacity(count);
    for (i, &number) in (0u32..).zip(numbers) {
        if number as usize == first.len() {
            first.push(i);
        }
    }
    first
}
