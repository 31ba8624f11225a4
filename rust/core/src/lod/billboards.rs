//! The billboards of a level as foliage, and their pruning order.

use glam::{DVec3, Vec2};

use crate::atlas::Atlas;
use crate::error::Result;
use crate::foliage::{Attributes, Foliage, Material};
use crate::geometry::Frame;
use crate::prune;

/// Returns a fan of triangles for each billboard. A pair is one leaf.
///
/// # Errors
/// No billboard has an area.
pub fn billboards(atlas: &Atlas, frame: &Frame, material: Material) -> Result<Foliage> {
    let positions: Vec<DVec3> =
        atlas.billboards.iter().flat_map(|b| b.outline_corners().map(|corner| frame.to_caller(corner))).collect();
    let corners = atlas.outline_corners();
    let mut triangles = Vec::with_capacity((corners - 2) * atlas.billboards.len());
    let mut attributes = Attributes::default();
    for (index, billboard) in (0u32..).zip(&atlas.billboards) {
        let uvs: Vec<Vec2> = atlas.uvs(billboard).map(Vec2::from_array).collect();
        for second in 1..corners - 1 {
            let fan = [0, second, second + 1];
            triangles.push(fan.map(|i| corners as u32 * index + i as u32));
            attributes.uvs.push(fan.map(|i| uvs[i]));
            attributes.leaf_ids.push(i64::from(billboard.plane));
        }
    }
    Ok(Foliage::new(&positions, triangles, attributes, vec![material])?.at(frame.placement))
}

/// Returns the pruning ranks of billboards, by the same rule as for leaves.
pub(super) fn billboard_ranks(atlas: &Atlas, frame: &Frame, seed: u64) -> Result<Vec<f32>> {
    let shell = billboards(atlas, frame, Material::default())?;
    let by_leaf = prune::order(&shell, &[], seed);
    let triangles = atlas.outline_corners() - 2;
    Ok(shell.leaf_ids().iter().step_by(triangles).map(|&leaf| by_leaf[leaf as usize]).collect())
}
