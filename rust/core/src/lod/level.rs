//! One level: fitted to the level before it, packed, baked, and measured against the leaves.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use super::billboards::{billboard_ranks, billboards};
use super::references::References;
use super::settings::ChainSettings;
use super::{drawn, sides, size, tune};
use crate::atlas::{Atlas, AtlasSettings, PageSize, Region};
use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::fit::{FitSettings, Named, fit_within};
use crate::foliage::{Foliage, Image, Opacity};
use crate::geometry::Frame;
use crate::metrics::{Comparison, Reference};
use crate::outlines::{OutlineSettings, outlines};
use crate::progress::Progress;
use crate::textures::mips::PagePart;
use crate::textures::{
    CASCADE_LEVELS, ChannelSeconds, Channels, Page, Sky, bake_timed, for_plain_means, keeping_area, mips,
};
use crate::transition::{HAND_OVER, Projection};

/// Seconds for each stage of a level.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Planes and the parent plane of each triangle.
    pub fit: f64,
    /// Outlines and atlas.
    pub pack: f64,
    /// Textures.
    pub bake: f64,
    /// Metrics: stretch limit, alpha cutoff, tone, report.
    pub metrics: f64,
}

impl Seconds {
    /// Returns the sum of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.fit + self.pack + self.bake + self.metrics
    }
}

/// A billboard cloud or cross impostor with its atlas page. Lengths are in the caller's units unless noted as shares of R.
#[derive(Clone, Debug)]
pub struct Level {
    /// The fitter's name, or "cross".
    pub method: &'static str,
    /// ε as a share of the leaves' R; `None` for the cross impostor.
    pub epsilon: Option<f64>,
    /// The planes, and the parent plane of each triangle of the level before; `None` for the cross impostor.
    pub cloud: Option<Cloud>,
    /// Positions of the level before at a = 1; `None` for the cross impostor.
    pub projection: Option<Projection>,
    /// The local frame of planes, projection and atlas layout.
    pub frame: Frame,
    /// Atlas layout of the billboards.
    pub atlas: Atlas,
    /// Images of the atlas page.
    pub page: Page,
    /// Least alpha that is drawn; 0 if alpha is coverage and nothing is cut out.
    pub alpha_cutoff: f32,
    /// Whether front and back have separate textures, as pairs of single-sided billboards.
    pub two_sided: bool,
    /// Each billboard's rank in the pruning order; the two of a pair share one.
    pub ranks: Vec<f32>,
    /// Area-weighted mean deviation from the level before; for the cross impostor, the mean distance of corners from the nearest plane.
    pub mean_deviation: f64,
    /// The greatest motion within a plane.
    pub in_plane_motion: f64,
    /// Bound on the deviation from the leaves: the sum of the deviations of all levels so far; for the cross impostor, the greatest
    /// distance of a corner from the nearest plane.
    pub max_deviation_leaves: f64,
    /// Alpha over the leaves' alpha, as the mean over the report's views.
    pub coverage: f64,
    /// Pictures of the leaves and of the level in the report's views.
    pub pictures: Comparison,
    /// Seconds for each stage.
    pub seconds: Seconds,
    /// Share of `seconds.bake` that each image took.
    pub channel_seconds: ChannelSeconds,
    /// Parts of all trees on a shared page, with their engine cutoffs; empty for a page of one tree.
    pub(super) sharers: Arc<[PagePart]>,
    pub(super) engine: OnceLock<(Image, f32)>,
}

/// Inputs of a level.
pub(super) struct Step<'a> {
    /// The level before.
    pub finer: &'a Foliage,
    /// Opaque parts of `finer`.
    pub opacity: Opacity,
    /// R of the leaves.
    pub radius: f64,
    /// Fit settings; ε as a share of `radius`.
    pub fit: FitSettings,
    /// Deviation of the level before from the leaves.
    pub deviation: f64,
    /// Size of the atlas page.
    pub page: PageSize,
    /// Channels of the atlas page.
    pub channels: Channels,
    /// Sky visibility in leaves and trunk, if a channel depends on it.
    pub sky: Option<&'a Sky>,
    /// Metrics renderers for the leaves.
    pub references: &'a References,
}

/// Planes with their places on the atlas page.
struct Layout {
    cloud: Cloud,
    projection: Projection,
    atlas: Atlas,
    two_sided: bool,
    /// Measured seconds: for fitting the planes, and for choosing the stretch limit.
    seconds: [f64; 2],
}

/// Returns the layout. A default size limit doubles until it no longer limits, while the level has more than half of the triangles of
/// the level before it or more billboards than the atlas page holds.
fn layout(step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Layout> {
    let by_default = settings.fit.max_size.is_none();
    let mut fit = step.fit.clone();
    let mut done = 0.0;
    loop {
        let limited = by_default && fit.max_size.is_some();
        let rest = progress.part(done, if limited { 0.5 * (1.0 + done) } else { 1.0 });
        let found = layout_of(step, &fit, settings, limited, rest);
        match found {
            Ok(None) | Err(Error::Invalid(_)) if limited => fit.max_size = size::larger(fit.max_size),
            Ok(found) => return Ok(found.expect("any number of triangles will do without a limit")),
            Err(error) => return Err(error),
        }
        done = 0.5 * (1.0 + done);
    }
}

/// Returns the layout for one size limit; `None` if `counted` is set and the level has too many triangles.
fn layout_of(
    step: &Step,
    fit: &FitSettings,
    settings: &ChainSettings,
    counted: bool,
    progress: Progress,
) -> Result<Option<Layout>> {
    let (started, finer, opacity) = (Instant::now(), step.finer, &step.opacity);
    let cloud = fit_within(finer, opacity, fit, fit.epsilon * step.radius, progress.part(0.0, 0.6), None)?;
    if counted && !size::is_worth(cloud.planes.len() * (fit.max_corners - 2), finer.triangle_count()) {
        return Ok(None);
    }
    let fitted = Instant::now();
    progress.tell("pack", 0.6)?;
    let projection = tune::projection(finer, &cloud, &step.references.tuning)?;
    let projected = Instant::now();
    let shape = OutlineSettings { corners: settings.fit.max_corners };
    let outlines = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], opacity, shape);
    let two_sided = match settings.back_sides {
        Some(wish) => wish,
        None => sides::differ(finer, &cloud, &projection, &outlines)?,
    };
    let pack = if settings.tight_pages { Atlas::pack } else { Atlas::pack_loosely };
    let atlas = pack(&cloud.planes, &outlines, AtlasSettings::of_size(step.page, two_sided))?;
    let seconds = [fitted - started, projected - fitted].map(|time| time.as_secs_f64());
    Ok(Some(Layout { cloud, projection, atlas, two_sided, seconds }))
}

pub(super) fn build(step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Level> {
    let (started, finer) = (Instant::now(), step.finer);
    let Layout { cloud, projection, atlas, two_sided, seconds: [fit, stretch] } =
        layout(step, settings, progress.part(0.0, 0.65))?;
    let packed = Instant::now();

    let baking = progress.part(0.65, 0.9);
    baking.tell("bake", 0.0)?;
    // A texture for both sides shows single-sided leaves from both sides.
    let either = if two_sided { None } else { Some(finer.double_sided()) };
    let shown = either.as_ref().unwrap_or(finer);
    let channels = (&step.channels, step.sky);
    // A blended triangle that is drawn on two billboards would cover twice as much.
    let (page, channel_seconds) = if settings.close_gaps && !settings.blended {
        bake_timed(&atlas, settings.samples, channels, drawn::all_triangles(shown, &cloud, &projection), baking)?
    } else {
        bake_timed(&atlas, settings.samples, channels, drawn::own_triangles(shown, &cloud, &projection), baking)?
    };
    let baked = Instant::now();
    let tuning = |share: f64| progress.tell("tune", share);
    tuning(0.9)?;
    let ranks = billboard_ranks(&atlas, finer.frame(), settings.fit.seed)?;
    let (page, alpha_cutoff) = if settings.blended {
        (tune::blended(&atlas, &page, finer.frame(), !two_sided, &step.references.tuning)?, 0.0)
    } else {
        let collapsed = projection.at(finer, HAND_OVER)?;
        let views = tune::views_of_places(settings.views.places, settings.up)?;
        let before = Reference::new(&[&collapsed], finer.frame(), views)?;
        let best = tune::cutoff(&atlas, &page, finer.frame(), !two_sided, &before)?;
        tuning(0.92)?;
        let cutoff = tune::matched(best, &atlas, &page, finer.frame(), !two_sided, &step.references.tuning)?;
        (page, cutoff)
    };
    tuning(0.96)?;
    let page = tune::page(&atlas, page, finer.frame(), alpha_cutoff, !two_sided, &step.references.tuning)?;
    tuning(0.98)?;
    let shown = billboards(&atlas, finer.frame(), page.material(alpha_cutoff, !two_sided))?;
    let pictures = step.references.report.compare(&shown)?;
    let coverage = pictures.coverage();
    tune::check_shown(coverage, &page, alpha_cutoff)?;
    Ok(Level {
        method: settings.fit.method.name(),
        epsilon: Some(cloud.bound / step.radius),
        frame: *finer.frame(),
        alpha_cutoff,
        two_sided,
        ranks,
        mean_deviation: cloud.mean_deviation(finer),
        in_plane_motion: projection.in_plane_motion(finer, &cloud) * finer.frame().radius,
        max_deviation_leaves: step.deviation + cloud.max_deviation(),
        coverage,
        pictures,
        cloud: Some(cloud),
        projection: Some(projection),
        sharers: Arc::default(),
        atlas,
        page,
        seconds: Seconds {
            fit,
            pack: (packed - started).as_secs_f64() - fit - stretch,
            bake: (baked - packed).as_secs_f64(),
            metrics: stretch + baked.elapsed().as_secs_f64(),
        },
        channel_seconds,
        engine: OnceLock::new(),
    })
}

impl Level {
    /// Returns whether this level is the cross impostor.
    #[must_use]
    pub fn is_cross(&self) -> bool {
        self.cloud.is_none()
    }

    /// Returns the grid, in texels, that regions stay aligned to when they move to a shared page. It keeps their mip levels the same.
    pub(super) fn grid(&self) -> usize {
        if self.is_cross() { 1 << CASCADE_LEVELS } else { 1 }
    }

    /// Returns base color and cutoff for engines that make mip levels themselves, computed on the first call. Do not call it on a rayon
    /// worker: a thread that waits for the result does no other work.
    pub fn for_engines(&self) -> &(Image, f32) {
        self.engine.get_or_init(|| match self.alpha_cutoff {
            0.0 => (self.page.base_color.clone(), 0.0), // Box filtering keeps coverage.
            cutoff if self.is_cross() => keeping_area(&self.page.base_color, cutoff),
            cutoff => for_plain_means(&self.page.base_color, cutoff),
        })
    }

    /// Returns the mip levels of a channel; base color as engines draw it. `None` for a missing channel and for label textures.
    #[must_use]
    pub fn mips(&self, channel: &str) -> Option<mips::Levels> {
        if channel == "base_color" {
            let (image, cutoff) = self.for_engines();
            if *cutoff == 0.0 {
                return Some(mips::means(image));
            }
            return Some(mips::of_parts(image, &self.parts()));
        }
        self.page.levels(channel)
    }

    /// Returns the regions of mip level `number`, of `width` × `height` texels, in which alpha is cut out, each with its least drawn alpha
    /// code.
    #[must_use]
    pub fn cut_outs(&self, channel: &str, number: usize, width: usize, height: usize) -> Vec<(Region, u8)> {
        let cut = channel == "base_color" && self.alpha_cutoff > 0.0;
        if cut { mips::cut_outs(&self.parts(), number, width, height) } else { Vec::new() }
    }

    /// Returns the parts of all trees on the page, this level's among them.
    fn parts(&self) -> Cow<'_, [PagePart]> {
        if self.sharers.is_empty() {
            Cow::Owned(vec![PagePart::of(&self.atlas, self.for_engines().1)])
        } else {
            Cow::Borrowed(&self.sharers)
        }
    }

    /// Returns the level's share of the used area of its atlas page; 1 for a page of one tree.
    #[must_use]
    pub fn page_share(&self) -> f64 {
        let area = |regions: &[Region]| regions.iter().map(|region| region.width * region.height).sum::<usize>() as f64;
        let all: f64 = self.sharers.iter().map(|part| area(&part.regions)).sum();
        if all > 0.0 { self.atlas.texels() as f64 / all } else { 1.0 }
    }

    /// Returns the billboards as foliage: each is a fan of triangles (0, 1, 2), (0, 2, 3) and so on. A pair is one leaf.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn foliage(&self) -> Result<Foliage> {
        billboards(&self.atlas, &self.frame, self.page.material(self.alpha_cutoff, !self.two_sided))
    }
}
