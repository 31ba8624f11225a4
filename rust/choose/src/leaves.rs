//! Simplified leaves as level 1, where they are worth it.
//!
//! Broad and curved leaves of several triangles are drawn with fewer ones long before billboards look like them. The best bound is the one
//! with which the scene is cheapest to draw, the leaves where they are nearer than the level may take over.

use std::time::Instant;

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::{ChainSettings, LEAST_SAVING, Origin, report_of};
use leafcloud::metrics::Comparison;
use leafcloud::prune::Kept;
use leafcloud::transition::leaf_pivots;
use leafcloud::{Error, Foliage, Progress};
use leafcloud_simplify::{SimplifiedLeaves, simplified_leaves};

use crate::costs::Prices;
use crate::wishes::Wishes;
use crate::yardstick::{Passed, Subject, Yardstick};

/// Bounds that are tried, in R, by about 2.
const BOUNDS: [f64; 3] = [0.005, 0.01, 0.02];

/// Mean number of triangles of a leaf from which simpler leaves are looked for: cards have two.
const WORTH_A_TRY: f64 = 2.5;

/// Which form level 1 may have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// Simplified leaves where they make the tree cheaper to draw, else billboards.
    #[default]
    Auto,
    /// Billboards.
    Billboards,
    /// Simplified leaves, however little they save.
    Leaves,
}

/// A level of leaves: simplified ones, or fewer and larger ones.
#[derive(Clone, Debug)]
pub struct LeafLevel {
    /// The leaves. Their targets are for the corners of the level before.
    pub leaves: SimplifiedLeaves,
    /// Where they may take over.
    pub passed: Passed,
    /// Pictures of the tree's own leaves and of these in the report's views.
    pub pictures: Comparison,
    /// Seconds for finding them.
    pub seconds: f64,
    /// The triangles of the simplified leaves, or of the tree's own without these, that fewer leaves keep; `None` for simplified leaves.
    pub kept: Option<Kept>,
    /// For each triangle of the level, the pivot of its leaf, local frame of the tree.
    pub pivots: Vec<DVec3>,
    /// For each target, the place of the leaf's pivot there.
    pub pivot_targets: Vec<DVec3>,
}

impl LeafLevel {
    /// Returns the origin of the levels after this one. `leaves`: the tree's own.
    #[must_use]
    pub fn origin<'a>(&'a self, leaves: &'a Foliage) -> Origin<'a> {
        Origin {
            finest: &self.leaves.foliage,
            deviation: self.leaves.deviation * leaves.frame().radius,
            ..Origin::of(leaves)
        }
    }
}

/// Returns simplified leaves that pass the yardstick. `None` for billboards: with [`Form::Auto`] if simplified leaves do not save a tenth of the
/// cost of the scene, or if leaves have too few triangles.
///
/// # Errors
/// No simpler leaves for [`Form::Leaves`]; a setting outside its range; [`Error::Cancelled`](leafcloud::Error::Cancelled).
pub fn leaf_level(
    foliage: &Foliage,
    wishes: &Wishes,
    yardstick: &Yardstick,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Option<LeafLevel>> {
    // Levels at wished sizes are clouds.
    let form = if wishes.sizes.is_empty() { wishes.form } else { Form::Billboards };
    let q = wishes.q();
    let are_cards = (foliage.triangle_count() as f64) < WORTH_A_TRY * foliage.leaf_count() as f64;
    if form == Form::Billboards || form == Form::Auto && are_cards {
        return Ok(None);
    }
    let (started, scene) = (Instant::now(), wishes.scene()?);
    let radius = foliage.frame().radius;
    let whole = Prices::of(&[foliage], radius, settings.up, &scene)?;
    let most = settings.triangles.unwrap_or(usize::MAX);
    let saving = if form == Form::Auto { LEAST_SAVING } else { 0.0 };
    let mut least = scene.cost(&[(f64::INFINITY, &whole.totals)]) * (1.0 - saving);
    let mut best = None;
    for bound in BOUNDS {
        let Some(leaves) = simplified_leaves(foliage, bound, progress)? else { continue };
        progress.tell("simplify", 0.0)?;
        let passed = yardstick.largest(Subject::Foliage(&leaves.foliage), q, wishes.largest_crown())?;
        if !passed.passes {
            break;
        }
        progress.tell("simplify", 0.0)?;
        let own = Prices::of(&[&leaves.foliage], radius, settings.up, &scene)?;
        let found = scene.cost(&[(f64::INFINITY, &whole.totals), (passed.crown, &own.totals)]);
        if found < least && leaves.foliage.triangle_count() <= most {
            (least, best) = (found, Some((leaves, passed)));
        } else if best.is_some() {
            break; // The cost has one minimum: coarser leaves take over later.
        }
    }
    let Some((leaves, passed)) = best else {
        return match form {
            Form::Leaves => Err(Error::invalid(
                "form is \"leaves\", but no leaves with fewer triangles look like the tree's at any size; use \"auto\"",
            )),
            _ => Ok(None),
        };
    };
    let pictures = report_of(foliage, settings)?.compare(&[&leaves.foliage])?;
    let (pivots, seconds) = (leaf_pivots(foliage), started.elapsed().as_secs_f64());
    let of_leaves = |ids: &[u32]| ids.iter().map(|&leaf| pivots[leaf as usize]).collect();
    let (pivot_targets, pivots) = (of_leaves(foliage.leaf_ids()), of_leaves(leaves.foliage.leaf_ids()));
    Ok(Some(LeafLevel { leaves, passed, pictures, seconds, kept: None, pivots, pivot_targets }))
}
