//! Predicts seconds and error from what a sweep measured.
//!
//! A sweep changes one setting at a time, so settings are taken to act by factors: on logarithmic axes each has a curve through its points, and the
//! curves add up. Two things go together: the smaller ε, the more billboards share a page, and the larger are its texels. So error follows from ε
//! and from the size of a texel, which follows from ε and the page. What a quick sweep leaves out is put back: time grows by a line through the
//! two samples of the leaves up to all of them, and with the number of looks.

use leafcloud::fit::{Effort, Method};
use leafcloud::lod::Looks;

use crate::choice::Choice;
use crate::sweep::{Curve, Point, Stages};

/// What settings are expected to cost and to give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Of the whole chain.
    pub seconds: f64,
    /// The judge's error of the finest level.
    pub image_error: f64,
}

/// What is read off a point, on a logarithmic axis.
type Figure = fn(&Point) -> f64;

/// A setting as a number above 0 on a logarithmic axis.
type Setting = fn(&Choice) -> f64;

/// The settings that have curves. Effort counts the fewest steps of its search.
const SETTINGS: [Setting; 6] = [EPSILON, PAGE, |c| c.candidates as f64, |c| c.samples as f64, steps, levels];
const EPSILON: Setting = |c| c.epsilon;
const PAGE: Setting = |c| c.texture_size as f64;

const STAGES: [Figure; 5] =
    [|p| p.seconds.prepare, |p| p.seconds.fit, |p| p.seconds.pack, |p| p.seconds.bake, |p| p.seconds.look];

/// Less than this is not told apart, seconds or a share.
const LEAST: f64 = 1e-5;

fn steps(choice: &Choice) -> f64 {
    match choice.effort {
        Effort::Literal => 1.0,
        Effort::Default => 100.0,
        Effort::Final => 3000.0,
        Effort::Best => 30_000.0,
    }
}

fn levels(choice: &Choice) -> f64 {
    (choice.levels + usize::from(choice.cross)) as f64
}

/// How a line goes on beyond its ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Beyond {
    /// As its last part does.
    Straight,
    /// Not at all.
    Level,
}

/// Through points with ascending x.
#[derive(Clone, Debug)]
struct Line(Vec<(f64, f64)>);

impl Line {
    fn new(mut points: Vec<(f64, f64)>) -> Self {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by(|a, b| a.0 == b.0);
        Self(points)
    }

    /// 0 without points.
    fn at(&self, x: f64, beyond: Beyond) -> f64 {
        let points = &self.0;
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return 0.0 };
        if points.len() == 1 {
            return first.1;
        }
        let x = if beyond == Beyond::Level { x.clamp(first.0, last.0) } else { x };
        let end = points.iter().position(|p| p.0 >= x).unwrap_or(points.len() - 1).max(1);
        let (a, b) = (points[end - 1], points[end]);
        a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)
    }
}

/// Predicts from a sweep.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    curve: &'a Curve,
    base: &'a Point,
    /// What each stage takes beside the base's own, for all the leaves and all looks.
    whole: [f64; 5],
    /// By the texel's size: the error, from the pages that were tried.
    by_texel: Line,
}

impl<'a> Model<'a> {
    /// The first point of the curve is the base.
    #[must_use]
    pub fn new(curve: &'a Curve) -> Self {
        let base = &curve.points[0];
        let mut model = Self { curve, base, whole: [1.0; 5], by_texel: Line(Vec::new()) };
        let texels = model.along(PAGE).map(|p| (log(p.texel), log(p.image_error))).collect();
        model.by_texel = Line::new(texels);
        model.whole = model.whole();
        model
    }

    /// What `choice` is expected to cost and to give.
    #[must_use]
    pub fn predict(&self, choice: &Choice) -> Prediction {
        let seconds = (0..5).map(|stage| self.whole[stage] * self.figure(STAGES[stage], choice).exp()).sum();
        Prediction { seconds, image_error: self.error(choice).exp().min(1.0) }
    }

    /// The points that differ from the base in one setting at most.
    fn along(&self, setting: Setting) -> impl Iterator<Item = &'a Point> {
        let base = self.base;
        self.curve.points.iter().filter(move |p| {
            let others =
                SETTINGS.iter().filter(|s| s(&p.choice) != s(&base.choice) && **s as usize != setting as usize);
            others.count() == 0 && kind(&p.choice) == kind(&base.choice) && p.measured_on == base.measured_on
        })
    }

    /// How far the figure's logarithm is from the base's where only `setting` is that of `choice`.
    fn effect(&self, figure: Figure, setting: Setting, choice: &Choice) -> f64 {
        let line = Line::new(self.along(setting).map(|p| (setting(&p.choice).ln(), log(figure(p)))).collect());
        line.at(setting(choice).ln(), Beyond::Straight) - log(figure(self.base))
    }

    /// Of a method that is not the base's: what its point nearest in ε has beside what would be predicted there for the base's.
    fn effect_of_kind(&self, figure: Figure, choice: &Choice) -> f64 {
        if kind(choice) == kind(&self.base.choice) {
            return 0.0;
        }
        let same = self.curve.points.iter().filter(|p| kind(&p.choice) == kind(choice));
        let near = |p: &&Point| (p.choice.epsilon / choice.epsilon).ln().abs();
        let nearest = same.min_by(|a, b| near(a).total_cmp(&near(b)));
        nearest.map_or(0.0, |p| log(figure(p)) - log(figure(self.base)) - self.effect(figure, EPSILON, &p.choice))
    }

    fn figure(&self, figure: Figure, choice: &Choice) -> f64 {
        let effects: f64 = SETTINGS.iter().map(|setting| self.effect(figure, *setting, choice)).sum();
        log(figure(self.base)) + effects + self.effect_of_kind(figure, choice)
    }

    fn error(&self, choice: &Choice) -> f64 {
        let error: Figure = |p| p.image_error;
        let texel: Figure = |p| p.texel;
        // What ε alone does: the error beside what the texels of its point would do to the base's.
        let alone = |p: &Point| log(error(p)) - self.by_texel.at(log(p.texel), Beyond::Level);
        let line = Line::new(self.along(EPSILON).map(|p| (EPSILON(&p.choice).ln(), alone(p))).collect());
        let size = log(texel(self.base)) + self.effect(texel, EPSILON, choice) + self.effect(texel, PAGE, choice);
        let others: f64 = SETTINGS[2..].iter().map(|setting| self.effect(error, *setting, choice)).sum();
        line.at(EPSILON(choice).ln(), Beyond::Straight)
            + self.by_texel.at(size, Beyond::Level)
            + others
            + self.effect_of_kind(error, choice)
    }

    /// From a sample and few looks to all.
    fn whole(&self) -> [f64; 5] {
        let smaller = self.curve.points.iter().find(|p| p.measured_on < self.base.measured_on);
        let mut whole = [1.0; 5];
        for (stage, whole) in STAGES.iter().zip(&mut whole) {
            let Some(smaller) = smaller else { continue };
            let (few, some) = (smaller.measured_on as f64, self.base.measured_on as f64);
            let slope = (stage(self.base) - stage(smaller)).max(0.0) / (some - few);
            *whole = 1.0 + slope * (self.curve.triangles as f64 - some) / stage(self.base).max(LEAST);
        }
        let looks = if self.curve.sweep == crate::Sweep::Quick { more_looks(self.curve.settings.looks) } else { 1.0 };
        whole[0] *= looks;
        whole[4] *= looks;
        whole
    }
}

/// How many times as many looks as a quick sweep's.
fn more_looks(looks: Looks) -> f64 {
    let all = |Looks { places, amounts, report }: Looks| (places + amounts + report) as f64;
    all(looks) / all(Looks::QUICK)
}

/// What has no order: the method; the published search is one of its own.
fn kind(choice: &Choice) -> (Method, bool) {
    (choice.method, choice.method == Method::Stochastic && choice.effort == Effort::Literal)
}

fn log(figure: f64) -> f64 {
    figure.max(LEAST).ln()
}

impl Stages {
    /// How far another total is off, as a share of this one.
    #[must_use]
    pub fn off_by(&self, predicted: f64) -> f64 {
        predicted / self.total() - 1.0
    }
}
