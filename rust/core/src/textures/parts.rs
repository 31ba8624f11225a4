//! The trees on an atlas page, each with a cutoff of its own.

use super::halves::texels;
use crate::atlas::{Atlas, Billboard, Region};

/// Regions of an atlas page that are drawn at one cutoff: those of one tree.
#[derive(Clone, Debug)]
pub struct PagePart {
    /// Regions with their gutters.
    pub regions: Vec<Region>,
    /// Least alpha that is drawn, greater than 0.
    pub alpha_cutoff: f32,
    /// For each texel of the page the share that polygons cover.
    pub drawn: Vec<f32>,
}

impl PagePart {
    /// Returns the part with all regions of an atlas layout.
    #[must_use]
    pub fn of(atlas: &Atlas, alpha_cutoff: f32) -> Self {
        let regions = atlas.regions().map(|region| region.grown(atlas.gutter)).collect();
        Self { regions, alpha_cutoff, drawn: drawn_texels(atlas) }
    }
}

/// Returns 1 for each texel of the page with its center on a polygon, else 0.
fn drawn_texels(atlas: &Atlas) -> Vec<f32> {
    let mut drawn = vec![0.0; atlas.size.texels()];
    for billboard in &atlas.billboards {
        for texel in texels(billboard.region, atlas.size.width) {
            let at = [texel % atlas.size.width, texel / atlas.size.width];
            drawn[texel] = f32::from(u8::from(covers(billboard, at)));
        }
    }
    drawn
}

/// Returns whether a polygon of the billboard covers the center of a texel of its region.
fn covers(billboard: &Billboard, [column, row]: [usize; 2]) -> bool {
    let Region { x, y, width, height } = billboard.region;
    let across = ((column - x) as f64 + 0.5) / width as f64;
    let up = 1.0 - ((row - y) as f64 + 0.5) / height as f64;
    billboard.polygons.iter().any(|polygon| {
        let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
        let crossed =
            sides.filter(|(a, b)| (a.y > up) != (b.y > up) && across < a.x + (b.x - a.x) * (up - a.y) / (b.y - a.y));
        crossed.count() % 2 == 1
    })
}
