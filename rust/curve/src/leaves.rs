//! Simplified leaves as level 1, where they are worth it.
//!
//! Broad and curved leaves of several triangles are drawn with fewer ones long before billboards look like them. The best bound is the one
//! with which the tree is cheapest to draw at all distances, the leaves where they are nearer than the level may take over.

use std::time::Instant;

use leafcloud::error::Result;
use leafcloud::lod::{ChainSettings, LEAST_SAVING, Origin, report_pictures};
use leafcloud::metrics::Comparison;
use leafcloud::{Error, Foliage, Progress};
use leafcloud_flip::crown_pixels;
use leafcloud_simplify::{SimplifiedLeaves, simplified_leaves};

use crate::quality::{Scale, cost, costs, octave_of};

/// Bounds that are tried, in R, by about √2.
const BOUNDS: [f64; 6] = [0.004, 0.0056, 0.008, 0.011, 0.016, 0.022];

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

/// Level 1 as simplified leaves.
#[derive(Clone, Debug)]
pub struct LeafLevel {
    /// The leaves.
    pub leaves: SimplifiedLeaves,
    /// The cost of drawing them in the middle of each octave of sizes.
    pub(crate) costs: Vec<f64>,
    /// Pictures of the tree's own leaves and of these in the report's views.
    pub pictures: Comparison,
    /// Seconds for finding them.
    pub seconds: f64,
}

impl LeafLevel {
    /// Returns the origin of the levels after this one. `leaves`: the tree's own.
    #[must_use]
    pub fn origin<'a>(&'a self, leaves: &'a Foliage) -> Origin<'a> {
        Origin { leaves, finest: &self.leaves.foliage, deviation: self.leaves.deviation * leaves.frame().radius }
    }
}

/// Returns simplified leaves that may take over where their image error is `target`. `None` for billboards: with [`Form::Auto`] if simplified
/// leaves do not save a tenth of the cost of drawing the leaves, both where they take over and at all distances, or if leaves have too few triangles.
///
/// # Errors
/// No simpler leaves for [`Form::Leaves`]; a setting outside its range; [`Error::Cancelled`](leafcloud::Error::Cancelled).
pub fn leaf_level(
    target: f64,
    scale: &Scale,
    settings: &ChainSettings,
    form: Form,
    progress: Progress,
) -> Result<Option<LeafLevel>> {
    let Scale { leaves: foliage, costs: whole, .. } = scale;
    let are_cards = (foliage.triangle_count() as f64) < WORTH_A_TRY * foliage.leaf_count() as f64;
    if form == Form::Billboards || form == Form::Auto && are_cards {
        return Ok(None);
    }
    let started = Instant::now();
    let most = settings.triangles.unwrap_or(usize::MAX);
    let saving = if form == Form::Auto { LEAST_SAVING } else { 0.0 };
    let mut least = whole.iter().sum::<f64>() * (1.0 - saving);
    let mut best = None;
    for bound in BOUNDS {
        let Some(leaves) = simplified_leaves(foliage, bound, progress)? else { continue };
        let Some(size) = scale.largest_size(&leaves.foliage, target)? else { break };
        let own = costs(&leaves.foliage, settings)?;
        let found = cost(crown_pixels(size), whole, &own);
        let there = octave_of(crown_pixels(size));
        let is_worth_making = own[there] < (1.0 - saving) * whole[there];
        if is_worth_making && found < least && leaves.foliage.triangle_count() <= most {
            (least, best) = (found, Some((leaves, own)));
        } else if best.is_some() {
            break; // The cost has one minimum: coarser leaves take over later.
        }
    }
    let Some((leaves, costs)) = best else {
        return match form {
            Form::Leaves => Err(Error::invalid(format!(
                "form is \"leaves\", but no leaves with fewer triangles have an image error of {target:.3} or less; use \"auto\""
            ))),
            _ => Ok(None),
        };
    };
    let pictures = report_pictures(foliage, &leaves.foliage, settings)?;
    Ok(Some(LeafLevel { leaves, costs, pictures, seconds: started.elapsed().as_secs_f64() }))
}
