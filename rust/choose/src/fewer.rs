//! Fewer, larger leaves before the clouds.
//!
//! One leaf stands for each cluster of neighbors, and grows so that it covers as much of the picture as all of them
//! ([`leafcloud::prune::clusters`], after Cook, Halstead, Planck, Ryu, "Stochastic Simplification of Aggregate Detail", 2007). These leaves have
//! the textures of the tree's own, so they cost no memory, and they draw no empty pixels between leaves, as the clouds of sparse crowns do.
//!
//! Levels are three quarters of the leaves, a half, a quarter and so on. O(halvings · pictures). Known limit: single leaves show in the outline, so crowns of few broad leaves pass late.

use std::time::Instant;

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::foliage::Opacity;
use leafcloud::lod::{ChainSettings, prune_trends, report_of};
use leafcloud::metrics::{Reference, visibility};
use leafcloud::prune::{Cluster, Clusters, Kept, clusters};
use leafcloud::transition::leaf_pivots;
use leafcloud::{Foliage, Progress};
use leafcloud_simplify::SimplifiedLeaves;

use crate::last::LEAST_STEP;
use crate::leaves::{Form, LeafLevel};
use crate::wishes::Wishes;
use crate::yardstick::{Subject, UNJUDGED, Yardstick};

/// Directions from which leaves are looked at.
const VIEWS: usize = 16;

/// Fewest leaves that are pruned: without one of a few leaves, a tree looks different.
const FEWEST: usize = 200;

/// Pixels by which a leaf may be wider than the tree's own, in the mean: where leaves are seen one by one, twice as large ones look like another plant.
const MOST_WIDER: f64 = 4.0;

/// Largest share of the triangles that such a level may have.
const MOST_KEPT: f64 = 0.8;

/// Returns levels that were made from all leaves as they are drawn: corners move from the places that they have in the level before.
#[must_use]
pub fn one_after_another(mut levels: Vec<LeafLevel>) -> Vec<LeafLevel> {
    for number in (1..levels.len()).rev() {
        let Some(Kept { triangles, .. }) = levels[number - 1].kept.clone() else { continue };
        let LeafLevel { leaves, pivot_targets, .. } = &mut levels[number];
        leaves.targets = triangles.iter().map(|&t| leaves.targets[t as usize]).collect();
        *pivot_targets = triangles.iter().map(|&t| pivot_targets[t as usize]).collect();
    }
    levels
}

/// The tree's leaves, and the leaves from which fewer are taken.
pub struct Whole<'a> {
    /// The tree's own leaves.
    pub leaves: &'a Foliage,
    /// Simplified leaves, if they are level 1.
    pub simplified: Option<&'a LeafLevel>,
}

impl Whole<'_> {
    fn base(&self) -> &Foliage {
        self.simplified.map_or(self.leaves, |level| &level.leaves.foliage)
    }

    /// Returns levels of fewer leaves, finest first. Each is made from all leaves: [`one_after_another`] makes a chain of them.
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
        let (mut levels, base) = (Vec::new(), self.base());
        let most = self.simplified.map_or(wishes.largest_crown(), |level| level.passed.crown / LEAST_STEP);
        let may_be_leaves =
            wishes.free && wishes.form != Form::Billboards && settings.pruning.is_none() && wishes.sizes.is_empty();
        if !may_be_leaves || base.leaf_count() < FEWEST {
            return Ok(levels);
        }
        let samples = visibility(base, &Opacity::of(base), settings.up, VIEWS, progress)?;
        let seen: Vec<f64> = samples.iter().map(|leaf| leaf.seen).collect();
        let Clusters { three_quarters, halved } = clusters(base, &seen);
        let search = Search {
            whole: self,
            yardstick,
            q: wishes.q(),
            amounts: prune_trends::reference(base, settings.up)?,
            report: report_of(self.leaves, settings)?,
            progress,
        };
        for set in halved {
            let Some(level) = search.judged(set, levels.last().map_or(most, |last: &LeafLevel| last.passed.crown))?
            else {
                break;
            };
            levels.push(level);
        }
        // Where a half does not pass as near as it may, three quarters may.
        if levels.first().is_none_or(|half| half.passed.crown < most) {
            levels.splice(0..0, search.judged(three_quarters, most)?);
        }
        Ok(levels)
    }

    /// Returns the leaves with the places to which all corners and pivots move: onto the larger leaves, or, of leaves that are gone, into their pivots.
    fn moved(&self, foliage: Foliage, standing: &Standing) -> (SimplifiedLeaves, Vec<DVec3>) {
        let (base, tree, kept) = (self.base(), self.leaves.frame(), &standing.kept);
        let in_tree = |p: DVec3| tree.to_local(base.frame().to_caller(p));
        let pivots = leaf_pivots(base);
        let own_pivot = |t: usize| in_tree(pivots[base.leaf_ids()[t] as usize]);
        let mut pivot_targets: Vec<DVec3> = (0..base.triangle_count()).map(own_pivot).collect();
        let mut targets: Vec<[DVec3; 3]> = pivot_targets.iter().map(|&pivot| [pivot; 3]).collect();
        for ((&t, corners), &pivot) in kept.triangles.iter().zip(standing.corners(base, 1.0)).zip(&standing.places) {
            targets[t as usize] = corners.map(in_tree);
            pivot_targets[t as usize] = in_tree(pivot);
        }
        let places = kept.triangles.iter().map(|&t| targets[t as usize]).collect();
        let own =
            |t: u32| self.simplified.map_or([3 * t, 3 * t + 1, 3 * t + 2], |level| level.leaves.corners[t as usize]);
        let moves = |t: usize| base.corners(t).into_iter().zip(targets[t]).map(|(p, q)| in_tree(p).distance(q));
        let deviation = (0..targets.len()).flat_map(moves).fold(0.0, f64::max);
        let corners = kept.triangles.iter().map(|&t| own(t)).collect();
        (SimplifiedLeaves { foliage, corners, places, targets, deviation }, pivot_targets)
    }
}

/// What all levels of fewer leaves are compared with.
struct Search<'a> {
    whole: &'a Whole<'a>,
    yardstick: &'a Yardstick<'a>,
    /// Allowed FLIP over the control's.
    q: f64,
    /// All leaves, for the growth of those that stand for them.
    amounts: Reference,
    /// The tree's leaves in the report's views.
    report: Reference,
    progress: Progress<'a>,
}

impl Search<'_> {
    /// Returns a level of leaves that stand for clusters, with the largest crown up to `most` at which it passes; `None` if it
    /// passes nowhere or has too many triangles.
    fn judged(&self, set: Vec<Cluster>, most: f64) -> Result<Option<LeafLevel>> {
        let (started, base) = (Instant::now(), self.whole.base());
        let mut standing = Standing::of(base, set);
        // Protected leaves stay.
        if standing.kept.triangles.len() as f64 > MOST_KEPT * base.triangle_count() as f64 {
            return Ok(None);
        }
        let growth = prune_trends::growth_of(&self.amounts, self.progress, |growth| standing.foliage(base, growth))?;
        standing.grow(growth);
        let foliage = standing.foliage(base, 1.0)?;
        let most = most.min(2.0 * MOST_WIDER / standing.widening(base));
        let passed = self.yardstick.largest(Subject::Foliage(&foliage), self.q, most)?;
        if !passed.passes || passed.crown < UNJUDGED {
            return Ok(None);
        }
        let pictures = self.report.compare(&[&foliage])?;
        let (leaves, pivot_targets) = self.whole.moved(foliage, &standing);
        let pivots = standing.kept.triangles.iter().map(|&t| pivot_targets[t as usize]).collect();
        let seconds = started.elapsed().as_secs_f64();
        let kept = Some(standing.kept);
        Ok(Some(LeafLevel { leaves, passed, pictures, seconds, kept, pivots, pivot_targets }))
    }
}

/// The triangles of leaves that stand for clusters.
struct Standing {
    kept: Kept,
    /// For each triangle, the pivot of its leaf, and the place to which it moves.
    pivots: Vec<DVec3>,
    places: Vec<DVec3>,
}

impl Standing {
    fn of(base: &Foliage, mut clusters: Vec<Cluster>) -> Self {
        let (leaves, pivots) = (base.leaves(), leaf_pivots(base));
        let of_triangles = |cluster: Cluster| leaves.get(cluster.leaf).iter().map(move |&t| (t, cluster));
        clusters.sort_unstable_by_key(|cluster| cluster.leaf);
        let mut found: Vec<(u32, Cluster)> = clusters.into_iter().flat_map(of_triangles).collect();
        found.sort_by_key(|&(t, _)| t);
        Self {
            kept: Kept {
                triangles: found.iter().map(|&(t, _)| t).collect(),
                growth: found.iter().map(|(_, cluster)| cluster.growth).collect(),
            },
            pivots: found.iter().map(|(_, cluster)| pivots[cluster.leaf]).collect(),
            places: found.iter().map(|(_, cluster)| cluster.place).collect(),
        }
    }

    /// Returns the growth of each triangle, times `factor`. Leaves that stand for themselves stay as they are.
    fn growth(&self, factor: f64) -> impl Iterator<Item = f64> + '_ {
        self.kept.growth.iter().map(move |&growth| if growth > 1.0 { factor * growth } else { 1.0 })
    }

    fn corners<'a>(&'a self, base: &'a Foliage, factor: f64) -> impl Iterator<Item = [DVec3; 3]> + 'a {
        let places = self.pivots.iter().zip(&self.places);
        self.kept
            .triangles
            .iter()
            .zip(places)
            .zip(self.growth(factor))
            .map(|((&t, (&pivot, &place)), growth)| base.corners(t as usize).map(|p| place + (p - pivot) * growth))
    }

    fn foliage(&self, base: &Foliage, factor: f64) -> Result<Foliage> {
        base.part(&self.kept.triangles, &self.corners(base, factor).collect::<Vec<_>>())
    }

    /// Returns the mean growth of the leaves' widths, the roots of their areas, local units.
    fn widening(&self, base: &Foliage) -> f64 {
        let leaf = |t: u32| base.leaf_ids()[t as usize] as usize;
        let mut areas = vec![0.0; base.leaf_count()];
        for t in 0..base.triangle_count() as u32 {
            areas[leaf(t)] += base.area_vector(t as usize).length();
        }
        let kept = self.kept.triangles.iter().zip(&self.kept.growth);
        let sum: f64 = kept.map(|(&t, growth)| areas[leaf(t)].sqrt() * (growth - 1.0)).sum();
        sum / self.kept.triangles.len() as f64
    }

    fn grow(&mut self, factor: f64) {
        self.kept.growth = self.growth(factor).collect();
    }
}
