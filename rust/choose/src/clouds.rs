//! ε and size of each cloud.
//!
//! How much a cloud differs, over the control, follows ε and hardly the size. So ε of the first cloud is the largest one that q allows, found with
//! drafts ([`Drafts`]), which have no textures: one at the usual ε, and one or two that correct it. The first cloud then passes at any size for
//! which its page has texels, and nearness is bought by memory. The control moves by more of a small crown ([`crate::sway::motion`]), so later
//! clouds may have a larger ε.

use leafcloud::error::Result;
use leafcloud::fit::{FitSettings, Method};
use leafcloud::lod::{ChainSettings, CloudStep, Draft, Drafts, EPSILON_STEP, STEP_IN_SCENES, is_published};
use leafcloud::{Foliage, Progress};

use crate::sway::{MOVE, motion};
use crate::wishes::{LARGEST_CROWN, Wishes};
use crate::yardstick::{OF_DRAFTS, Subject, Yardstick};

/// ε of the first draft for q = 1: the measured trees differ by 0.7 to 1 × the control. The difference grows with about the root of ε.
const USUAL: f64 = 0.04;
const BY_Q: f64 = 1.5;

/// Range of ε that is tried.
const FINEST: f64 = 0.008;
const COARSEST: f64 = 0.12;

/// Share of an allowance that a draft may use: textures need the rest.
const WANTED: (f64, f64) = (0.7, 0.92);
const AIM: f64 = 0.82;

/// Most drafts, and the greatest factor on ε from one to the next.
const MOST_DRAFTS: usize = 3;
const LARGEST_STEP: f64 = 2.5;

/// Deviation in pixels of the first draft, as that of the first cloud: its size limit of billboards is that of all drafts.
const PIXELS: f64 = 10.0;

/// Diameters of the crown in pixels for which clouds get texels.
pub const CROWNS: [f64; 3] = [LARGEST_CROWN, 100.0, 40.0];

/// Share of these at which later clouds are expected to pass.
const EXPECTED: f64 = 0.95;

/// Least ε of a later cloud, as a share of the allowed one.
const LEAST_SHARE: f64 = 0.5;

/// A value of ε that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriedEpsilon {
    /// ε as a share of R.
    pub epsilon: f64,
    /// The greatest share of an allowance that the leaves use on their planes, without textures, and the name of the figure.
    pub excess: (f64, &'static str),
    /// Number of billboards.
    pub billboards: usize,
}

/// Returns whether no other setting determines ε.
#[must_use]
pub fn leave_a_choice(fit: &FitSettings) -> bool {
    let is_fixed = fit.max_billboards.is_some() || fit.max_texels.is_some() || fit.image.is_some();
    !is_fixed && fit.method == Method::Stochastic && !is_published(fit.method, fit.effort)
}

/// Returns the ε that were tried; the last one is the largest that q allows.
///
/// # Errors
/// The errors of a fit; [`Error::Cancelled`](leafcloud::Error::Cancelled).
pub fn tried_epsilons(
    wishes: &Wishes,
    yardstick: &Yardstick,
    finest: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Vec<TriedEpsilon>> {
    let q = wishes.q();
    let allowed = |epsilon: f64| settings.fit.max_size.map_or(epsilon, |size| epsilon.min(size));
    let first = allowed((USUAL * libm::pow(q, BY_Q)).clamp(FINEST, COARSEST));
    let fit = FitSettings { epsilon: first, ..settings.fit.clone() };
    let settings = ChainSettings { fit, pixels: PIXELS, steps: Vec::new(), ..settings.clone() };
    let drafts = Drafts::new(&settings, finest, trunk, progress.part(0.0, 0.4))?;
    let judge = |draft: &Draft, epsilon: f64| -> Result<TriedEpsilon> {
        let judged = yardstick.judge(Subject::Foliage(&draft.collapsed), OF_DRAFTS, q)?;
        let excess = judged.map_or((0.0, "difference"), |judged| {
            let difference = (judged.difference / q, "difference");
            if judged.places > difference.0 { (judged.places, "places") } else { difference }
        });
        Ok(TriedEpsilon { epsilon, excess, billboards: draft.billboards() })
    };
    let mut tried = vec![judge(&drafts.first, first)?];
    let most = if wishes.is_quick() { 1 } else { MOST_DRAFTS };
    let next = |last: &TriedEpsilon| {
        let (excess, _) = last.excess;
        let step = libm::pow(AIM / excess.max(0.01), BY_Q).clamp(1.0 / LARGEST_STEP, LARGEST_STEP);
        allowed((last.epsilon * step).clamp(FINEST, COARSEST))
    };
    while let Some(last) = tried.last() {
        let is_right = (WANTED.0..=WANTED.1).contains(&last.excess.0);
        let epsilon = next(last);
        if is_right || tried.len() == most || (epsilon / last.epsilon - 1.0).abs() < 0.05 {
            break;
        }
        let draft =
            drafts.with(epsilon, progress.part(0.3 + 0.2 * tried.len() as f64, 0.5 + 0.2 * tried.len() as f64))?;
        tried.push(judge(&draft, epsilon)?);
    }
    if tried.len() == most && !wishes.is_quick() {
        // The last of the drafts may still use too much: then the best that was found counts, or a finer one.
        tried.sort_by(|a, b| b.excess.0.total_cmp(&a.excess.0));
        if let Some(place) = tried.iter().position(|each| each.excess.0 <= WANTED.1) {
            let best = tried.remove(place);
            tried.push(best);
        }
    }
    Ok(tried)
}

/// Returns ε and size of each cloud, without those before number `first`. `epsilon`: what q allows.
#[must_use]
pub fn steps(wishes: &Wishes, epsilon: f64, levels: usize, first: usize) -> Vec<CloudStep> {
    let count = if wishes.sizes.is_empty() { levels } else { wishes.sizes.len() };
    let (mut steps, mut squares) = (Vec::new(), 0.0);
    for number in first..count {
        let coarser = 0.4 * steps.last().map_or(LARGEST_CROWN, |step: &CloudStep| step.crown_pixels);
        let usual = CROWNS.get(number).copied().unwrap_or(coarser);
        let crown_pixels = wishes.crown(number).unwrap_or(usual);
        let passes = if number == 0 || !wishes.sizes.is_empty() { crown_pixels } else { EXPECTED * crown_pixels };
        let allowed = epsilon * motion(passes) / MOVE;
        // Independent motions add up by their squares.
        let own = (allowed * allowed - squares).max(0.0).sqrt().max(LEAST_SHARE * epsilon).min(1.0);
        squares += own * own;
        let share = libm::pow(STEP_IN_SCENES as f64, -(number as f64));
        steps.push(CloudStep { epsilon: own, crown_pixels, share });
    }
    steps
}

/// Returns ε and size of each cloud, if the first ε is given: ε grows by [`EPSILON_STEP`] from cloud to cloud, and the yardstick is expected to pass
/// each cloud at its size.
#[must_use]
pub fn given_steps(wishes: &Wishes, epsilon: f64, levels: usize) -> Vec<CloudStep> {
    let usual = USUAL * libm::pow(wishes.q(), BY_Q);
    let count = if wishes.sizes.is_empty() { levels } else { wishes.sizes.len() };
    let (mut steps, mut squares) = (Vec::new(), 0.0);
    for number in 0..count {
        let own = (epsilon * libm::pow(EPSILON_STEP, number as f64)).min(1.0);
        squares += own * own;
        let needed = squares.sqrt() / usual * MOVE;
        let passes = if needed <= MOVE { LARGEST_CROWN } else { (3.0 / needed).max(12.0) };
        let crown_pixels = wishes.crown(number).unwrap_or(passes);
        steps.push(CloudStep { epsilon: own, crown_pixels, share: 1.0 });
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_together_deviate_as_much_as_the_breeze_moves_a_crown_of_their_size() {
        let found = steps(&Wishes::default(), 0.04, 2, 0);
        let together = |count: usize| found[..count].iter().map(|step| step.epsilon.powi(2)).sum::<f64>().sqrt();
        let crowns: Vec<f64> = found.iter().map(|step| step.crown_pixels).collect();
        assert_eq!(crowns, [540.0, 100.0]);
        for (count, expected) in [(1, 0.04), (2, 0.04 * (3.0 / 95.0) / 0.025)] {
            assert!((together(count) - expected).abs() < 1e-9, "{count}: {} {expected}", together(count));
        }
    }

    #[test]
    fn wished_sizes_are_kept() {
        let wishes = Wishes { sizes: vec![0.5, 0.25, 0.1], ..Wishes::default() };
        let found: Vec<f64> = steps(&wishes, 0.04, 2, 0).iter().map(|step| step.crown_pixels).collect();
        assert_eq!(found, [540.0, 270.0, 108.0]);
    }

    #[test]
    fn a_coarse_epsilon_takes_over_where_the_crown_is_small() {
        let crowns = [0.02, 0.08, 0.2].map(|epsilon| given_steps(&Wishes::default(), epsilon, 1)[0].crown_pixels);
        assert!(crowns[0] == LARGEST_CROWN && crowns[1] < 100.0 && crowns[2] < 40.0, "{crowns:?}");
    }
}
