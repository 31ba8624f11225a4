//! The billboards of a level as foliage, and their pruning order.

use glam::{DVec3, Vec2};

use crate::atlas::{Atlas, Billboard};
use crate::error::Result;
use crate::foliage::{Attributes, Foliage, Material};
use crate::geometry::Frame;
use crate::prune;

/// Returns each polygon of each billboard as a fan of triangles. A pair is one leaf.
///
/// # Errors
/// No billboard has an area.
pub fn billboards(atlas: &Atlas, frame: &Frame, material: Material) -> Result<Foliage> {
    let positions: Vec<DVec3> =
        atlas.billboards.iter().flat_map(|b| b.drawn_corners().map(|corner| frame.to_caller(corner))).collect();
    let mut triangles = Vec::with_capacity(atlas.triangles());
    let mut attributes = Attributes::default();
    let mut first = 0;
    for billboard in &atlas.billboards {
        let uvs: Vec<Vec2> = atlas.uvs(billboard).map(Vec2::from_array).collect();
        let mut own = 0;
        for polygon in &billboard.polygons {
            for second in own + 1..own + polygon.len() - 1 {
                let fan = [own, second, second + 1];
                triangles.push(fan.map(|i| (first + i) as u32));
                attributes.uvs.push(fan.map(|i| uvs[i]));
                attributes.leaf_ids.push(i64::from(billboard.plane));
            }
            own += polygon.len();
        }
        first += own;
    }
    Ok(Foliage::new(&positions, triangles, attributes, vec![material])?.at(frame.placement))
}

/// Returns the pruning ranks of billboards, by the same rule as for leaves.
pub(super) fn billboard_ranks(atlas: &Atlas, frame: &Frame, seed: u64) -> Result<Vec<f32>> {
    let shell = billboards(atlas, frame, Material::default())?;
    let by_leaf = prune::order(&shell, &[], seed);
    let mut triangle = 0;
    let rank = |billboard: &Billboard| {
        let leaf = shell.leaf_ids()[triangle];
        triangle += billboard.triangles();
        by_leaf[leaf as usize]
    };
    Ok(atlas.billboards.iter().map(rank).collect())
}
