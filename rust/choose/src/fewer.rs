//! Fewer, larger leaves, where the first cloud takes over late.
//!
//! A share of the leaves in the order of pruning, enlarged so that they cover as much (Cook, Halstead, Planck, Ryu, "Stochastic
//! Simplification of Aggregate Detail", 2007). They have the textures of the tree's own leaves, so they cost no memory. Needles, which no cloud
//! shows well near by, need half of the leaves at a quarter of the picture's height.
//!
//! O(shares · pictures). Known limit: the order is random, so gaps between few large leaves show.

use std::time::Instant;

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::{Chain, ChainSettings, prune_trends, report_pictures};
use leafcloud::prune::{Kept, Pruned, pruned};
use leafcloud::transition::leaf_pivots;
use leafcloud::{Foliage, Progress};
use leafcloud_simplify::SimplifiedLeaves;

use crate::last::LEAST_STEP;
use crate::leaves::{Form, LeafLevel};
use crate::wishes::Wishes;
use crate::yardstick::{Subject, UNJUDGED, Yardstick};

/// Shares of leaves that are tried. A quarter are twice as large, and larger ones look like other leaves.
const SHARES: [f64; 2] = [0.5, 0.25];

/// Fewest leaves that are pruned: without one of a few leaves, a tree looks different.
const FEWEST: usize = 200;

/// Largest share of the triangles that such a level may have.
const MOST_KEPT: f64 = 0.75;

/// Least ratio of the size at which such a level takes over to that of the first cloud.
const LEAST_BAND: f64 = 1.5;

/// Returns the levels that are drawn one after another until the crown is `until` pixels large, where the first cloud takes over.
#[must_use]
pub fn in_turn(found: &[LeafLevel], until: f64) -> Vec<LeafLevel> {
    let mut levels: Vec<LeafLevel> = Vec::new();
    for level in found.iter().take_while(|level| level.passed.crown >= LEAST_BAND * until) {
        // A level that passes at the size of the one before takes its place.
        levels.pop_if(|finer| finer.passed.crown < LEAST_STEP * level.passed.crown);
        levels.push(level.clone());
    }
    // Corners move from the places that they have in the level before.
    for number in (1..levels.len()).rev() {
        let Some(Kept { triangles, .. }) = levels[number - 1].kept.clone() else { continue };
        let all = &levels[number].leaves.targets;
        levels[number].leaves.targets = triangles.iter().map(|&t| all[t as usize]).collect();
    }
    levels
}

/// The tree's leaves, and the leaves from which fewer are taken.
pub struct Whole<'a> {
    /// The tree's own leaves.
    pub leaves: &'a Foliage,
    /// Simplified leaves, if they are level 1.
    pub simplified: Option<&'a LeafLevel>,
    /// The levels after them.
    pub chain: &'a Chain,
}

impl Whole<'_> {
    fn base(&self) -> &Foliage {
        self.simplified.map_or(self.leaves, |level| &level.leaves.foliage)
    }

    /// Returns levels of fewer leaves, finest first. Each is made from all leaves: [`in_turn`] makes a chain of them.
    ///
    /// # Errors
    /// Those of a render; [`Error::Cancelled`](leafcloud::Error::Cancelled).
    pub fn fewer(
        &self,
        wishes: &Wishes,
        yardstick: &Yardstick,
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Vec<LeafLevel>> {
        let mut levels = Vec::new();
        let most = self.simplified.map_or(wishes.largest_crown(), |level| level.passed.crown / LEAST_STEP);
        let least = LEAST_BAND * UNJUDGED;
        let may_be_leaves =
            wishes.free && wishes.form != Form::Billboards && settings.pruning.is_none() && wishes.sizes.is_empty();
        if !may_be_leaves || self.base().leaf_count() < FEWEST || most < least {
            return Ok(levels);
        }
        for share in SHARES {
            let started = Instant::now();
            let Pruned { foliage, kept } = self.pruned(share, settings, progress)?;
            // Protected leaves stay.
            if (kept.triangles.len() as f64) > MOST_KEPT * self.base().triangle_count() as f64 {
                break;
            }
            let passed = yardstick.largest(Subject::Foliage(&foliage), wishes.q(), most)?;
            if !passed.passes || passed.crown < least {
                break;
            }
            let pictures = report_pictures(self.leaves, &foliage, settings)?;
            let leaves = self.moved(foliage, &kept);
            levels.push(LeafLevel {
                leaves,
                passed,
                pictures,
                seconds: started.elapsed().as_secs_f64(),
                kept: Some(kept),
            });
        }
        Ok(levels)
    }

    /// Returns a share of the leaves, which cover as much as all.
    fn pruned(&self, share: f64, settings: &ChainSettings, progress: Progress) -> Result<Pruned> {
        let (base, ranks) = (self.base(), &self.chain.ranks);
        let growth = prune_trends::growth_of(base, ranks, share, settings.up, progress)?;
        pruned(base, ranks, share, growth)
    }

    /// Returns the leaves with the places to which all corners move: onto the larger leaves, or into the pivots of those that are gone.
    fn moved(&self, foliage: Foliage, kept: &Kept) -> SimplifiedLeaves {
        let (base, tree) = (self.base(), self.leaves.frame());
        let in_tree = |p: DVec3| tree.to_local(base.frame().to_caller(p));
        let pivots = leaf_pivots(base);
        let pivot = |t: usize| pivots[base.leaf_ids()[t] as usize];
        let mut targets: Vec<[DVec3; 3]> = (0..base.triangle_count()).map(|t| [in_tree(pivot(t)); 3]).collect();
        for (&t, &growth) in kept.triangles.iter().zip(&kept.growth) {
            let (t, pivot) = (t as usize, pivot(t as usize));
            targets[t] = base.corners(t).map(|p| in_tree(pivot + (p - pivot) * growth));
        }
        let places = kept.triangles.iter().map(|&t| targets[t as usize]).collect();
        let own =
            |t: u32| self.simplified.map_or([3 * t, 3 * t + 1, 3 * t + 2], |level| level.leaves.corners[t as usize]);
        let moves = |t: usize| base.corners(t).into_iter().zip(targets[t]).map(|(p, q)| in_tree(p).distance(q));
        let deviation = (0..targets.len()).flat_map(moves).fold(0.0, f64::max);
        let corners = kept.triangles.iter().map(|&t| own(t)).collect();
        SimplifiedLeaves { foliage, corners, places, targets, deviation }
    }
}
