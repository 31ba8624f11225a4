//! Levels of detail. Level 1 is a billboard cloud of the leaves, each further level a coarser cloud of the billboards before it.
//! The last level is the cross impostor.

mod cross;
mod drawn;
mod level;
pub mod pruned_look;
mod shared;
mod sides;
mod size;
mod tune;

pub use level::{Level, Seconds, billboards};
pub use shared::share_page;
pub use size::{is_published, settled as settled_size};

use std::time::Instant;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::fit::{FitSettings, ImageBound, Method};
use crate::foliage::Foliage;
use crate::geometry::Frame;
use crate::judge::{Judge, Views, visibility};
use crate::progress::Progress;
use crate::prune::{self, Kept, Thinned, Trend};
use crate::sheet::PageSize;
use crate::textures::{Channels, Samples, Sky};
use crate::transition::leaf_pivots;

/// Factor by which ε grows from level to level (the paper: at least 2).
pub const EPSILON_STEP: f64 = 2.5;

/// Divisor of the billboard count from level to level, if `max_billboards` is the input of the method.
const BILLBOARDS_STEP: usize = 4;

/// Returns the views that the reported metrics use.
fn report_views(count: usize, up: DVec3) -> Views {
    Views { count, size: 128, samples: Samples::default(), up, turn: 0.5 }
}

/// Number of view directions for each measurement of a chain: 0 to 64 for `order`, 1 to 64 for the others. Time is proportional to them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Looks {
    /// Visible share of each leaf, for the pruning order. With 0, position and chance alone decide the order.
    pub order: usize,
    /// Overlap with the leaves, for the alpha cutoff.
    pub places: usize,
    /// Coverage and mean color, for the stretch limit, the alpha cutoff and the tone.
    pub amounts: usize,
    /// Reported metrics.
    pub report: usize,
}

impl Looks {
    /// The fewest views that still tell settings apart. The figures are off by a few percent.
    pub const QUICK: Self = Self { order: 0, places: 1, amounts: 1, report: 2 };

    fn check(self) -> Result<()> {
        let Self { order, places, amounts, report } = self;
        let judges = [order.max(1), places, amounts, report];
        match judges.into_iter().find(|count| !(1..=64).contains(count)) {
            Some(count) => Err(Error::invalid(format!("the number of view directions is {count}; it must be 1 to 64"))),
            None => Ok(()),
        }
    }
}

impl Default for Looks {
    fn default() -> Self {
        Self { order: 16, places: 6, amounts: 16, report: 8 }
    }
}

/// Settings of a chain of levels.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // The flags are independent.
pub struct ChainSettings {
    /// The fit of level 1; ε grows by [`EPSILON_STEP`] from level to level.
    pub fit: FitSettings,
    /// Number of billboard clouds, in [0, 16].
    pub levels: usize,
    /// Adds the cross impostor as the last level.
    pub cross: bool,
    /// Up direction; the planes of the cross impostor contain it.
    pub up: DVec3,
    /// Atlas size of level 1, both sides in [64, 16384]; halved from level to level.
    pub texture_size: PageSize,
    /// Sub-samples for baking the textures.
    pub samples: Samples,
    /// Channels of the atlas beside base color.
    pub channels: Channels,
    /// Separate textures for front and back. With `None`, each level bakes both sides small and compares them.
    pub back_sides: Option<bool>,
    /// Pruning of the leaves before level 1 takes over; `None` keeps all leaves.
    pub pruning: Option<PruneSettings>,
    /// Closes gaps between billboards: each billboard also shows the parts of other planes' triangles within ε of its own plane.
    pub close_gaps: bool,
    /// Draws billboards alpha blended: alpha is coverage and nothing is cut out. They must be drawn from back to front
    /// ([`crate::blend_order`]).
    pub blended: bool,
    /// Spends seconds on packing the atlas tightly, for texels a few percent finer than quick packing gives.
    pub tight_pages: bool,
    /// Size in pixels, > 0, at which a level's deviation from the leaves is seen where the level takes over. The texels of the cross
    /// impostor are at most half a pixel there.
    pub pixels: f64,
    /// Numbers of view directions.
    pub looks: Looks,
}

/// Settings for pruning the leaves before level 1 takes over.
#[derive(Clone, Copy, Debug)]
pub struct PruneSettings {
    /// λ where level 1 takes over, in (0, 1]. The levels are built from the leaves kept at that λ, at their size there.
    pub keep: f64,
    /// Length of a leaf in pixels where pruning begins, > 0.
    pub leaf_pixels: f64,
    /// h of the law of λ, in (0, ½]; see [`prune::keep`].
    pub half: f64,
    /// Measures the loss of contrast.
    pub contrast: bool,
}

impl PruneSettings {
    fn check(&self) -> Result<()> {
        let Self { keep, leaf_pixels, half, contrast: _ } = *self;
        let ranges = [
            ("keep", keep, keep > 0.0 && keep <= 1.0, "greater than 0 and at most 1"),
            ("leaf_pixels", leaf_pixels, leaf_pixels > 0.0 && leaf_pixels.is_finite(), "greater than 0 and finite"),
            ("prune_half", half, half > 0.0 && half <= 0.5, "greater than 0 and at most 0.5"),
        ];
        match ranges.into_iter().find(|(.., holds, _)| !holds) {
            Some((name, value, _, limit)) => Err(Error::invalid(format!("{name} is {value}; it must be {limit}"))),
            None => Ok(()),
        }
    }

    /// Returns the crown's width in pixels at the distance where the share `keep` of its leaves is kept, clamped to [12, 192].
    #[must_use]
    pub fn crown_pixels(&self, foliage: &Foliage, keep: f64) -> usize {
        let area: f64 = (0..foliage.triangle_count()).map(|t| foliage.area_vector(t).length()).sum();
        let leaf = (area / foliage.leaf_count() as f64).sqrt();
        let nearer = libm::pow(keep, libm::log(self.half) / libm::log(0.5));
        (2.05 / leaf * self.leaf_pixels * nearer).clamp(12.0, 192.0) as usize
    }
}

impl Default for ChainSettings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            levels: 2,
            cross: true,
            up: DVec3::Z,
            texture_size: 2048.into(),
            samples: Samples::default(),
            channels: Channels::default(),
            back_sides: None,
            pruning: None,
            close_gaps: false,
            blended: false,
            tight_pages: true,
            pixels: 8.0,
            looks: Looks::default(),
        }
    }
}

impl ChainSettings {
    /// Checks all settings.
    ///
    /// # Errors
    /// The first setting outside its range.
    pub fn check(&self) -> Result<()> {
        self.fit.check()?;
        self.channels.check()?;
        self.looks.check()?;
        if self.levels > 16 {
            return Err(Error::invalid(format!("levels is {}; it must be at most 16", self.levels)));
        }
        if self.levels == 0 && !self.cross {
            return Err(Error::invalid(
                "levels is 0 without a cross impostor; ask for at least one level or for the cross impostor",
            ));
        }
        self.pruning.as_ref().map_or(Ok(()), PruneSettings::check)?;
        if !self.up.is_finite() || self.up.try_normalize().is_none() {
            return Err(Error::invalid(format!("up is {:?}; it needs a finite length above 0", self.up.to_array())));
        }
        if !(self.pixels > 0.0 && self.pixels.is_finite()) {
            return Err(Error::invalid(format!("pixels is {}; it must be greater than 0 and finite", self.pixels)));
        }
        let PageSize { width, height } = self.texture_size;
        if let Some(side) = [width, height].into_iter().find(|side| !(64..=16_384).contains(side)) {
            return Err(Error::invalid(format!("the texture size is {side}; it must lie between 64 and 16384 texels")));
        }
        Ok(())
    }

    /// Returns the fit settings of the level with this index, from 0; `finer` is the ε of the level before it. A budget applies to the
    /// first level only. Later levels follow from its ε or, if the billboard count is the input of the method, from that count.
    fn fit_of(&self, index: usize, finer: Option<f64>) -> FitSettings {
        let Some(finer) = finer else { return self.fit.clone() };
        let coarser = libm::pow(EPSILON_STEP, index as f64);
        let fewer = |count: usize| (count / BILLBOARDS_STEP.pow(index as u32)).max(1);
        FitSettings {
            epsilon: (finer * EPSILON_STEP).min(1.0),
            max_billboards: self.fit.max_billboards.filter(|_| self.fit.method == Method::KMeans).map(fewer),
            max_texels: None,
            image: self.fit.image.map(|image| ImageBound { angle: image.angle * coarser, ..image }),
            // A billboard torn in two shows a seam through its whole texture.
            whole_leaves: true,
            ..self.fit.clone()
        }
    }

    /// Returns the atlas size of the level with this index, from 0.
    fn page(&self, index: usize) -> PageSize {
        let PageSize { width, height } = self.texture_size;
        PageSize { width: (width >> index).max(64), height: (height >> index).max(64) }
    }
}

/// Seconds of the measurements before the first level; 0 for steps that were not requested.
#[derive(Clone, Copy, Debug, Default)]
pub struct LookSeconds {
    /// Measuring the visible share of each leaf.
    pub order: f64,
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
    /// Each leaf's rank in the pruning order, see [`prune::order`].
    pub ranks: Vec<f32>,
    /// The pivot of each triangle's leaf, caller's units.
    pub pivots: Vec<DVec3>,
    /// γ: growth of pruned leaves beyond the growth that keeps their area.
    pub growth: Trend,
    /// κ: factor on the distance of pruned leaves' colors from their mean.
    pub contrast: Trend,
    /// The leaves' triangles that level 1 is built from; `None` for all triangles, unchanged.
    pub kept: Option<Kept>,
    /// Seconds of the measurements for optional effects.
    pub look_seconds: LookSeconds,
    /// Seconds before the first level: pruning order, reference renderings of the leaves, sky visibility.
    pub prepare_seconds: f64,
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
    settings.check()?;
    let started = Instant::now();
    let frame = *foliage.frame();
    trunk.map_or(Ok(()), |trunk| check_trunk(trunk.frame(), &frame))?;
    let mut seconds = LookSeconds::default();
    let mut seen = Vec::new();
    if settings.looks.order > 0 {
        seen = timed(&mut seconds.order, || visibility(foliage, settings.up, settings.looks.order))?;
    }
    let ranks = prune::order(foliage, &seen, settings.fit.seed);
    let pivots = pivots(foliage);
    let (mut growth, mut contrast) = Default::default();
    if let Some(pruning) = &settings.pruning {
        growth = timed(&mut seconds.growth, || pruned_look::growth(foliage, &ranks, settings.up))?;
        if pruning.contrast {
            let look = || pruned_look::contrast(foliage, &ranks, growth, pruning, settings.up);
            contrast = timed(&mut seconds.contrast, look)?;
        }
    }
    let keep = settings.pruning.map(|pruning| pruning.keep).filter(|keep| *keep < 1.0);
    let thinned = keep.map(|keep| prune::thin(foliage, &ranks, keep, growth.factor(keep))).transpose()?;
    let whole = foliage;
    let (foliage, kept) = match &thinned {
        Some(Thinned { foliage, kept }) => (foliage, Some(kept.clone())),
        None => (foliage, None),
    };
    let judges = Judges::new(&[foliage], &[whole], &frame, settings)?;
    let channels = settings.channels.completed();
    let trunk = trunk.map(Foliage::without_labels);
    let parts: Vec<&Foliage> = std::iter::once(foliage).chain(&trunk).collect();
    let sky = channels.need_sky().then(|| timed(&mut seconds.sky, || Sky::over(&parts, &frame)));
    let prepare_seconds = started.elapsed().as_secs_f64();
    let count = settings.levels + usize::from(settings.cross);
    let share = |index: usize| {
        // The first level processes all leaves and takes most of the time.
        let done = |i: usize| if i == 0 { 0.0 } else { 0.7 + 0.3 * i as f64 / count.max(1) as f64 };
        progress.part(done(index), if index + 1 == count { 1.0 } else { done(index + 1) })
    };
    let mut levels: Vec<Level> = Vec::with_capacity(count);
    for index in 0..settings.levels {
        let finer = levels.last().map(Level::foliage).transpose()?;
        let finer = finer.as_ref().unwrap_or(foliage);
        let fit = settings.fit_of(index, levels.last().and_then(|finer| finer.epsilon));
        let fit = FitSettings { max_size: size::limit(&fit, finer), ..fit };
        let opacity = fit.opacity(finer);
        if index == 0 && opacity.shows_nothing() {
            return Err(Error::invalid(
                "no leaf is visible: no texel reaches the alpha cutoff of its material, or an alpha of 0.02 where the material is \
                 blended; check the alpha of the materials",
            ));
        }
        let step = level::Step {
            finer,
            opacity,
            radius: frame.radius,
            fit,
            deviation: levels.last().map_or(0.0, |l| l.max_deviation_leaves),
            page: settings.page(index),
            channels: if index == 0 { channels } else { channels.of_billboards() },
            sky: sky.as_ref(),
            judges: &judges,
        };
        levels.push(level::build(&step, settings, share(index))?);
    }
    if settings.cross {
        let page = settings.page(settings.levels);
        levels.push(cross::build(&parts, page, (&channels, sky.as_ref()), settings, share(settings.levels))?);
    }
    progress.tell("bake", 1.0)?;
    Ok(Chain { levels, ranks, pivots, growth, contrast, kept, look_seconds: seconds, prepare_seconds })
}

/// Returns the pivot of each triangle's leaf, caller's units.
fn pivots(foliage: &Foliage) -> Vec<DVec3> {
    let pivots: Vec<DVec3> = leaf_pivots(foliage).into_iter().map(|pivot| foliage.frame().to_caller(pivot)).collect();
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

/// The two metrics renderers of a chain: one for choosing settings, one for the report. Their views differ.
struct Judges {
    tuning: Judge,
    report: Judge,
}

impl Judges {
    /// Tunes levels to `left`, the leaves that pruning keeps where the first level takes over, and reports them against `whole`.
    fn new(left: &[&Foliage], whole: &[&Foliage], frame: &Frame, settings: &ChainSettings) -> Result<Self> {
        let ChainSettings { looks, up, .. } = *settings;
        Ok(Self {
            tuning: Judge::new(left, frame, tune::views_of_amounts(looks.amounts, up)?)?,
            report: Judge::new(whole, frame, report_views(looks.report, up))?,
        })
    }
}

#[cfg(test)]
mod tests;
