//! How pruned leaves must grow, and lose contrast, for a crown to look as it did.
//!
//! Area stays by the law of the scale, but what is seen of it does not: leaves that overlapped, crossed cards above all, no longer do, and
//! large leaves at the rim reach beyond it. A pine of crossed cards gets a third denser at λ = 0.1. And larger leaves show their textures
//! larger: pixels vary more, not only where leaves are smaller than pixels, as Cook et al. reckon, but wherever their needles are. Both
//! are looked at by the judge, and both are nearly powers of λ: two looks at two λ give the two numbers of a [`Trend`].

use glam::DVec3;

use super::Looks;
use super::PruneSettings;
use super::tune::views_of_amounts;
use crate::error::Result;
use crate::foliage::Foliage;
use crate::judge::{Judge, Views};
use crate::prune::{Trend, thin};
use crate::textures::Samples;

/// λ where it is looked, down to where it is promised. Coverage is followed over all of it, so on either side of its middle, in logarithms;
/// contrast counts where few leaves are left.
const GROWTH_LOOKS: [f64; 2] = [0.3, 0.02];
const CONTRAST_LOOKS: [f64; 2] = [0.1, 0.02];

/// How often the scale is moved at each, and how near the coverage is to come.
const MOVES: usize = 5;
const NEAR: f64 = 0.003;

/// The logarithms of γ and κ are no farther from 0.
const MOST: f64 = std::f64::consts::LN_2;
const LEAST_CONTRAST: f64 = -3.0;

/// γ, by which pruned leaves grow beside what their area asks for: with it they cover what all cover.
///
/// # Errors
/// A picture without pixels. Where no leaf with an area is left there is nothing to measure, and no error.
pub fn growth(foliage: &Foliage, ranks: &[f32], up: DVec3) -> Result<Trend> {
    let judge = Judge::new(&[foliage], foliage.frame(), views_of_amounts(Looks::default().amounts, up)?)?;
    let [a, b] = GROWTH_LOOKS.map(|keep| growth_at(foliage, ranks, &judge, keep));
    Ok(Trend::through(GROWTH_LOOKS, [a?, b?]))
}

/// ln γ at a λ, by secants of ln coverage; as near as it comes.
fn growth_at(foliage: &Foliage, ranks: &[f32], judge: &Judge, keep: f64) -> Result<f64> {
    let coverage = |logarithm: f64| -> Result<Option<f64>> {
        let Ok(thinned) = thin(foliage, ranks, keep, libm::exp(logarithm)) else { return Ok(None) };
        Ok(Some(libm::log(judge.glance(&thinned.foliage)?.coverage)).filter(|found| found.is_finite()))
    };
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

/// κ, by which the colours of pruned leaves keep their distance from the mean: with it pixels vary as those of all leaves do, at the sizes
/// at which so many are left. At most 1.
///
/// # Errors
/// A picture without pixels.
pub fn contrast(foliage: &Foliage, ranks: &[f32], growth: Trend, settings: &PruneSettings, up: DVec3) -> Result<Trend> {
    let at = |keep: f64| -> Result<f64> {
        let views =
            Views { count: 12, size: settings.crown_pixels(foliage, keep), samples: Samples::new(4)?, up, turn: 0.25 };
        let judge = Judge::new(&[foliage], foliage.frame(), views)?;
        let Ok(thinned) = thin(foliage, ranks, keep, growth.factor(keep)) else { return Ok(0.0) };
        Ok(libm::log(judge.contrast(&thinned.foliage)?).clamp(LEAST_CONTRAST, 0.0))
    };
    let [a, b] = CONTRAST_LOOKS.map(at);
    Ok(Trend::through(CONTRAST_LOOKS, [a?, b?]))
}
