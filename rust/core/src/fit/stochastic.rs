//! The stochastic method, by effort: the published search, or a greedy search over all offsets followed by a descent.
//!
//! Large foliage is fitted through a core-set: a sample with slightly tighter bounds. All pieces are tested against the core-set's slabs;
//! some of the missed pieces join it for the next round. Finally, a greedy search covers the pieces that are still missed.

use super::descent::{DescentPlan, descend};
use super::greedy::{self, GreedyPlan};
use super::pieces::{Pieces, Slab};
use super::settings::Effort;
use super::sweep::Search;
use super::{Fitter, assign, literal};
use crate::error::Result;
use crate::progress::Progress;
use crate::random::Stream;

/// The stochastic method.
pub struct Stochastic {
    /// Planes tried per billboard (N of the paper).
    pub candidates: usize,
    pub effort: Effort,
}

/// Greatest number of pieces that are fitted without a core-set.
const MOST_PIECES: usize = 40_000;

/// Initial pieces of a core-set, number of pieces that join it in each round, and number of rounds.
const CORE: usize = 12_000;
const JOINING: usize = 4_000;
const ROUNDS: usize = 3;

/// Share of a full descent's steps in each round.
const STEPS_SHARE: f64 = 0.38;

/// Factor of the bounds of pieces in a core-set.
const TIGHTER: f32 = 0.97;

/// Number of pieces at which a descent takes half of its full steps per slab; smaller foliage needs fewer.
const FEW_PIECES: f64 = 6000.0;

/// Area that a descent with default effort may lose, relative to the loss of the greedy answer.
const QUICK_LOSS: f64 = 1.1;

/// Longer searches may keep less leaf area whole than the greedy search: at most this share of the difference between the greedy
/// search and the published algorithm.
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

    /// Returns the share of their area that the pieces must keep: between the shares of the greedy answer and of the published algorithm,
    /// which is lower; with default effort near the greedy answer's.
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

/// Returns ascending numbers below `count`, one from each of `size` equal parts: spread over the whole, because pieces are in spatial
/// order.
fn sample(count: usize, size: usize, seed: u64) -> Vec<u32> {
    let mut stream = Stream::new(seed, 0, 1 << 22);
    let part = count as f64 / size as f64;
    let mut drawn: Vec<u32> = (0..size).map(|i| ((i as f64 + stream.unit()) * part) as u32).collect();
    drawn.dedup();
    drawn
}
