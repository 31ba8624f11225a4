//! Settings for a target: the image error that a level may have where it takes over.
//!
//! A small ε makes a level that may take over near the viewer, so the leaves are drawn over a short range of distances, but it has many
//! triangles. A large ε makes a level that is cheap and takes over late. The best ε makes the whole range of distances cheapest to draw
//! ([`cost`]). It is found with drafts of level 1 ([`Draft`]): their pictures tell the size at which the level may take over, and
//! their rectangles the cost of drawing it. A draft takes a small part of the time of a level, and a search two to five drafts, a quick
//! bake one.
//!
//! The choice depends on FLIP. The last digits of FLIP differ between machines, so errors are rounded to three digits. Two machines choose
//! different bounds only if two costs are equal to a thousandth and an error lies between two roundings.

use leafcloud::error::Result;
use leafcloud::fit::{FitSettings, Method};
use leafcloud::limits::Limits;
use leafcloud::lod::{ChainSettings, Draft, Drafts, ViewCounts, is_published};
use leafcloud::metrics::{Reference, Views, drawing_cost};
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress};
use leafcloud_flip::{ImageErrors, SMALLEST, crown_pixels};

use crate::leaves::LeafLevel;

/// Range of the target.
pub const TARGET: Limits = Limits { above: true, below: true, ..Limits::SHARE };

/// The ε that is tried first, and larger and smaller ones, by √2.
const FIRST: f64 = 0.04;
const COARSER: [f64; 3] = [0.056, 0.08, 0.11];
const FINER: [f64; 3] = [0.028, 0.02, 0.014];

/// Views of drafts, other ones than the report's and the benchmarks'.
const VIEWS: usize = 3;
const SIZE: usize = 256;
const TURN: f64 = 0.25;

/// Diameter of the leaves' sphere in pixels: from the nearest to the farthest distance that counts, in octaves.
const FARTHEST: f64 = 8.0;
const OCTAVES: i32 = 6;

/// Deviation in pixels for the first fit: about that of the measured trees at the default target. All drafts have the size limit of
/// this fit.
const TYPICAL_PIXELS: f64 = 2.0;

/// Least number of pixels that a deviation is allowed: less would ask for texels that no picture shows.
const LEAST_PIXELS: f64 = 0.5;

/// Target of level 1 from which a bake is quick: half of the views are enough to tell errors of this size, and ε follows from one draft.
const QUICK: f64 = 0.12;

/// Most views of a quick bake.
const FEWER: ViewCounts = ViewCounts { order: 8, amounts: 8, report: 4 };

/// Returns whether a bake with this target of level 1 is quick.
#[must_use]
pub fn is_quick(target: f64) -> bool {
    target >= QUICK
}

/// Returns `settings` with the views of a quick bake.
#[must_use]
pub fn with_fewer_views(settings: &ChainSettings) -> ChainSettings {
    let ViewCounts { order, amounts, report } = settings.views;
    let views = ViewCounts {
        order: order.min(FEWER.order),
        amounts: amounts.min(FEWER.amounts),
        report: report.min(FEWER.report),
    };
    ChainSettings { views, ..settings.clone() }
}

/// Factor on the target of levels after level 1: the tree is smaller where they take over.
pub const LATER: f64 = 4.0 / 3.0;

/// The leaves, as choices compare levels with them.
pub struct Scale<'a> {
    /// The tree's own leaves.
    pub leaves: &'a Foliage,
    /// Their pictures, also lit if levels have the normals of their leaves.
    pub(crate) pictures: Reference,
    /// The cost of drawing them in the middle of each octave.
    pub(crate) costs: Vec<f64>,
    /// Whether ε follows from one draft.
    quick: bool,
}

impl<'a> Scale<'a> {
    /// Renders the leaves, and measures the cost of drawing them. `quick`: whether choices may be rough.
    ///
    /// # Errors
    /// An `up` without a finite length above 0.
    pub fn of(leaves: &'a Foliage, settings: &ChainSettings, quick: bool) -> Result<Self> {
        let views = Views { count: VIEWS, size: SIZE, samples: Samples::new(2)?, up: settings.up, turn: TURN };
        let render = if settings.is_lit() { Reference::lit } else { Reference::new };
        let pictures = render(&[leaves], leaves.frame(), views)?;
        Ok(Self { leaves, pictures, costs: costs(leaves, settings)?, quick })
    }

    /// Returns the side of the largest picture in which `level` is within the target; `None` if it is within it in none.
    pub(crate) fn largest_size(&self, level: &Foliage, target: f64) -> Result<Option<f64>> {
        Ok(ImageErrors::up_to(&self.pictures.compare(&[level])?, target).largest_size(target))
    }
}

/// Returns `settings` with the ε that makes the tree cheapest to draw if the first cloud may differ from the leaves by the image error
/// `target` where it takes over, and with the deviation in pixels that is predicted there, at most that of `settings`. `free`: whether ε
/// may change. `simplified`: the leaves that are drawn before the cloud and that it is made from, if they are not the tree's own.
///
/// # Errors
/// A target outside [`TARGET`]; the errors of a fit; [`Error::Cancelled`](leafcloud::Error::Cancelled).
pub fn settings_for(
    target: f64,
    scale: &Scale,
    simplified: Option<&LeafLevel>,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    free: bool,
    progress: Progress,
) -> Result<ChainSettings> {
    TARGET.check("target_error", target)?;
    settings.check()?;
    let free = free && leaves_a_choice(&settings.fit);
    // Billboards show the normals that leaves had before they collapsed.
    let (finest, costs) =
        simplified.map_or((scale.leaves, &scale.costs), |level| (&level.leaves.foliage, &level.costs));
    let finest = finest.with_normals();
    let drafts = drafts(&finest, trunk, settings, free, progress.part(0.0, FIRST_SHARE))?;
    let first = Tried::of(&drafts.first, drafts.epsilon(), target, scale)?;
    let search = Search { target, drafts: &drafts, scale, costs };
    let best = match free {
        false => first,
        true if !scale.quick => search.best(first, settings.fit.max_size, progress.part(FIRST_SHARE, 1.0))?,
        true => search.guessed(first, settings.fit.max_size),
    };
    let deviation = 0.5 * best.epsilon * crown_pixels(best.size);
    let pixels = deviation.clamp(LEAST_PIXELS.min(settings.pixels), settings.pixels);
    let fit = FitSettings { epsilon: best.epsilon, ..settings.fit.clone() };
    Ok(ChainSettings { fit, pixels, ..settings.clone() })
}

/// Share of the progress for the first draft.
const FIRST_SHARE: f64 = 0.4;

/// Makes the first draft: with ε [`FIRST`] if it is `free`, else with that of the settings.
fn drafts<'a>(
    foliage: &'a Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    free: bool,
    progress: Progress,
) -> Result<Drafts<'a>> {
    let epsilon = if free { FIRST } else { settings.fit.epsilon };
    let epsilon = settings.fit.max_size.map_or(epsilon, |size| epsilon.min(size));
    let fit = FitSettings { epsilon, ..settings.fit.clone() };
    let settings = ChainSettings { fit, pixels: TYPICAL_PIXELS.min(settings.pixels), ..settings.clone() };
    Drafts::new(&settings, foliage, trunk, progress)
}

/// Returns the cost of drawing the leaves in the middle of each octave.
pub(crate) fn costs(foliage: &Foliage, settings: &ChainSettings) -> Result<Vec<f64>> {
    let cost = |radius_pixels: f64| {
        let scale = radius_pixels / foliage.frame().radius;
        Ok(drawing_cost(&[foliage], scale, settings.up, Progress::silent())?.total())
    };
    middles().map(cost).collect()
}

/// Returns whether no other setting determines ε.
fn leaves_a_choice(fit: &FitSettings) -> bool {
    let is_fixed = fit.max_billboards.is_some() || fit.max_texels.is_some() || fit.image.is_some();
    !is_fixed && fit.method == Method::Stochastic && !is_published(fit.method, fit.effort)
}

/// Returns the number of the octave with a sphere of `size` pixels, the nearest one beyond the ends.
pub(crate) fn octave_of(size: f64) -> usize {
    (libm::log2(size / FARTHEST).floor() as usize).min(OCTAVES as usize - 1)
}

/// Returns R in pixels in the middle of each octave, ascending.
fn middles() -> impl Iterator<Item = f64> {
    (0..OCTAVES).map(|octave| 0.5 * FARTHEST * libm::exp2(f64::from(octave) + 0.5))
}

/// A value of ε that was tried.
#[derive(Clone, Copy)]
struct Tried {
    epsilon: f64,
    /// Side of the picture in pixels, where the level takes over.
    size: f64,
    billboards: usize,
}

/// Exponent of the number of billboards in 1 / ε: 1.2 to 1.9 on the measured trees.
const GROWTH: f64 = 1.5;

/// A finer ε is not tried if more than this share of the most billboards is expected.
const TOO_MANY: f64 = 1.2;

impl Tried {
    fn of(draft: &Draft, epsilon: f64, target: f64, scale: &Scale) -> Result<Self> {
        let size = scale.largest_size(&draft.collapsed, target)?.unwrap_or(SMALLEST as f64);
        Ok(Self { epsilon, size, billboards: draft.billboards() })
    }

    /// Returns the number of billboards that another ε is expected to need.
    fn billboards_with(&self, epsilon: f64) -> f64 {
        self.billboards as f64 * libm::pow(self.epsilon / epsilon, GROWTH)
    }
}

struct Search<'a> {
    target: f64,
    drafts: &'a Drafts<'a>,
    scale: &'a Scale<'a>,
    /// Cost of drawing the leaves before the level in the middle of each octave.
    costs: &'a [f64],
}

impl Search<'_> {
    /// Returns the best ε, at most `max_size`.
    ///
    /// The cost has one minimum: with a larger ε the leaves are drawn over more distances, with a smaller one the level has more
    /// triangles. The side that looks cheaper from the first draft is searched first. No ε is finer than the first unless the level keeps its
    /// budget of triangles.
    fn best(&self, first: Tried, max_size: Option<f64>, progress: Progress) -> Result<Tried> {
        let largest = max_size.unwrap_or(f64::INFINITY);
        let (mut best, mut least, mut done) = (first, self.cost(&first, &self.drafts.first), 0.0);
        let [coarser, finer] = [COARSER, FINER].map(|side| self.predicted(&first, side[0]));
        let sides = if finer < coarser { [FINER, COARSER] } else { [COARSER, FINER] };
        for side in sides {
            for &epsilon in side.iter().filter(|epsilon| **epsilon <= largest) {
                let is_finer = epsilon < first.epsilon;
                if is_finer && best.billboards_with(epsilon) > TOO_MANY * self.drafts.most as f64 {
                    break;
                }
                let draft = self.drafts.with(epsilon, progress.part(done, 0.5 * (1.0 + done)))?;
                done = 0.5 * (1.0 + done);
                let next = Tried::of(&draft, epsilon, self.target, self.scale)?;
                let cost = self.cost(&next, &draft);
                if cost >= least || (is_finer && next.billboards > self.drafts.most) {
                    break;
                }
                (best, least) = (next, cost);
            }
            if best.epsilon != first.epsilon {
                break;
            }
        }
        Ok(best)
    }

    /// Returns the ε that looks best from the first draft alone, at most `max_size`.
    fn guessed(&self, first: Tried, max_size: Option<f64>) -> Tried {
        let largest = max_size.unwrap_or(f64::INFINITY);
        let allowed = |epsilon: &f64| {
            *epsilon <= largest
                && (*epsilon >= first.epsilon || first.billboards_with(*epsilon) <= self.drafts.most as f64)
        };
        let all = COARSER.into_iter().chain(FINER).filter(allowed);
        let better = |best: f64, next: f64| {
            if self.predicted(&first, next) < self.predicted(&first, best) { next } else { best }
        };
        let epsilon = all.fold(first.epsilon, better);
        Tried {
            epsilon,
            size: first.size * first.epsilon / epsilon,
            billboards: first.billboards_with(epsilon) as usize,
        }
    }

    /// Returns the cost that another ε is expected to have, from that of the first draft: deviations are as many pixels where the level takes
    /// over, and billboards are drawn as often as there are.
    fn predicted(&self, first: &Tried, epsilon: f64) -> f64 {
        let size = first.size * first.epsilon / epsilon;
        let more = first.billboards_with(epsilon) / first.billboards as f64;
        let level: Vec<f64> = middles().map(|middle| more * self.drafts.first.cost(middle)).collect();
        cost(crown_pixels(size), self.costs, &level)
    }

    fn cost(&self, tried: &Tried, draft: &Draft) -> f64 {
        cost(crown_pixels(tried.size), self.costs, &middles().map(|middle| draft.cost(middle)).collect::<Vec<_>>())
    }
}

/// Returns the cost of drawing a tree at all distances, in fragments: the leaves where their sphere is larger than `size` pixels, else the
/// level; both in the middle of each octave. Every doubling of the distance counts the same.
pub(crate) fn cost(size: f64, leaves: &[f64], level: &[f64]) -> f64 {
    let octave = |(radius_pixels, (leaves, level)): (f64, (&f64, &f64))| {
        // The share of the octave, in the logarithm, in which the tree is smaller than `size`.
        let share = (libm::log2(size / (2.0 * radius_pixels)) + 0.5).clamp(0.0, 1.0);
        share * level + (1.0 - share) * leaves
    };
    middles().zip(leaves.iter().zip(level)).map(octave).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octaves_double_from_the_smallest_sphere() {
        let found = [1.0, 8.0, 15.9, 16.0, 300.0, 511.0, 1e9, f64::INFINITY].map(octave_of);
        assert_eq!(found, [0, 0, 0, 1, 5, 5, 5, 5]);
    }

    #[test]
    fn every_octave_counts_the_same() {
        let leaves = vec![10.0; OCTAVES as usize];
        let at = |size: f64| cost(size, &leaves, &[1.0; OCTAVES as usize]);
        assert!((at(FARTHEST) - 60.0).abs() < 1e-9, "leaves alone");
        assert!((at(512.0) - 6.0).abs() < 1e-9, "the level alone");
        assert!((at(64.0) - 33.0).abs() < 1e-9, "three octaves of each");
        assert!((at(64.0 * 2f64.sqrt()) - 28.5).abs() < 1e-9, "half an octave more");
    }
}
