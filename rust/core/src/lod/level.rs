//! One level: fitted to the level before it, packed, baked, and measured against the leaves.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::billboards::{billboard_ranks, billboards};
use super::cut::{CutOut, mip_of};
use super::drawn;
use super::references::References;
use super::refine::{Arrangement, Refined};
use super::settings::ChainSettings;
use super::size::{self, Fitted, is_published};
use super::tight::{Shown, with_polygons};
use super::tune::{self, Laid};
use glam::DVec3;

use crate::atlas::{Atlas, AtlasSettings, PageChoice, PageSize};
use crate::cloud::Cloud;
use crate::error::Result;
use crate::fit::{FitSettings, Named, fit_within};
use crate::foliage::{Foliage, Opacity, source_texel};
use crate::geometry::Frame;
use crate::metrics::Comparison;
use crate::outlines::outlines;
use crate::polygons::{PolygonSettings, Scale};
use crate::progress::Progress;
use crate::textures::{ChannelSeconds, Channels, Page, Sky, bake_timed};
use crate::transition::{Projection, leaf_pivots};

/// Seconds for each stage of a level.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Planes and the parent plane of each triangle.
    pub fit: f64,
    /// Outlines and atlas.
    pub pack: f64,
    /// Textures.
    pub bake: f64,
    /// Stretch limit, alpha cutoff, tone, polygons, report.
    pub metrics: f64,
    /// Refinement of planes and textures.
    pub refine: f64,
}

impl Seconds {
    /// Returns the sum of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.fit + self.pack + self.bake + self.metrics + self.refine
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
    pub cloud: Option<Arc<Cloud>>,
    /// Positions of the level before at a = 1; `None` for the cross impostor.
    pub projection: Option<Arc<Projection>>,
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
    /// R in pixels where the level was built to take over.
    pub radius_pixels: f64,
    /// What the refinement of the textures changed; `None` without one.
    pub refined: Option<Refined>,
    /// What the refinement of the planes changed, in pictures of the collapsed leaves; `None` without one.
    pub refined_planes: Option<Refined>,
    /// Alpha over the leaves' alpha, as the mean over the report's views.
    pub coverage: f64,
    /// Pictures of the leaves and of the level in the report's views.
    pub pictures: Comparison,
    /// Seconds for each stage.
    pub seconds: Seconds,
    /// Share of `seconds.bake` that each image took.
    pub channel_seconds: ChannelSeconds,
    /// Layout and cutoff of all trees on a shared page, this one among them; empty for a page of one tree.
    pub(super) sharers: Arc<[(Atlas, f32)]>,
}

/// Inputs of a level.
pub(super) struct Step<'a> {
    /// The level before.
    pub finer: &'a Foliage,
    /// The leaves that all levels replace.
    pub leaves: &'a Foliage,
    /// Opaque parts of `finer`.
    pub opacity: Opacity,
    /// R of the leaves.
    pub radius: f64,
    /// Number of the level, from 0.
    pub index: usize,
    /// Fit settings; ε as a share of `radius`.
    pub fit: FitSettings,
    /// Budget of triangles.
    pub triangles: usize,
    /// Whether the budget is a wish: then it holds whatever ε.
    pub is_wish: bool,
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

/// Greatest size of a texel in pixels, where a level takes over: leaves are only some pixels large there, and coarser texels make lumps of
/// them.
const TEXEL_PIXELS: f64 = 0.5;

/// Least size of a texel as a share of the size of a texel of the level before.
const SOURCE_SHARE: f64 = 0.5;

/// Planes with the places of the leaves on them.
struct Layout {
    cloud: Cloud,
    laid: Laid,
    two_sided: bool,
    refined: Option<Refined>,
    /// Measured seconds: for fitting the planes, for refining them, and for choosing the stretch limit.
    seconds: [f64; 3],
}

fn layout(step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Layout> {
    let (started, finer) = (Instant::now(), step.finer);
    let two_sided = settings.back_sides.unwrap_or_else(|| finer.is_single_sided());
    let cloud = fitted(step, two_sided, settings, progress.part(0.0, 0.6))?;
    let fitted = Instant::now();
    let (cloud, refined) = arranged(step, settings, cloud, progress.part(0.6, 0.9))?;
    let arranged = Instant::now();
    progress.tell("pack", 0.9)?;
    let laid = tune::projection(finer, &cloud, &step.references.tuning)?;
    let projected = Instant::now();
    let arranging = if refined.is_some() { arranged - fitted } else { Duration::ZERO };
    let seconds = [fitted - started, arranging, projected - arranged].map(|time| time.as_secs_f64());
    Ok(Layout { cloud, laid, two_sided, refined, seconds })
}

/// Returns the places of the billboards on the smallest atlas page with texels that are fine enough.
fn packed(step: &Step, settings: &ChainSettings, layout: &Layout, projection: &Projection) -> Result<Atlas> {
    let (cloud, finer) = (&layout.cloud, step.finer);
    let outlines = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], &step.opacity);
    let deviation = (step.deviation + cloud.max_deviation()) / finer.frame().radius;
    let texel = if settings.fitting_pages {
        // Finer texels than half of the source's show nothing more.
        let source = source_texel(finer).unwrap_or(0.0);
        (TEXEL_PIXELS / settings.radius_pixels(step.index, deviation)).max(SOURCE_SHARE * source)
    } else {
        0.0
    };
    let choice = PageChoice { most: step.page, texel, back_sides: layout.two_sided, tight: settings.tight_pages };
    Atlas::pack_smallest(&cloud.planes, &outlines, choice)
}

/// Returns the cloud with planes refined by pictures, and what changed.
fn arranged(
    step: &Step,
    settings: &ChainSettings,
    cloud: Cloud,
    progress: Progress,
) -> Result<(Cloud, Option<Refined>)> {
    if settings.blended || !settings.refined_parts.planes {
        return Ok((cloud, None));
    }
    let deviation = step.deviation + cloud.max_deviation();
    let arrangement = Arrangement {
        finer: step.finer,
        opacity: &step.opacity,
        leaves: step.leaves,
        amounts: &step.references.tuning,
        image: step.fit.image,
        up: settings.up,
        radius_pixels: settings.radius_pixels(step.index, deviation / step.radius),
        seed: settings.fit.seed,
    };
    arrangement.refined(cloud, settings.refine, progress)
}

/// Returns the planes within ε. A wished number of triangles is met by a larger ε if small billboards alone do not meet it.
fn fitted(step: &Step, two_sided: bool, settings: &ChainSettings, progress: Progress) -> Result<Cloud> {
    let copies = if two_sided { 2 } else { 1 };
    let room = AtlasSettings::of_size(step.page, two_sided).room();
    let deviation = step.deviation / step.radius + step.fit.epsilon;
    let scale = Scale { pixels_per_unit: settings.radius_pixels(step.index, deviation), copies };
    let fitted = Fitted {
        finer: step.finer,
        opacity: &step.opacity,
        bound: step.fit.epsilon * step.radius,
        most: size::billboards_within(step.triangles, copies).min(room),
        scale,
    };
    let (_, cloud) = fitted.cloud(&step.fit, progress.part(0.0, 0.8))?;
    let most = step.triangles / (2 * copies);
    if !step.is_wish || cloud.planes.len() <= most || is_published(step.fit.method, step.fit.effort) {
        return Ok(cloud);
    }
    let fewer = FitSettings { max_billboards: Some(most.max(1)), ..step.fit.clone() };
    fit_within(step.finer, &step.opacity, &fewer, fitted.bound, progress.part(0.8, 1.0), None)
}

/// A level's page with its cutoff and tight polygons.
struct Textured {
    atlas: Atlas,
    page: Page,
    cutoff: f32,
    /// Coverage of the leaves that is missing; 0 if alpha could be tuned to show all of it.
    missing: f64,
    channel_seconds: ChannelSeconds,
    /// Seconds for baking and for tuning.
    seconds: [f64; 2],
}

fn textured(
    step: &Step,
    settings: &ChainSettings,
    layout: &Layout,
    projection: &Projection,
    atlas: Atlas,
    baking: Progress,
) -> Result<Textured> {
    let (started, finer) = (Instant::now(), step.finer);
    let Layout { cloud, two_sided, .. } = layout;
    baking.tell("bake", 0.0)?;
    // A texture for both sides shows single-sided leaves from both sides.
    let either = if *two_sided { None } else { Some(finer.double_sided()) };
    let shown = either.as_ref().unwrap_or(finer);
    let channels = (&step.channels, step.sky);
    // A blended triangle that is drawn on two billboards would cover twice as much.
    let (page, channel_seconds) = if settings.close_gaps && !settings.blended {
        bake_timed(&atlas, settings.samples, channels, drawn::all_triangles(shown, cloud, projection), baking)?
    } else if drawn::tears_many(shown, cloud) && !settings.blended {
        bake_timed(&atlas, settings.samples, channels, drawn::with_torn_leaves(shown, cloud, projection), baking)?
    } else {
        bake_timed(&atlas, settings.samples, channels, drawn::own_triangles(shown, cloud, projection), baking)?
    };
    let baked = Instant::now();
    baking.tell("tune", 0.9)?;
    let radius_pixels = step.radius_pixels(settings, cloud);
    let leaves = &step.references.tuning;
    let (page, cutoff, atlas, missing) = if settings.blended {
        let page = tune::blended(&atlas, &page, finer.frame(), !two_sided, leaves)?;
        let atlas = tightened(atlas, &Shown::new(&page.base_color, 0.0), radius_pixels, step.triangles, settings);
        (page, 0.0, atlas, 0.0)
    } else {
        let atlas = tightened(atlas, &Shown::of_shares(&page.base_color), radius_pixels, step.triangles, settings);
        let mip = mip_of(radius_pixels * atlas.texel());
        let plain = billboards(&atlas, finer.frame(), page.material(0.0, !two_sided))?;
        let (page, cutoff, coverage) = CutOut::of(&plain, leaves, mip)?.settled(page)?;
        (page, cutoff, atlas, (1.0 - coverage).max(0.0))
    };
    let seconds = [(baked - started).as_secs_f64(), baked.elapsed().as_secs_f64()];
    Ok(Textured { atlas, page, cutoff, missing, channel_seconds, seconds })
}

pub(super) fn build(step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Level> {
    let (started, finer) = (Instant::now(), step.finer);
    let layout = layout(step, settings, progress.part(0.0, 0.65))?;
    progress.tell("pack", 0.65)?;
    let atlas = packed(step, settings, &layout, &layout.laid.projection)?;
    let done = Instant::now();
    progress.tell("pack", 0.65)?;
    let grown = tune::grown(finer, &layout.cloud, &layout.laid, &step.references.tuning)?;
    let growing = done.elapsed().as_secs_f64();
    let baking = progress.part(0.65, 0.9);
    let mut textured = textured(step, settings, &layout, &layout.laid.projection, atlas, baking)?;
    if textured.missing > tune::LEAST_LOSS && grown != layout.laid.projection {
        // Texels are too fine for alpha to widen leaves by as much as they hide one another: the leaves on the page grow, too.
        let atlas = packed(step, settings, &layout, &grown)?;
        textured = self::textured(step, settings, &layout, &grown, atlas, baking)?;
    }
    let Layout { cloud, two_sided, refined: refined_planes, seconds: [fit, arranging, stretch], .. } = layout;
    let Textured { atlas, page, cutoff: alpha_cutoff, channel_seconds, seconds: [bake, tuning], .. } = textured;
    let settled = Instant::now();
    let deviation = step.deviation + cloud.max_deviation();
    let radius_pixels = step.radius_pixels(settings, &cloud);
    progress.tell("tune", 0.96)?;
    let page = tune::page(&atlas, page, finer.frame(), alpha_cutoff, !two_sided, &step.references.tuning)?;
    let shown = billboards(&atlas, finer.frame(), page.material(alpha_cutoff, !two_sided))?;
    let pictures = step.references.report.compare(&[&shown])?;
    let coverage = pictures.coverage();
    tune::check_shown(coverage, &page, alpha_cutoff)?;
    Ok(Level {
        method: settings.fit.method.name(),
        epsilon: Some(cloud.bound / step.radius),
        frame: *finer.frame(),
        alpha_cutoff,
        two_sided,
        ranks: billboard_ranks(&atlas, finer.frame(), settings.fit.seed)?,
        mean_deviation: cloud.mean_deviation(finer),
        refined: None,
        refined_planes,
        in_plane_motion: grown.in_plane_motion(finer, &cloud) * finer.frame().radius,
        max_deviation_leaves: deviation,
        radius_pixels,
        coverage,
        pictures,
        cloud: Some(Arc::new(cloud)),
        projection: Some(Arc::new(grown)),
        sharers: Arc::default(),
        atlas,
        page,
        seconds: Seconds {
            fit,
            pack: (done - started).as_secs_f64() - fit - arranging - stretch,
            bake,
            metrics: stretch + growing + tuning + settled.elapsed().as_secs_f64(),
            refine: arranging,
        },
        channel_seconds,
    })
}

impl Step<'_> {
    /// Returns R in pixels where the level takes over with these planes.
    fn radius_pixels(&self, settings: &ChainSettings, cloud: &Cloud) -> f64 {
        settings.radius_pixels(self.index, (self.deviation + cloud.max_deviation()) / self.radius)
    }
}

/// Returns the layout with tight polygons, for the distance at which the level takes over: R is `radius_pixels` large there, and texels at
/// most a pixel.
pub(super) fn tightened(
    atlas: Atlas,
    shown: &Shown,
    radius_pixels: f64,
    triangles: usize,
    settings: &ChainSettings,
) -> Atlas {
    let pixels_per_texel = (radius_pixels * atlas.texel()).min(1.0);
    let copies = if atlas.billboards.iter().any(|billboard| billboard.back) { 2 } else { 1 };
    let scale = Scale { pixels_per_unit: pixels_per_texel, copies };
    with_polygons(atlas, shown, PolygonSettings { corners: settings.max_corners, triangles, scale })
}

impl Level {
    /// Keeps the planes and places of the first triangles of the level before, those of its own. The others are twigs, which do not move.
    pub(super) fn keep_own(&mut self, triangles: usize) {
        if let Some(cloud) = self.cloud.as_mut().map(Arc::make_mut) {
            cloud.parents.truncate(triangles);
            cloud.deviations.truncate(triangles);
        }
        if let Some(Projection { targets, pivots, pivot_targets }) = self.projection.as_mut().map(Arc::make_mut) {
            targets.truncate(triangles);
            pivots.truncate(triangles);
            pivot_targets.truncate(triangles);
        }
    }

    /// Returns whether this level is the cross impostor.
    #[must_use]
    pub fn is_cross(&self) -> bool {
        self.cloud.is_none()
    }

    /// Returns the level's share of the used area of its atlas page; 1 for a page of one tree.
    #[must_use]
    pub fn page_share(&self) -> f64 {
        let all: usize = self.sharers.iter().map(|(atlas, _)| atlas.texels()).sum();
        if all > 0 { self.atlas.texels() as f64 / all as f64 } else { 1.0 }
    }

    /// Returns the area centroid of the polygons on each plane, in the tree's own coordinates: the pivot about which a billboard moves as a
    /// leaf of the next level.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn plane_pivots(&self) -> Result<Vec<DVec3>> {
        let foliage = self.foliage()?;
        Ok(leaf_pivots(&foliage).into_iter().map(|pivot| foliage.frame().to_tree(pivot)).collect())
    }

    /// Returns the billboards as foliage: each polygon is a fan of triangles (0, 1, 2), (0, 2, 3) and so on. A pair is one leaf.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn foliage(&self) -> Result<Foliage> {
        billboards(&self.atlas, &self.frame, self.page.material(self.alpha_cutoff, !self.two_sided))
    }

    /// Returns the billboards as foliage with fractional alpha, for renderers that dither or hash alpha or draw it as coverage.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn shares(&self) -> Result<Foliage> {
        billboards(&self.atlas, &self.frame, self.page.material(0.0, !self.two_sided))
    }
}
