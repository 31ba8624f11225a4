//! The alpha cutoff of a level, decided by its looks.
//!
//! Filtering spreads lacy leaves over their texels, so a cutoff of ½ loses coverage; overlap hides the loss, and both differ from plant
//! to plant: there is no right value in theory. A few small views (other ones than those reported) are compared with the leaves,
//! and from ½ the cutoff moves along [`CUTOFFS`] while that lowers the cost. Coverage falls as the cutoff rises, so the cost has one
//! valley.
//!
//! The limit of the stretch is not tuned: over maple, pine and oak, error and coverage at 1.25, 1.5 and 2 differ by less than
//! neighbouring cutoffs do.

use crate::error::Result;
use crate::foliage::Foliage;
use crate::judge::{Judge, Judgement, Views};
use crate::textures::Samples;

/// The limit of the stretch that lays leaves into their planes.
pub const STRETCH: f64 = 1.5;

/// The cutoffs that may be chosen, and where the search begins.
const CUTOFFS: [f32; 9] = [0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7];
const FIRST: usize = 6;

/// How much coverage may differ from the leaves' before it counts.
const COVERAGE: f64 = 0.02;

/// What a choice is judged by.
pub fn views() -> Result<Views> {
    Ok(Views { count: 6, size: 96, samples: Samples::new(2)?, turn: 0.0 })
}

/// The alpha cutoff with which `shown` looks best.
pub fn cutoff(shown: impl Fn(f32) -> Result<Foliage>, judge: &Judge) -> Result<f32> {
    let cost_of = |index: usize| -> Result<f64> { Ok(cost(&judge.judge(&shown(CUTOFFS[index])?)?)) };
    let (mut best, mut least) = (FIRST, cost_of(FIRST)?);
    for direction in [-1isize, 1] {
        while let Some(next) = best.checked_add_signed(direction).filter(|&i| i < CUTOFFS.len()) {
            let cost = cost_of(next)?;
            if cost >= least {
                break;
            }
            (best, least) = (next, cost);
        }
        if best != FIRST {
            break;
        }
    }
    Ok(CUTOFFS[best])
}

/// The image error, and what coverage strays beyond [`COVERAGE`].
fn cost(judged: &Judgement) -> f64 {
    judged.error + ((judged.coverage - 1.0).abs() - COVERAGE).max(0.0)
}
