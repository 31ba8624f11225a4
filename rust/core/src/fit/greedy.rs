//! Greedy cover: repeatedly takes the slab that holds the most remaining weight.
//!
//! The field, the histograms of all directions and offsets, persists from slab to slab. The pieces of a slab are subtracted from every
//! histogram, so each piece is added and removed once instead of swept for every slab: O(n · D) for D directions instead of O(K · n · D).
//! The field holds a sample of the pieces. It is rebuilt with other directions whenever half of the pieces are gone. Its highest peaks are
//! then refined: cones of directions around them, over all pieces nearby.
//!
//! Some searches cannot use a field: those with an ε so small that there are too many offsets, and those with a limited billboard
//! size, which direction and offset do not determine. They start from planes through random pieces instead.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::pieces::{Pieces, Slab};
use super::seeds::{perturbed_plane, seeded_normal};
use super::sweep::{Bins, Histogram, LANES, Octet, Search, best_near, cone, hemisphere};
use crate::error::Result;
use crate::progress::Progress;
use crate::random::Stream;

/// Effort of the greedy search.
#[derive(Clone, Copy, Debug)]
pub struct GreedyPlan {
    /// Number of directions in the field, in groups of eight.
    pub octets: usize,
}

/// Peaks of the field to refine.
const PEAKS: usize = 2;

/// Random starts that replace each peak without a field.
const STARTS_PER_PEAK: usize = 8;

/// Pieces in a field.
const SAMPLE: usize = 2000;

/// Cones around a peak: spreads as shares of the spacing of the field's directions, and directions in groups of eight.
const CONES: [f64; 2] = [0.6, 0.2];
const CONE_OCTETS: usize = 2;

/// Integer units of the whole foliage's weight, and of the heaviest piece (its product with a share must stay below 2²²).
const WHOLE: f64 = (1u32 << 28) as f64;
const HEAVIEST: f64 = 4e6;

/// Returns slabs that serve each piece at least once.
pub fn cover(pieces: &Pieces, plan: GreedyPlan, search: &Search, progress: Progress) -> Result<Vec<Slab>> {
    let mut state = GreedyState::new(pieces, plan, search);
    let whole = state.left();
    let mut slabs = Vec::new();
    while !state.remaining.is_empty() {
        progress.tell("fit", 1.0 - state.left() / whole)?;
        let round = slabs.len();
        state.renew_field(round);
        let found = state.best_slab(round).map(|slab| (slab, state.taken(&slab)));
        let (slab, taken) = match found {
            Some((slab, taken)) if !taken.is_empty() => (slab, taken),
            // Only slivers are left, or pieces that f32 misses: the first piece gets its own plane.
            _ => {
                let first = state.remaining[0].0;
                let own = pieces.own_slab(first as usize, search.reach);
                let mut taken = state.taken(&own);
                if !taken.contains(&first) {
                    taken.push(first);
                }
                (own, taken)
            }
        };
        state.remove(&taken);
        slabs.push(slab);
    }
    Ok(slabs)
}

struct GreedyState<'a> {
    pieces: &'a Pieces<'a>,
    plan: GreedyPlan,
    search: &'a Search<'a>,
    weights: Vec<i32>,
    open: Vec<bool>,
    remaining: Vec<(u32, i32)>,
    /// `None` if a field cannot be used.
    field: Option<Field>,
}

impl<'a> GreedyState<'a> {
    fn new(pieces: &'a Pieces<'a>, plan: GreedyPlan, search: &'a Search<'a>) -> Self {
        let weights = weights(pieces);
        let remaining = (0u32..).zip(weights.iter().copied()).collect();
        Self { pieces, plan, search, weights, open: vec![true; pieces.len()], remaining, field: None }
    }

    /// Returns the remaining weight.
    fn left(&self) -> f64 {
        self.remaining.iter().map(|m| f64::from(m.1)).sum()
    }

    fn renew_field(&mut self, round: usize) {
        let range = 1.0 + self.pieces.greatest_bound();
        if self.search.reach.is_finite() || !Bins::are_enough(range, self.search.bin) {
            return;
        }
        let bins = Bins::over(range, self.search.bin);
        if self.field.as_ref().is_none_or(|field| self.remaining.len() * 2 < field.built_for) {
            self.field = Some(Field::new(self.pieces, &self.remaining, bins, self.plan.octets, self.search, round));
        }
    }

    /// Returns the open pieces that the slab serves.
    fn taken(&self, slab: &Slab) -> Vec<u32> {
        let mut served = self.search.served(self.pieces, slab);
        served.retain(|&i| self.open[i as usize]);
        served
    }

    fn remove(&mut self, taken: &[u32]) {
        for &i in taken {
            self.open[i as usize] = false;
        }
        if let Some(field) = &mut self.field {
            field.remove(self.pieces, taken, &self.weights, self.search);
        }
        self.remaining.retain(|m| self.open[m.0 as usize]);
    }

    fn best_slab(&self, round: usize) -> Option<Slab> {
        let starts = match &self.field {
            Some(field) => field.peaks(PEAKS),
            None => self.seeds(round),
        };
        let close =
            |(number, start): (usize, &Slab)| self.closer(start, &mut Stream::new(self.search.seed, round, number));
        let found: Vec<(f32, Slab)> = starts.par_iter().enumerate().map(close).collect();
        found.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, slab)| slab)
    }

    /// Returns planes through random pieces.
    fn seeds(&self, round: usize) -> Vec<Slab> {
        let seed = |number: usize| {
            let mut stream = Stream::new(self.search.seed, round, (1 << 20) + number);
            let piece = self.remaining[stream.below(self.remaining.len())].0 as usize;
            let plane = perturbed_plane(self.pieces, piece, &mut stream)?;
            let reach = self.pieces.reach_around(piece, self.search.reach);
            Some(Slab { plane, centre: self.pieces.centre(piece), reach })
        };
        (0..PEAKS * STARTS_PER_PEAK).filter_map(seed).collect()
    }

    /// Returns the best slab in cones around `start`, with its score.
    fn closer(&self, start: &Slab, stream: &mut Stream) -> (f32, Slab) {
        let bound = self.pieces.greatest_bound();
        let spacing = (std::f64::consts::TAU / (self.plan.octets * LANES) as f64).sqrt().min(4.0 * f64::from(bound));
        let mut best = (0.0, *start);
        for share in CONES {
            let spread = share * spacing;
            let members = self.members(&best.1, 1.0 + spread as f32 / bound);
            let normals = cone(best.1.plane.normal, spread, stream.signed() * std::f64::consts::PI, CONE_OCTETS);
            let around = Slab { centre: self.pivot(&best.1), ..best.1 };
            let found = best_near(self.pieces, &members, &around, &normals, 2.0 * bound, self.search);
            if found.0 > best.0 {
                best = (found.0, Slab { centre: best.1.centre, ..found.1 });
            }
        }
        best
    }

    /// Returns the open pieces within `width` bounds of the slab's plane and within its reach, with their weights.
    fn members(&self, slab: &Slab, width: f32) -> Vec<(u32, i32)> {
        let wanted = |i: &u32| {
            let i = *i as usize;
            self.open[i] && self.pieces.touches(i, slab, width) && self.pieces.within_reach(i, slab.centre, slab.reach)
        };
        self.pieces.near(slab, width).filter(wanted).map(|i| (i, self.weights[i as usize])).collect()
    }

    /// Returns the pivot of cones: the middle of the slab's pieces, or its center if its size is limited.
    fn pivot(&self, slab: &Slab) -> Vec3 {
        let taken = if slab.reach.is_finite() { Vec::new() } else { self.taken(slab) };
        if taken.is_empty() {
            return slab.centre;
        }
        let sum: DVec3 = taken.iter().map(|&i| self.pieces.centre(i as usize).as_dvec3()).sum();
        (sum / taken.len() as f64).as_vec3()
    }
}

/// Returns each piece's weight in integer units, at least one.
fn weights(pieces: &Pieces) -> Vec<i32> {
    let weight = |i: usize| f64::from(pieces.weight(i));
    let (total, most) = (0..pieces.len()).map(weight).fold((0.0, 0.0f64), |(sum, most), w| (sum + w, most.max(w)));
    let unit = if total > 0.0 { (WHOLE / total).min(HEAVIEST / most) } else { 0.0 };
    (0..pieces.len()).map(|i| ((weight(i) * unit) as i32).max(1)).collect()
}

/// Histograms of all directions.
struct Field {
    octets: Vec<Octet>,
    histograms: Vec<Histogram>,
    bins: Bins,
    built_for: usize,
    /// Whether the field holds each piece.
    knows: Vec<bool>,
}

impl Field {
    fn new(pieces: &Pieces, members: &[(u32, i32)], bins: Bins, octets: usize, search: &Search, round: usize) -> Self {
        let range = bins.width * bins.count as f32 / 2.0;
        let normals = directions(pieces, members, octets, search.seed, round);
        let octets = normals.iter().map(|normals| Octet::new(normals, Vec3::ZERO, range, search.favour));
        let octets: Vec<Octet> = octets.collect();
        let stride = members.len().div_ceil(SAMPLE);
        let sample: Vec<(u32, i32)> = members.iter().skip(round % stride).step_by(stride).copied().collect();
        let mut knows = vec![false; pieces.len()];
        for m in &sample {
            knows[m.0 as usize] = true;
        }
        let histograms = octets.iter().map(|_| Histogram::new(bins)).collect();
        let mut field = Self { octets, histograms, bins, built_for: members.len(), knows };
        field.add(pieces, &sample, search);
        field
    }

    fn add(&mut self, pieces: &Pieces, members: &[(u32, i32)], search: &Search) {
        let (bins, guard) = (self.bins, search.guard);
        self.octets.par_iter().zip(&mut self.histograms).for_each(|(octet, histogram)| {
            histogram.add(octet, pieces, bins, guard, members);
        });
    }

    fn remove(&mut self, pieces: &Pieces, taken: &[u32], weights: &[i32], search: &Search) {
        let known = taken.iter().filter(|&&i| self.knows[i as usize]);
        let gone: Vec<(u32, i32)> = known.map(|&i| (i, -weights[i as usize])).collect();
        self.add(pieces, &gone, search);
    }

    /// Returns the best plane of each of the `count` best groups of eight directions.
    fn peaks(&self, count: usize) -> Vec<Slab> {
        let pairs = self.octets.par_iter().zip(&self.histograms);
        let mut peaks: Vec<_> = pairs.map(|(octet, histogram)| (histogram.peak(octet), octet)).collect();
        peaks.retain(|(peak, _)| peak.score > 0.0);
        peaks.sort_by(|a, b| b.0.score.total_cmp(&a.0.score));
        peaks.truncate(count);
        let slab = |(peak, octet): &(_, &Octet)| {
            let plane = octet.plane(peak, self.bins);
            Slab { plane, centre: (plane.normal * plane.distance).as_vec3(), reach: f32::INFINITY }
        };
        peaks.iter().map(slab).collect()
    }
}

/// Returns the directions of a field: half evenly spread over the hemisphere, half the normals of planes through random pieces.
fn directions(pieces: &Pieces, members: &[(u32, i32)], octets: usize, seed: u64, round: usize) -> Vec<[Vec3; LANES]> {
    let even = octets.div_ceil(2);
    let mut directions = hemisphere(even);
    let seeded = |number: usize| -> Vec3 {
        let mut stream = Stream::new(seed, round, (1 << 21) + number);
        let piece = members[stream.below(members.len())].0 as usize;
        seeded_normal(pieces, piece, &mut stream).unwrap_or(Vec3::Z)
    };
    directions.extend((even..octets).map(|o| std::array::from_fn(|l| seeded(o * LANES + l))));
    directions
}
