//! Choice of each piece's parent plane, after all planes are found.
//!
//! Among the planes that hold the piece within ε, in f64, the parent is the one with the least
//! `mean(h²)/ε² + w · (1 − |cos|)`. h are the heights of its vertices, cos is the cosine between plane and leaf: a plane that sees a leaf
//! face-on keeps its area, which is worth some distance. w = 0 takes the nearest plane. Runs on all cores; each plane tests only the boxes
//! that it touches.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::pieces::{Pieces, Slab};
use super::sweep::Search;
use crate::foliage::Foliage;

/// Pieces per task; a multiple of the pieces in a box.
const TASK: usize = 2048;

/// Slabs with their held leaves in memory at the same time.
const SLABS_AT_ONCE: usize = 16;

/// Weight of facing for [`kept_share`].
const FACING: f32 = 1.0;

/// Returns the cheapest parent of each piece; the earliest of equal ones. `None` if no slab holds the piece.
pub fn parents(pieces: &Pieces, slabs: &[Slab], parent_cost: &ParentCost) -> Vec<Option<u32>> {
    let mut best: Vec<(f32, u32)> = vec![(f32::INFINITY, u32::MAX); pieces.len()];
    best.par_chunks_mut(TASK).enumerate().for_each(|(number, best)| {
        let first = number * TASK;
        for (k, slab) in (0u32..).zip(slabs) {
            for i in pieces.held_in(slab, first..first + best.len()) {
                let cost = parent_cost.cost(pieces, i as usize, slab, k as usize);
                let best = &mut best[i as usize - first];
                if cost < best.0 {
                    *best = (cost, k);
                }
            }
        }
    });
    best.into_iter().map(|(_, k)| (k != u32::MAX).then_some(k)).collect()
}

/// Cost of a parent plane for a piece.
#[derive(Clone, Debug, Default)]
pub struct ParentCost {
    /// Weight of 1 − |cos|.
    pub facing: f32,
    /// Weight of the squared distance (in R) between the piece and the middle of the plane's pieces.
    pub gather: f32,
    /// The middles of the planes' pieces; empty until parents are known.
    middles: Vec<Vec3>,
}

impl ParentCost {
    pub fn new(facing: f32, gather: f32) -> Self {
        Self { facing, gather, middles: Vec::new() }
    }

    /// Returns the same cost with the middles of the pieces that each slab has as parent.
    pub fn gathered(&self, pieces: &Pieces, slabs: &[Slab], parents: &[Option<u32>]) -> Self {
        let mut sums = vec![(DVec3::ZERO, 0.0); slabs.len()];
        for (i, parent) in parents.iter().enumerate() {
            if let Some(k) = parent {
                let (sum, weight) = &mut sums[*k as usize];
                *sum += pieces.centre(i).as_dvec3() * f64::from(pieces.area(i));
                *weight += f64::from(pieces.area(i));
            }
        }
        let middle = |(sum, weight): (DVec3, f64)| if weight > 0.0 { (sum / weight).as_vec3() } else { Vec3::ZERO };
        Self { middles: sums.into_iter().map(middle).collect(), ..self.clone() }
    }

    /// Returns the cost for the piece, with an error of at most `COST_ERROR` over the piece's bound.
    pub fn cost(&self, pieces: &Pieces, piece: usize, slab: &Slab, number: usize) -> f32 {
        let (normal, distance) = (slab.plane.normal.as_vec3(), slab.plane.distance as f32);
        let points = pieces.points(piece);
        let squares: f32 = points.iter().map(|p| (normal.dot(*p) - distance).powi(2)).sum();
        let bound = pieces.bound(piece);
        let away = self.middles.get(number).map_or(0.0, |middle| pieces.centre(piece).distance_squared(*middle));
        squares / (points.len() as f32 * bound * bound)
            + self.facing * (1.0 - pieces.facing(piece, normal))
            + self.gather * away
    }
}

/// Gives the triangles of a leaf one parent if any slab holds them all: the cheapest such slab. `parents` has one entry per triangle.
pub fn reunite_leaves(
    pieces: &Pieces,
    slabs: &[Slab],
    parent_cost: &ParentCost,
    foliage: &Foliage,
    parents: &mut [u32],
) {
    let leaf_ids = foliage.leaf_ids();
    let mut sizes = vec![0u32; foliage.leaf_count()];
    for &leaf in leaf_ids {
        sizes[leaf as usize] += 1;
    }
    // The leaves of several pieces that a slab holds whole, and their cost.
    let held = |(number, slab): (usize, &Slab)| -> Vec<(u32, f32)> {
        let pieces_held = pieces.held_in(slab, 0..pieces.len()).into_iter().map(|i| i as usize);
        let parts = pieces_held.map(|i| (leaf_ids[pieces.triangles(i)[0] as usize], i));
        let mut parts: Vec<(u32, usize)> =
            parts.filter(|&(leaf, i)| sizes[leaf as usize] as usize > pieces.triangles(i).len()).collect();
        parts.sort_unstable();
        let whole = parts.chunk_by(|a, b| a.0 == b.0).filter_map(|part| {
            let triangles: usize = part.iter().map(|&(_, i)| pieces.triangles(i).len()).sum();
            let cost = || part.iter().map(|&(_, i)| parent_cost.cost(pieces, i, slab, number)).sum();
            (triangles == sizes[part[0].0 as usize] as usize).then(|| (part[0].0, cost()))
        });
        whole.collect()
    };
    let mut best: Vec<(f32, u32)> = vec![(f32::INFINITY, u32::MAX); sizes.len()];
    for (first, some) in slabs.chunks(SLABS_AT_ONCE).enumerate() {
        let numbered = some.par_iter().enumerate().map(|(i, slab)| (first * SLABS_AT_ONCE + i, slab));
        let held: Vec<Vec<(u32, f32)>> = numbered.map(held).collect();
        for (k, leaves) in (first * SLABS_AT_ONCE..).zip(held) {
            for (leaf, cost) in leaves {
                let best = &mut best[leaf as usize];
                if cost < best.0 {
                    *best = (cost, k as u32);
                }
            }
        }
    }
    for (parent, &leaf) in parents.iter_mut().zip(leaf_ids) {
        let (_, k) = best[leaf as usize];
        *parent = if k == u32::MAX { *parent } else { k };
    }
}

/// Returns the share of their weight that pieces keep when each is projected onto its parent's plane.
pub fn kept_share(pieces: &Pieces, slabs: &[Slab]) -> f64 {
    let (mut kept, mut whole) = (0.0, 0.0);
    for (i, parent) in parents(pieces, slabs, &ParentCost::new(FACING, 0.0)).into_iter().enumerate() {
        let weight = f64::from(pieces.weight(i));
        let facing = parent.map_or(0.0, |k| pieces.facing(i, slabs[k as usize].plane.normal.as_vec3()));
        whole += weight;
        kept += weight * f64::from(facing);
    }
    if whole > 0.0 { kept / whole } else { 1.0 }
}

/// Returns the pieces that no slab serves, in ascending order.
pub fn unserved(pieces: &Pieces, slabs: &[Slab], search: &Search) -> Vec<u32> {
    let in_task = |number: usize| {
        let range = number * TASK..((number + 1) * TASK).min(pieces.len());
        let mut open = vec![true; range.len()];
        for slab in slabs {
            for i in search.served_in(pieces, slab, range.clone()) {
                open[i as usize - range.start] = false;
            }
        }
        range.zip(open).filter(|(_, open)| *open).map(|(i, _)| i as u32).collect::<Vec<u32>>()
    };
    (0..pieces.len().div_ceil(TASK)).into_par_iter().flat_map_iter(in_task).collect()
}
