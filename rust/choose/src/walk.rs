//! The cheapest walk through the levels of a tree, from the nearest tree of the scene to the horizon.
//!
//! Each level may be drawn up to the size at which it passes the yardstick. Levels of fewer leaves are optional: every choice of some of them is
//! tried. O(2^levels · rings).

use leafcloud::error::Result;

use crate::costs::Prices;
use crate::last::LEAST_STEP;
use crate::scene::{HORIZON, Scene};
use crate::yardstick::UNJUDGED;

/// Chains are compared to the scene's horizon and to this multiple of it: levels of small crowns should be cheap, too.
const BEYOND: f64 = 4.0;

/// Horizon in R to which prices are known, at least.
const FARTHEST: f64 = 300.0;

/// Factor by which a scene must get cheaper for a level that nearly looks like the leaves.
const LEAST_OF_NEARLY: f64 = 1.5;

/// A level that may be drawn.
pub struct Candidate<'a> {
    /// Largest diameter of the crown in pixels at which it may take over.
    pub largest: f64,
    /// Whether it looks like the leaves there.
    pub passes: bool,
    /// Diameter of the crown in pixels at which the settings want it.
    pub wished: Option<f64>,
    /// Its drawing cost in each ring of the scene.
    pub prices: &'a Prices,
}

/// The levels of a tree.
pub struct Levels<'a> {
    /// What the tree's own leaves cost.
    pub leaves: &'a Prices,
    /// Simplified leaves.
    pub simplified: Option<Candidate<'a>>,
    /// Fewer leaves, finest first.
    pub fewer: Vec<Candidate<'a>>,
    /// Clouds, finest first.
    pub clouds: Vec<Candidate<'a>>,
    /// Whether an impostor follows.
    pub impostor: bool,
}

/// A walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// The levels of fewer leaves that are drawn.
    pub fewer: Vec<usize>,
    /// Number of clouds that are drawn.
    pub clouds: usize,
    /// Diameter of the crown in pixels where each level takes over: simplified leaves, fewer leaves, clouds.
    pub crowns: Vec<f64>,
    /// Whether all of them look like the leaves.
    pub passes: bool,
    /// The mean of the logarithms of the costs of the scene and of [`BEYOND`] times its horizon.
    pub cost: f64,
}

impl Walk {
    /// Returns whether this walk is the better of two: the cheaper one, if both look like the leaves.
    #[must_use]
    pub fn is_better(&self, than: &Self) -> bool {
        let own = |walk: &Self| walk.cost + if walk.passes { 0.0 } else { libm::log(LEAST_OF_NEARLY) };
        own(self) < own(than)
    }
}

/// The scenes that are walked through.
pub struct Scenes {
    near: Scene,
    far: Scene,
    /// The scene for which levels need prices.
    pub priced: Scene,
}

impl Scenes {
    /// Returns the scenes for a horizon in R.
    ///
    /// # Errors
    /// A horizon outside its range.
    pub fn to(horizon: f64) -> Result<Self> {
        let beyond = (BEYOND * horizon).min(HORIZON.high);
        Ok(Self { near: Scene::to(horizon)?, far: Scene::to(beyond)?, priced: Scene::to(beyond.max(FARTHEST))? })
    }

    /// Returns the best walk. `most`: levels of fewer leaves and clouds, with fewer leaves. `least`: clouds.
    #[must_use]
    pub fn best(&self, levels: &Levels, most: usize, least: usize) -> Walk {
        let (count, all) = (levels.fewer.len(), levels.clouds.len());
        let sets =
            (0..1_u32 << count).map(|set| (0..count).filter(|number| set >> number & 1 == 1).collect::<Vec<_>>());
        let walks = sets.flat_map(|fewer| (least.min(all)..=all).map(move |clouds| (fewer.clone(), clouds)));
        let fits =
            |(fewer, clouds): &(Vec<usize>, usize)| fewer.is_empty() && *clouds == all || fewer.len() + clouds <= most;
        let walks = walks.filter(fits).filter_map(|(fewer, clouds)| self.walk(levels, fewer, clouds));
        // An impostor takes over at `UNJUDGED` at the latest: a cloud that begins just before is never seen.
        let begins = |walk: &Walk| walk.crowns.last().copied().unwrap_or(f64::INFINITY);
        let is_seen = |walk: &Walk| !levels.impostor || walk.clouds <= least || begins(walk) >= LEAST_STEP * UNJUDGED;
        let walks = walks.filter(is_seen);
        let none = Walk { fewer: Vec::new(), clouds: all, crowns: Vec::new(), passes: false, cost: f64::INFINITY };
        walks.reduce(|best, next| if next.is_better(&best) { next } else { best }).unwrap_or(none)
    }

    /// Returns the walk through these levels of fewer leaves and the first clouds; `None` if it would hardly draw a level of leaves.
    fn walk(&self, levels: &Levels, fewer: Vec<usize>, clouds: usize) -> Option<Walk> {
        let leaves = levels.simplified.iter().chain(fewer.iter().map(|&number| &levels.fewer[number]));
        let (mut crowns, mut most, mut before) = (Vec::new(), f64::INFINITY, levels.leaves);
        let mut drawn = vec![(f64::INFINITY, &levels.leaves.totals[..])];
        let leaf_levels = leaves.clone().count();
        let mut passes = true;
        for (number, level) in leaves.chain(&levels.clouds[..clouds]).enumerate() {
            let limit = level.largest.min(most);
            let cheaper = || level.prices.cheaper_from(limit, before, levels.leaves);
            let crown = level.wished.unwrap_or_else(|| if number < leaf_levels { limit } else { cheaper() });
            passes &= level.passes;
            crowns.push(crown);
            drawn.push((crown, &level.prices.totals[..]));
            (most, before) = (crown / LEAST_STEP, level.prices);
        }
        let is_drawn = |pair: &[f64]| pair[0] >= LEAST_STEP * pair[1] * 0.999;
        let of_leaves = (leaf_levels + 1).min(crowns.len());
        if !fewer.is_empty() && !crowns[..of_leaves].windows(2).all(is_drawn) {
            return None;
        }
        let cost = 0.5 * (libm::log(self.near.cost(&drawn)) + libm::log(self.far.cost(&drawn)));
        Some(Walk { fewer, clouds, crowns, passes, cost })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costs::tests::prices;

    fn candidate(largest: f64, prices: &Prices) -> Candidate<'_> {
        Candidate { largest, passes: true, wished: None, prices }
    }

    #[test]
    fn fewer_leaves_are_drawn_where_they_are_cheaper() {
        let [leaves, half, quarter, cloud] =
            [(2.0, 4000.0), (1.8, 2000.0), (1.6, 1000.0), (2.4, 100.0)].map(|(area, count)| prices(area, count));
        let levels = |at: f64| Levels {
            leaves: &leaves,
            simplified: None,
            fewer: vec![candidate(500.0, &half), candidate(200.0, &quarter)],
            clouds: vec![candidate(at, &cloud)],
            impostor: true,
        };
        let scenes = Scenes::to(50.0).unwrap();
        let late = scenes.best(&levels(60.0), 4, 1);
        assert_eq!((&late.fewer[..], &late.crowns[..]), (&[0, 1][..], &[500.0, 200.0, 60.0][..]));
        let one = scenes.best(&levels(60.0), 2, 1);
        assert_eq!((&one.fewer[..], one.clouds), (&[1][..], 1));
        assert!(one.cost > late.cost && one.cost < scenes.best(&levels(60.0), 1, 1).cost);
        // A cloud that takes over before they do leaves them no room.
        let early = scenes.best(&Levels { fewer: vec![candidate(70.0, &half)], ..levels(80.0) }, 4, 1);
        assert_eq!((early.fewer.len(), early.clouds), (0, 1));
    }

    #[test]
    fn a_cloud_that_nearly_passes_must_save_much() {
        let [leaves, half] = [(2.0, 4000.0), (1.0, 2000.0)].map(|(area, count)| prices(area, count));
        for (count, clouds) in [(1900.0, 0), (10.0, 1)] {
            let cloud = prices(1.0, count);
            let levels = Levels {
                leaves: &leaves,
                simplified: None,
                fewer: vec![candidate(500.0, &half)],
                clouds: vec![Candidate { passes: false, ..candidate(60.0, &cloud) }],
                impostor: true,
            };
            assert_eq!(Scenes::to(50.0).unwrap().best(&levels, 4, 0).clouds, clouds, "{count}");
        }
    }

    #[test]
    fn a_cloud_that_the_impostor_replaces_at_once_is_left_out() {
        let [leaves, first, second] =
            [(2.0, 4000.0), (2.0, 400.0), (2.0, 100.0)].map(|(area, count)| prices(area, count));
        for (at, impostor, clouds) in [(13.0, true, 1), (13.0, false, 2), (20.0, true, 2)] {
            let both = vec![candidate(100.0, &first), candidate(at, &second)];
            let levels = Levels { leaves: &leaves, simplified: None, fewer: Vec::new(), clouds: both, impostor };
            assert_eq!(Scenes::to(200.0).unwrap().best(&levels, 4, 1).clouds, clouds, "{at}");
        }
    }

    #[test]
    fn wished_sizes_are_kept() {
        let [leaves, cloud] = [prices(2.0, 4000.0), prices(9.0, 3000.0)];
        let cloud = Candidate { wished: Some(300.0), ..candidate(60.0, &cloud) };
        let levels =
            Levels { leaves: &leaves, simplified: None, fewer: Vec::new(), clouds: vec![cloud], impostor: true };
        assert_eq!(Scenes::to(50.0).unwrap().best(&levels, 4, 1).crowns, [300.0]);
    }
}
