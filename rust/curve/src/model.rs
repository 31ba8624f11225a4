//! Prediction of seconds and error from the measurements of a sweep.
//!
//! A sweep changes one setting at a time, so settings are assumed to act as factors: on logarithmic axes each setting has a curve through
//! its points, and the curves add up. Two settings interact: a smaller ε puts more billboards on a page, so texels become larger. So error
//! is predicted from ε and texel size, and texel size from ε and page. The model adds the costs that a quick sweep leaves out: the measured
//! fit of all leaves, the measured extra time of a view of all leaves, and the larger number of views. Tight packing adds the same time
//! to every cloud. Texture time is a cost for each texel and for each sample of a texel; metrics cost time for each texel of a page. Pages
//! halve from level to level.

use leafcloud::atlas::tight_work;
use leafcloud::fit::{Effort, Method};
use leafcloud::lod::ViewCounts;

use crate::choice::Choice;
use crate::sweep::{Curve, Point, Stages, Sweep};

/// Predicted cost and error of settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Seconds to build the whole chain.
    pub seconds: f64,
    /// Image error of the finest level, mean FLIP in [0, 1].
    pub image_error: f64,
}

/// A figure of a point, for a logarithmic axis.
type Figure<'f> = &'f dyn Fn(&Point) -> f64;

/// The settings with curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Setting {
    Epsilon,
    Page,
    Candidates,
    Samples,
    Effort,
    Levels,
    Tight,
}

impl Setting {
    const ALL: [Self; 7] =
        [Self::Epsilon, Self::Page, Self::Candidates, Self::Samples, Self::Effort, Self::Levels, Self::Tight];

    /// Returns the setting as a number above 0.
    fn of(self, choice: &Choice) -> f64 {
        match self {
            Self::Epsilon => choice.epsilon,
            Self::Page => choice.texture_size as f64,
            Self::Candidates => choice.candidates as f64,
            Self::Samples => choice.samples as f64,
            // The least number of steps of each search.
            Self::Effort => match choice.effort {
                Effort::Literal => 1.0,
                Effort::Default => 100.0,
                Effort::Final => 3000.0,
                Effort::Best => 30_000.0,
            },
            Self::Levels => (choice.levels + usize::from(choice.cross)) as f64,
            Self::Tight => f64::from(u8::from(choice.tight_pages)) + 1.0,
        }
    }
}

/// The settings that affect packing.
const PACKING: [Setting; 3] = [Setting::Epsilon, Setting::Levels, Setting::Tight];

/// The settings that act on the error independently.
const ALONE: [Setting; 3] = [Setting::Candidates, Setting::Samples, Setting::Effort];

/// Mean number of renderings of the leaves from each view to choose the stretch limit; renderings to compare the sides of billboards.
const STRETCHES: f64 = 4.0;
const SIDES: f64 = 2.0;

/// Approximate time for a texel of a large page relative to a page of a quick sweep, on the measured trees: sharper texture levels are
/// read, and less of them stays in a cache.
const LARGE_PAGES: f64 = 1.5;

/// Smallest figure, in seconds or as a share; smaller ones count as this.
const LEAST: f64 = 1e-5;

/// Extrapolation of a line beyond its ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Beyond {
    /// Continues the last segment.
    Straight,
    /// Constant toward smaller values; continues the last segment toward larger ones.
    LevelBelow,
}

/// Polyline through points with ascending x.
#[derive(Clone, Debug)]
struct Line(Vec<(f64, f64)>);

impl Line {
    fn new(mut points: Vec<(f64, f64)>) -> Self {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by(|a, b| a.0 == b.0);
        Self(points)
    }

    /// Returns the value at `x`; 0 without points.
    fn at(&self, x: f64, beyond: Beyond) -> f64 {
        let points = &self.0;
        let Some(first) = points.first() else { return 0.0 };
        if points.len() == 1 {
            return first.1;
        }
        let x = if beyond == Beyond::LevelBelow { x.max(first.0) } else { x };
        let end = points.iter().position(|p| p.0 >= x).unwrap_or(points.len() - 1).max(1);
        let (a, b) = (points[end - 1], points[end]);
        a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)
    }
}

/// Prediction model of a sweep.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    curve: &'a Curve,
    base: &'a Point,
    /// Cost of the views relative to that of the base's views.
    more_views: f64,
    /// Time to fit all leaves relative to the base's fit.
    fit_whole: f64,
    /// Seconds to bake a texel: fixed, and for each sample.
    bake: (f64, f64),
    /// Factor on `bake` for pages of full size.
    baked: f64,
    /// Seconds of the metrics for each texel of a page.
    metrics: f64,
    /// Seconds that tight packing adds to each cloud.
    tight: f64,
    /// Error over texel size, from the pages in the sweep.
    by_texel: Line,
}

impl<'a> Model<'a> {
    /// Returns the model of a curve; its first point is the base.
    #[must_use]
    pub fn new(curve: &'a Curve) -> Self {
        let base = &curve.points[0];
        let plain = Self {
            curve,
            base,
            more_views: if curve.sweep == Sweep::Quick { more_views(curve.settings.views) } else { 1.0 },
            fit_whole: curve.rest.map_or(1.0, |rest| (rest.fit / base.seconds.fit.max(LEAST)).max(1.0)),
            bake: (0.0, 0.0),
            baked: if curve.sweep == Sweep::Quick { LARGE_PAGES } else { 1.0 },
            metrics: 0.0,
            tight: 0.0,
            by_texel: Line(Vec::new()),
        };
        let by_texel = plain.along(Setting::Page).map(|p| (log(p.texel), log(p.image_error))).collect();
        Self {
            bake: plain.bake(),
            metrics: plain.for_a_texel(|p| p.seconds.metrics),
            tight: plain.tight(),
            by_texel: Line::new(by_texel),
            ..plain
        }
    }

    /// Returns the predicted cost and error of `choice`.
    #[must_use]
    pub fn predict(&self, choice: &Choice) -> Prediction {
        let seconds = self.stages(choice).total().max(LEAST);
        Prediction { seconds, image_error: self.error(choice).exp().min(1.0) }
    }

    /// Returns the predicted seconds for each stage.
    #[must_use]
    pub fn stages(&self, choice: &Choice) -> Stages {
        let tighter = f64::from(choice.tight_pages) - f64::from(self.base.choice.tight_pages);
        let pack: Figure = &|p| p.seconds.pack;
        let loosely = Choice { tight_pages: self.base.choice.tight_pages, ..*choice };
        let packed = self.figure(pack, &PACKING, &loosely).exp();
        let fitted = [Setting::Epsilon, Setting::Candidates, Setting::Effort, Setting::Levels];
        let viewed =
            self.figure(&|p| self.views(p), &[Setting::Epsilon, Setting::Effort, Setting::Levels], choice).exp();
        let work = |billboards: f64| tight_work(billboards as usize).max(1) as f64;
        let more = work(self.billboards(choice)) / work(self.base.billboards as f64);
        let tight = tighter * self.tight * more * choice.levels as f64;
        let (texel, sample) = self.bake;
        // Only the first level and the cross impostor render the leaves.
        let ViewCounts { amounts, report, .. } = self.curve.settings.views;
        let view = self.curve.rest.map_or(0.0, |rest| rest.view);
        let first = STRETCHES * amounts as f64;
        let cross = if choice.cross { (amounts + report) as f64 } else { 0.0 };
        Stages {
            prepare: self.more_views * self.typical(&|p| p.seconds.prepare, &[]).exp()
                + view * (amounts + report) as f64
                + self.curve.order,
            fit: self.fit_whole * self.figure(&|p| p.seconds.fit, &fitted, choice).exp(),
            pack: (packed + tight).max(0.0) + view * SIDES,
            bake: self.baked * texels(choice) * (texel + sample * (choice.samples * choice.samples) as f64) + view,
            metrics: self.more_views * viewed + self.metrics * texels(choice) + view * (first + cross),
        }
    }

    /// Returns the part of a point's metrics seconds that depends on views, not on texels.
    fn views(&self, point: &Point) -> f64 {
        let seconds = point.seconds.metrics;
        (seconds - self.metrics * texels(&point.choice)).max(0.1 * seconds)
    }

    /// Returns the points that differ from the base at most in `setting`.
    fn along(&self, setting: Setting) -> impl Iterator<Item = &'a Point> {
        let base = self.base;
        self.curve.points.iter().filter(move |p| {
            let differs = |other: &Setting| *other != setting && other.of(&p.choice) != other.of(&base.choice);
            let alike = kind(&p.choice) == kind(&base.choice) && p.measured_on == base.measured_on;
            alike && !Setting::ALL.iter().any(differs)
        })
    }

    /// Returns the change of the figure's logarithm from the base if only `setting` changes to that of `choice`.
    fn effect(&self, figure: Figure, setting: Setting, choice: &Choice) -> f64 {
        self.effect_beside(log(figure(self.base)), figure, setting, choice)
    }

    /// Returns the same change as [`Self::effect`] with a better estimate `base` of the base's logarithm.
    fn effect_beside(&self, base: f64, figure: Figure, setting: Setting, choice: &Choice) -> f64 {
        let at_base = setting.of(&self.base.choice);
        let value = |p: &Point| if setting.of(&p.choice) == at_base { base } else { log(figure(p)) };
        let line = Line::new(self.along(setting).map(|p| (setting.of(&p.choice).ln(), value(p))).collect());
        line.at(setting.of(choice).ln(), Beyond::Straight) - base
    }

    /// Returns the effect of a method other than the base's: the logarithm at its point nearest in ε, minus the base method's prediction
    /// there.
    fn effect_of_kind(&self, figure: Figure, choice: &Choice) -> f64 {
        if kind(choice) == kind(&self.base.choice) {
            return 0.0;
        }
        let same = self.curve.points.iter().filter(|p| kind(&p.choice) == kind(choice));
        let near = |p: &&Point| (p.choice.epsilon / choice.epsilon).ln().abs();
        let nearest = same.min_by(|a, b| near(a).total_cmp(&near(b)));
        nearest
            .map_or(0.0, |p| log(figure(p)) - log(figure(self.base)) - self.effect(figure, Setting::Epsilon, &p.choice))
    }

    /// Returns the predicted logarithm of a figure that depends on these axes only; all points measure it.
    fn figure(&self, figure: Figure, axes: &[Setting], choice: &Choice) -> f64 {
        let base = self.typical(figure, axes);
        let effects: f64 = axes.iter().map(|setting| self.effect_beside(base, figure, *setting, choice)).sum();
        base + effects + self.effect_of_kind(figure, choice)
    }

    /// Returns the median of the figure's logarithm over the base and all points that differ from it along other axes only. Single timings
    /// of stages that take a few hundredths of a second are off by tens of percent.
    fn typical(&self, figure: Figure, axes: &[Setting]) -> f64 {
        let base = self.base;
        let alike = |p: &&Point| {
            let same = |setting: &Setting| setting.of(&p.choice) == setting.of(&base.choice);
            kind(&p.choice) == kind(&base.choice) && p.measured_on == base.measured_on && axes.iter().all(same)
        };
        let mut values: Vec<f64> = self.curve.points.iter().filter(alike).map(|p| log(figure(p))).collect();
        values.sort_by(f64::total_cmp);
        0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
    }

    /// Returns the predicted number of billboards of level 1, pairs counted once.
    pub(crate) fn billboards(&self, choice: &Choice) -> f64 {
        let base = self.base.billboards.max(1) as f64;
        let whole = self.curve.rest.map_or(base, |rest| (rest.billboards as f64).max(base));
        whole * self.effect(&|p| p.billboards as f64, Setting::Epsilon, choice).exp()
    }

    /// Returns the predicted side of a texel of level 1, a share of R.
    pub(crate) fn texel(&self, choice: &Choice) -> f64 {
        self.log_texel(choice).exp()
    }

    fn log_texel(&self, choice: &Choice) -> f64 {
        let texel: Figure = &|p| p.texel;
        let axes = [Setting::Epsilon, Setting::Page];
        log(texel(self.base)) + axes.iter().map(|setting| self.effect(texel, *setting, choice)).sum::<f64>()
    }

    fn error(&self, choice: &Choice) -> f64 {
        let error: Figure = &|p| p.image_error;
        // The effect of ε alone: the error minus the effect of the point's texel size.
        let alone = |p: &Point| log(error(p)) - self.by_texel.at(log(p.texel), Beyond::LevelBelow);
        let line = Line::new(self.along(Setting::Epsilon).map(|p| (p.choice.epsilon.ln(), alone(p))).collect());
        let size = self.log_texel(choice);
        let others: f64 = ALONE.iter().map(|setting| self.effect(error, *setting, choice)).sum();
        line.at(choice.epsilon.ln(), Beyond::Straight)
            + self.by_texel.at(size, Beyond::LevelBelow)
            + others
            + self.effect_of_kind(error, choice)
    }

    /// Returns the seconds that each texel adds to a stage, from the smallest to the largest page in the sweep.
    fn for_a_texel(&self, stage: fn(&Point) -> f64) -> f64 {
        let size = |p: &&Point| p.choice.texture_size;
        let (small, large) = (self.along(Setting::Page).min_by_key(size), self.along(Setting::Page).max_by_key(size));
        let (Some(small), Some(large)) = (small, large) else { return 0.0 };
        let more = texels(&large.choice) - texels(&small.choice);
        if more > 0.0 { ((stage(large) - stage(small)) / more).max(0.0) } else { 0.0 }
    }

    /// Returns the seconds to bake a texel, and the seconds that each of its samples adds.
    fn bake(&self) -> (f64, f64) {
        let count = |p: &&Point| p.choice.samples;
        let (few, many) =
            (self.along(Setting::Samples).min_by_key(count), self.along(Setting::Samples).max_by_key(count));
        let squared = |p: &Point| (p.choice.samples * p.choice.samples) as f64;
        let all = texels(&self.base.choice);
        let sample = match (few, many) {
            (Some(few), Some(many)) if squared(many) > squared(few) => {
                (many.seconds.bake - few.seconds.bake).max(0.0) / (all * (squared(many) - squared(few)))
            }
            _ => 0.0,
        };
        let texel = self.for_a_texel(|p| p.seconds.bake);
        // With a single page size, take the base's whole time.
        let texel = if texel > 0.0 { texel } else { self.base.seconds.bake / all };
        ((texel - sample * squared(self.base)).max(0.0), sample)
    }

    fn tight(&self) -> f64 {
        let other = self.along(Setting::Tight).find(|p| p.choice.tight_pages != self.base.choice.tight_pages);
        let base = self.typical(&|p| p.seconds.pack, &PACKING).exp();
        let more = other.map_or(0.0, |p| (p.seconds.pack - base).abs());
        more / self.base.choice.levels.max(1) as f64
    }
}

/// Returns the texels of the pages of all levels, as if they were square.
fn texels(choice: &Choice) -> f64 {
    let side = |level: usize| (choice.texture_size >> level).max(64);
    (0..choice.levels + usize::from(choice.cross)).map(|level| (side(level) * side(level)) as f64).sum()
}

/// Returns the cost of the views relative to that of a quick sweep.
fn more_views(views: ViewCounts) -> f64 {
    // Cost of a direction in each measurement: approximate number of renderings, times the samples of a picture.
    let all =
        |ViewCounts { amounts, report, .. }: ViewCounts| 26.0 * 36_864.0 * amounts as f64 + 262_144.0 * report as f64;
    all(views) / all(ViewCounts::QUICK)
}

/// Returns the kind of a choice: the method, and whether it is the published search. Kinds have no order.
fn kind(choice: &Choice) -> (Method, bool) {
    (choice.method, choice.method == Method::Stochastic && choice.effort == Effort::Literal)
}

fn log(figure: f64) -> f64 {
    figure.max(LEAST).ln()
}
