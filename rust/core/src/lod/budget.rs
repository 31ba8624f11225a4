//! Triangles of the levels.
//!
//! A level needs few triangles: each costs a renderer its vertices, and on edges between two triangles fragments are shaded twice.

use super::settings::ChainSettings;
use crate::foliage::Foliage;

/// Most triangles of level 1 by default, trunk included.
const MOST: usize = 3000;

/// Triangles of level 1 by default, as a share of the tree's: leaves that are cut out of cards, and modelled ones, which cost
/// triangles more than fragments.
const SHARE: f64 = 0.15;
const SHARE_OF_MODELLED: f64 = 0.10;

/// Fewer triangles cost a renderer next to nothing.
const LEAST: usize = 500;

/// Divisor of the triangles from one level to the next, at most.
const STEP: usize = 3;

/// Largest share of level 1's triangles for the trunk.
const TRUNK_SHARE: f64 = 0.25;

/// Returns the budget of triangles for the leaves of level 1: the tree's, without the trunk's share; by default at most three quarters of the leaves'.
pub fn of_first(settings: &ChainSettings, leaves: &Foliage, trunk: Option<&Foliage>) -> usize {
    let trunk = trunk.map_or(0, Foliage::triangle_count);
    let all = settings.triangles.unwrap_or_else(|| {
        let share = if leaves.has_cutouts() { SHARE } else { SHARE_OF_MODELLED };
        let wished = (share * (leaves.triangle_count() + trunk) as f64) as usize;
        wished.clamp(LEAST, MOST).min(leaves.triangle_count() * 3 / 4)
    });
    all - trunk.min((TRUNK_SHARE * all as f64) as usize)
}

/// Returns the budget for the level after one that draws `finer` triangles.
pub fn of_next(finer: usize) -> usize {
    finer / STEP
}
