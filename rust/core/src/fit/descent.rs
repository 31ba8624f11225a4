//! Weighted descent: reduces the number of slabs while they serve all pieces.
//!
//! A local search for set covers with row weights (after Gao, Weise, Li, "An efficient local search heuristic with row weighting for the
//! unicost set covering problem", 2015) in which the columns are all planes. Whenever every piece is served, the answer is kept and the
//! slab with the least loss is dropped; a slab's loss is the weight that only it serves. Then, in each step: draw an unserved piece; let
//! some slabs offer new planes through it, aimed at the pieces that only they serve and at unserved pieces; move the slab with the greatest
//! gain; raise the weight of the pieces that remain unserved. The search stops after a fixed number of steps, not seconds, so it is
//! reproducible.
//!
//! Minimizing the count alone drifts to slabs that see many leaves edge-on. An answer therefore counts only if its pieces keep a
//! wanted share of their area on their parents' planes. If one does not, the guard rises: pieces that a slab sees too flatly are no longer
//! served by it.
//!
//! A step costs O(asked · (n / K) · D) for the sweeps and O(n) / 8 to find the pieces of the moved slab. Known limit: no proof of a
//! minimum.

use glam::Vec3;

use super::assign;
use super::pieces::{Pieces, Slab};
use super::seeds::seeded_normal;
use super::sweep::{LANES, Search, best_near, cone};
use crate::error::Result;
use crate::progress::Progress;
use crate::random::Stream;

/// Length and quality limit of a descent.
#[derive(Clone, Copy, Debug)]
pub struct DescentPlan {
    /// Number of steps; each moves a slab.
    pub steps: usize,
    /// Least share of their area that the pieces keep, in [0, 1].
    pub kept: f64,
}

/// Slabs that make offers in each step: half of them the nearest to the piece, half those with the least loss.
const ASKED: usize = 8;

/// Spreads (tangents) of the cones for an offer, and for the final aim of the slab that moves.
const FIRST_CONES: [f64; 2] = [0.05, 0.25];
const LAST_CONES: [f64; 2] = [0.06, 0.02];

/// Steps during which a moved slab makes no offers.
const REST: usize = 2;

/// Range of offsets around the piece's center, in bounds.
const RANGE: f32 = 1.25;

/// First weight of a piece, large enough for integer shares, and greatest weight. 2¹⁶ pieces, more than are ever searched together, sum to
/// at most 2³¹.
const UNIT: i32 = 16;
const HEAVIEST: i32 = 1 << 15;

/// Slope of the guard; less than in the greedy search, because the descent limits the lost area itself.
const SLOPE: f32 = 0.2;

/// Increase of the guard when the pieces keep too little of their area.
const GUARD_STEP: f32 = 0.03;

/// Steps between two checks for cancellation.
const PATIENCE: usize = 64;

/// Pieces in the sample that estimates the kept area.
const SAMPLE: usize = 2500;

/// Place of a piece that is served, so not in `unserved`.
const NOWHERE: u32 = u32::MAX;

/// Returns at most as many slabs as `slabs` that serve all pieces. `answer` receives each better answer on the way.
pub fn descend(
    pieces: &Pieces,
    slabs: Vec<Slab>,
    plan: DescentPlan,
    search: &Search,
    progress: Progress,
    answer: &dyn Fn(&[Slab]),
) -> Result<Vec<Slab>> {
    // The kept share is a mean, so a sample is enough.
    let stride = pieces.len().div_ceil(SAMPLE);
    let sample: Vec<u32> = (0..pieces.len() as u32).step_by(stride).collect();
    let sample = pieces.select(&sample);
    let mut best = slabs.clone();
    let mut search = *search;
    search.guard.slope = SLOPE;
    let mut state = DescentState::new(pieces, search, slabs);
    for step in 0..plan.steps {
        if step % PATIENCE == 0 {
            progress.tell("fit", step as f64 / plan.steps as f64)?;
        }
        while state.unserved.is_empty() {
            let found = state.alive();
            if assign::kept_share(&sample, &found) >= plan.kept {
                answer(&found);
                best = found;
                if best.len() == 1 {
                    return Ok(best);
                }
                state.drop_cheapest();
            } else {
                state = state.with_higher_guard();
            }
        }
        state.step(step);
    }
    if state.unserved.is_empty() && assign::kept_share(&sample, &state.alive()) >= plan.kept {
        best = state.alive();
    }
    Ok(best)
}

struct DescentState<'a> {
    pieces: &'a Pieces<'a>,
    search: Search<'a>,
    /// `None` for dropped slabs.
    slabs: Vec<Option<Slab>>,
    /// The pieces that each slab serves.
    served: Vec<Vec<u32>>,
    /// The weight that only this slab serves.
    loss: Vec<i64>,
    /// The first step at which a slab may make offers again.
    rests_until: Vec<usize>,
    /// The number of slabs that serve each piece.
    servers: Vec<u32>,
    /// The exclusive or of the numbers of these slabs: with one server, its number.
    server: Vec<u32>,
    weights: Vec<i32>,
    unserved: Vec<u32>,
    /// Index of each piece in `unserved`.
    place: Vec<u32>,
}

impl<'a> DescentState<'a> {
    fn new(pieces: &'a Pieces<'a>, search: Search<'a>, slabs: Vec<Slab>) -> Self {
        let n = pieces.len();
        Self::with_weights(pieces, search, slabs, vec![UNIT; n])
    }

    fn with_weights(pieces: &'a Pieces<'a>, search: Search<'a>, slabs: Vec<Slab>, weights: Vec<i32>) -> Self {
        let (n, count) = (pieces.len(), slabs.len());
        let mut state = Self {
            pieces,
            search,
            slabs: vec![None; count],
            served: vec![Vec::new(); count],
            loss: vec![0; count],
            rests_until: vec![0; count],
            servers: vec![0; n],
            server: vec![0; n],
            weights,
            unserved: (0..n as u32).collect(),
            place: (0..n as u32).collect(),
        };
        for (number, slab) in slabs.into_iter().enumerate() {
            state.put(number, slab);
        }
        state
    }

    fn with_higher_guard(self) -> Self {
        let (slabs, mut search) = (self.alive(), self.search);
        search.guard.facing += GUARD_STEP;
        Self::with_weights(self.pieces, search, slabs, self.weights)
    }

    fn alive(&self) -> Vec<Slab> {
        self.slabs.iter().flatten().copied().collect()
    }

    fn put(&mut self, number: usize, slab: Slab) {
        let served = self.search.served(self.pieces, &slab);
        self.loss[number] = 0;
        for &piece in &served {
            let i = piece as usize;
            let weight = i64::from(self.weights[i]);
            match self.servers[i] {
                0 => {
                    self.no_longer_unserved(piece);
                    self.loss[number] += weight;
                }
                1 => self.loss[self.server[i] as usize] -= weight,
                _ => {}
            }
            self.servers[i] += 1;
            self.server[i] ^= number as u32;
        }
        self.served[number] = served;
        self.slabs[number] = Some(slab);
    }

    fn take(&mut self, number: usize) {
        self.slabs[number] = None;
        for piece in std::mem::take(&mut self.served[number]) {
            let i = piece as usize;
            self.servers[i] -= 1;
            self.server[i] ^= number as u32;
            match self.servers[i] {
                0 => {
                    self.place[i] = self.unserved.len() as u32;
                    self.unserved.push(piece);
                }
                1 => self.loss[self.server[i] as usize] += i64::from(self.weights[i]),
                _ => {}
            }
        }
    }

    fn no_longer_unserved(&mut self, piece: u32) {
        let at = std::mem::replace(&mut self.place[piece as usize], NOWHERE) as usize;
        self.unserved.swap_remove(at);
        if let Some(&moved) = self.unserved.get(at) {
            self.place[moved as usize] = at as u32;
        }
    }

    fn drop_cheapest(&mut self) {
        let alive = (0..self.slabs.len()).filter(|&k| self.slabs[k].is_some());
        let cheapest = alive.min_by_key(|&k| (self.loss[k], k)).expect("some slab is alive");
        self.take(cheapest);
    }

    /// Moves a slab to serve one of the unserved pieces.
    fn step(&mut self, step: usize) {
        let mut stream = Stream::new(self.search.seed, step, 0);
        // Draw two and take the heavier.
        let [one, other] = [(); 2].map(|()| self.unserved[stream.below(self.unserved.len())]);
        let piece = if self.weights[other as usize] > self.weights[one as usize] { other } else { one } as usize;
        let offer = |number: usize| {
            let slab = self.slabs[number].expect("only live slabs make offers");
            let (gain, slab) = self.aimed(number, &slab, piece, &mut stream);
            (f64::from(gain) - self.loss[number] as f64, number, slab)
        };
        let offers = self.asked(piece, step).into_iter().map(offer);
        let Some((_, number, slab)) = offers.reduce(|a, b| if b.0 > a.0 { b } else { a }) else { return };
        let slab = self.aimed_finely(number, slab, piece, &mut stream);
        self.take(number);
        self.put(number, slab);
        self.rests_until[number] = step + REST;
        for &piece in &self.unserved {
            let weight = &mut self.weights[piece as usize];
            *weight = (*weight + UNIT).min(HEAVIEST);
        }
    }

    /// Returns the slabs that may move to serve the piece: the nearest and those with the least loss, without recently moved ones.
    fn asked(&self, piece: usize, step: usize) -> Vec<usize> {
        let height = |slab: &Slab| self.pieces.greatest_height(piece, slab);
        let awake = self.slabs.iter().enumerate().filter(|(k, _)| self.rests_until[*k] <= step);
        let mut near: Vec<(f32, usize)> = awake.filter_map(|(k, slab)| Some((height(slab.as_ref()?), k))).collect();
        let mut cheap: Vec<(i64, usize)> = near.iter().map(|&(_, k)| (self.loss[k], k)).collect();
        keep_least(&mut near, ASKED / 2, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        cheap.retain(|c| near.iter().all(|n| n.1 != c.1));
        keep_least(&mut cheap, ASKED / 2, Ord::cmp);
        near.into_iter().map(|n| n.1).chain(cheap.into_iter().map(|c| c.1)).collect()
    }

    /// Returns the pieces that a slab should serve: those that only it serves, and the unserved ones.
    fn targets(&self, number: usize, centre: Vec3, reach: f32) -> Vec<(u32, i32)> {
        let only = self.served[number].iter().filter(|&&i| self.servers[i as usize] == 1);
        let within = |i: &&u32| self.pieces.within_reach(**i as usize, centre, reach);
        only.chain(&self.unserved).filter(within).map(|&i| (i, self.weights[i as usize])).collect()
    }

    /// Returns the best plane for a slab near the piece, with its score.
    fn aimed(&self, number: usize, slab: &Slab, piece: usize, stream: &mut Stream) -> (f32, Slab) {
        let reach = self.pieces.reach_around(piece, self.search.reach);
        let through = Slab { centre: self.pieces.centre(piece), reach, ..*slab };
        let targets = self.targets(number, through.centre, reach);
        let turn = stream.signed() * std::f64::consts::PI;
        let mut normals: Vec<[Vec3; LANES]> =
            FIRST_CONES.iter().flat_map(|&spread| cone(slab.plane.normal, spread, turn, 1)).collect();
        normals.push(std::array::from_fn(|lane| {
            let of = if lane % 2 == 0 { piece } else { targets[stream.below(targets.len())].0 as usize };
            seeded_normal(self.pieces, of, stream).unwrap_or(Vec3::Z)
        }));
        best_near(self.pieces, &targets, &through, &normals, RANGE * self.pieces.bound(piece), &self.search)
    }

    /// Refines the plane of a slab that is about to move.
    fn aimed_finely(&self, number: usize, slab: Slab, piece: usize, stream: &mut Stream) -> Slab {
        let targets = self.targets(number, slab.centre, slab.reach);
        let mut best = (0.0, slab);
        for spread in LAST_CONES {
            let normals = cone(best.1.plane.normal, spread, stream.signed() * std::f64::consts::PI, 1);
            let range = RANGE * self.pieces.bound(piece);
            let found = best_near(self.pieces, &targets, &best.1, &normals, range, &self.search);
            if found.0 > best.0 {
                best = found;
            }
        }
        best.1
    }
}

/// Keeps the `count` least items, in order.
fn keep_least<T>(items: &mut Vec<T>, count: usize, order: impl Fn(&T, &T) -> std::cmp::Ordering) {
    if count < items.len() {
        items.select_nth_unstable_by(count, &order);
        items.truncate(count);
    }
    items.sort_unstable_by(order);
}

#[cfg(test)]
mod tests {
    use super::super::kernel_tests::{foliage, pieces};
    use super::super::sweep::Guard;
    use super::*;
    use crate::common::stability::case;

    /// Counts the differences between the state, updated by moves, and the same values computed from scratch.
    fn drifted(state: &DescentState) -> usize {
        let mut servers = vec![Vec::new(); state.pieces.len()];
        for (number, slab) in state.slabs.iter().enumerate() {
            let Some(slab) = slab else { continue };
            for piece in state.search.served(state.pieces, slab) {
                servers[piece as usize].push(number);
            }
        }
        let mut loss = vec![0i64; state.slabs.len()];
        let mut wrong = 0;
        for (i, by) in servers.iter().enumerate() {
            wrong += usize::from(state.servers[i] as usize != by.len());
            wrong += usize::from(by.is_empty() != state.unserved.contains(&(i as u32)));
            wrong += usize::from(by.is_empty() != (state.place[i] != NOWHERE));
            if let [only] = by[..] {
                loss[only] += i64::from(state.weights[i]);
                wrong += usize::from(state.server[i] as usize != only);
            }
        }
        let alive = (0..loss.len()).filter(|&k| state.slabs[k].is_some());
        wrong + alive.filter(|&k| loss[k] != state.loss[k]).count()
    }

    #[test]
    fn what_is_kept_up_to_date() {
        let foliage = foliage(400, 0.1);
        let pieces = pieces(&foliage, 0.08);
        let favour = |_: Vec3| 1.0;
        let guard = Guard { facing: 0.0, slope: SLOPE };
        let search = Search { guard, bin: 0.01, reach: f32::INFINITY, favour: &favour, seed: 5 };
        let slabs = (0..20).map(|i| pieces.own_slab(i * 19, f32::INFINITY)).collect();
        let mut state = DescentState::new(&pieces, search, slabs);
        let mut wrong = drifted(&state);
        for step in 0..300 {
            if state.unserved.is_empty() || step % 60 == 59 {
                state.drop_cheapest();
            }
            state.step(step);
            wrong += if step % 10 == 0 { drifted(&state) } else { 0 };
        }
        let shares = state.weights.iter().all(|w| (UNIT..=HEAVIEST).contains(w));
        assert!(shares && state.weights.iter().any(|&w| w > UNIT));
        case(
            "Kernels",
            "the descent's losses, servers and unserved pieces after 300 moves",
            "definition: as counted anew",
        )
        .holds(wrong as f64, 0.0);
    }
}
