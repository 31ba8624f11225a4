//! Random search for planes: Lacewell, Edwards, Shirley, Thompson, "Stochastic Billboard Clouds for Interactive Foliage
//! Rendering" (2006), Algorithm 1.
//!
//! Until no piece remains: draw N planes, each through a random remaining triangle whose vertices are moved by up to ±ε along
//! its normal; keep the one that holds the greatest projected area; remove what it holds. The printed pseudo-code resets its maximum inside the
//! loop and never updates it; the text is right, the best of N is kept.
//!
//! Beyond the paper, the best plane is refined: rounds of small turns and shifts about the centre of what it holds,
//! with a shrinking step. That is worth more than the same number of fresh draws (a fifth fewer planes).
//!
//! Complexity O(K · N · n) for K planes over n pieces; the constant is a block scan (see `blocks`). Known limit: greedy, it
//! never takes a plane back.

use glam::DVec3;
use rayon::prelude::*;

use super::Fitter;
use super::blocks::Blocks;
use super::pieces::{Piece, Pieces};
use super::random::Stream;
use crate::error::Result;
use crate::geometry::Plane;
use crate::progress::Progress;

/// Steps of the refinement, as shares of the bound.
const REFINE_STEPS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Candidates of one refinement step, as a share of N.
const REFINE_SHARE: usize = 8;

/// One candidate in this many is its seed's own plane.
const UNMOVED: usize = 16;

/// Best of N random planes, again and again.
pub struct Stochastic {
    /// N of the paper.
    pub candidates: usize,
    pub seed: u64,
}

/// A plane and the area that it would capture.
#[derive(Clone, Copy)]
struct Scored {
    area: f64,
    plane: Plane,
}

impl Fitter for Stochastic {
    fn cover(&self, pieces: &Pieces, bound: f64, progress: Progress) -> Result<Vec<Plane>> {
        let total: f64 = pieces.as_slice().iter().map(Piece::area).sum();
        let mut remaining: Vec<&Piece> = pieces.as_slice().iter().collect();
        let mut planes = Vec::new();
        while !remaining.is_empty() {
            let left: f64 = remaining.iter().map(|p| p.area()).sum();
            progress.tell("fit", 1.0 - left / total)?;
            let plane = self.best_plane(&remaining, bound, planes.len());
            let before = remaining.len();
            remaining.retain(|p| !p.held_by(&plane, bound));
            if remaining.len() < before {
                planes.push(plane);
            } else {
                // Only slivers are left, or f32 saw a capture that f64 does not: the first piece gets a plane of its own.
                let own = remaining[0].own;
                remaining.retain(|p| !p.held_by(&own, bound));
                planes.push(own);
            }
        }
        Ok(planes)
    }
}

impl Stochastic {
    fn best_plane(&self, remaining: &[&Piece], bound: f64, round: usize) -> Plane {
        let blocks = Blocks::of(remaining.iter().copied());
        let draw = |candidate: usize| {
            let mut stream = Stream::new(self.seed, round, candidate);
            let seed = remaining[stream.below(remaining.len())];
            // Some seeds stay where they are: leaves in one plane, however large, are captured by it alone.
            let reach = if candidate.is_multiple_of(UNMOVED) { 0.0 } else { bound };
            perturbed_seed(seed, reach, &mut stream)
        };
        let fallback = Scored { area: 0.0, plane: remaining[0].own };
        let mut best = best_of(&blocks, bound, fallback, 0..self.candidates, draw);
        let tries = self.candidates.div_ceil(REFINE_SHARE);
        for (step, share) in REFINE_STEPS.iter().enumerate() {
            let pivot = centre_of_held(remaining, &best.plane, bound);
            let first = self.candidates + step * tries;
            let turn = |candidate: usize| {
                let mut stream = Stream::new(self.seed, round, candidate);
                turned(&best.plane, pivot, share * bound, &mut stream)
            };
            best = best_of(&blocks, bound, best, first..first + tries, turn);
        }
        best.plane
    }
}

/// The best of `start` and what `draw` gives for each candidate; of equal ones the earliest.
fn best_of(
    blocks: &Blocks,
    bound: f64,
    start: Scored,
    candidates: std::ops::Range<usize>,
    draw: impl Fn(usize) -> Option<Plane> + Sync,
) -> Scored {
    let scored = |candidate: usize| {
        let plane = draw(candidate)?;
        Some((candidate, Scored { area: blocks.score(&plane, bound), plane }))
    };
    let better = |a: (usize, Scored), b: (usize, Scored)| {
        let b_wins = b.1.area > a.1.area || (b.1.area == a.1.area && b.0 < a.0);
        if b_wins { b } else { a }
    };
    match candidates.into_par_iter().filter_map(scored).reduce_with(better) {
        Some((_, found)) if found.area > start.area => found,
        _ => start,
    }
}

/// The plane through three vertices of the seed, each moved along the seed's normal by at most `reach`; `None` for a seed without
/// area and for moved points on one line.
fn perturbed_seed(seed: &Piece, reach: f64, stream: &mut Stream) -> Option<Plane> {
    let normal = seed.areas.get(stream.below(seed.areas.len().max(1)))?.try_normalize()?;
    let count = seed.vertices.len();
    // Three distinct vertices: a random one, and two steps on that cannot meet.
    let first = stream.below(count);
    let second = 1 + stream.below(count - 1);
    let third = 1 + stream.below(count - 2);
    let third = if third >= second { third + 1 } else { third };
    let corners = [first, (first + second) % count, (first + third) % count].map(|i| seed.vertices[i]);
    Plane::through_points(corners.map(|v| v + normal * (stream.signed() * reach)))
}

/// The plane turned about `pivot` and shifted, both by about `step`.
fn turned(plane: &Plane, pivot: DVec3, step: f64, stream: &mut Stream) -> Option<Plane> {
    let normal = (plane.normal + stream.vector() * step).try_normalize()?;
    let height = plane.height(pivot) + stream.signed() * step;
    Some(Plane { normal, distance: normal.dot(pivot) - height })
}

/// The mean of the vertices that the plane holds; its own foot point when it holds none.
fn centre_of_held(remaining: &[&Piece], plane: &Plane, bound: f64) -> DVec3 {
    let held = remaining.iter().filter(|p| p.held_by(plane, bound)).flat_map(|p| &p.vertices);
    let (sum, count) = held.fold((DVec3::ZERO, 0usize), |(sum, count), &v| (sum + v, count + 1));
    if count == 0 { plane.normal * plane.distance } else { sum / count as f64 }
}
