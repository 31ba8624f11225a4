//! Levels of detail. Level 1 is a billboard cloud of the leaves, each further level a coarser cloud of the billboards before it.
//! The last level is the cross impostor.

mod billboards;
mod budget;
mod clouds;
mod cross;
mod cut;
mod draft;
mod drawn;
mod hidden;
mod level;
mod measured;
mod mips;
pub mod octahedral;
pub mod prune_trends;
mod references;
pub mod refine;
mod settings;
mod shared;
mod size;
mod tight;
mod tune;
mod twigs;
mod worth;

pub use billboards::billboards;
pub use budget::STEP_IN_SCENES;
pub use clouds::Clouds;
pub use draft::{Draft, Drafts, settled_fit};
pub use level::{Level, Seconds};
pub use measured::{Measured, MeasuringSeconds};
pub use octahedral::Octahedral;
pub use references::{References, report_of};
pub use refine::{Refined, RefinedParts, Refinement};
pub use settings::{ChainSettings, CloudStep, EPSILON_STEP, PruneSettings, ViewCounts};
pub use shared::share_page;
pub use size::is_published;
pub use worth::{LEAST_SAVING, LeftOut};

use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::foliage::Foliage;
use crate::progress::Progress;
use crate::prune::{Kept, Trend};

/// All levels after the leaves, finest first.
#[derive(Clone, Debug)]
pub struct Chain {
    /// The billboard clouds, then the cross impostor.
    pub levels: Vec<Level>,
    /// The levels that were not made, because they save too little of the cost of drawing the level before.
    pub left_out: Vec<LeftOut>,
    /// Each leaf's rank in the pruning order, see [`prune::order`].
    pub ranks: Vec<f32>,
    /// The pivot of each triangle's leaf, in the tree's own coordinates.
    pub pivots: Vec<DVec3>,
    /// γ: growth of pruned leaves beyond the growth that keeps their area.
    pub growth: Trend,
    /// κ: factor on the distance of pruned leaves' colors from their mean.
    pub contrast: Trend,
    /// For each cloud, how many sets of thin branches it shows, see [`Clouds::new`].
    pub twigs: Vec<usize>,
    /// The triangles of [`Origin::finest`] that level 1 is built from, without pruned and hidden leaves; `None` for all triangles, unchanged.
    pub kept: Option<Kept>,
    /// The renderings of all leaves and the trunk that the cross impostor is compared with; `None` without one, or if leaves are pruned.
    pub whole: Option<Arc<References>>,
    /// Seconds of the measurements for optional effects.
    pub measuring_seconds: MeasuringSeconds,
    /// Seconds before the first level: pruning order, reference renderings of the leaves, sky visibility.
    pub prepare_seconds: f64,
}

/// The leaves of a chain.
#[derive(Clone, Copy)]
pub struct Origin<'a> {
    /// The leaves that the levels are compared with.
    pub leaves: &'a Foliage,
    /// The leaves that the first level is built from: the same, or simplified ones with the same leaf numbers.
    pub finest: &'a Foliage,
    /// Deviation of `finest` from `leaves`, caller's units.
    pub deviation: f64,
}

impl<'a> Origin<'a> {
    /// Returns the origin of a chain that is built from the leaves themselves.
    #[must_use]
    pub fn of(leaves: &'a Foliage) -> Self {
        Self { leaves, finest: leaves, deviation: 0.0 }
    }
}

/// Fits, packs, bakes and measures every level. `trunk` (trunk and branches) appears in the cross impostor only.
///
/// # Errors
/// Those of [`Measured::of`], [`Clouds::add`] and [`Clouds::with_cross`].
pub fn build_chain(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Chain> {
    let measured = Measured::of(Origin::of(foliage), trunk, settings, progress.part(0.0, 0.0))?;
    let mut clouds = Clouds::new(&measured, settings.clone(), Vec::new())?;
    while clouds.add(progress)?.is_some() {}
    clouds.with_cross(clouds.chain(), progress)
}

#[cfg(test)]
mod tests;
