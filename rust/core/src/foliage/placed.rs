//! Foliage that comes in the tree's own coordinates.

use glam::DVec3;

use super::{Attributes, Foliage, Material};
use crate::error::Result;
use crate::geometry::{Frame, Placement};

impl Foliage {
    /// Moves triangles from the tree's coordinates to the world, then checks them as [`Self::new`] does.
    ///
    /// # Errors
    /// As [`Self::new`]; messages give positions in the world.
    pub fn placed(
        placement: Placement,
        positions: &[DVec3],
        triangles: Vec<[u32; 3]>,
        attributes: Attributes,
        materials: Vec<Material>,
    ) -> Result<Self> {
        let positions: Vec<DVec3> = positions.iter().map(|&p| placement.to_world(p)).collect();
        let triangles = wound(triangles, &placement);
        Ok(Self::new(&positions, triangles, attributes.placed(&placement), materials)?.at(placement))
    }

    /// Returns the same foliage as part of a tree with this placement.
    pub(crate) fn at(self, placement: Placement) -> Self {
        Self { frame: Frame { placement, ..self.frame }, ..self }
    }
}

impl Attributes {
    fn placed(self, placement: &Placement) -> Self {
        let to_world = |corners: [_; 3]| corners.map(|normal| placement.normal_to_world(normal));
        Self {
            uvs: wound(self.uvs, placement),
            normals: wound(self.normals, placement).into_iter().map(to_world).collect(),
            colors: wound(self.colors, placement),
            back_colors: wound(self.back_colors, placement),
            ..self
        }
    }
}

fn wound<T>(triangles: Vec<[T; 3]>, placement: &Placement) -> Vec<[T; 3]> {
    triangles.into_iter().map(|corners| placement.wound(corners)).collect()
}
