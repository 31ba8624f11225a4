//! Measures leaves and trunk before the first level: the pruning order, the leaves that the crown hides, and the light of the sky. Chains of the same
//! leaves with other clouds share the results.

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use glam::DVec3;

use super::hidden;
use super::references::References;
use super::settings::ChainSettings;
use super::{Origin, prune_trends};
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Opacity};
use crate::geometry::Frame;
use crate::metrics::{LeafSamples, visibility};
use crate::progress::Progress;
use crate::prune::{self, Pruned, Trend};
use crate::textures::Sky;
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

/// The leaves and the trunk of chains, measured.
pub struct Measured<'a> {
    pub(super) origin: Origin<'a>,
    /// The trunk, as one part.
    pub(super) trunk: Option<Foliage>,
    pub(super) order: Order,
    /// The pivot of each triangle's leaf, in the tree's own coordinates.
    pub(super) pivots: Vec<DVec3>,
    /// The leaves without pruned or hidden ones; `None` if all stay.
    pub(super) pruned: Option<Pruned>,
    /// Whether leaves are pruned before level 1 takes over.
    pub(super) prunes: bool,
    pub(super) sky: Option<Sky>,
    pub(super) seconds: MeasuringSeconds,
    /// Seconds for all of it.
    pub(super) total_seconds: f64,
    /// The renderings that clouds and the cross impostor are compared with, once one needs them: of the leaves, and of leaves and trunk.
    of_leaves: OnceLock<Arc<References>>,
    of_tree: OnceLock<Arc<References>>,
}

impl<'a> Measured<'a> {
    /// Measures leaves and trunk for settings. Chains may have other numbers, steps and pages of clouds.
    ///
    /// # Errors
    /// A setting outside its range; a trunk that reaches too far from the leaves; [`Error::Cancelled`].
    pub fn of(
        origin: Origin<'a>,
        trunk: Option<&Foliage>,
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Self> {
        settings.check()?;
        let started = Instant::now();
        let Origin { leaves, finest, .. } = origin;
        trunk.map_or(Ok(()), |trunk| check_trunk(trunk.frame(), leaves.frame()))?;
        let mut seconds = MeasuringSeconds::default();
        let order = Order::of(finest, settings, &mut seconds, progress)?;
        let keep = settings.pruning.map(|pruning| pruning.keep).filter(|keep| *keep < 1.0);
        let pruned = fewer(finest, keep, &order, settings, &mut seconds, progress)?;
        progress.tell("measure", 0.0)?;
        let mut measured = Self {
            origin,
            trunk: trunk.map(Foliage::without_labels),
            order,
            pivots: pivots(leaves),
            pruned,
            prunes: keep.is_some(),
            sky: None,
            seconds,
            total_seconds: 0.0,
            of_leaves: OnceLock::new(),
            of_tree: OnceLock::new(),
        };
        if settings.channels.completed().need_sky() {
            let sky = timed(&mut seconds.sky, || Sky::over(&measured.parts(), leaves.frame()));
            measured.sky = Some(sky);
        }
        Ok(Self { seconds, total_seconds: started.elapsed().as_secs_f64(), ..measured })
    }

    /// Returns what the first level is built from.
    pub(super) fn finest(&self) -> &Foliage {
        self.pruned.as_ref().map_or(self.origin.finest, |pruned| &pruned.foliage)
    }

    /// Returns the leaves that levels show. Leaves that are hidden are still seen a little and shade the others; pruned ones are gone.
    pub(super) fn shown(&self) -> &Foliage {
        if self.prunes { self.finest() } else { self.origin.leaves }
    }

    /// Returns the leaves that levels show, and the trunk.
    pub(super) fn parts(&self) -> Vec<&Foliage> {
        std::iter::once(self.shown()).chain(&self.trunk).collect()
    }

    /// Returns the renderings of the leaves that clouds are compared with.
    ///
    /// # Errors
    /// Those of [`References::new`].
    pub(super) fn of_leaves(&self, settings: &ChainSettings) -> Result<Arc<References>> {
        let leaves = self.origin.leaves;
        known_or(&self.of_leaves, || References::new(&[self.shown()], &[leaves], leaves.frame(), settings))
    }

    /// Returns the renderings of leaves and trunk that impostors are compared with.
    ///
    /// # Errors
    /// Those of [`References::new`].
    pub fn of_tree(&self, settings: &ChainSettings) -> Result<Arc<References>> {
        let parts = self.parts();
        known_or(&self.of_tree, || References::new(&parts, &parts, parts[0].frame(), settings))
    }
}

fn known_or<T>(known: &OnceLock<Arc<T>>, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
    if let Some(known) = known.get() {
        return Ok(Arc::clone(known));
    }
    let made = Arc::new(make()?);
    Ok(Arc::clone(known.get_or_init(|| made)))
}

/// The pruning order of the leaves, and how pruned leaves grow and change their colors.
pub(super) struct Order {
    pub ranks: Vec<f32>,
    pub growth: Trend,
    pub contrast: Trend,
}

impl Order {
    /// Measures the pruning order and the trends that the settings ask for.
    fn of(
        foliage: &Foliage,
        settings: &ChainSettings,
        seconds: &mut MeasuringSeconds,
        progress: Progress,
    ) -> Result<Self> {
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
        Ok(Self { ranks, growth, contrast })
    }
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
