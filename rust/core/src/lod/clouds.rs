//! The levels of a chain, one after another: the billboard clouds, each built from the one before, and the cross impostor.

use std::time::Instant;

use super::cross;
use super::level::{self, Level};
use super::measured::{Measured, Order};
use super::refine;
use super::settings::ChainSettings;
use super::twigs::Twigs;
use super::worth::{Before, Made};
use super::{Chain, budget};
use crate::error::{Error, Result};
use crate::fit::FitSettings;
use crate::foliage::{Foliage, Opacity};
use crate::progress::Progress;

/// A chain without its last clouds.
pub struct Clouds<'a> {
    measured: &'a Measured<'a>,
    settings: ChainSettings,
    twigs: Twigs,
    /// For each cloud, how many sets of thin branches it shows.
    shown_twigs: Vec<usize>,
    made: Made,
    /// ε of the last cloud that was tried: it grows from one to the next, whether they are made or not.
    epsilon: Option<f64>,
    /// Number of clouds that were tried.
    tried: usize,
}

impl<'a> Clouds<'a> {
    /// Begins a chain. `settings` are those of the measurement, but for numbers, steps and pages of clouds. `twigs`: thin branches that clouds show beside the leaves: those of the first cloud, those that the second shows in addition, and
    /// so on. Within the frame of the leaves.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(measured: &'a Measured<'a>, settings: ChainSettings, twigs: Vec<Option<Foliage>>) -> Result<Self> {
        settings.check()?;
        let (shown_twigs, made) = Default::default();
        Ok(Self { measured, settings, twigs: Twigs::new(twigs), shown_twigs, made, epsilon: None, tried: 0 })
    }

    /// Fits, packs, bakes and measures the next cloud that is worth making. Returns its number among those that the settings ask for, from 0; `None`
    /// if no other is made. `progress` is that of the whole chain. After an error the next call goes on with the cloud behind.
    ///
    /// # Errors
    /// Fully transparent leaves; an atlas page without visible texels; more billboards than the atlas page holds; [`Error::Cancelled`].
    pub fn add(&mut self, progress: Progress) -> Result<Option<usize>> {
        while !self.is_complete() {
            let number = self.tried;
            self.tried += 1;
            if self.is_made(number, progress)? {
                return Ok(Some(number));
            }
        }
        Ok(None)
    }

    /// Returns whether all clouds that the settings ask for were tried.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.tried >= self.settings.levels
    }

    /// Returns the clouds so far.
    #[must_use]
    pub fn levels(&self) -> &[Level] {
        &self.made.levels
    }

    /// Returns how many sets of thin branches each cloud shows.
    #[must_use]
    pub fn twigs(&self) -> &[usize] {
        &self.shown_twigs
    }

    /// Returns the chain with the clouds so far.
    #[must_use]
    pub fn chain(&self) -> Chain {
        let Self { measured, made, .. } = self;
        let Order { ranks, growth, contrast } = &measured.order;
        Chain {
            levels: made.levels.clone(),
            left_out: made.left_out.clone(),
            ranks: ranks.clone(),
            pivots: measured.pivots.clone(),
            growth: *growth,
            contrast: *contrast,
            kept: measured.pruned.as_ref().map(|pruned| pruned.kept.clone()),
            whole: None,
            twigs: self.shown_twigs.clone(),
            measuring_seconds: measured.seconds,
            prepare_seconds: measured.total_seconds + self.twigs.seconds,
        }
    }

    /// Adds the cross impostor of leaves and trunk to a chain of these clouds, if the settings ask for it and it is worth making.
    ///
    /// # Errors
    /// An atlas page without visible texels; [`Error::Cancelled`].
    pub fn with_cross(&self, chain: Chain, progress: Progress) -> Result<Chain> {
        let Self { measured, settings, .. } = self;
        if !settings.cross {
            progress.tell("bake", 1.0)?;
            return Ok(chain);
        }
        let progress = part_of_level(progress, settings.levels, settings);
        progress.tell("measure", 0.0)?;
        let started = Instant::now();
        let references = measured.of_tree(settings)?;
        let rendering = started.elapsed().as_secs_f64();
        let parts = measured.parts();
        let channels = (&settings.channels.completed(), measured.sky.as_ref());
        let mut cross =
            cross::build(&parts, settings.page(settings.levels), channels, &references, settings, progress)?;
        cross.seconds.metrics += rendering;
        let Chain { levels, left_out, .. } = chain;
        let mut made = Made { levels, left_out };
        let finer = made.levels.last().map(Level::foliage).transpose()?;
        let before = Before { leaves: finer.as_ref().unwrap_or(measured.finest()), trunk: parts.get(1).copied() };
        made.add(std::iter::once(Ok(cross)), &before, true, settings, progress.part(1.0, 1.0))?;
        progress.tell("bake", 1.0)?;
        let Made { levels, left_out } = made;
        Ok(Chain { levels, left_out, whole: Some(references).filter(|_| !measured.prunes), ..chain })
    }

    /// Builds the cloud with this number. Returns whether it is worth making.
    fn is_made(&mut self, number: usize, progress: Progress) -> Result<bool> {
        let Self { measured, settings, twigs, made, .. } = self;
        let (foliage, whole) = (measured.finest(), measured.origin.leaves);
        let before = made.levels.last().map(Level::foliage).transpose()?;
        let finer = before.as_ref().unwrap_or(foliage);
        let (of_leaves, own_triangles) = (before.is_none(), finer.triangle_count());
        twigs.add();
        let with_twigs = twigs.with(finer);
        let (all, references) = twigs.compared(measured, settings)?;
        let finer = with_twigs.as_ref().unwrap_or(finer);
        let fit = settings.fit_of(number, self.epsilon);
        let whole_leaves = if of_leaves { settings.fit.whole_leaves } else { fit.whole_leaves };
        let fit = FitSettings { whole_leaves, ..fit };
        let opacity = fit.opacity(finer);
        if number == 0 {
            let of_leaves = with_twigs.is_some().then(|| fit.opacity(foliage));
            check_visible(of_leaves.as_ref().unwrap_or(&opacity))?;
        }
        let channels = settings.channels.completed();
        let mut step = level::Step {
            finer,
            leaves: all.as_ref().unwrap_or(measured.shown()),
            opacity,
            radius: whole.frame().radius,
            index: number,
            fit,
            triangles: 0,
            is_wish: number == 0 && settings.triangles.is_some(),
            deviation: made.levels.last().map_or(measured.origin.deviation, |level| level.max_deviation_leaves),
            page: settings.page(number),
            channels: if of_leaves { channels } else { channels.of_billboards() },
            sky: measured.sky.as_ref(),
            references,
        };
        let drawn = made.levels.last().map(|finer| finer.atlas.triangles());
        let budgets = budget::of(settings, drawn, whole, measured.trunk.as_ref());
        let progress = part_of_level(progress, number, settings);
        let found = 1.0 - settings.refine.share();
        let candidates = budgets.iter().enumerate().map(|(i, &triangles)| {
            step.triangles = triangles;
            let done = |tries: usize| found * tries as f64 / budgets.len() as f64;
            level::build(&step, settings, progress.part(done(i), done(i + 1)))
        });
        let before = Before { leaves: finer, trunk: measured.trunk.as_ref() };
        let finer_levels = made.levels.len();
        let is_last = number + 1 == count(settings);
        self.epsilon = made.add(candidates, &before, is_last, settings, progress.part(found, found))?;
        let is_made = made.levels.len() > finer_levels;
        if is_made {
            made.refine_last(|level| refine::refined(level, &step, settings, progress.part(found, 1.0)))?;
            made.levels[finer_levels].keep_own(own_triangles);
            self.shown_twigs.push(twigs.show());
        }
        Ok(is_made)
    }
}

/// Returns the number of levels that the settings ask for.
fn count(settings: &ChainSettings) -> usize {
    settings.levels + usize::from(settings.cross)
}

/// Returns the progress of the level with this number. The first processes all leaves and takes most of the time.
fn part_of_level<'a>(progress: Progress<'a>, number: usize, settings: &ChainSettings) -> Progress<'a> {
    let count = count(settings);
    let done = |i: usize| if i == 0 { 0.0 } else { 0.7 + 0.3 * i as f64 / count.max(1) as f64 };
    progress.part(done(number), if number + 1 == count { 1.0 } else { done(number + 1) })
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
