//! Leaves with thin branches: a cloud shows both, and only the leaves are leaves of the tree.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use super::{Attributes, Foliage, unmade};

impl Foliage {
    /// Returns these triangles, then those of `wood`, in the frame of these. The parts of `wood` are further leaves without labels. Corners of `wood`
    /// should lie within the frame, or hardly outside: the error bounds of fits hold for coordinates up to 1.3.
    #[must_use]
    pub fn joined(&self, wood: &Self) -> Self {
        let (vertices, triangles) = (self.positions.len() as u32, self.triangle_count());
        let moved = wood.positions.iter().map(|&p| self.frame.to_local(wood.frame.to_caller(p)));
        let leaf_ids = wood.leaf_ids.iter().map(|leaf| leaf + self.leaf_count as u32);
        let leaf_ids: Vec<u32> = self.leaf_ids.iter().copied().chain(leaf_ids).collect();
        let materials = self.materials.iter().chain(wood.materials.iter()).cloned().collect::<Vec<_>>();
        Self {
            frame: self.frame,
            positions: self.positions.iter().copied().chain(moved).collect(),
            triangles: self
                .triangles
                .iter()
                .copied()
                .chain(wood.triangles.iter().map(|t| t.map(|v| v + vertices)))
                .collect(),
            attributes: Arc::new(self.attributes_with(wood)),
            coverage: unmade(&materials),
            materials: materials.into(),
            leaf_ids: leaf_ids.into(),
            leaf_count: self.leaf_count + wood.leaf_count,
            labelled: self.labelled.min(triangles),
        }
    }

    /// Returns the same triangles with other leaves, by arbitrary values.
    #[must_use]
    pub fn with_leaves(&self, leaves: &[i64]) -> Self {
        let (leaf_ids, leaf_count) = super::number_by_appearance(leaves.iter());
        Self { leaf_ids: leaf_ids.into(), leaf_count, ..self.clone() }
    }

    /// Returns the attributes of both, but for the leaves.
    fn attributes_with(&self, wood: &Self) -> Attributes {
        let counts = [self.triangle_count(), wood.triangle_count()];
        let both = [&self.attributes, &wood.attributes];
        let normals = if both.iter().all(|each| each.normals.is_empty()) {
            Vec::new()
        } else {
            [self, wood].map(Self::with_normals).iter().flat_map(|part| part.attributes.normals.clone()).collect()
        };
        let back = |part: &Attributes, count: usize| -> Vec<[Vec3; 3]> {
            if part.back_colors.is_empty() {
                let front = |t: usize| part.colors.get(t).map_or([Vec3::ONE; 3], |colors| colors.map(Vec4::truncate));
                (0..count).map(front).collect()
            } else {
                part.back_colors.clone()
            }
        };
        let has_backs = both.iter().any(|each| !each.back_colors.is_empty());
        let material = |(part, first): (&Self, usize)| -> Vec<u32> {
            (0..part.triangle_count()).map(|t| (first + part.material_id(t)) as u32).collect()
        };
        Attributes {
            uvs: filled(both.map(|each| &each.uvs), counts, [Vec2::ZERO; 3]),
            normals,
            colors: filled(both.map(|each| &each.colors), counts, [Vec4::ONE; 3]),
            back_colors: if has_backs {
                both.into_iter().zip(counts).flat_map(|(part, count)| back(part, count)).collect()
            } else {
                Vec::new()
            },
            material_ids: [(self, 0), (wood, self.materials.len())].into_iter().flat_map(material).collect(),
            leaf_ids: Vec::new(),
            protected: filled(both.map(|each| &each.protected), counts, false),
        }
    }
}

/// Returns the values of both parts, `usual` for each triangle of a part without values; nothing if neither has any.
fn filled<T: Copy>(parts: [&Vec<T>; 2], counts: [usize; 2], usual: T) -> Vec<T> {
    if parts.iter().all(|part| part.is_empty()) {
        return Vec::new();
    }
    let part = |(part, count): (&Vec<T>, usize)| if part.is_empty() { vec![usual; count] } else { part.clone() };
    parts.into_iter().zip(counts).flat_map(part).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::foliage::Material;

    fn square(at: f64, color: Vec4, attributes: Attributes) -> Foliage {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x + at, y, 0.0));
        let material = Material { base_color: color, ..Material::default() };
        Foliage::new(&corners, vec![[0, 1, 2], [0, 2, 3]], attributes, vec![material]).unwrap()
    }

    #[test]
    fn wood_comes_after_the_leaves_with_its_place_and_its_material() {
        let green = Vec4::new(0.0, 1.0, 0.0, 1.0);
        let brown = Vec4::new(0.5, 0.25, 0.0, 1.0);
        let leaves = square(0.0, green, Attributes { uvs: vec![[Vec2::ONE; 3]; 2], ..Attributes::default() });
        let wood = square(0.25, brown, Attributes { colors: vec![[Vec4::ONE * 0.5; 3]; 2], ..Attributes::default() });
        let both = leaves.joined(&wood);
        assert_eq!((both.triangle_count(), both.leaf_count()), (4, 2));
        assert_eq!(both.leaf_ids(), [0, 0, 1, 1]);
        assert_eq!((0..4).map(|t| both.material(t).base_color).collect::<Vec<_>>(), [green, green, brown, brown]);
        assert_eq!(both.frame().radius, leaves.frame().radius);
        for t in 0..2 {
            let expected = wood.corners(t).map(|p| wood.frame().to_caller(p));
            assert_eq!(both.corners(2 + t).map(|p| both.frame().to_caller(p)), expected);
        }
        assert_eq!(both.attributes().uvs, [[Vec2::ONE; 3], [Vec2::ONE; 3], [Vec2::ZERO; 3], [Vec2::ZERO; 3]]);
        assert_eq!(both.attributes().colors[0], [Vec4::ONE; 3], "leaves without colors stay as they are");
        assert_eq!(both.attributes().colors[3], [Vec4::ONE * 0.5; 3]);
        let labels: Vec<_> = (0..4).map(|t| both.label_of_material(t)).collect();
        assert_eq!(labels, [Some(0), Some(0), None, None], "wood has no labels");
    }

    #[test]
    fn leaves_may_be_numbered_anew() {
        let found = square(0.0, Vec4::ONE, Attributes::default()).with_leaves(&[7, -1]);
        assert_eq!((found.leaf_ids(), found.leaf_count()), (&[0, 1][..], 2));
    }
}
