//! Growth and contrast loss that make a pruned crown look like the full one.
//!
//! The scale law keeps the leaf area, but not the visible area. Leaves that overlapped, above all crossed cards, no longer do, and enlarged
//! leaves at the rim reach beyond it. A pine of crossed cards becomes a third denser at λ = 0.1. Enlarged leaves also show their textures
//! enlarged, so pixels vary more: not only where leaves are smaller than pixels, as Cook et al. assume, but wherever their needles are.
//! Both effects are measured from renderings. Both are nearly powers of λ, so measurements at two λ give the two numbers of a [`Trend`].

use glam::DVec3;

use super::settings::{PruneSettings, ViewCounts};
use super::tune::views_of_amounts;
use crate::error::Result;
use crate::foliage::Foliage;
use crate::metrics::{Reference, Views};
use crate::progress::Progress;
use crate::prune::{Trend, pruned};
use crate::textures::Samples;

/// The λ of the measurements, down to the least supported λ. Coverage matters over the whole range, so its two λ lie on both sides of the
/// middle, in logarithms. Contrast matters where few leaves are kept.
const GROWTH_KEEPS: [f64; 2] = [0.3, 0.02];
const CONTRAST_KEEPS: [f64; 2] = [0.1, 0.02];

/// Most steps of the search at each λ, and the error of ln coverage at which it stops.
const MOVES: usize = 5;
const NEAR: f64 = 0.003;

/// Limits: |ln γ| ≤ `MOST` and ln κ ≥ `LEAST_CONTRAST`.
const MOST: f64 = std::f64::consts::LN_2;
const LEAST_CONTRAST: f64 = -3.0;

/// Measures γ, the growth of pruned leaves beyond the growth that keeps their area. With it they cover as much as all leaves.
///
/// # Errors
/// A picture without pixels; [`crate::Error::Cancelled`]. If no kept leaf has an area, there is nothing to measure and γ is 1.
pub fn growth(foliage: &Foliage, ranks: &[f32], up: DVec3, progress: Progress) -> Result<Trend> {
    let reference = reference(foliage, up)?;
    let at = |keep: f64| {
        let kept = move |growth| Ok(pruned(foliage, ranks, keep, growth)?.foliage);
        growth_at(covers(&reference, progress, kept))
    };
    let [a, b] = GROWTH_KEEPS;
    Ok(Trend::through(GROWTH_KEEPS, [at(a)?, at(b)?]))
}

/// Measures γ of leaves that stand for all: with it they cover as much. `all`: by [`reference`]. `standing` returns them at a γ.
///
/// # Errors
/// As [`growth`].
pub fn growth_of(all: &Reference, progress: Progress, standing: impl Fn(f64) -> Result<Foliage>) -> Result<f64> {
    growth_at(covers(all, progress, standing)).map(libm::exp)
}

/// Renders leaves for [`growth_of`].
///
/// # Errors
/// An `up` without a finite length above 0.
pub fn reference(foliage: &Foliage, up: DVec3) -> Result<Reference> {
    Reference::new(&[foliage], foliage.frame(), views_of_amounts(ViewCounts::default().amounts, up)?)
}

/// Returns ln of the coverage of `leaves` at a ln γ; `None` if nothing is visible.
fn covers<'a>(
    reference: &'a Reference,
    progress: Progress<'a>,
    leaves: impl Fn(f64) -> Result<Foliage> + 'a,
) -> impl Fn(f64) -> Result<Option<f64>> + 'a {
    move |logarithm| {
        progress.tell("measure", 0.0)?;
        let Ok(leaves) = leaves(libm::exp(logarithm)) else { return Ok(None) };
        Ok(Some(libm::log(reference.agreement(&leaves)?.coverage)).filter(|found| found.is_finite()))
    }
}

/// Returns the best ln γ found at a λ, by the secant method on `coverage`: ln of the coverage at a ln γ, `None` if nothing is visible.
fn growth_at(coverage: impl Fn(f64) -> Result<Option<f64>>) -> Result<f64> {
    let (mut at, mut slope) = (0.0, 2.0);
    let Some(mut found) = coverage(at)? else { return Ok(0.0) };
    let mut best = (found.abs(), at);
    for _ in 0..MOVES {
        let next = (at - found / slope).clamp(-MOST, MOST);
        if best.0 < NEAR || next == at {
            break;
        }
        let Some(then) = coverage(next)? else { break };
        slope = ((then - found) / (next - at)).clamp(0.25, 4.0);
        (at, found) = (next, then);
        if found.abs() < best.0 {
            best = (found.abs(), at);
        }
    }
    Ok(best.1)
}

/// Measures κ, the factor on the distance of pruned leaves' colors from their mean. With it, pixels vary as much as those of all leaves, at
/// the crown sizes at which that many leaves are kept. At most 1.
///
/// # Errors
/// A picture without pixels; [`crate::Error::Cancelled`].
pub fn contrast(
    foliage: &Foliage,
    ranks: &[f32],
    growth: Trend,
    settings: &PruneSettings,
    up: DVec3,
    progress: Progress,
) -> Result<Trend> {
    let at = |keep: f64| -> Result<f64> {
        progress.tell("measure", 0.0)?;
        let views =
            Views { count: 12, size: settings.crown_pixels(foliage, keep), samples: Samples::new(4)?, up, turn: 0.25 };
        let reference = Reference::new(&[foliage], foliage.frame(), views)?;
        let Ok(pruned) = pruned(foliage, ranks, keep, growth.factor(keep)) else { return Ok(0.0) };
        Ok(libm::log(reference.contrast(&pruned.foliage)?).clamp(LEAST_CONTRAST, 0.0))
    };
    let [a, b] = CONTRAST_KEEPS;
    Ok(Trend::through(CONTRAST_KEEPS, [at(a)?, at(b)?]))
}
