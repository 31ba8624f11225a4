//! Pruned foliage: the kept leaves, enlarged.

use glam::DVec3;

use super::{area_scale, leaf_scale};
use crate::error::Result;
use crate::foliage::{Foliage, area_vector};
use crate::transition::leaf_pivots;

/// Pruned foliage.
#[derive(Clone, Debug)]
pub struct Pruned {
    /// The kept leaves, enlarged.
    pub foliage: Foliage,
    /// The source triangle of each triangle of `foliage`.
    pub kept: Kept,
}

/// The triangles that pruning keeps.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Their indices in the full foliage, ascending.
    pub triangles: Vec<u32>,
    /// s·γ·r of each: linear scale against the original size, > 0.
    pub growth: Vec<f64>,
}

impl Kept {
    /// Returns the kept triangles of the full foliage, grown about the pivots of their leaves.
    ///
    /// # Errors
    /// No kept leaf has an area.
    ///
    /// # Panics
    /// If `foliage` lacks a kept triangle.
    pub fn of(&self, foliage: &Foliage) -> Result<Foliage> {
        let pivots = leaf_pivots(foliage);
        let grown = |(&t, &growth): (&u32, &f64)| {
            let pivot = pivots[foliage.leaf_ids()[t as usize] as usize];
            foliage.corners(t as usize).map(|p| pivot + (p - pivot) * growth)
        };
        let corners: Vec<[DVec3; 3]> = self.triangles.iter().zip(&self.growth).map(grown).collect();
        foliage.part(&self.triangles, &corners)
    }
}

/// Returns the leaves with a rank below `keep`, scaled about their pivots so that the covered area stays, times `growth` γ. O(t).
///
/// `ranks` has one entry per leaf. Leaves with a negative rank are protected and stay unchanged.
///
/// # Errors
/// No kept leaf has an area.
pub fn pruned(foliage: &Foliage, ranks: &[f32], keep: f64, growth: f64) -> Result<Pruned> {
    let scale = growth * area_scale(ranks.iter().map(|&rank| f64::from(rank)).zip(leaf_areas(foliage)), keep);
    let growth_of = |rank: f32| if rank < 0.0 { 1.0 } else { scale * leaf_scale(f64::from(rank), keep) };
    let of_leaf: Vec<f64> = ranks.iter().map(|&rank| growth_of(rank)).collect();
    let growth_at = |triangle: u32| of_leaf[foliage.leaf_ids()[triangle as usize] as usize];
    let triangles: Vec<u32> = (0..foliage.triangle_count() as u32).filter(|&t| growth_at(t) > 0.0).collect();
    let growth: Vec<f64> = triangles.iter().map(|&t| growth_at(t)).collect();
    let kept = Kept { triangles, growth };
    Ok(Pruned { foliage: kept.of(foliage)?, kept })
}

/// Returns the area of each leaf, local units.
fn leaf_areas(foliage: &Foliage) -> impl Iterator<Item = f64> + Clone {
    let mut areas = vec![0.0; foliage.leaf_count()];
    for (t, &leaf) in foliage.leaf_ids().iter().enumerate() {
        areas[leaf as usize] += area_vector(foliage.corners(t)).length();
    }
    areas.into_iter()
}
