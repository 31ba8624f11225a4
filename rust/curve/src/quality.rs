//! Settings for a target: the image error that a level may have where it takes over.
//!
//! A small ε makes a level that may take over near the viewer, so the leaves are drawn over a short range of distances, but it has many
//! triangles. A large ε makes a level that is cheap and takes over late. The best ε makes the whole range of distances cheapest to draw
//! ([`cost`]). It is found with drafts of level 1 ([`Draft`]): their pictures tell the size at which the level may take over, and
//! their rectangles the cost of drawing it. A draft takes a small part of the time of a level, and a search three to five drafts.
//!
//! A choice depends on FLIP, whose last digits differ between machines, rounded to three digits. So two machines choose differently only if
//! two costs are equal to a thousandth and an error lies between two roundings.

use leafcloud::error::Result;
use leafcloud::fit::{FitSettings, Method};
use leafcloud::limits::Limits;
use leafcloud::lod::{ChainSettings, Draft, Drafts, is_published};
use leafcloud::metrics::{Reference, Views, drawing_cost};
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress};
use leafcloud_flip::{ImageErrors, SMALLEST, crown_pixels};

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

/// Deviation in pixels for the first fit, whose size limit all drafts have: about the deviation of the measured trees at their target.
const TYPICAL_PIXELS: f64 = 2.0;

/// Least number of pixels that a deviation is allowed: less would ask for texels that no picture shows.
const LEAST_PIXELS: f64 = 0.5;

/// Returns `settings` with the ε that makes the tree cheapest to draw if level 1 may differ from the leaves by the image error `target` where
/// it takes over, and with the deviation in pixels that is predicted there, at most that of `settings`. `free`: whether ε may change.
///
/// # Errors
/// A target outside [`TARGET`]; the errors of a fit; [`Error::Cancelled`](leafcloud::Error::Cancelled).
pub fn settings_for(
    target: f64,
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    free: bool,
    progress: Progress,
) -> Result<ChainSettings> {
    TARGET.check("target_error", target)?;
    settings.check()?;
    let search = Search::new(target, foliage, settings)?;
    let best = search.best(trunk, settings, free && leaves_a_choice(&settings.fit), progress)?;
    let deviation = 0.5 * best.epsilon * crown_pixels(best.size);
    let pixels = deviation.clamp(LEAST_PIXELS.min(settings.pixels), settings.pixels);
    let fit = FitSettings { epsilon: best.epsilon, ..settings.fit.clone() };
    Ok(ChainSettings { fit, pixels, ..settings.clone() })
}

/// Returns whether no other setting determines ε.
fn leaves_a_choice(fit: &FitSettings) -> bool {
    let is_fixed = fit.max_billboards.is_some() || fit.max_texels.is_some() || fit.image.is_some();
    !is_fixed && fit.method == Method::Stochastic && !is_published(fit.method, fit.effort)
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
    cost: f64,
}

/// Exponent of the number of billboards in 1 / ε: 1.2 to 1.9 on the measured trees.
const GROWTH: f64 = 1.5;

/// A finer ε is not tried if more than this share of the most billboards is expected.
const TOO_MANY: f64 = 1.2;

impl Tried {
    /// Returns the number of billboards that another ε is expected to need.
    fn billboards_with(&self, epsilon: f64) -> f64 {
        self.billboards as f64 * libm::pow(self.epsilon / epsilon, GROWTH)
    }
}

struct Search<'a> {
    target: f64,
    foliage: &'a Foliage,
    pictures: Reference,
    /// Cost of drawing the leaves in the middle of each octave.
    costs: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(target: f64, foliage: &'a Foliage, settings: &ChainSettings) -> Result<Self> {
        let views = Views { count: VIEWS, size: SIZE, samples: Samples::new(2)?, up: settings.up, turn: TURN };
        let pictures = Reference::new(&[foliage], foliage.frame(), views)?;
        let cost = |radius_pixels: f64| {
            let scale = radius_pixels / foliage.frame().radius;
            Ok(drawing_cost(&[foliage], scale, settings.up, Progress::silent())?.total())
        };
        Ok(Self { target, foliage, pictures, costs: middles().map(cost).collect::<Result<_>>()? })
    }

    /// Returns the best ε, or that of the settings if it is not `free`.
    ///
    /// The cost has one minimum: with a larger ε the leaves are drawn over more distances, with a smaller one the level has more
    /// triangles. No ε is finer than the first unless the level keeps its budget of triangles.
    fn best(&self, trunk: Option<&Foliage>, settings: &ChainSettings, free: bool, progress: Progress) -> Result<Tried> {
        let pixels = TYPICAL_PIXELS.min(settings.pixels);
        let epsilon = if free { FIRST } else { settings.fit.epsilon };
        let epsilon = settings.fit.max_size.map_or(epsilon, |size| epsilon.min(size));
        let fit = FitSettings { epsilon, ..settings.fit.clone() };
        let settings = ChainSettings { fit, pixels, ..settings.clone() };
        let drafts = Drafts::new(&settings, self.foliage, trunk, progress.part(0.0, 0.4))?;
        let mut best = self.tried(epsilon, &drafts.first)?;
        if !free {
            return Ok(best);
        }
        let (first, mut done) = (best, 0.4);
        let largest = settings.fit.max_size.unwrap_or(f64::INFINITY);
        for side in [&COARSER[..], &FINER[..]] {
            for &epsilon in side.iter().filter(|epsilon| **epsilon <= largest) {
                let is_finer = epsilon < first.epsilon;
                if is_finer && best.billboards_with(epsilon) > TOO_MANY * drafts.most as f64 {
                    break;
                }
                let draft = drafts.with(epsilon, progress.part(done, 0.5 * (1.0 + done)))?;
                done = 0.5 * (1.0 + done);
                let next = self.tried(epsilon, &draft)?;
                if next.cost >= best.cost || (is_finer && next.billboards > drafts.most) {
                    break;
                }
                best = next;
            }
            if best.epsilon != first.epsilon {
                break;
            }
        }
        Ok(best)
    }

    fn tried(&self, epsilon: f64, draft: &Draft) -> Result<Tried> {
        let errors = ImageErrors::of(&self.pictures.compare(&draft.collapsed)?);
        let size = errors.largest_size(self.target).unwrap_or(SMALLEST as f64);
        let billboards = draft.billboards();
        Ok(Tried {
            epsilon,
            size,
            billboards,
            cost: cost(crown_pixels(size), &self.costs, |radius_pixels| draft.cost(radius_pixels)),
        })
    }
}

/// Returns the cost of drawing a tree at all distances, in fragments: the leaves where their sphere is larger than `size` pixels, else the
/// level. Every doubling of the distance counts the same.
fn cost(size: f64, leaves: &[f64], level: impl Fn(f64) -> f64) -> f64 {
    let octave = |(radius_pixels, leaves): (f64, &f64)| {
        // The share of the octave, in the logarithm, in which the tree is smaller than `size`.
        let share = (libm::log2(size / (2.0 * radius_pixels)) + 0.5).clamp(0.0, 1.0);
        share * level(radius_pixels) + (1.0 - share) * leaves
    };
    middles().zip(leaves).map(octave).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_octave_counts_the_same() {
        let leaves = vec![10.0; OCTAVES as usize];
        let at = |size: f64| cost(size, &leaves, |_| 1.0);
        assert!((at(FARTHEST) - 60.0).abs() < 1e-9, "leaves alone");
        assert!((at(512.0) - 6.0).abs() < 1e-9, "the level alone");
        assert!((at(64.0) - 33.0).abs() < 1e-9, "three octaves of each");
        assert!((at(64.0 * 2f64.sqrt()) - 28.5).abs() < 1e-9, "half an octave more");
    }
}
