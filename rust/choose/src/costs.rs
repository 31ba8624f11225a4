//! What the levels of a tree cost to draw: where a level is cheaper than the one before, and which of two chains is cheaper.
//!
//! Of trunks only thin branches count, because some clouds show them ([`crate::twigs`]) and others leave them to their trunks. Trunks are simplified
//! later, beside the levels: to about half beside leaves, and to as many triangles as a cloud has.

use std::collections::HashSet;

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::{LEAST_SAVING, Level};
use leafcloud::metrics::{DrawingCost, drawing_cost};
use leafcloud::{Foliage, Progress};

use crate::chain::Chosen;
use crate::scene::{HORIZON, Scene};
use crate::twigs::wood;

/// Diameter of the crown in pixels where a level takes over at the latest.
const LEAST_CROWN: f64 = 16.0;

/// Fragments that a level may draw over the leaves', for crowns of at least [`FEW_PIXELS`]. Triangles cost more than fragments in smaller ones.
const MOST_FRAGMENTS: f64 = 1.25;
const FEW_PIXELS: f64 = 100.0;

/// Chains are compared to the scene's horizon and to this multiple of it: levels of small crowns should be cheap, too.
const BEYOND: f64 = 4.0;

/// Fewest triangles of a simplified trunk.
const FEWEST_OF_TRUNKS: usize = 250;

/// The costs of a tree.
pub struct Costs<'a> {
    leaves: &'a Foliage,
    up: DVec3,
    /// Thin branches in the trunks beside leaves, and beside each cloud.
    of_leaves: Option<Foliage>,
    of_clouds: Vec<Option<Foliage>>,
}

impl<'a> Costs<'a> {
    /// `thin`: the triangles of the trunk's thin branches.
    ///
    /// # Errors
    /// Those of [`Foliage::part`].
    pub fn of(leaves: &'a Foliage, trunk: Option<&Foliage>, thin: &[u32], up: DVec3, chosen: &Chosen) -> Result<Self> {
        let of_cloud = |(number, level): (usize, &Level)| {
            let shown: HashSet<u32> = chosen.twigs.get(number).into_iter().flatten().copied().collect();
            let left: Vec<u32> = thin.iter().copied().filter(|triangle| !shown.contains(triangle)).collect();
            wood(trunk, &some(&left, level.atlas.triangles().max(FEWEST_OF_TRUNKS)))
        };
        let clouds = chosen.chain.levels.iter().filter(|level| !level.is_cross());
        Ok(Self {
            leaves,
            up,
            of_leaves: wood(trunk, &some(thin, thin.len().div_ceil(2)))?,
            of_clouds: clouds.enumerate().map(of_cloud).collect::<Result<_>>()?,
        })
    }

    /// Returns a level with its thin branches. `cloud`: its number among the clouds; `None` for leaves.
    pub fn with<'b>(&'b self, level: &'b Foliage, cloud: Option<usize>) -> Vec<&'b Foliage> {
        let branches = cloud.map_or(Some(&self.of_leaves), |cloud| self.of_clouds.get(cloud));
        std::iter::once(level).chain(branches.and_then(Option::as_ref)).collect()
    }

    /// Returns what parts cost where the crown is `size` pixels large.
    fn at(&self, parts: &[&Foliage], size: f64) -> Result<DrawingCost> {
        drawing_cost(parts, 0.5 * size / self.leaves.frame().radius, self.up, Progress::silent())
    }

    /// Returns the largest diameter of the crown in pixels, up to `crown`, at which a level is cheaper to draw than the level before it, and, where
    /// fragments cost most, draws at most [`MOST_FRAGMENTS`] times those of the tree's own leaves. Between two sizes the cost over the allowed one is
    /// taken as linear in the logarithm of the size.
    ///
    /// # Errors
    /// Those of [`drawing_cost`].
    pub fn cheaper_from(&self, crown: f64, level: &[&Foliage], before: &[&Foliage]) -> Result<f64> {
        let leaves = self.with(self.leaves, None);
        let (mut size, mut larger) = (crown, None);
        while size > LEAST_CROWN {
            let [own, before, leaves] = [level, before, &leaves].map(|parts| self.at(parts, size));
            let (own, before) = (own?, before?);
            let of_fragments =
                if size < FEW_PIXELS { 0.0 } else { own.fragments / (MOST_FRAGMENTS * leaves?.fragments) };
            let excess = f64::max(own.total() / ((1.0 - LEAST_SAVING) * before.total()), of_fragments);
            if excess <= 1.0 {
                let between =
                    |(above, over): (f64, f64)| size * libm::pow(above / size, (1.0 - excess) / (over - excess));
                return Ok(larger.map_or(size, between));
            }
            larger = Some((size, excess));
            size /= std::f64::consts::SQRT_2;
        }
        Ok(size.max(LEAST_CROWN.min(crown)))
    }

    /// Returns the mean of the logarithms of the costs of the scene and of one to [`BEYOND`] times its horizon. `leaves`: the levels of leaves, the
    /// tree's own first. `clouds`: as they are drawn.
    ///
    /// # Errors
    /// Those of [`drawing_cost`].
    pub fn of_scenes(&self, horizon: f64, leaves: &[&Foliage], clouds: &[Foliage], chosen: &Chosen) -> Result<f64> {
        let levels: Vec<&Foliage> = leaves.iter().copied().chain(clouds).collect();
        let cost = |size: f64| {
            let number =
                chosen.takes_over.iter().take_while(|passed| passed.crown >= size).count().min(levels.len() - 1);
            Ok(self.at(&self.with(levels[number], number.checked_sub(leaves.len())), size)?.total())
        };
        let horizons = [horizon, (BEYOND * horizon).min(HORIZON.high)];
        let [near, far] = horizons.map(|horizon| Scene::to(horizon)?.total(cost).map(libm::log));
        Ok(0.5 * (near? + far?))
    }
}

/// Returns at most `most` of the triangles, from all over the trunk.
fn some(triangles: &[u32], most: usize) -> Vec<u32> {
    triangles.iter().copied().step_by(triangles.len().div_ceil(most.max(1)).max(1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_triangles_are_from_all_over() {
        let all: Vec<u32> = (0..100).collect();
        assert_eq!(some(&all, 4), [0, 25, 50, 75]);
        assert_eq!(some(&all, 100), all);
        assert_eq!(some(&all[..3], 2), [0, 2]);
        assert!(some(&[], 5).is_empty() && some(&all, 0).len() == 1);
    }
}
