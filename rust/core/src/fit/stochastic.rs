//! The stochastic method, by effort: the published search, a greedy one over all offsets, and a descent behind it.
//!
//! Large soups are fitted by a core-set: a sample, held a little closer than it must be. All pieces are checked against its answer;
//! some of those that are missed join it, and in the end what is still missed gets planes of its own.

use super::descent::{DescentPlan, descend};
use super::greedy::{self, GreedyPlan};
use super::pieces::{Pieces, Slab};
use super::random::Stream;
use super::settings::Effort;
use super::sweep::Search;
use super::{Fitter, assign, literal};
use crate::error::Result;
use crate::progress::Progress;

/// Random search and what grew from it.
pub struct Stochastic {
    /// N of the paper.
    pub candidates: usize,
    pub effort: Effort,
}

/// More pieces than this are fitted by a core-set.
const MOST_PIECES: usize = 40_000;

/// Pieces of a core-set at first, and how many join it in each round.
const CORE: usize = 12_000;
const JOINING: usize = 4_000;
const ROUNDS: usize = 3;

/// The share of a whole descent's steps in each round.
const STEPS_SHARE: f64 = 0.38;

/// The share of its bound that a piece of a core-set is held to.
const TIGHTER: f32 = 0.97;

/// Pieces from which on the steps of a descent are proportional to the slabs that it begins with; smaller foliage needs fewer.
const FEW_PIECES: f64 = 6000.0;

/// Of the area that the greedy answer loses, what a quick search may lose.
const QUICK_LOSS: f64 = 1.1;

/// How far a long search may go from the share of the greedy answer to the published algorithm's.
const TOWARDS_LITERAL: f64 = 0.4;

impl Fitter for Stochastic {
    fn cover(
        &self,
        pieces: &Pieces,
        search: &Search,
        progress: Progress,
        answer: &dyn Fn(&[Slab]),
    ) -> Result<Vec<Slab>> {
        if self.effort == Effort::Literal {
            return literal::cover(pieces, self.candidates, search, progress);
        }
        if pieces.len() <= MOST_PIECES {
            let slabs = greedy::cover(pieces, self.greedy_plan(), search, progress.part(0.0, 0.3))?;
            return self.descended(pieces, slabs, search, 1.0, progress.part(0.3, 1.0), answer);
        }
        self.cover_by_core_set(pieces, search, progress)
    }
}

impl Stochastic {
    fn greedy_plan(&self) -> GreedyPlan {
        GreedyPlan { octets: self.candidates.div_ceil(20).clamp(2, 512) }
    }

    fn descended(
        &self,
        pieces: &Pieces,
        slabs: Vec<Slab>,
        search: &Search,
        share: f64,
        progress: Progress,
        answer: &dyn Fn(&[Slab]),
    ) -> Result<Vec<Slab>> {
        let (per_slab, fewest) = match self.effort {
            Effort::Literal => return Ok(slabs),
            Effort::Default => (1.0, 100.0),
            Effort::Final => (150.0, 3000.0),
            Effort::Best => (1500.0, 30000.0),
        };
        let n = pieces.len() as f64;
        let steps = (per_slab * slabs.len() as f64 * n / (n + FEW_PIECES)).max(fewest);
        let plan = DescentPlan { steps: (steps * share) as usize, kept: self.wanted_share(pieces, &slabs, search)? };
        answer(&slabs);
        descend(pieces, slabs, plan, search, progress, answer)
    }

    /// What share of their area the pieces must keep: between what they keep in the greedy answer and in the published algorithm, which is
    /// less; a quick search stays near the former.
    fn wanted_share(&self, pieces: &Pieces, slabs: &[Slab], search: &Search) -> Result<f64> {
        let greedy = assign::kept_share(pieces, slabs);
        if self.effort == Effort::Default {
            return Ok(1.0 - QUICK_LOSS * (1.0 - greedy));
        }
        let literal = literal::kept_share(pieces, search, Progress::silent())?.min(greedy);
        Ok(greedy + TOWARDS_LITERAL * (literal - greedy))
    }

    fn cover_by_core_set(&self, pieces: &Pieces, search: &Search, progress: Progress) -> Result<Vec<Slab>> {
        let plan = self.greedy_plan();
        let mut core = sample(pieces.len(), CORE, search.seed);
        let (mut slabs, mut missed): (Vec<Slab>, Vec<u32>) = (Vec::new(), Vec::new());
        for round in 0..ROUNDS {
            let progress = progress.part(0.9 * round as f64 / ROUNDS as f64, 0.9 * (round + 1) as f64 / ROUNDS as f64);
            core.extend(missed.iter().step_by(missed.len().div_ceil(JOINING).max(1)));
            core.sort_unstable();
            core.dedup();
            let tight = pieces.select(&core).held_to(TIGHTER);
            let open = assign::unserved(&tight, &slabs, search);
            slabs.extend(greedy::cover(&tight.select(&open), plan, search, progress.part(0.0, 0.3))?);
            slabs = self.descended(&tight, slabs, search, STEPS_SHARE, progress.part(0.3, 1.0), &|_| {})?;
            missed = assign::unserved(pieces, &slabs, search);
            if missed.is_empty() {
                break;
            }
        }
        while !missed.is_empty() {
            let some: Vec<u32> = missed.iter().copied().step_by(missed.len().div_ceil(CORE)).collect();
            slabs.extend(greedy::cover(&pieces.select(&some), plan, search, progress.part(0.9, 1.0))?);
            missed = assign::unserved(pieces, &slabs, search);
        }
        Ok(slabs)
    }
}

/// Ascending numbers below `count`, one drawn from each of `size` equal parts: in spatial order, spread over the whole.
fn sample(count: usize, size: usize, seed: u64) -> Vec<u32> {
    let mut stream = Stream::new(seed, 0, 1 << 22);
    let part = count as f64 / size as f64;
    let mut drawn: Vec<u32> = (0..size).map(|i| ((i as f64 + stream.unit()) * part) as u32).collect();
    drawn.dedup();
    drawn
}
