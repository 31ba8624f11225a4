//! Lacewell, Edwards, Shirley, Thompson, "Stochastic Billboard Clouds for Interactive Foliage Rendering" (2006), Algorithm 1.
//!
//! Until no piece remains: draw N planes, each through a random remaining triangle with vertices moved by up to ±ε along
//! its normal; keep the plane that holds the greatest projected area; remove its pieces. The printed pseudo-code resets its maximum inside
//! the loop and never updates it; this code follows the text, which keeps the best of N. For comparison only: O(K · N · n).

use rayon::prelude::*;

use super::pieces::{Pieces, Slab};
use super::seeds::perturbed_plane;
use super::sweep::Search;
use crate::error::Result;
use crate::progress::Progress;
use crate::random::Stream;

/// Returns slabs that hold each piece at least once.
pub fn cover(pieces: &Pieces, candidates: usize, search: &Search, progress: Progress) -> Result<Vec<Slab>> {
    let mut open = vec![true; pieces.len()];
    let mut remaining: Vec<u32> = (0..pieces.len() as u32).collect();
    let mut slabs = Vec::new();
    while !remaining.is_empty() {
        let draw = |candidate: usize| {
            let mut stream = Stream::new(search.seed, slabs.len(), candidate);
            let piece = remaining[stream.below(remaining.len())] as usize;
            let plane = perturbed_plane(pieces, piece, &mut stream)?;
            let reach = pieces.reach_around(piece, search.reach);
            let slab = Slab { plane, centre: pieces.centre(piece), reach };
            Some((captured_area(pieces, &open, &slab), candidate, slab))
        };
        let better = |a: (f64, usize, Slab), b: (f64, usize, Slab)| {
            let b_wins = b.0 > a.0 || (b.0 == a.0 && b.1 < a.1);
            if b_wins { b } else { a }
        };
        let mut best: Option<(f64, usize, Slab)> = None;
        for first in (0..candidates).step_by(AT_ONCE) {
            progress.tell("fit", 1.0 - remaining.len() as f64 / pieces.len() as f64)?;
            let some = (first..(first + AT_ONCE).min(candidates)).into_par_iter().filter_map(draw).reduce_with(better);
            best = best.into_iter().chain(some).reduce(better);
        }
        let first = remaining[0];
        let slab = match best {
            Some((area, _, slab)) if area > 0.0 => slab,
            _ => {
                open[first as usize] = false; // its own plane holds it, even if rounding says otherwise
                pieces.own_slab(first as usize, search.reach)
            }
        };
        for i in pieces.held_in(&slab, 0..pieces.len()) {
            open[i as usize] = false;
        }
        remaining.retain(|&i| open[i as usize]);
        slabs.push(slab);
    }
    Ok(slabs)
}

/// Estimates the share of their weight that pieces keep in the published algorithm, each on the plane that captured it. A sample of pieces
/// and few candidates are enough, because the share hardly depends on either.
pub fn kept_share(pieces: &Pieces, search: &Search, progress: Progress) -> Result<f64> {
    let stride = pieces.len().div_ceil(SAMPLE);
    let sample: Vec<u32> = (0..pieces.len() as u32).step_by(stride).collect();
    let sample = pieces.select(&sample);
    let slabs = cover(&sample, CANDIDATES, search, progress)?;
    let mut captured = vec![false; sample.len()];
    let (mut kept, mut whole) = (0.0, 0.0);
    for slab in &slabs {
        let normal = slab.plane.normal.as_vec3();
        for i in sample.held_in(slab, 0..sample.len()).into_iter().map(|i| i as usize) {
            if !std::mem::replace(&mut captured[i], true) {
                whole += f64::from(sample.weight(i));
                kept += f64::from(sample.weight(i) * sample.facing(i, normal));
            }
        }
    }
    Ok(if whole > 0.0 { kept / whole } else { 1.0 })
}

/// Candidates between two checks for cancellation.
const AT_ONCE: usize = 4096;

/// Pieces and candidates of the estimate.
const SAMPLE: usize = 1500;
const CANDIDATES: usize = 64;

/// Returns the projected area of the open pieces that the slab holds.
fn captured_area(pieces: &Pieces, open: &[bool], slab: &Slab) -> f64 {
    let normal = slab.plane.normal.as_vec3();
    let held = pieces.held_in(slab, 0..pieces.len()).into_iter().map(|i| i as usize).filter(|&i| open[i]);
    held.map(|i| f64::from(pieces.facing(i, normal) * pieces.weight(i))).sum()
}
