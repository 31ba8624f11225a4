//! Levels of detail: a cloud for the leaves, a coarser one for its billboards, and so on, and the cross behind them.

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

/// How much coarser each level is than the one before: ε grows by it (the paper: at least 2).
pub const EPSILON_STEP: f64 = 2.5;

/// How many times fewer billboards each level has where their number is given.
const BILLBOARDS_STEP: usize = 4;

/// What the judge of the report looks at.
fn report_views(count: usize, up: DVec3) -> Views {
    Views { count, size: 128, samples: Samples::default(), up, turn: 0.5 }
}

/// From how many directions each judge of a chain looks, at most 64, and all but the first at least 1. Time is in proportion to them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Looks {
    /// How much of each leaf is seen, for the order in which they are pruned; 0: place and chance alone decide.
    pub order: usize,
    /// Where leaves are.
    pub places: usize,
    /// How much there is of them.
    pub amounts: usize,
    /// What is reported.
    pub report: usize,
}

impl Looks {
    /// As few as tell settings apart: figures are some per cent off.
    pub const QUICK: Self = Self { order: 0, places: 1, amounts: 1, report: 2 };

    fn check(self) -> Result<()> {
        let Self { order, places, amounts, report } = self;
        let judges = [order.max(1), places, amounts, report];
        match judges.into_iter().find(|count| !(1..=64).contains(count)) {
            Some(count) => Err(Error::invalid(format!("a judge looks from {count} directions; it must be 1 to 64"))),
            None => Ok(()),
        }
    }
}

impl Default for Looks {
    fn default() -> Self {
        Self { order: 16, places: 6, amounts: 16, report: 8 }
    }
}

/// What a chain may be asked.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // Each is on or not, whatever the others.
pub struct ChainSettings {
    /// The fit of level 1; ε grows by [`EPSILON_STEP`] from level to level.
    pub fit: FitSettings,
    /// How many clouds, in [0, 16].
    pub levels: usize,
    /// Whether the cross of two stands behind them.
    pub cross: bool,
    /// What is up; the cross stands along it.
    pub up: DVec3,
    /// Level 1's page, both sides in [64, 16384]; halved from level to level.
    pub texture_size: PageSize,
    /// Of the textures.
    pub samples: Samples,
    /// What pages have beside base colour.
    pub channels: Channels,
    /// Textures of their own for the two sides; `None` lets each level decide by looking whether they differ.
    pub back_sides: Option<bool>,
    /// How leaves are pruned before level 1 takes over; `None`: they are not.
    pub pruning: Option<PruneSettings>,
    /// Whether a billboard also shows the parts of other planes' triangles that lie within ε of its own.
    pub close_cracks: bool,
    /// Whether billboards are see-through where leaves are: then alpha is coverage, and nothing is cut out. They have to be drawn from back to
    /// front ([`crate::blend_order`]).
    pub blended: bool,
    /// Whether pages are packed as tightly as seconds allow, some per cent finer than at once.
    pub tight_pages: bool,
    /// How large a level's deviation from the leaves is seen where the level takes over, in pixels, > 0. The page of the cross has texels of
    /// half a pixel there, or smaller ones.
    pub pixels: f64,
    /// From how many directions the judges look.
    pub looks: Looks,
}

/// How leaves are pruned before level 1 takes over.
#[derive(Clone, Copy, Debug)]
pub struct PruneSettings {
    /// λ where level 1 takes over, in (0, 1]: the levels are made of the leaves that are left there, as large as they are.
    pub keep: f64,
    /// How many pixels a leaf is long where pruning begins, > 0.
    pub leaf_pixels: f64,
    /// h of λ's law, in (0, ½].
    pub half: f64,
    /// Whether it is measured how much contrast is lost.
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

    /// How many pixels across the crown is where the share `keep` of its leaves is left; not so few or many that there is nothing to see.
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
            close_cracks: false,
            blended: false,
            tight_pages: true,
            pixels: 8.0,
            looks: Looks::default(),
        }
    }
}

impl ChainSettings {
    /// # Errors
    /// The first setting that is outside its range.
    pub fn check(&self) -> Result<()> {
        self.fit.check()?;
        self.channels.check()?;
        self.looks.check()?;
        if self.levels > 16 {
            return Err(Error::invalid(format!("levels is {}; it must be at most 16", self.levels)));
        }
        if self.levels == 0 && !self.cross {
            return Err(Error::invalid("levels is 0 without a cross; ask for one level at least, or for the cross"));
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

    /// What the level with this index, from 0, is fitted with; the level before has the ε `finer`. A budget is the first level's: those behind
    /// it follow from its ε, or, where the number of billboards is the input, from that.
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

    /// The page of the level with this index, from 0.
    fn page(&self, index: usize) -> PageSize {
        let PageSize { width, height } = self.texture_size;
        PageSize { width: (width >> index).max(64), height: (height >> index).max(64) }
    }
}

/// Where the time went before the levels; 0 for what was not asked for.
#[derive(Clone, Copy, Debug, Default)]
pub struct LookSeconds {
    /// Finding how much of each leaf is seen.
    pub order: f64,
    /// Finding how much of the sky is seen.
    pub sky: f64,
    /// Finding how pruned leaves grow.
    pub growth: f64,
    /// Finding how much contrast they keep.
    pub contrast: f64,
}

/// What `work` gives; the seconds that it took are written into `seconds`.
fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = work();
    *seconds = started.elapsed().as_secs_f64();
    result
}

/// All levels behind the leaves, finest first.
#[derive(Clone, Debug)]
pub struct Chain {
    /// The clouds, then the cross.
    pub levels: Vec<Level>,
    /// Each leaf's place in the pruning order, see [`prune::order`].
    pub ranks: Vec<f32>,
    /// The pivot of each triangle's leaf, caller's units.
    pub pivots: Vec<DVec3>,
    /// γ, by which leaves grow beside what their area asks for when they are pruned.
    pub growth: Trend,
    /// κ, by which their colours then keep their distance from the mean.
    pub contrast: Trend,
    /// Which of the leaves' triangles level 1 is made of; `None` when of all as they are.
    pub kept: Option<Kept>,
    /// What it took to look at the leaves for the sake of some effects.
    pub look_seconds: LookSeconds,
    /// What was done before the first level: orders, the judges' looks at the leaves, the sky.
    pub prepare_seconds: f64,
}

/// Fits, packs, bakes and judges every level. `wood` is seen by the cross only.
///
/// # Errors
/// A setting outside its range; leaves of which nothing can be seen, or nothing on their page; wood out of all proportion; more billboards
/// than the page holds; [`Error::Cancelled`].
pub fn build_chain(
    foliage: &Foliage,
    wood: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Chain> {
    settings.check()?;
    let started = Instant::now();
    let frame = *foliage.frame();
    wood.map_or(Ok(()), |wood| check_wood(wood.frame(), &frame))?;
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
    let wood = wood.map(Foliage::without_labels);
    let parts: Vec<&Foliage> = std::iter::once(foliage).chain(&wood).collect();
    let sky = channels.need_sky().then(|| timed(&mut seconds.sky, || Sky::over(&parts, &frame)));
    let prepare_seconds = started.elapsed().as_secs_f64();
    let count = settings.levels + usize::from(settings.cross);
    let share = |index: usize| {
        // The first level sees all leaves and takes most of the time.
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
                "nothing can be seen of the leaves: no texel reaches its material's alpha cutoff, or is a fiftieth opaque where it is \
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

/// The pivot of each triangle's leaf, caller's units.
fn pivots(foliage: &Foliage) -> Vec<DVec3> {
    let pivots: Vec<DVec3> = leaf_pivots(foliage).into_iter().map(|pivot| foliage.frame().to_caller(pivot)).collect();
    foliage.leaf_ids().iter().map(|&leaf| pivots[leaf as usize]).collect()
}

/// How far, in R of the leaves, the wood may reach from them.
const WOOD_REACH: f64 = 1000.0;

/// The cross shows leaves and wood on one page; beside wood that is too large no texel would be left for the leaves.
fn check_wood(wood: &Frame, leaves: &Frame) -> Result<()> {
    let reach = (wood.centre.distance(leaves.centre) + wood.radius) / leaves.radius;
    if reach <= WOOD_REACH {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "the wood reaches {reach:.1e} times the leaves' radius away from them; it may reach {WOOD_REACH}: apply its scale, or leave it out"
    )))
}

/// The two judges of a chain: what the one sees decides settings, what the other sees is reported.
struct Judges {
    tuning: Judge,
    report: Judge,
}

impl Judges {
    /// Levels are tuned to `left`, what pruning has left where the first takes over, and reported beside the whole.
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
