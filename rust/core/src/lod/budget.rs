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

/// The same in a scene: where level 1 takes over near the viewer, its fragments cost more than its triangles, and small billboards save fragments.
const MOST_IN_SCENES: usize = 4000;
const SHARE_IN_SCENES: f64 = 0.2;

/// Least factor from the first budget to the second.
const WORTH_A_TRY: f64 = 1.25;

/// Fewer triangles cost a renderer next to nothing.
const LEAST: usize = 500;

/// Divisor of the triangles from one level to the next, at most.
const STEP: usize = 3;
/// The same in a scene.
pub const STEP_IN_SCENES: usize = 4;

/// Largest share of level 1's triangles for the trunk.
const TRUNK_SHARE: f64 = 0.25;

/// Returns the budgets to try for a level. `finer`: triangles that the level before draws; `None` for level 1.
pub fn of(settings: &ChainSettings, finer: Option<usize>, leaves: &Foliage, trunk: Option<&Foliage>) -> Vec<usize> {
    finer.map_or_else(|| of_first(settings, leaves, trunk), |finer| vec![of_next(settings, finer)])
}

/// Returns budgets of triangles for the leaves of level 1: the usual share, and the most that a level may have, if the level is not worth
/// making with its share. A small tree's level 1 may be cheaper with more. Each is the tree's budget without the trunk's share. A wish is the
/// only one. `leaves`: the tree's own.
fn of_first(settings: &ChainSettings, leaves: &Foliage, trunk: Option<&Foliage>) -> Vec<usize> {
    let trunk = trunk.map_or(0, Foliage::triangle_count);
    let without_trunk = |all: usize| all - trunk.min((TRUNK_SHARE * all as f64) as usize);
    if let Some(wish) = settings.triangles {
        return vec![without_trunk(wish)];
    }
    let (share, most) = match (settings.steps.is_empty(), leaves.has_cutouts()) {
        (false, _) => (SHARE_IN_SCENES, MOST_IN_SCENES),
        (true, true) => (SHARE, MOST),
        (true, false) => (SHARE_OF_MODELLED, MOST),
    };
    let of_size = settings.steps.first().map_or(1.0, |step| step.share);
    let scaled = |count: usize| (of_size * count as f64) as usize;
    let wished = scaled((share * (leaves.triangle_count() + trunk) as f64) as usize);
    let most = scaled(most).min(leaves.triangle_count() * 3 / 4);
    let first = wished.max(scaled(LEAST)).min(most);
    let larger = (WORTH_A_TRY * (first as f64) < most as f64).then_some(most);
    std::iter::once(first).chain(larger).map(without_trunk).collect()
}

/// Returns the budget for the level after one that draws `finer` triangles.
fn of_next(settings: &ChainSettings, finer: usize) -> usize {
    finer / if settings.steps.is_empty() { STEP } else { STEP_IN_SCENES }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::foliage::Attributes;

    fn triangles(count: usize) -> Foliage {
        let positions: Vec<DVec3> =
            (0..count).flat_map(|i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p + i as f64 * DVec3::Z)).collect();
        let triangles = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
    }

    fn budgets(wish: Option<usize>, leaves: usize, trunk: usize) -> Vec<usize> {
        let settings = ChainSettings { triangles: wish, ..ChainSettings::default() };
        let trunk = (trunk > 0).then(|| triangles(trunk));
        of_first(&settings, &triangles(leaves), trunk.as_ref())
    }

    #[test]
    fn the_second_budget_is_three_quarters_of_the_leaves() {
        assert_eq!(budgets(None, 1344, 0), [500, 1008]);
        assert_eq!(budgets(None, 800, 0), [500], "600 is hardly more");
        assert_eq!(budgets(None, 10_000, 0), [1000, 3000]);
        assert_eq!(budgets(None, 40_000, 0), [3000]);
        assert_eq!(budgets(None, 12, 0), [9]);
        assert_eq!(budgets(None, 1, 0), [0]);
    }

    #[test]
    fn a_wish_is_the_only_budget_and_the_trunk_takes_its_share() {
        assert_eq!(budgets(Some(400), 2000, 0), [400]);
        assert_eq!(budgets(Some(400), 2000, 30), [370]);
        assert_eq!(budgets(Some(400), 2000, 900), [300], "a quarter");
    }
}
