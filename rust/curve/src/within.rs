//! A chain that meets a wish: the best quality within a time limit, the shortest time within an error limit, or a preset.
//!
//! The settings come from the Pareto front of the predictions of a quick sweep. Predictions are off by some ten percent, so each built
//! chain is measured, and the deviation corrects the prediction for the next try.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use leafcloud::atlas::AtlasSettings;
use leafcloud::error::{Error, Result};
use leafcloud::fit::{Effort, Method};
use leafcloud::limits::Limits;
use leafcloud::lod::{Chain, ChainSettings, Refinement, build_chain};
use leafcloud::{Foliage, Progress};

use crate::choice::Choice;
use crate::front::front;
use crate::model::{Model, Prediction};
use crate::sweep::{Curve, Point, Sweep, measure, sweep};

/// A position on the Pareto front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// The quickest with at most twice the least error.
    Draft,
    /// The quickest with at most 1.25 times the least error.
    Balanced,
    /// The least error.
    Final,
}

impl Preset {
    /// All presets, quickest first.
    pub const ALL: [Self; 3] = [Self::Draft, Self::Balanced, Self::Final];

    /// Returns the name in settings.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Balanced => "balanced",
            Self::Final => "final",
        }
    }

    /// Returns the preset with this name.
    ///
    /// # Errors
    /// An unknown name.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|preset| preset.name() == name)
            .ok_or_else(|| Error::invalid(format!("preset {name:?} is unknown; choose one of: draft, balanced, final")))
    }

    /// Returns the offer of this preset; `None` without offers.
    #[must_use]
    pub fn of(self, offers: &[Offer]) -> Option<&Offer> {
        let least = offers.last()?.predicted.image_error;
        let most = match self {
            Self::Draft => 2.0,
            Self::Balanced => 1.25,
            Self::Final => 1.0,
        };
        offers.iter().find(|offer| offer.predicted.image_error <= most * least)
    }
}

/// Range of a wish for a time.
pub const SECONDS: Limits = Limits::POSITIVE;

/// Range of a wish for an image error.
pub const IMAGE_ERROR: Limits = Limits { above: true, below: true, ..Limits::SHARE };

/// The goal for a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// Best quality within this many seconds, above 0; the quick sweep counts.
    Seconds(f64),
    /// Shortest time with at most this error, in (0, 1).
    ImageError(f64),
    /// A position on the Pareto front.
    Preset(Preset),
}

/// Settings on the Pareto front of the predictions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// The settings.
    pub choice: Choice,
    /// Their predicted cost and error.
    pub predicted: Prediction,
}

/// Result of a wish.
#[derive(Clone, Debug)]
pub struct Built {
    /// The levels.
    pub chain: Chain,
    /// Their settings and the prediction for them.
    pub offer: Offer,
    /// Number of chains built.
    pub tries: usize,
}

/// Values of ε in offers.
const EPSILONS: [f64; 9] = [0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.11, 0.16];

/// Halvings of the requested page in offers, and the smallest side, unless the requested page is smaller.
const HALVINGS: std::ops::RangeInclusive<usize> = 0..=3;
const SMALLEST: usize = 256;

/// Greatest side of a texel in offers, as a multiple of ε. With larger texels, a smaller ε puts more billboards on the page and makes
/// texels even larger; the remaining gain is less than the error of a prediction. If a small page has only larger texels, all choices are
/// offered.
const MOST_TEXEL: f64 = 1.0;

/// Greatest predicted number of billboards, as a share of the number that fit on the page at a texel each.
const MOST_ROOM: f64 = 0.5;

/// Greatest error of an offer, as a share of the error of the offer before it.
const STEP: f64 = 0.97;

/// Returns the Pareto front of the predictions over ε, pages up to the requested size, samples and efforts: quickest first, each with less
/// error than the one before.
///
/// The last offers are at least as fine as the settings of the curve in each setting. A quick sweep measures little of the effect of large
/// pages and many samples, and would predict their quality for less.
#[must_use]
pub fn offers(curve: &Curve) -> Vec<Offer> {
    let asked = Choice { method: Method::Stochastic, max_billboards: None, ..Choice::of(&curve.settings) };
    let model = Model::new(curve);
    let offer = |choice: Choice| Offer { choice, predicted: model.predict(&choice) };
    let mut all: Vec<Offer> = choices(&asked, curve.settings.fit.max_size).into_iter().map(offer).collect();
    let sharp = |offer: &Offer| model.texel(&offer.choice) <= MOST_TEXEL * offer.choice.epsilon;
    let two_sided = curve.settings.back_sides.unwrap_or(true);
    let fits = |offer: &Offer| {
        let room = AtlasSettings::of_size(offer.choice.page(&curve.settings), two_sided).room();
        model.billboards(&offer.choice) <= MOST_ROOM * room as f64
    };
    for wanted in [&fits as &dyn Fn(&Offer) -> bool, &sharp] {
        if all.iter().any(wanted) {
            all.retain(wanted);
        }
    }
    if let Some(Offer { predicted: own, .. }) = all.iter().find(|offer| offer.choice == asked).copied() {
        let is_quicker = |p: &Prediction| p.seconds < own.seconds && STEP * p.image_error > own.image_error;
        all.retain(|offer| offer.choice.is_as_fine_as(&asked) || is_quicker(&offer.predicted));
    }
    let costs: Vec<(f64, f64)> = all.iter().map(|o| (o.predicted.seconds, o.predicted.image_error)).collect();
    let mut best: Vec<Offer> = all.into_iter().zip(front(&costs)).filter(|(_, on)| *on).map(|(o, _)| o).collect();
    best.sort_by(|a, b| a.predicted.seconds.total_cmp(&b.predicted.seconds));
    let mut kept: Vec<Offer> = Vec::new();
    for offer in best {
        let error = |offer: &Offer| offer.predicted.image_error;
        if kept.last().is_none_or(|last| error(&offer) <= STEP * error(last)) {
            kept.push(offer);
        }
    }
    kept
}

/// Returns the choices to compare: `asked`, and each ε up to the size limit of billboards with each page, number of samples and effort.
fn choices(asked: &Choice, max_size: Option<f64>) -> Vec<Choice> {
    let most = max_size.unwrap_or(f64::INFINITY).max(EPSILONS[0]);
    let page = |halved: usize| (asked.texture_size >> halved).max(SMALLEST.min(asked.texture_size));
    let mut all = vec![*asked];
    for epsilon in EPSILONS.into_iter().chain([asked.epsilon]).filter(|epsilon| *epsilon <= most) {
        for texture_size in HALVINGS.map(page) {
            for samples in [1, 2, 4, asked.samples] {
                for effort in [Effort::Default, Effort::Final.max(asked.effort)] {
                    all.push(Choice { effort, epsilon, texture_size, samples, ..*asked });
                }
            }
        }
    }
    all
}

/// Builds a chain that meets the wish. It chooses ε, page, samples and effort, with pages up to the size in `settings`; all other settings
/// stay. It compares chains without refinement. The chosen chain is then built again with it, beyond a limit of time.
///
/// # Errors
/// A wish outside its range; settings that leave no choice; an error limit that no try reaches; a time limit too short for any offer; the
/// errors of [`build_chain`].
///
/// # Panics
/// Never: a curve has offers.
pub fn build_within(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    wish: Wish,
    progress: Progress,
) -> Result<Built> {
    let begun = Instant::now();
    wish.check(settings)?;
    let chosen = if settings.refine == Refinement::Off { 1.0 } else { 1.0 - SHARE_OF_REFINEMENT };
    let curve = sweep(foliage, trunk, settings, Sweep::Quick, progress.part(0.0, 0.2 * chosen))?;
    let (model, offers, plain) = (Model::new(&curve), offers(&curve), &curve.settings);
    let trying = progress.part(0.2 * chosen, chosen);
    let tries = Tries { foliage, trunk, settings: plain, model, offers, count: 0, progress: trying };
    let mut built = match wish {
        Wish::Preset(preset) => tries.place(preset),
        Wish::ImageError(most) => tries.reach(most),
        Wish::Seconds(most) => tries.hurry(most, begun),
    }?;
    if settings.refine != Refinement::Off {
        let refined = ChainSettings { refine: settings.refine, ..built.offer.choice.applied(plain)? };
        built.chain = build_chain(foliage, trunk, &refined, progress.part(chosen, 1.0))?;
    }
    progress.tell("bake", 1.0)?;
    Ok(built)
}

/// Share of the progress for a chain with refinement.
const SHARE_OF_REFINEMENT: f64 = 0.6;

impl Wish {
    fn check(self, settings: &ChainSettings) -> Result<()> {
        settings.check()?;
        match self {
            Self::Seconds(seconds) => SECONDS.check("seconds", seconds)?,
            Self::ImageError(error) => IMAGE_ERROR.check("image_error", error)?,
            Self::Preset(_) => {}
        }
        let fit = &settings.fit;
        let given = [
            ("triangles", settings.triangles.is_some()),
            ("method", fit.method != Method::Stochastic),
            ("max_billboards", fit.max_billboards.is_some()),
            ("max_texels", fit.max_texels.is_some()),
            ("image_epsilon", fit.image.is_some()),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            Some((name, _)) => Err(Error::invalid(format!(
                "`{name}` leaves no choice of `epsilon` for `seconds`, `image_error` or a `preset`; leave one of them out"
            ))),
            None => Ok(()),
        }
    }
}

/// Most chains built to reach an error limit.
const MOST_TRIES: usize = 8;

/// Greatest predicted error, as a share of the error limit.
const MARGIN: f64 = 0.97;

/// Greatest predicted time of a try, as a share of the remaining seconds.
const CAREFUL: f64 = 0.85;

/// The same share for the first try: its measurement matters more than its result.
const FIRST: f64 = 0.3;

/// Time at which a try is stopped if there is an earlier result, as a multiple of the time limit.
const LATE: f64 = 1.05;

struct Tries<'a> {
    foliage: &'a Foliage,
    trunk: Option<&'a Foliage>,
    settings: &'a ChainSettings,
    model: Model<'a>,
    offers: Vec<Offer>,
    count: usize,
    progress: Progress<'a>,
}

impl Tries<'_> {
    /// Builds a chain and measures it. Stops with [`Error::Cancelled`] once `late` returns true.
    fn build(&mut self, offer: &Offer, late: &(dyn Fn() -> bool + Sync)) -> Result<(Chain, Point)> {
        // Each try gets half of the remaining progress.
        let left = |count: usize| 1.0 - 0.5f64.powi(count as i32);
        let part = self.progress.part(left(self.count), left(self.count + 1));
        self.count += 1;
        let report = |stage: &str, fraction: f64| part.tell(stage, fraction).is_ok() && !late();
        let settings = offer.choice.applied(self.settings)?;
        measure(self.foliage, self.trunk, &settings, Progress::new(&report))
    }

    /// Builds the offer of a preset. If its page holds too few billboards, tries the slower offers, then the quicker ones.
    fn place(mut self, preset: Preset) -> Result<Built> {
        let meant = preset.of(&self.offers).copied();
        let (before, behind) =
            self.offers.split_at(self.offers.iter().position(|offer| Some(*offer) == meant).unwrap_or(0));
        let all: Vec<Offer> = behind.iter().chain(before.iter().rev()).copied().collect();
        let mut refused = None;
        for offer in all {
            match self.build(&offer, &|| false) {
                Ok((chain, _)) => return Ok(Built { chain, offer, tries: self.count }),
                Err(error @ Error::Invalid(_)) => refused = refused.or(Some(error)),
                Err(error) => return Err(error),
            }
        }
        Err(refused.unwrap_or_else(|| Error::invalid("a curve without points offers nothing")))
    }

    /// Builds the quickest chain with at most this error: moves along the front, then on to finer settings.
    fn reach(mut self, most: f64) -> Result<Built> {
        let (mut next, mut bias, mut least) = (0, 1.0, f64::INFINITY);
        let (mut known, mut refused): (Option<Offer>, Option<Error>) = (None, None);
        while self.count < MOST_TRIES {
            let enough = |offer: &Offer| offer.predicted.image_error * bias <= MARGIN * most;
            let left = &self.offers[next..];
            let (offer, passed) = match left.iter().position(enough).or(left.len().checked_sub(1)) {
                Some(index) => (left[index], index + 1),
                None => match known.and_then(|known| self.finer(&known)) {
                    Some(offer) => (offer, 0),
                    None => break,
                },
            };
            next += passed;
            let (chain, point) = match self.build(&offer, &|| false) {
                Ok(built) => built,
                Err(error @ Error::Invalid(_)) => {
                    refused = Some(error);
                    if passed > 0 {
                        continue;
                    }
                    break;
                }
                Err(error) => return Err(error),
            };
            let error = point.image_error;
            if error <= most {
                return Ok(Built { chain, offer, tries: self.count });
            }
            known = Some(offer);
            least = least.min(error);
            bias = error / offer.predicted.image_error;
        }
        Err(refused.filter(|_| least.is_infinite()).unwrap_or_else(|| self.beyond(most, least)))
    }

    fn beyond(&self, most: f64, least: f64) -> Error {
        Error::invalid(format!(
            "`image_error` is {most}; the least that {} tries reached is {least}: raise it, `texture_size` or `samples`",
            self.count
        ))
    }

    /// Builds the best chain within the time limit: moves along the front, then on to finer settings even if no gain is predicted, because
    /// a quick sweep measures little of the effect of a small ε and large pages.
    fn hurry(mut self, most: f64, begun: Instant) -> Result<Built> {
        let mut best: Option<(Chain, Offer, f64)> = None;
        let mut slower = 1.0;
        loop {
            let left = most - begun.elapsed().as_secs_f64();
            let fits = |offer: &Offer, share: f64| offer.predicted.seconds * slower <= share * left;
            let fitting = |share: f64| self.offers.iter().rev().find(|offer| fits(offer, share)).copied();
            let offer = match &best {
                None => fitting(FIRST).or_else(|| fitting(CAREFUL)).ok_or_else(|| self.too_few(most, begun))?,
                Some((_, known, error)) => {
                    let off = error / known.predicted.image_error;
                    let helps = |offer: &Offer| offer.predicted.image_error * off <= STEP * error;
                    let finer = || self.finer(known).filter(|offer| fits(offer, CAREFUL));
                    match fitting(CAREFUL).filter(helps).or_else(finer) {
                        Some(offer) => offer,
                        None => break,
                    }
                }
            };
            let gave_up = AtomicBool::new(false);
            let fallback = best.is_some();
            let late = || {
                let late = fallback && begun.elapsed().as_secs_f64() > LATE * most;
                gave_up.fetch_or(late, Ordering::Relaxed);
                late
            };
            match self.build(&offer, &late) {
                Ok((chain, point)) => {
                    slower = point.seconds.total() / offer.predicted.seconds;
                    let before = best.as_ref().map_or(f64::INFINITY, |(_, _, error)| *error);
                    let error = point.image_error;
                    if error < before {
                        best = Some((chain, offer, error));
                    }
                    if error > STEP * before {
                        break;
                    }
                }
                Err(Error::Cancelled) if gave_up.load(Ordering::Relaxed) => break,
                Err(error @ Error::Invalid(_)) => {
                    let before = self.offers.len();
                    self.offers.retain(|other| *other != offer);
                    // A refused try finer than all offers is not repeated.
                    let finer = self.offers.len() == before;
                    match &best {
                        Some(_) if finer => break,
                        None if self.offers.is_empty() => return Err(error),
                        _ => {}
                    }
                }
                Err(error) => return Err(error),
            }
        }
        let (chain, offer, _) = best.expect("the loop ends only with a chain");
        Ok(Built { chain, offer, tries: self.count })
    }

    /// Returns an offer with the requested page and samples or, if it has them, the next smaller ε; `None` after the smallest.
    fn finer(&self, than: &Offer) -> Option<Offer> {
        let Choice { texture_size, samples, .. } = Choice::of(self.settings);
        let whole = Choice { texture_size, samples: samples.max(than.choice.samples), ..than.choice };
        let choice = if whole == than.choice {
            let epsilon = EPSILONS.into_iter().rev().find(|epsilon| *epsilon < than.choice.epsilon)?;
            Choice { epsilon, ..whole }
        } else {
            whole
        };
        Some(Offer { choice, predicted: self.model.predict(&choice) })
    }

    fn too_few(&self, most: f64, begun: Instant) -> Error {
        let swept = begun.elapsed().as_secs_f64();
        let quickest = self.offers.first().map_or(f64::NAN, |offer| offer.predicted.seconds);
        Error::invalid(format!(
            "`seconds` is {most}; the quick sweep took {swept:.1}, and the quickest settings are predicted to take {quickest:.1}: raise it"
        ))
    }
}
