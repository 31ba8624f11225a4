//! One level: fitted to the one before, packed, baked, and judged against the leaves.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use glam::{DVec3, Vec2};

use super::{ChainSettings, Judges, drawn, sides, size, tune};
use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::fit::{FitSettings, Named, fit_within};
use crate::foliage::{Attributes, Foliage, Image, Material, Opacity};
use crate::geometry::Frame;
use crate::judge::{Judge, Judgement};
use crate::outlines::{OutlineSettings, outlines};
use crate::progress::Progress;
use crate::prune;
use crate::sheet::{PageSize, Region, Sheet, SheetSettings};
use crate::textures::mips::Part;
use crate::textures::{
    CASCADE_LEVELS, ChannelSeconds, Channels, Page, Sky, bake_timed, for_plain_means, keeping_area, mips,
};
use crate::transition::{HAND_OVER, Projection};

/// Where the time went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Finding planes and parents.
    pub fit: f64,
    /// Outlines and atlas.
    pub pack: f64,
    /// Textures.
    pub bake: f64,
    /// Judging by looks: the stretch, the cutoff, the tone, the report.
    pub look: f64,
}

impl Seconds {
    /// All of it.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.fit + self.pack + self.bake + self.look
    }
}

/// A cloud or cross with its page. Lengths are in the caller's units unless they are said to be shares of R.
#[derive(Clone, Debug)]
pub struct Level {
    /// The fitter's name, or "cross".
    pub method: &'static str,
    /// ε as a share of the leaves' R; `None` for the cross.
    pub epsilon: Option<f64>,
    /// The planes and parents of the level before; `None` for the cross.
    pub cloud: Option<Cloud>,
    /// Where the level before lies at a = 1; `None` for the cross.
    pub projection: Option<Projection>,
    /// The local frame of planes, projection and sheet.
    pub frame: Frame,
    /// Where each billboard lies on the page.
    pub sheet: Sheet,
    /// What the billboards show.
    pub page: Page,
    /// Texels of at least this alpha are drawn; 0 where alpha is coverage, and nothing is cut out.
    pub alpha_cutoff: f32,
    /// Whether the sides have textures of their own, as pairs of single-sided billboards.
    pub two_sided: bool,
    /// Each billboard's place in the pruning order; pairs share theirs.
    pub ranks: Vec<f32>,
    /// Area-weighted mean deviation from the level before.
    pub mean_deviation: f64,
    /// The greatest motion within a plane.
    pub in_plane_motion: f64,
    /// Bound of the deviation from the leaves: the deviations of all levels so far, added.
    pub max_deviation_leaves: f64,
    /// What it looks like beside the leaves.
    pub judgement: Judgement,
    /// Where the time went.
    pub seconds: Seconds,
    /// What each image of the page took of `seconds.bake`.
    pub channel_seconds: ChannelSeconds,
    /// Of all trees that share the page, with the cutoffs that engines draw them at; empty where none does.
    pub(super) sharers: Arc<[Part]>,
    pub(super) engine: OnceLock<(Image, f32)>,
}

/// What a level is built from.
pub(super) struct Step<'a> {
    /// The level before.
    pub finer: &'a Foliage,
    /// What can be seen of it.
    pub opacity: Opacity,
    /// R of the leaves.
    pub radius: f64,
    /// How it is fitted; ε as a share of `radius`.
    pub fit: FitSettings,
    /// Of the level before from the leaves.
    pub deviation: f64,
    /// Texels of the page.
    pub page: PageSize,
    /// What the page shows.
    pub channels: Channels,
    /// Over the leaves and the wood, when a channel depends on it.
    pub sky: Option<&'a Sky>,
    /// Of the leaves.
    pub judges: &'a Judges,
}

/// Planes with their places on the page.
struct Layout {
    cloud: Cloud,
    projection: Projection,
    sheet: Sheet,
    two_sided: bool,
    /// Finding the planes, and choosing the stretch by looks.
    seconds: [f64; 2],
}

/// The layout within the settings. The default size limit doubles, up to none, while the level has more than half of the triangles of the level
/// before it or more billboards than the page holds.
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

/// `None` where the triangles are counted and too many.
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
    let projection = tune::projection(finer, &cloud, &step.judges.tuning)?;
    let projected = Instant::now();
    let shape = OutlineSettings { corners: settings.fit.max_corners };
    let outlines = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], opacity, shape);
    let two_sided = match settings.back_sides {
        Some(wish) => wish,
        None => sides::differ(finer, &cloud, &projection, &outlines)?,
    };
    let pack = if settings.tight_pages { Sheet::pack } else { Sheet::pack_loosely };
    let sheet = pack(&cloud.planes, &outlines, SheetSettings::of_size(step.page, two_sided))?;
    let seconds = [fitted - started, projected - fitted].map(|time| time.as_secs_f64());
    Ok(Some(Layout { cloud, projection, sheet, two_sided, seconds }))
}

pub(super) fn build(step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Level> {
    let (started, finer) = (Instant::now(), step.finer);
    let Layout { cloud, projection, sheet, two_sided, seconds: [fit, stretch] } =
        layout(step, settings, progress.part(0.0, 0.65))?;
    let packed = Instant::now();

    progress.tell("bake", 0.65)?;
    // One texture for both sides shows leaves from either side.
    let either = if two_sided { None } else { Some(finer.double_sided()) };
    let shown = either.as_ref().unwrap_or(finer);
    let channels = (&step.channels, step.sky);
    // What is blended and drawn twice hides twice as much.
    let (page, channel_seconds) = if settings.close_cracks && !settings.blended {
        bake_timed(&sheet, settings.samples, channels, drawn::all_triangles(shown, &cloud, &projection))
    } else {
        bake_timed(&sheet, settings.samples, channels, drawn::own_triangles(shown, &cloud, &projection))
    };
    let baked = Instant::now();
    progress.tell("bake", 0.9)?;
    let ranks = billboard_ranks(&sheet, finer.frame(), settings.fit.seed)?;
    let (page, alpha_cutoff) = if settings.blended {
        (tune::blended(&sheet, &page, finer.frame(), !two_sided, &step.judges.tuning)?, 0.0)
    } else {
        let collapsed = projection.at(finer, HAND_OVER)?;
        let views = tune::views_of_places(settings.looks.places, settings.up)?;
        let before = Judge::new(&[&collapsed], finer.frame(), views)?;
        let best = tune::cutoff(&sheet, &page, finer.frame(), !two_sided, &before)?;
        let cutoff = tune::matched(best, &sheet, &page, finer.frame(), !two_sided, &step.judges.tuning)?;
        (page, cutoff)
    };
    let page = tune::page(&sheet, page, finer.frame(), alpha_cutoff, !two_sided, &step.judges.tuning)?;
    let shown = billboards(&sheet, finer.frame(), page.material(alpha_cutoff, !two_sided))?;
    let judgement = step.judges.report.judge(&shown)?;
    tune::check_shown(&judgement, &page, alpha_cutoff)?;
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
        judgement,
        cloud: Some(cloud),
        projection: Some(projection),
        sharers: Arc::default(),
        sheet,
        page,
        seconds: Seconds {
            fit,
            pack: (packed - started).as_secs_f64() - fit - stretch,
            bake: (baked - packed).as_secs_f64(),
            look: stretch + baked.elapsed().as_secs_f64(),
        },
        channel_seconds,
        engine: OnceLock::new(),
    })
}

/// The pruning order of billboards, as of leaves.
pub(super) fn billboard_ranks(sheet: &Sheet, frame: &Frame, seed: u64) -> Result<Vec<f32>> {
    let shell = billboards(sheet, frame, Material::default())?;
    let by_leaf = prune::order(&shell, &[], seed);
    let triangles = sheet.outline_corners() - 2;
    Ok(shell.leaf_ids().iter().step_by(triangles).map(|&leaf| by_leaf[leaf as usize]).collect())
}

impl Level {
    /// Whether this is the last level, the crossed billboards of the whole tree.
    #[must_use]
    pub fn is_cross(&self) -> bool {
        self.cloud.is_none()
    }

    /// Regions of the page start at multiples of so many texels where they move to another page, so that mip levels stay the same.
    pub(super) fn grid(&self) -> usize {
        if self.is_cross() { 1 << CASCADE_LEVELS } else { 1 }
    }

    /// The base colour and the cutoff with which engines draw the level that make mip levels themselves, made when first asked for. Not to
    /// be asked for on a worker of rayon's: who waits for it does not help.
    pub fn for_engines(&self) -> &(Image, f32) {
        self.engine.get_or_init(|| match self.alpha_cutoff {
            0.0 => (self.page.base_color.clone(), 0.0), // Plain means keep what is covered.
            cutoff if self.is_cross() => keeping_area(&self.page.base_color, cutoff),
            cutoff => for_plain_means(&self.page.base_color, cutoff),
        })
    }

    /// The mip levels of a channel, of base colour as engines draw it. `None` for a channel that is not there or has none.
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

    /// Where on one of those levels of a channel, of so many texels, alpha is cut out, and the least code that passes.
    #[must_use]
    pub fn cut_outs(&self, channel: &str, number: usize, width: usize, height: usize) -> Vec<(Region, u8)> {
        let cut = channel == "base_color" && self.alpha_cutoff > 0.0;
        if cut { mips::cut_outs(&self.parts(), number, width, height) } else { Vec::new() }
    }

    /// Who shares the page as engines draw it, the level among them.
    fn parts(&self) -> Cow<'_, [Part]> {
        if self.sharers.is_empty() {
            Cow::Owned(vec![Part::of(&self.sheet, self.for_engines().1)])
        } else {
            Cow::Borrowed(&self.sharers)
        }
    }

    /// The level's share of its page, by the area of what lies on it; 1 where it has the page for itself.
    #[must_use]
    pub fn page_share(&self) -> f64 {
        let area = |regions: &[Region]| regions.iter().map(|region| region.width * region.height).sum::<usize>() as f64;
        let all: f64 = self.sharers.iter().map(|part| area(&part.regions)).sum();
        if all > 0.0 { self.sheet.texels() as f64 / all } else { 1.0 }
    }

    /// The billboards as foliage again: a fan of triangles each, corners (0, 1, 2), (0, 2, 3) and so on; a pair is one leaf.
    ///
    /// # Errors
    /// All billboards are without area.
    pub fn foliage(&self) -> Result<Foliage> {
        billboards(&self.sheet, &self.frame, self.page.material(self.alpha_cutoff, !self.two_sided))
    }
}

/// A fan of triangles for each billboard; pairs are one leaf.
///
/// # Errors
/// All billboards are without area.
pub fn billboards(sheet: &Sheet, frame: &Frame, material: Material) -> Result<Foliage> {
    let positions: Vec<DVec3> =
        sheet.billboards.iter().flat_map(|b| b.outline_corners().map(|corner| frame.to_caller(corner))).collect();
    let corners = sheet.outline_corners();
    let mut triangles = Vec::with_capacity((corners - 2) * sheet.billboards.len());
    let mut attributes = Attributes::default();
    for (index, billboard) in (0u32..).zip(&sheet.billboards) {
        let uvs: Vec<Vec2> = sheet.uvs(billboard).map(Vec2::from_array).collect();
        for second in 1..corners - 1 {
            let fan = [0, second, second + 1];
            triangles.push(fan.map(|i| corners as u32 * index + i as u32));
            attributes.uvs.push(fan.map(|i| uvs[i]));
            attributes.leaf_ids.push(i64::from(billboard.plane));
        }
    }
    Foliage::new(&positions, triangles, attributes, vec![material])
}
