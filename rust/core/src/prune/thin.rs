//! What is left of foliage once it is pruned.

use glam::DVec3;

use super::{area_scale, leaf_scale};
use crate::error::Result;
use crate::foliage::{Foliage, area_vector};
use crate::transition::leaf_pivots;

/// Foliage with a share of its leaves, grown.
#[derive(Clone, Debug)]
pub struct Thinned {
    /// What is left.
    pub foliage: Foliage,
    /// Of what it is left, triangle by triangle.
    pub kept: Kept,
}

/// The triangles that pruning has left.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Their numbers in the whole foliage, ascending.
    pub triangles: Vec<u32>,
    /// s·γ·r of each: how much larger than at first, linearly; > 0.
    pub growth: Vec<f64>,
}

/// The leaves whose rank is below `keep`, grown about their pivots so that the covered area stays, times `growth` γ. O(t).
///
/// `ranks` has one entry a leaf; a negative one is that of a protected leaf, which stays as it is.
///
/// # Errors
/// No leaf is left, or none that has an area.
pub fn thin(foliage: &Foliage, ranks: &[f32], keep: f64, growth: f64) -> Result<Thinned> {
    let scale = growth * area_scale(ranks.iter().map(|&rank| f64::from(rank)).zip(leaf_areas(foliage)), keep);
    let growth_of = |rank: f32| if rank < 0.0 { 1.0 } else { scale * leaf_scale(f64::from(rank), keep) };
    let of_leaf: Vec<f64> = ranks.iter().map(|&rank| growth_of(rank)).collect();
    let growth_at = |triangle: u32| of_leaf[foliage.leaf_ids()[triangle as usize] as usize];
    let triangles: Vec<u32> = (0..foliage.triangle_count() as u32).filter(|&t| growth_at(t) > 0.0).collect();
    let growth: Vec<f64> = triangles.iter().map(|&t| growth_at(t)).collect();
    let pivots = leaf_pivots(foliage);
    let grown = |(&t, &growth): (&u32, &f64)| {
        let pivot = pivots[foliage.leaf_ids()[t as usize] as usize];
        foliage.corners(t as usize).map(|p| pivot + (p - pivot) * growth)
    };
    let corners: Vec<[DVec3; 3]> = triangles.iter().zip(&growth).map(grown).collect();
    Ok(Thinned { foliage: foliage.part(&triangles, &corners)?, kept: Kept { triangles, growth } })
}

/// The area of each leaf, local units.
fn leaf_areas(foliage: &Foliage) -> impl Iterator<Item = f64> + Clone {
    let mut areas = vec![0.0; foliage.leaf_count()];
    for (t, &leaf) in foliage.leaf_ids().iter().enumerate() {
        areas[leaf as usize] += area_vector(foliage.corners(t)).length();
    }
    areas.into_iter()
}
