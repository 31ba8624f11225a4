//! Sweeps: chains built with many settings, each measured.

use std::time::Instant;

use glam::DVec3;
use leafcloud::error::{Error, Result};
use leafcloud::fit::{Effort, FitSettings, Method, fit};
use leafcloud::foliage::{Foliage, Opacity};
use leafcloud::lod::{Chain, ChainSettings, Level, Refinement, ViewCounts, build_chain, settled_fit};
use leafcloud::metrics::{View, render, visibility};
use leafcloud::textures::Samples;
use leafcloud::{Progress, prune};
use leafcloud_flip::image_error;

use crate::choice::Choice;
use crate::front::front;
use crate::memory::peak;

/// Extent of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    /// Every setting, on all leaves: takes minutes.
    Full,
    /// Few settings, on a sample of the leaves, with few views and small pages: takes seconds.
    Quick,
}

/// Seconds for each stage, all levels together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stages {
    /// Pruning order, reference renderings of the leaves, sky visibility.
    pub prepare: f64,
    /// Planes, and the parent plane of each triangle.
    pub fit: f64,
    /// Outlines and atlases.
    pub pack: f64,
    /// Textures.
    pub bake: f64,
    /// Metrics.
    pub metrics: f64,
}

impl Stages {
    /// Returns the stages of a chain.
    #[must_use]
    pub fn of(chain: &Chain) -> Self {
        let sum = |stage: fn(&Level) -> f64| chain.levels.iter().map(stage).sum();
        Self {
            prepare: chain.prepare_seconds,
            fit: sum(|level| level.seconds.fit),
            pack: sum(|level| level.seconds.pack),
            bake: sum(|level| level.seconds.bake),
            metrics: sum(|level| level.seconds.metrics),
        }
    }

    /// Returns the stages with their names, in order.
    #[must_use]
    pub const fn named(&self) -> [(&'static str, f64); 5] {
        let Self { prepare, fit, pack, bake, metrics } = *self;
        [("prepare", prepare), ("fit", fit), ("pack", pack), ("bake", bake), ("look", metrics)]
    }

    /// Returns the sum of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.named().into_iter().map(|(_, seconds)| seconds).sum()
    }
}

/// Measured cost and result of a choice. Lengths are shares of R.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The settings.
    pub choice: Choice,
    /// Number of leaf triangles in the measurement.
    pub measured_on: usize,
    /// Seconds for each stage.
    pub seconds: Stages,
    /// Greatest growth of the process in bytes; `None` on systems that do not report it.
    pub peak_bytes: Option<u64>,
    /// Billboards of level 1, pairs counted once.
    pub billboards: usize,
    /// Triangles of these billboards.
    pub triangles: usize,
    /// Texels in billboards, all levels.
    pub texels: usize,
    /// Graphics memory of all levels: four bytes for each texel of the pages and their mip levels, and 32 bytes for each corner.
    pub bytes: u64,
    /// Side of a texel of level 1.
    pub texel: f64,
    /// The greatest distance of a leaf from its billboard on level 1.
    pub max_deviation: f64,
    /// The area-weighted mean distance of a leaf from its billboard on level 1.
    pub mean_deviation: f64,
    /// Image error of the finest level, mean FLIP in [0, 1].
    pub image_error: f64,
    /// Whether the point is on the Pareto front of seconds and error.
    pub front: bool,
}

/// A choice that cannot be built.
#[derive(Clone, Debug, PartialEq)]
pub struct Refused {
    /// The settings.
    pub choice: Choice,
    /// The reason, in one line.
    pub reason: String,
}

/// Measurements of a sweep.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Points in the order of measurement. The first is the base; the others change its settings.
    pub points: Vec<Point>,
    /// Choices that could not be built.
    pub refused: Vec<Refused>,
    /// The settings that the sweep started from.
    pub settings: ChainSettings,
    /// Triangles of all leaves.
    pub triangles: usize,
    /// Extent of the sweep.
    pub sweep: Sweep,
    /// Extra cost of all leaves, if a sample was measured.
    pub rest: Option<Rest>,
    /// Seconds for the pruning order, not included in the points of a quick sweep.
    pub order: f64,
}

/// Cost of all leaves, if a quick sweep measured a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Extra seconds to render a view of all leaves rather than of the sample.
    pub view: f64,
    /// Seconds to fit all leaves.
    pub fit: f64,
    /// Number of billboards of that fit.
    pub billboards: usize,
}

impl Rest {
    fn of(whole: &Foliage, sample: &Foliage, settings: &ChainSettings, progress: Progress) -> Result<Self> {
        let frame = whole.frame();
        let view = View {
            direction: DVec3::new(0.6, -1.0, 0.5),
            up: settings.up,
            centre: frame.centre,
            radius: frame.radius * 1.025,
            size: 64,
            samples: Samples::default(),
        };
        let seconds_of = |foliage: &Foliage| timed(|| render(&[foliage], &view)).map(|(_, seconds)| seconds);
        let view = (seconds_of(whole)? - seconds_of(sample)?).max(0.0);
        let (cloud, fit) = timed(|| fit(whole, &settings.fit, progress))?;
        Ok(Self { view, fit, billboards: cloud.planes.len() })
    }
}

/// Returns the predicted seconds for measuring the visible share of each leaf, from the time for a few of the directions.
fn order_seconds(foliage: &Foliage, settings: &ChainSettings) -> Result<f64> {
    let all = settings.views.order;
    let few = all.div_ceil(8);
    let opacity = Opacity::of(foliage);
    let measure = |count| visibility(foliage, &opacity, settings.up, count, Progress::silent());
    measure(few.min(1))?; // The first view builds the texture pyramids.
    let (_, seconds) = timed(|| measure(few))?;
    Ok(seconds * all as f64 / few.max(1) as f64)
}

fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, f64)> {
    let started = Instant::now();
    let result = work()?;
    Ok((result, started.elapsed().as_secs_f64()))
}

impl Point {
    /// Returns the figures of `chain`, which was built from `foliage` with `choice`.
    #[must_use]
    fn of(chain: &Chain, choice: Choice, foliage: &Foliage, peak_bytes: Option<u64>) -> Self {
        let radius = foliage.frame().radius;
        let first = &chain.levels[0];
        let pair = if first.two_sided { 2 } else { 1 };
        let corners =
            |level: &Level| level.atlas.billboards.iter().flat_map(|b| &b.polygons).map(Vec::len).sum::<usize>();
        Self {
            choice,
            measured_on: foliage.triangle_count(),
            seconds: Stages::of(chain),
            peak_bytes,
            billboards: first.atlas.billboards.len() / pair,
            triangles: first.atlas.triangles(),
            texels: chain.levels.iter().map(|level| level.atlas.texels()).sum(),
            bytes: chain.levels.iter().map(|level| page_bytes(level) + 32 * corners(level) as u64).sum(),
            texel: first.atlas.texel() * first.frame.radius / radius,
            max_deviation: first.max_deviation_leaves / radius,
            mean_deviation: first.mean_deviation / radius,
            image_error: image_error(&first.pictures),
            front: false,
        }
    }
}

/// Returns the bytes of a level's images with their mip levels: four thirds of level 0.
fn page_bytes(level: &Level) -> u64 {
    level.page.images().map(|(_, image)| (4 * image.width() * image.height()) as u64 * 4 / 3).sum()
}

/// Builds a chain and measures it.
///
/// # Errors
/// The errors of [`build_chain`].
pub fn measure(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<(Chain, Point)> {
    let (chain, bytes) = peak(|| build_chain(foliage, trunk, settings, progress));
    let chain = chain?;
    let point = Point::of(&chain, Choice::of(settings), foliage, bytes);
    Ok((chain, point))
}

/// Returns the number of triangles in the sample of a quick sweep: a tenth, within bounds.
fn sample_of(triangles: usize) -> usize {
    (triangles / 10).clamp(3_500, 9_000)
}

/// Measures many choices that change `settings`, without refinement: it would take most of the time.
///
/// # Errors
/// Settings outside their ranges; settings with pruning or without a cloud; a budget in a full sweep; no choice that can be built;
/// [`Error::Cancelled`].
pub fn sweep(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    sweep: Sweep,
    progress: Progress,
) -> Result<Curve> {
    settings.check()?;
    if settings.pruning.is_some() || settings.levels == 0 {
        return Err(Error::invalid(
            "a cost curve measures billboard clouds of all leaves; ask for at least one level and no pruning",
        ));
    }
    let FitSettings { method, max_billboards, max_texels, .. } = &settings.fit;
    let budget = max_texels.is_some() || (max_billboards.is_some() && *method != Method::KMeans);
    if budget && sweep == Sweep::Full {
        return Err(Error::invalid(
            "a budget of billboards or texels determines `epsilon`, which a cost curve varies; leave `max_billboards` and `max_texels` out",
        ));
    }
    // All points use one size limit: a default that grew for some points would hide the effect of the other settings.
    // The page is a setting of each point, so no page is made smaller.
    let settings = &ChainSettings {
        fit: settled_fit(settings, foliage, trunk, Progress::silent())?,
        fitting_pages: false,
        refine: Refinement::Off,
        ..settings.clone()
    };
    let mut curve = Curve {
        points: Vec::new(),
        refused: Vec::new(),
        settings: settings.clone(),
        triangles: foliage.triangle_count(),
        sweep,
        rest: None,
        order: 0.0,
    };
    match sweep {
        Sweep::Full => curve.measure_all(foliage, trunk, settings, &full_choices(settings), progress)?,
        Sweep::Quick => {
            curve.order = order_seconds(foliage, settings)?;
            let settings = quick_base(settings);
            let (whole, sample) = (foliage, sampled(foliage, sample_of(foliage.triangle_count()))?);
            let foliage = sample.as_ref().unwrap_or(whole);
            curve.measure_all(foliage, trunk, &settings, &quick_choices(&settings), progress.part(0.0, 0.95))?;
            if let Some(sample) = &sample {
                curve.rest = Some(Rest::of(whole, sample, &settings, progress.part(0.95, 1.0))?);
            }
        }
    }
    if curve.points.is_empty() {
        let reason = curve.refused.first().map_or_else(String::new, |refused| refused.reason.clone());
        return Err(Error::Invalid(reason));
    }
    let costs: Vec<(f64, f64)> = curve.points.iter().map(|p| (p.seconds.total(), p.image_error)).collect();
    for (point, on) in curve.points.iter_mut().zip(front(&costs)) {
        point.front = on;
    }
    progress.tell("measure", 1.0)?;
    Ok(curve)
}

impl Curve {
    fn measure_all(
        &mut self,
        foliage: &Foliage,
        trunk: Option<&Foliage>,
        settings: &ChainSettings,
        choices: &[Choice],
        progress: Progress,
    ) -> Result<()> {
        for (index, choice) in choices.iter().enumerate() {
            let part = |index: usize| index as f64 / choices.len() as f64;
            progress.tell("measure", part(index))?;
            let choice = self.with_clusters(*choice);
            let built = choice.applied(settings);
            let built = built.and_then(|s| measure(foliage, trunk, &s, progress.part(part(index), part(index + 1))));
            match built {
                Ok((_, point)) => self.points.push(point),
                Err(Error::Cancelled) => return Err(Error::Cancelled),
                Err(error) => self.refused.push(Refused { choice, reason: error.to_string() }),
            }
        }
        Ok(())
    }

    /// Gives the method kmeans as many billboards as the method stochastic needed at the same ε.
    fn with_clusters(&self, choice: Choice) -> Choice {
        let same = |p: &&Point| p.choice.method == Method::Stochastic && p.choice.epsilon == choice.epsilon;
        let count = self.points.iter().find(same).map_or(64, |p| p.billboards);
        let clustered = choice.method == Method::KMeans;
        Choice { max_billboards: if clustered { Some(count) } else { choice.max_billboards }, ..choice }
    }
}

/// Returns a share of the leaves, enlarged so that they cover as much; `None` if there are few enough.
fn sampled(foliage: &Foliage, most: usize) -> Result<Option<Foliage>> {
    if foliage.triangle_count() <= most {
        return Ok(None);
    }
    let share = most as f64 / foliage.triangle_count() as f64;
    let ranks = prune::order(foliage, &[], 0);
    Ok(Some(prune::pruned(foliage, &ranks, share, 1.0)?.foliage))
}

/// ε of a quick sweep's base.
const QUICK_EPSILON: f64 = 0.056;

/// Returns `settings` with small and quick values for the choice. ε is at most the size limit of billboards.
fn quick_base(settings: &ChainSettings) -> ChainSettings {
    let quick = Choice {
        method: Method::Stochastic,
        effort: Effort::Default,
        epsilon: settings.fit.max_size.map_or(QUICK_EPSILON, |most| most.min(QUICK_EPSILON)),
        candidates: 600,
        max_billboards: None,
        levels: 1,
        cross: false,
        texture_size: 512,
        samples: 1,
        tight_pages: false,
    };
    let settings = ChainSettings { views: ViewCounts::QUICK, ..settings.clone() };
    quick.applied(&settings).expect("one sample is a number of samples")
}

/// Returns the base, then choices that change one setting at a time.
fn quick_choices(settings: &ChainSettings) -> Vec<Choice> {
    let base = Choice::of(settings);
    let mut all = vec![base];
    let most = settings.fit.max_size.unwrap_or(f64::INFINITY);
    let epsilons = [0.5, 2.0].map(|times| times * base.epsilon).into_iter().filter(|epsilon| *epsilon <= most);
    all.extend(epsilons.map(|epsilon| Choice { epsilon, ..base }));
    all.extend([256, 1024].map(|texture_size| Choice { texture_size, ..base }));
    all.push(Choice { samples: 4, ..base });
    all.push(Choice { effort: Effort::Final, ..base });
    all.push(Choice { levels: 2, cross: true, ..base });
    all.push(Choice { tight_pages: true, ..base });
    all
}

/// Returns the base, choices that change one setting at a time, the other methods at some ε, and choices that are coarse or fine in all.
fn full_choices(settings: &ChainSettings) -> Vec<Choice> {
    let base = Choice::of(settings);
    let mut all = vec![base];
    all.extend([0.01, 0.02, 0.03, 0.04, 0.06, 0.1, 0.16].map(|epsilon| Choice { epsilon, ..base }));
    all.extend([100, 3000].map(|candidates| Choice { candidates, ..base }));
    all.extend([1, 3].map(|levels| Choice { levels, ..base }));
    all.extend([512, 1024, 4096].map(|texture_size| Choice { texture_size, ..base }));
    all.extend([1, 2].map(|samples| Choice { samples, ..base }));
    all.push(Choice { tight_pages: !base.tight_pages, ..base });
    all.extend([Effort::Literal, Effort::Final, Effort::Best].map(|effort| Choice { effort, ..base }));
    let finer = [(0.16, 512, 1), (0.1, 1024, 1), (0.06, 1024, 2), (0.03, 2048, 2), (0.02, 2048, 4), (0.02, 4096, 2)];
    all.extend(finer.map(|(epsilon, texture_size, samples)| Choice { epsilon, texture_size, samples, ..base }));
    for method in [Method::Density, Method::KMeans] {
        all.extend([0.02, 0.04, 0.1].map(|epsilon| Choice { method, epsilon, ..base }));
    }
    let mut kept: Vec<Choice> = Vec::new();
    for choice in all {
        if !kept.contains(&choice) {
            kept.push(choice);
        }
    }
    kept
}
