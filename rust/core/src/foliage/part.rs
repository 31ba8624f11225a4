//! Foliage made of triangles or corners of another one, with their attributes.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::{Attributes, Foliage, located};
use crate::error::Result;

impl Attributes {
    /// Returns the attributes of triangles made of `corners`: corner c is corner c mod 3 of triangle c / 3. What belongs to a triangle is
    /// that of the triangle of the first corner.
    fn gathered(&self, corners: &[[u32; 3]]) -> Self {
        fn of_corners<T: Copy>(values: &[[T; 3]], corners: &[[u32; 3]]) -> Vec<[T; 3]> {
            let value = |corner: u32| values[corner as usize / 3][corner as usize % 3];
            if values.is_empty() { Vec::new() } else { corners.iter().map(|t| t.map(value)).collect() }
        }
        fn of_triangles<T: Copy>(values: &[T], corners: &[[u32; 3]]) -> Vec<T> {
            if values.is_empty() { Vec::new() } else { corners.iter().map(|t| values[t[0] as usize / 3]).collect() }
        }
        Self {
            uvs: of_corners(&self.uvs, corners),
            normals: of_corners(&self.normals, corners),
            colors: of_corners(&self.colors, corners),
            back_colors: of_corners(&self.back_colors, corners),
            material_ids: of_triangles(&self.material_ids, corners),
            leaf_ids: of_triangles(&self.leaf_ids, corners),
            protected: of_triangles(&self.protected, corners),
        }
    }
}

impl Foliage {
    /// Returns the same leaves with other corners; `corners` are local, one entry per triangle.
    ///
    /// # Errors
    /// All triangles have zero area.
    ///
    /// # Panics
    /// If the number of entries is not the number of triangles.
    pub fn with_corners(&self, corners: &[[DVec3; 3]]) -> Result<Self> {
        assert_eq!(corners.len(), self.triangle_count(), "an entry for each triangle");
        let triangles: Arc<[[u32; 3]]> = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let places: Vec<DVec3> = corners.as_flattened().par_iter().map(|&p| self.frame.to_caller(p)).collect();
        let (frame, positions) = located(&places, &triangles)?;
        Ok(Self { frame, positions, triangles, ..self.clone() }.at(self.frame.placement))
    }

    /// Returns some of the triangles with other corners; `corners` are local, one entry for each of `triangles`.
    ///
    /// # Errors
    /// No triangles; all have zero area.
    ///
    /// # Panics
    /// If the numbers of entries differ.
    pub fn part(&self, triangles: &[u32], corners: &[[DVec3; 3]]) -> Result<Self> {
        let own: Vec<[u32; 3]> = triangles.iter().map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        self.gathered(&own, corners)
    }

    /// Returns the local position of a corner, counted through all triangles.
    #[must_use]
    pub fn corner(&self, corner: u32) -> DVec3 {
        self.positions[self.triangles[corner as usize / 3][corner as usize % 3] as usize]
    }

    /// Returns triangles made of corners of this foliage, at other places: corner c is corner c mod 3 of triangle c / 3. The corners of a
    /// triangle belong to one leaf. `places` are local, one entry for each triangle.
    ///
    /// # Errors
    /// No triangles; all have zero area.
    ///
    /// # Panics
    /// If the numbers of entries differ.
    pub fn gathered(&self, corners: &[[u32; 3]], places: &[[DVec3; 3]]) -> Result<Self> {
        assert_eq!(corners.len(), places.len(), "an entry for each triangle");
        let positions: Vec<DVec3> = places.iter().flatten().map(|&p| self.frame.to_caller(p)).collect();
        let leaf_ids = corners.iter().map(|t| i64::from(self.leaf_ids[t[0] as usize / 3])).collect();
        let attributes = Attributes { leaf_ids, ..self.attributes.gathered(corners) };
        let labelled = corners.iter().take_while(|t| (t[0] as usize / 3) < self.labelled).count();
        let faces = (0..places.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let made = Self::new(&positions, faces, attributes, self.materials.to_vec())?;
        Ok(Self { coverage: Arc::clone(&self.coverage), labelled, ..made }.at(self.frame.placement))
    }
}
