//! Levels of detail. Level 1 is a billboard cloud of the leaves, each further level a coarser cloud of the billboards before it.
//! The last level is the cross impostor.

mod billboards;
mod budget;
mod cross;
mod cut;
mod draft;
mod drawn;
mod hidden;
mod level;
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
pub use draft::{Draft, Drafts, settled_fit};
pub use level::{Level, Seconds};
pub use octahedral::Octahedral;
pub use references::{References, report_of};
pub use refine::{Refined, RefinedParts, Refinement};
pub use settings::{ChainSettings, CloudStep, EPSILON_STEP, PruneSettings, ViewCounts};
pub use shared::share_page;
pub use size::is_published;
pub use worth::{LEAST_SAVING, LeftOut};

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use self::twigs::Twigs;
use self::worth::{Before, Made};
use crate::error::{Error, Result};
use crate::fit::FitSettings;
use crate::foliage::{Foliage, Opacity};
use crate::geometry::Frame;
use crate::metrics::{LeafSamples, visibility};
use crate::progress::Progress;
use crate::prune::{self, Kept, Pruned, Trend};
use crate::textures::{Channels, Sky};
use crate::transition::leaf_pivots;

/// Seconds of the measurements before the first level; 0 for steps that were not requested.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeasuringSeconds {
    /// Measuring the visible share of each leaf, for the pruning order.
    pub order: f64,
    /// Finding the leaves that the crown hides.
    pub hidden: f64,
    /// Measuring sky visibility.
    pub sky: f64,
    /// Measuring the growth of pruned leaves.
    pub growth: f64,
    /// Measuring the contrast of pruned leaves.
    pub contrast: f64,
}

/// Returns the result of `work` and writes its duration into `seconds`.
fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = work();
    *seconds = started.elapsed().as_secs_f64();
    result
}

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
    /// For each cloud, how many of [`Origin::twigs`] it shows.
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

/// Tells from the first cloud that is made, its number among those that the settings ask for, and how many of [`Origin::twigs`] it shows, whether
/// further clouds are wanted.
pub type GoesOn<'a> = dyn Fn(&Level, usize, usize) -> Result<bool> + 'a;

/// The leaves of a chain.
#[derive(Clone, Copy)]
pub struct Origin<'a> {
    /// The leaves that the levels are compared with.
    pub leaves: &'a Foliage,
    /// The leaves that the first level is built from: the same, or simplified ones with the same leaf numbers.
    pub finest: &'a Foliage,
    /// Deviation of `finest` from `leaves`, caller's units.
    pub deviation: f64,
    /// Thin branches that clouds show beside the leaves: those of the first cloud, those that the second shows in addition, and so on. Within the
    /// frame of the leaves.
    pub twigs: &'a [Option<Foliage>],
    /// [`Chain::whole`] of another chain of the same leaves, trunk and views.
    pub whole: Option<&'a Arc<References>>,
    /// Without it, all clouds are built.
    pub goes_on: Option<&'a GoesOn<'a>>,
}

impl<'a> Origin<'a> {
    /// Returns the origin of a chain that is built from the leaves themselves.
    #[must_use]
    pub fn of(leaves: &'a Foliage) -> Self {
        Self { leaves, finest: leaves, deviation: 0.0, twigs: &[], whole: None, goes_on: None }
    }
}

/// Fits, packs, bakes and measures every level. `trunk` (trunk and branches) appears in the cross impostor only.
///
/// # Errors
/// A setting outside its range; fully transparent leaves; an atlas page without visible texels; a trunk that reaches too far from the
/// leaves; more billboards than the atlas page holds; [`Error::Cancelled`].
pub fn build_chain(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Chain> {
    build_chain_of(Origin::of(foliage), trunk, settings, progress)
}

/// As [`build_chain`], with leaves that may be simplified already.
///
/// # Errors
/// As [`build_chain`].
pub fn build_chain_of(
    origin: Origin,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Chain> {
    settings.check()?;
    let started = Instant::now();
    let Origin { leaves: whole, finest: foliage, deviation, twigs, whole: known, goes_on } = origin;
    let frame = *whole.frame();
    trunk.map_or(Ok(()), |trunk| check_trunk(trunk.frame(), &frame))?;
    let mut seconds = MeasuringSeconds::default();
    // The measurements stay at the fraction 0; they report to be cancelled.
    let measuring = progress.part(0.0, 0.0);
    let order = order(foliage, settings, &mut seconds, measuring)?;
    let pivots = pivots(whole);
    let keep = settings.pruning.map(|pruning| pruning.keep).filter(|keep| *keep < 1.0);
    let pruned = fewer(foliage, keep, &order, settings, &mut seconds, measuring)?;
    let (foliage, kept) = match &pruned {
        Some(Pruned { foliage, kept }) => (foliage, Some(kept.clone())),
        None => (foliage, None),
    };
    // Leaves that are hidden are still seen a little and shade the others; pruned ones are gone.
    let shown = if keep.is_some() { foliage } else { whole };
    measuring.tell("measure", 0.0)?;
    let channels = settings.channels.completed();
    let trunk = trunk.map(Foliage::without_labels);
    let parts: Vec<&Foliage> = std::iter::once(shown).chain(&trunk).collect();
    measuring.tell("measure", 0.0)?;
    let sky = channels.need_sky().then(|| timed(&mut seconds.sky, || Sky::over(&parts, &frame)));
    let prepare_seconds = started.elapsed().as_secs_f64();
    let count = settings.levels + usize::from(settings.cross);
    let share = |index: usize| part_of_level(progress, index, count);
    let mut made = Made::default();
    // ε grows from candidate to candidate, whether they are made or not.
    let mut epsilon = None;
    let (mut twigs, mut shown_twigs) = (Twigs::new(twigs), Vec::new());
    for index in 0..settings.levels {
        let before = made.levels.last().map(Level::foliage).transpose()?;
        let finer = before.as_ref().unwrap_or(foliage);
        let (of_leaves, own_triangles) = (before.is_none(), finer.triangle_count());
        twigs.add(index);
        let with_twigs = twigs.with(finer);
        let (all, references) = twigs.compared(shown, whole, settings)?;
        let finer = with_twigs.as_ref().unwrap_or(finer);
        let fit = settings.fit_of(index, epsilon);
        let whole_leaves = if of_leaves { settings.fit.whole_leaves } else { fit.whole_leaves };
        let fit = FitSettings { whole_leaves, ..fit };
        let opacity = fit.opacity(finer);
        if index == 0 {
            let of_leaves = with_twigs.is_some().then(|| fit.opacity(foliage));
            check_visible(of_leaves.as_ref().unwrap_or(&opacity))?;
        }
        let mut step = level::Step {
            finer,
            leaves: all.as_ref().unwrap_or(shown),
            opacity,
            radius: frame.radius,
            index,
            fit,
            triangles: 0,
            is_wish: index == 0 && settings.triangles.is_some(),
            deviation: made.levels.last().map_or(deviation, |l| l.max_deviation_leaves),
            page: settings.page(index),
            channels: if of_leaves { channels } else { channels.of_billboards() },
            sky: sky.as_ref(),
            references,
        };
        let drawn = made.levels.last().map(|finer| finer.atlas.triangles());
        let budgets = budget::of(settings, drawn, whole, trunk.as_ref());
        let found = 1.0 - settings.refine.share();
        let candidates = budgets.iter().enumerate().map(|(i, &triangles)| {
            step.triangles = triangles;
            let done = |tries: usize| found * tries as f64 / budgets.len() as f64;
            level::build(&step, settings, share(index).part(done(i), done(i + 1)))
        });
        let before = Before { leaves: finer, trunk: trunk.as_ref() };
        let finer_levels = made.levels.len();
        epsilon = made.add(candidates, &before, index + 1 == count, settings, share(index).part(found, found))?;
        if made.levels.len() > finer_levels {
            made.refine_last(|level| refine::refined(level, &step, settings, share(index).part(found, 1.0)))?;
            shown_twigs.push(twigs.shown(index));
            made.levels[finer_levels].keep_own(own_triangles);
            let asked = goes_on.filter(|_| finer_levels == 0 && index + 1 < settings.levels);
            if !asked.map_or(Ok(true), |goes_on| goes_on(&made.levels[0], index, shown_twigs[0]))? {
                break;
            }
        }
    }
    let known = (foliage, known.filter(|_| keep.is_none()));
    let drawn = (&channels, sky.as_ref());
    let mut cross = || add_cross(&mut made, known, &parts, drawn, settings, share(settings.levels));
    let whole_tree = if settings.cross { Some(cross()?) } else { None };
    let (Made { levels, left_out }, Order { ranks, growth, contrast }) = (made, order);
    progress.tell("bake", 1.0)?;
    Ok(Chain {
        levels,
        left_out,
        ranks,
        pivots,
        growth,
        contrast,
        kept,
        whole: whole_tree.filter(|_| keep.is_none()),
        twigs: shown_twigs,
        measuring_seconds: seconds,
        prepare_seconds: prepare_seconds + twigs.seconds,
    })
}

/// Adds the cross impostor of all parts, the leaves first, if it is worth making. `foliage`: what the first level is built from. `known`:
/// the renderings that it is compared with, if another chain has them. Returns these renderings.
fn add_cross(
    made: &mut Made,
    (foliage, known): (&Foliage, Option<&Arc<References>>),
    parts: &[&Foliage],
    channels: (&Channels, Option<&Sky>),
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Arc<References>> {
    progress.tell("measure", 0.0)?;
    let measured = || References::new(parts, parts, parts[0].frame(), settings).map(Arc::new);
    let mut rendering = 0.0;
    let references = timed(&mut rendering, || known.map_or_else(measured, |known| Ok(Arc::clone(known))))?;
    let mut cross = cross::build(parts, settings.page(settings.levels), channels, &references, settings, progress)?;
    cross.seconds.metrics += rendering;
    let finer = made.levels.last().map(Level::foliage).transpose()?;
    let before = Before { leaves: finer.as_ref().unwrap_or(foliage), trunk: parts.get(1).copied() };
    made.add(std::iter::once(Ok(cross)), &before, true, settings, progress.part(1.0, 1.0))?;
    Ok(references)
}

/// The pruning order of the leaves, and how pruned leaves grow and change their colors.
struct Order {
    ranks: Vec<f32>,
    growth: Trend,
    contrast: Trend,
}

/// Measures the pruning order and the trends that the settings ask for.
fn order(
    foliage: &Foliage,
    settings: &ChainSettings,
    seconds: &mut MeasuringSeconds,
    progress: Progress,
) -> Result<Order> {
    let mut seen = Vec::new();
    if settings.views.order > 0 {
        let opacity = Opacity::of(foliage);
        let measure = || visibility(foliage, &opacity, settings.up, settings.views.order, progress);
        seen = timed(&mut seconds.order, measure)?.iter().map(LeafSamples::share).collect();
    }
    let ranks = prune::order(foliage, &seen, settings.fit.seed);
    let (mut growth, mut contrast) = Default::default();
    if let Some(pruning) = &settings.pruning {
        growth = timed(&mut seconds.growth, || prune_trends::growth(foliage, &ranks, settings.up, progress))?;
        if pruning.contrast {
            let measure = || prune_trends::contrast(foliage, &ranks, growth, pruning, settings.up, progress);
            contrast = timed(&mut seconds.contrast, measure)?;
        }
    }
    Ok(Order { ranks, growth, contrast })
}

/// Returns the progress of one of `count` levels. The first processes all leaves and takes most of the time.
fn part_of_level(progress: Progress<'_>, index: usize, count: usize) -> Progress<'_> {
    let done = |i: usize| if i == 0 { 0.0 } else { 0.7 + 0.3 * i as f64 / count.max(1) as f64 };
    progress.part(done(index), if index + 1 == count { 1.0 } else { done(index + 1) })
}

/// Returns the leaves without those that are pruned, or else hidden; `None` if all stay.
fn fewer(
    foliage: &Foliage,
    keep: Option<f64>,
    Order { ranks, growth, .. }: &Order,
    settings: &ChainSettings,
    seconds: &mut MeasuringSeconds,
    progress: Progress,
) -> Result<Option<Pruned>> {
    let Some(keep) = keep else {
        let visible = || hidden::without_hidden(foliage, settings.min_visibility, settings.up, progress);
        return timed(&mut seconds.hidden, visible);
    };
    Ok(Some(prune::pruned(foliage, ranks, keep, growth.factor(keep))?))
}

/// Returns the pivot of each triangle's leaf, in the tree's own coordinates.
fn pivots(foliage: &Foliage) -> Vec<DVec3> {
    let pivots: Vec<DVec3> = leaf_pivots(foliage).into_iter().map(|pivot| foliage.frame().to_tree(pivot)).collect();
    foliage.leaf_ids().iter().map(|&leaf| pivots[leaf as usize]).collect()
}

fn check_visible(opacity: &Opacity) -> Result<()> {
    if !opacity.shows_nothing() {
        return Ok(());
    }
    Err(Error::invalid(
        "no leaf is visible: no texel reaches the alpha cutoff of its material, or an alpha of 0.02 where the material is blended; check the \
         alpha of the materials",
    ))
}

/// Greatest distance of the trunk from the center of the leaves, in R of the leaves.
const TRUNK_REACH: f64 = 1000.0;

/// Checks the size of the trunk. The cross impostor shows leaves and trunk on one atlas page; beside a huge trunk the leaves would be
/// smaller than a texel.
fn check_trunk(trunk: &Frame, leaves: &Frame) -> Result<()> {
    let reach = (trunk.centre.distance(leaves.centre) + trunk.radius) / leaves.radius;
    if reach <= TRUNK_REACH {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "the trunk reaches {reach:.1e} times the leaves' radius away from them; the limit is {TRUNK_REACH}: apply its scale or leave it out"
    )))
}

#[cfg(test)]
mod tests;
