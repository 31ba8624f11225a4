//! Refits: each slab moves to the plane of least cost for its pieces, and all pieces choose anew; Lloyd's rounds under a bound.
//!
//! A cover fixes the number of slabs and leaves each where it held the most, not where its pieces lie best. So for each slab in turn,
//! refitting finds the plane that minimizes Σ w (mean(h²)/b² + facing · (1 − |cos|)) over the pieces that chose the slab. That plane comes
//! from an eigenvector of a 3 × 3 matrix, in which a multiple of 1 − cos² replaces 1 − |cos|. The slab moves toward it as far as it can.
//! Each step keeps every piece in some slab within its bound, and lowers the total cost of all pieces, each with the cheapest slab that
//! holds it. So the guaranteed bound still holds. O(rounds · K · n) for n pieces in K slabs, most of it eight at a time. Known limits: a
//! local minimum; and a slab that alone holds a piece at its very bound hardly moves.

use glam::{DMat3, DVec3};

use super::assign::ParentCost;
use super::pieces::{Pieces, Slab};
use super::sweep::Search;
use crate::error::Result;
use crate::geometry::{Plane, least_direction};
use crate::progress::Progress;

/// Least gain of a round, as a share of the cost, to continue.
const WORTH: f64 = 2e-3;

/// Shares of the way to try.
const WAYS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Approximate ratio of 1 − |cos| to 1 − cos² for leaves almost parallel to the plane; for others it is less.
const COSINES: f64 = 0.6;

/// Returns the slabs, refitted in at most `rounds` rounds.
pub fn refined(
    pieces: &Pieces,
    slabs: Vec<Slab>,
    rounds: usize,
    parent_cost: &ParentCost,
    search: &Search,
    progress: Progress,
) -> Result<Vec<Slab>> {
    if rounds == 0 {
        return Ok(slabs);
    }
    let mut state = RefineState::new(pieces, slabs, parent_cost);
    let mut before = state.cost();
    for round in 0..rounds {
        progress.tell("fit", round as f64 / rounds as f64)?;
        for number in 0..state.slabs.len() {
            state.improve(number, search);
        }
        let after = state.cost();
        if after > before * (1.0 - WORTH) {
            break;
        }
        before = after;
    }
    Ok(state.slabs)
}

struct RefineState<'a> {
    pieces: &'a Pieces<'a>,
    parent_cost: &'a ParentCost,
    slabs: Vec<Slab>,
    /// The pieces that each slab holds, with their costs, in ascending order.
    held: Vec<Vec<(u32, f32)>>,
    /// The slabs that hold each piece, with the costs.
    holders: Vec<Vec<(u32, f32)>>,
}

impl<'a> RefineState<'a> {
    fn new(pieces: &'a Pieces<'a>, slabs: Vec<Slab>, parent_cost: &'a ParentCost) -> Self {
        let mut state = Self { pieces, parent_cost, slabs, held: Vec::new(), holders: vec![Vec::new(); pieces.len()] };
        for number in 0..state.slabs.len() {
            let held = state.held_by(number, &state.slabs[number]);
            for &(piece, cost) in &held {
                state.holders[piece as usize].push((number as u32, cost));
            }
            state.held.push(held);
        }
        state
    }

    fn held_by(&self, number: usize, slab: &Slab) -> Vec<(u32, f32)> {
        let held = self.pieces.held_in(slab, 0..self.pieces.len());
        held.into_iter().map(|i| (i, self.parent_cost.cost(self.pieces, i as usize, slab, number))).collect()
    }

    /// Returns the least cost of a piece with any slab except `number`.
    fn elsewhere(&self, piece: u32, number: usize) -> f32 {
        let others = self.holders[piece as usize].iter().filter(|(k, _)| *k as usize != number);
        others.map(|(_, cost)| *cost).fold(f32::INFINITY, f32::min)
    }

    fn weight(&self, piece: u32) -> f64 {
        f64::from(self.pieces.weight(piece as usize))
    }

    /// Returns the cost of all pieces.
    fn cost(&self) -> f64 {
        let least = |piece: u32| f64::from(self.elsewhere(piece, usize::MAX));
        (0..self.pieces.len() as u32).map(|piece| self.weight(piece) * least(piece)).sum()
    }

    /// Moves a slab toward its best plane, by the largest share of the way that lowers the cost.
    fn improve(&mut self, number: usize, search: &Search) {
        let chosen = self.held[number].iter().filter(|(piece, cost)| *cost <= self.elsewhere(*piece, number));
        let chosen: Vec<u32> = chosen.map(|(piece, _)| *piece).collect();
        let old = self.slabs[number];
        let Some(best) = self.best_plane(&chosen, &old.plane) else { return };
        for way in WAYS {
            let Some(plane) = between(&old.plane, &best, way) else { continue };
            if (search.favour)(plane.normal.as_vec3()) < (search.favour)(old.plane.normal.as_vec3()) {
                continue;
            }
            let slab = Slab { plane, ..old };
            let held = self.held_by(number, &slab);
            if self.gain(number, &held).is_some_and(|gain| gain > 0.0) {
                self.put(number, slab, held);
                return;
            }
        }
    }

    /// Returns the decrease of the total cost if the slab holds `held` instead; `None` if a piece then has no slab.
    fn gain(&self, number: usize, held: &[(u32, f32)]) -> Option<f64> {
        let mut gain = 0.0;
        for &(piece, cost) in &self.held[number] {
            let elsewhere = self.elsewhere(piece, number);
            if elsewhere == f32::INFINITY && held.binary_search_by_key(&piece, |h| h.0).is_err() {
                return None;
            }
            // Cost without this slab; the second loop subtracts the cost with `held`. For pieces in no other slab, `FAR` cancels out.
            gain += self.weight(piece) * (f64::from(cost.min(elsewhere)) - f64::from(elsewhere.min(FAR)));
        }
        for &(piece, cost) in held {
            let elsewhere = self.elsewhere(piece, number).min(FAR);
            gain += self.weight(piece) * (f64::from(elsewhere) - f64::from(cost.min(elsewhere)));
        }
        Some(gain)
    }

    fn put(&mut self, number: usize, slab: Slab, held: Vec<(u32, f32)>) {
        for (piece, _) in std::mem::take(&mut self.held[number]) {
            self.holders[piece as usize].retain(|(k, _)| *k as usize != number);
        }
        for &(piece, cost) in &held {
            self.holders[piece as usize].push((number as u32, cost));
        }
        (self.slabs[number], self.held[number]) = (slab, held);
    }

    /// Returns the plane of least cost for these pieces; `None` if their weight is 0.
    fn best_plane(&self, chosen: &[u32], old: &Plane) -> Option<Plane> {
        let (mut total, mut sum) = (0.0, DVec3::ZERO);
        for &piece in chosen {
            let (share, points) = self.share(piece);
            total += share * points.len() as f64;
            sum += points.iter().map(|p| p.as_dvec3()).sum::<DVec3>() * share;
        }
        let mean = (total > 0.0).then(|| sum / total)?;
        let (mut spread, mut seen) = (DMat3::ZERO, DMat3::ZERO);
        for &piece in chosen {
            let (share, points) = self.share(piece);
            for point in points {
                spread += outer(point.as_dvec3() - mean) * share;
            }
            let area = f64::from(self.pieces.area(piece as usize)).max(f64::MIN_POSITIVE);
            for across in self.pieces.areas(piece as usize).iter().map(|a| a.as_dvec3()) {
                seen += outer(across) * (self.weight(piece) / (area * across.length().max(f64::MIN_POSITIVE)));
            }
        }
        let facing = COSINES * f64::from(self.parent_cost.facing);
        // The identity term changes no eigenvector and makes every eigenvalue positive.
        let weights: f64 = chosen.iter().map(|&piece| self.weight(piece)).sum();
        let matrix = spread + (DMat3::IDENTITY * weights - seen) * facing;
        Some(Plane::through(mean, least_direction(matrix, old.normal)))
    }

    /// Returns the weight of each of a piece's points in the mean of h²/b², and the points.
    fn share(&self, piece: u32) -> (f64, &[glam::Vec3]) {
        let points = self.pieces.points(piece as usize);
        let bound = f64::from(self.pieces.bound(piece as usize));
        (self.weight(piece) / (points.len() as f64 * bound * bound), points)
    }
}

/// Finite cost of a piece that no other slab holds.
const FAR: f32 = 1e3;

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Interpolates between two planes.
fn between(from: &Plane, to: &Plane, way: f64) -> Option<Plane> {
    let (normal, distance) =
        if from.normal.dot(to.normal) < 0.0 { (-to.normal, -to.distance) } else { (to.normal, to.distance) };
    let normal = from.normal.lerp(normal, way);
    let length = normal.length();
    (length > 0.0).then(|| Plane {
        normal: normal / length,
        distance: (from.distance + (distance - from.distance) * way) / length,
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::greedy::{self, GreedyPlan};
    use super::super::kernel_tests::{foliage, pieces};
    use super::super::sweep::Guard;
    use super::*;
    use crate::foliage::{Attributes, Foliage};

    fn search(favour: &(dyn Fn(Vec3) -> f32 + Sync)) -> Search<'_> {
        Search { guard: Guard { facing: 0.0, slope: 1.0 }, bin: 0.01, reach: f32::INFINITY, favour, seed: 1 }
    }

    /// The cost of every piece with the cheapest slab that holds it, from the definition; infinite if a piece has none.
    fn cost(pieces: &Pieces, slabs: &[Slab], parent_cost: &ParentCost) -> f64 {
        let least = |i: usize| {
            let holding = slabs.iter().enumerate().filter(|(_, slab)| {
                pieces.points(i).iter().all(|p| slab.plane.height(p.as_dvec3()).abs() <= f64::from(pieces.bound(i)))
            });
            holding.map(|(k, slab)| parent_cost.cost(pieces, i, slab, k)).fold(f32::INFINITY, f32::min)
        };
        (0..pieces.len()).map(|i| f64::from(pieces.weight(i)) * f64::from(least(i))).sum()
    }

    #[test]
    fn all_stay_held_and_cost_less() {
        let foliage = foliage(600, 0.1);
        let pieces = pieces(&foliage, 0.15);
        let (parent_cost, favour) = (ParentCost::new(1.0, 0.0), |_: Vec3| 1.0);
        let slabs = greedy::cover(&pieces, GreedyPlan { octets: 8 }, &search(&favour), Progress::silent()).unwrap();
        let before = cost(&pieces, &slabs, &parent_cost);
        let moved = refined(&pieces, slabs, 8, &parent_cost, &search(&favour), Progress::silent()).unwrap();
        let after = cost(&pieces, &moved, &parent_cost);
        assert!(before.is_finite() && after < 0.97 * before, "{before} to {after}");
    }

    /// Triangles in the plane x = 0.1, and a tilted slab that holds them.
    #[test]
    fn a_slab_goes_to_the_plane_of_its_leaves() {
        let corners = |i: u32| {
            let (y, z) = (f64::from(i % 8) / 4.0 - 1.0, f64::from(i / 8) / 4.0 - 0.5);
            [(y, z), (y + 0.1, z), (y, z + 0.1)].map(|(y, z)| DVec3::new(0.1, y, z))
        };
        let positions: Vec<DVec3> = (0..40).flat_map(corners).collect();
        let triangles = (0..40).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let foliage = Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap();
        let pieces = pieces(&foliage, 0.2);
        let own = pieces.own_slab(0, f32::INFINITY);
        let aslant = (own.plane.normal + 0.03 * DVec3::new(0.3, 1.0, -0.7).cross(own.plane.normal)).normalize();
        let plane = Plane { normal: aslant, distance: own.plane.distance + 0.02 };
        let (parent_cost, favour) = (ParentCost::new(1.0, 0.0), |_: Vec3| 1.0);
        let slabs = vec![Slab { plane, ..own }];
        let moved = refined(&pieces, slabs, 8, &parent_cost, &search(&favour), Progress::silent()).unwrap();
        assert!(moved[0].plane.normal.dot(own.plane.normal).abs() > 1.0 - 1e-12);
        assert!((moved[0].plane.distance.abs() - own.plane.distance.abs()).abs() < 1e-6);
    }
}
