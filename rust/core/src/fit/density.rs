//! Décoret, Durand, Sillion, Dorsey, "Billboard Clouds for Extreme Model Simplification" (2003): density in plane space.
//!
//! Planes are (θ, φ, ρ): the spherical angles of the normal and the distance along it, in uniform bins. For each direction, the planes
//! valid for a piece form an interval of ρ, found conservatively from the bin's four corner directions. A piece adds its projected area to
//! the bins of its interval, by the covered share of each bin. It subtracts `penalty` times as much from the bins within ε below the
//! interval, so planes that just miss it score less. The densest bin is refined until one plane serves all of its pieces: the bin and its
//! neighbors are cut into eight each, repeatedly. Then the pieces of that plane are removed, and the next bin is chosen.
//!
//! Differences from the paper. Its penalty of 10 suits surfaces. In a crown every plane just misses many leaves, so only isolated leaves
//! have a density above 0 and nearly every leaf gets its own plane; foliage needs a small penalty, or none. If no density is above 0,
//! coverage alone decides. At the poles every θ is the same plane, which only repeats candidates. Refinement has a depth limit, because no
//! single plane may serve all pieces of a bin. A piece that no bin's middle serves gets its own plane. Complexity: O(n · D) for D
//! directions, twice over all slabs, and O(n′ · 216) for a refinement step over the n′ pieces of the bin.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::Fitter;
use super::pieces::{Pieces, Slab};
use super::sweep::Search;
use crate::error::Result;
use crate::geometry::Plane;
use crate::progress::Progress;

/// Greatest number of halvings of a bin.
const DEEPEST: usize = 10;

/// Greatest number of bins of φ, and of the whole space.
const MOST_PHIS: usize = 40;
const MOST_BINS: usize = 1 << 22;

/// Integer units of the total weight: integer sums are exact in any order.
const WHOLE: f64 = (1u64 << 40) as f64;

/// The density method: repeatedly takes the densest plane.
pub struct Density {
    /// Approximate number of directions on half the sphere.
    pub directions: usize,
    /// Score that a piece subtracts from planes that just miss it, relative to the score that it adds to planes that hold it.
    pub penalty: f64,
}

impl Fitter for Density {
    fn cover(&self, pieces: &Pieces, search: &Search, progress: Progress, _: &dyn Fn(&[Slab])) -> Result<Vec<Slab>> {
        let mut space = Space::new(pieces, search, self);
        let mut open: Vec<bool> = vec![true; pieces.len()];
        let mut remaining: Vec<u32> = (0..pieces.len() as u32).collect();
        space.change(&remaining, 1);
        let mut slabs = Vec::new();
        while let Some(&first) = remaining.first() {
            progress.tell("fit", 1.0 - remaining.len() as f64 / pieces.len() as f64)?;
            let found = space.densest().and_then(|cell| space.refined(cell, &remaining));
            let slab = found.unwrap_or_else(|| pieces.own_slab(first as usize, search.reach));
            let mut taken = search.served(pieces, &slab);
            taken.retain(|&i| open[i as usize]);
            let (slab, taken) = if taken.is_empty() {
                (pieces.own_slab(first as usize, search.reach), vec![first])
            } else {
                (slab, taken)
            };
            for &i in &taken {
                open[i as usize] = false;
            }
            space.change(&taken, -1);
            remaining.retain(|&i| open[i as usize]);
            slabs.push(slab);
        }
        Ok(slabs)
    }
}

/// A box in plane space.
#[derive(Clone, Copy, Debug)]
struct Cell {
    theta: [f64; 2],
    phi: [f64; 2],
    rho: [f64; 2],
}

fn direction(theta: f64, phi: f64) -> DVec3 {
    let ((sin_theta, cos_theta), (sin_phi, cos_phi)) = (libm::sincos(theta), libm::sincos(phi));
    DVec3::new(cos_theta * cos_phi, sin_theta * cos_phi, sin_phi)
}

fn middle([low, high]: [f64; 2]) -> f64 {
    0.5 * (low + high)
}

impl Cell {
    fn corner_directions(&self) -> [DVec3; 4] {
        let [a, b] = self.theta;
        let [c, d] = self.phi;
        [direction(a, c), direction(b, c), direction(b, d), direction(a, d)]
    }

    fn plane(&self) -> Plane {
        Plane { normal: direction(middle(self.theta), middle(self.phi)), distance: middle(self.rho) }
    }

    /// Returns the eighths of this cell and its neighbors.
    fn parts_and_neighbours(&self) -> impl Iterator<Item = Self> + use<> {
        let step = |range: [f64; 2]| 0.5 * (range[1] - range[0]);
        let at = move |range: [f64; 2], i: usize| {
            let low = range[0] + (i as f64 - 2.0) * step(range);
            [low, low + step(range)]
        };
        let Self { theta, phi, rho } = *self;
        (0..216).map(move |i| Self { theta: at(theta, i % 6), phi: at(phi, i / 6 % 6), rho: at(rho, i / 36) })
    }
}

/// Returns the interval of ρ of the planes that are valid for a piece, for directions near `directions`; empty if no plane is.
///
/// Conservative for all directions between the four, except for the bulge of the sphere: with γ the angle from their middle to the
/// farthest, it may miss γ² at either end, plus f32's rounding of the points. Planes that it wrongly accepts are rejected later; planes
/// that it misses cost a bin.
fn valid(pieces: &Pieces, piece: usize, directions: &[DVec3; 4]) -> [f64; 2] {
    let bound = f64::from(pieces.bound(piece));
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for p in pieces.points(piece) {
        let along = directions.map(|d| d.dot(p.as_dvec3()));
        low = low.max(along.into_iter().fold(f64::INFINITY, f64::min) - bound);
        high = high.min(along.into_iter().fold(f64::NEG_INFINITY, f64::max) + bound);
    }
    [low, high]
}

/// Returns the length of the intersection of two intervals.
fn overlap(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[1].min(b[1]) - a[0].max(b[0])).max(0.0)
}

/// Weight that a bin holds and weight that it just misses, in integer units.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    coverage: i64,
    penalty: i64,
}

/// Quality of a plane: its density if above 0, then its coverage.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
struct Merit(f64, f64);

impl Merit {
    fn new(coverage: f64, penalty: f64) -> Self {
        Self((coverage - penalty).max(0.0), coverage)
    }

    fn times(self, factor: f64) -> Self {
        Self(self.0 * factor, self.1 * factor)
    }
}

/// The density in all bins.
struct Space<'a> {
    pieces: &'a Pieces<'a>,
    search: &'a Search<'a>,
    penalty: f64,
    /// Numbers of bins of θ, φ and ρ.
    counts: [usize; 3],
    /// Width of a bin of ρ, and start of the first.
    width: f64,
    low: f64,
    /// Integer units per area.
    unit: f64,
    /// Bins of ρ for each direction.
    rows: Vec<Vec<Bin>>,
}

impl<'a> Space<'a> {
    fn new(pieces: &'a Pieces<'a>, search: &'a Search<'a>, Density { directions, penalty }: &Density) -> Self {
        // Four times as many θ as φ; ρ of both signs, so half the sphere is enough.
        let phis = ((*directions as f64 / 4.0).sqrt().ceil() as usize).clamp(2, MOST_PHIS);
        let bound = f64::from(pieces.least_bound());
        let low = -1.0 - f64::from(pieces.greatest_bound());
        let rhos = ((-2.0 * low / bound).ceil() as usize).min(MOST_BINS / (4 * phis * phis));
        let total: f64 = (0..pieces.len()).map(|i| f64::from(pieces.weight(i))).sum();
        Self {
            pieces,
            search,
            penalty: *penalty,
            counts: [4 * phis, phis, rhos],
            width: -2.0 * low / rhos as f64,
            low,
            unit: if total > 0.0 { WHOLE / (total * (1.0 + penalty)) } else { 0.0 },
            rows: vec![vec![Bin::default(); rhos]; 4 * phis * phis],
        }
    }

    fn cell(&self, row: usize, bin: usize) -> Cell {
        let [thetas, phis, _] = self.counts;
        let (i, j) = (row % thetas, row / thetas);
        let part = |i: usize, count: usize, whole: f64| [i as f64, (i + 1) as f64].map(|i| i / count as f64 * whole);
        Cell {
            theta: part(i, thetas, TAU),
            phi: part(j, phis, FRAC_PI_2),
            rho: [bin as f64, (bin + 1) as f64].map(|b| self.low + b * self.width),
        }
    }

    /// Adds (`sign` 1) or removes (−1) the coverage and penalty of pieces in all bins.
    fn change(&mut self, members: &[u32], sign: i64) {
        let cells: Vec<Cell> = (0..self.rows.len()).map(|row| self.cell(row, 0)).collect();
        let (pieces, penalty, low, width, unit) = (self.pieces, self.penalty, self.low, self.width, self.unit);
        self.rows.par_iter_mut().zip(cells).for_each(|(bins, cell)| {
            let directions = cell.corner_directions();
            let normal = cell.plane().normal.as_vec3();
            let mut spread = |interval: [f64; 2], weight: f64, part: fn(&mut Bin) -> &mut i64| {
                let first = ((interval[0] - low) / width).max(0.0) as usize;
                let end = (((interval[1] - low) / width).ceil().max(0.0) as usize).min(bins.len());
                for (b, bin) in (first..end).zip(&mut bins[first.min(end)..end]) {
                    let whole = [b as f64, b as f64 + 1.0].map(|b| low + b * width);
                    *part(bin) += sign * (weight * overlap(interval, whole) / width) as i64;
                }
            };
            for &i in members {
                let i = i as usize;
                let interval = valid(pieces, i, &directions);
                if interval[0] < interval[1] {
                    let weight = f64::from(pieces.weight(i) * pieces.facing(i, normal)) * unit;
                    spread(interval, weight, |bin| &mut bin.coverage);
                    let below = [interval[0] - f64::from(pieces.bound(i)), interval[0]];
                    spread(below, penalty * weight, |bin| &mut bin.penalty);
                }
            }
        });
    }

    fn densest(&self) -> Option<Cell> {
        let best_of_row = |(row, bins): (usize, &Vec<Bin>)| {
            let (mut best, mut at) = (Merit::default(), None);
            let normal = self.cell(row, 0).plane().normal.as_vec3();
            let favour = f64::from((self.search.favour)(normal));
            for (bin, &Bin { coverage, penalty }) in bins.iter().enumerate() {
                let merit = Merit::new(coverage as f64, penalty as f64).times(favour);
                if merit > best {
                    (best, at) = (merit, Some((row, bin)));
                }
            }
            (best, at)
        };
        let rows: Vec<_> = self.rows.par_iter().enumerate().map(best_of_row).collect();
        let (_, at) = rows.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        at.map(|(row, bin)| self.cell(row, bin))
    }

    /// Returns the open pieces with a valid plane in the cell.
    fn members(&self, cell: &Cell, among: &[u32]) -> Vec<u32> {
        let directions = cell.corner_directions();
        let inside = |&i: &u32| overlap(valid(self.pieces, i as usize, &directions), cell.rho) > 0.0;
        among.par_iter().copied().filter(inside).collect()
    }

    fn merit(&self, cell: &Cell, members: &[u32]) -> Merit {
        let directions = cell.corner_directions();
        let normal = cell.plane().normal.as_vec3();
        let length = cell.rho[1] - cell.rho[0];
        let part = |&i: &u32| {
            let i = i as usize;
            let interval = valid(self.pieces, i, &directions);
            if interval[0] >= interval[1] {
                return (0.0, 0.0);
            }
            let below = [interval[0] - f64::from(self.pieces.bound(i)), interval[0]];
            let weight = f64::from(self.pieces.weight(i) * self.pieces.facing(i, normal));
            (weight * overlap(interval, cell.rho) / length, self.penalty * weight * overlap(below, cell.rho) / length)
        };
        let (coverage, penalty) = members.iter().map(part).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        Merit::new(coverage, penalty)
    }

    /// Refines a cell to a plane; `None` if the cell has no pieces.
    fn refined(&self, cell: Cell, among: &[u32]) -> Option<Slab> {
        let mut cell = cell;
        let mut members = self.members(&cell, among);
        for _ in 0..DEEPEST {
            let slab = self.slab(&cell, &members)?;
            if members.iter().all(|&i| self.pieces.greatest_height(i as usize, &slab) <= self.pieces.bound(i as usize))
            {
                return Some(slab);
            }
            let parts: Vec<Cell> = cell.parts_and_neighbours().collect();
            let merits: Vec<Merit> = parts.par_iter().map(|part| self.merit(part, &members)).collect();
            let best = (0..parts.len()).reduce(|a, b| if merits[b] > merits[a] { b } else { a })?;
            let inside = self.members(&parts[best], &members);
            if inside.is_empty() {
                return Some(slab);
            }
            (cell, members) = (parts[best], inside);
        }
        self.slab(&cell, &members)
    }

    /// Returns the plane in the middle of a cell, centered on the heaviest of its members.
    fn slab(&self, cell: &Cell, members: &[u32]) -> Option<Slab> {
        let weight = |i: u32| self.pieces.weight(i as usize);
        let heaviest = members.iter().copied().reduce(|a, b| if weight(b) > weight(a) { b } else { a })? as usize;
        let reach = self.pieces.reach_around(heaviest, self.search.reach);
        Some(Slab { plane: cell.plane(), centre: self.pieces.centre(heaviest), reach })
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel_tests::{foliage, pieces};
    use super::*;
    use crate::common::random::Random;
    use crate::common::stability::{case, worse};

    #[test]
    fn intervals_of_valid_planes() {
        let mut random = Random(61);
        let foliage = foliage(300, 0.05);
        let pieces = pieces(&foliage, 0.04);
        let mut worst: f64 = 0.0;
        for draw in 0..20_000 {
            let width = [0.3, 0.1, 0.01][draw % 3];
            let (theta, phi) = (random.signed() * 3.0, FRAC_PI_2 * (0.5 + 0.4 * random.signed()));
            let cell = Cell { theta: [theta, theta + width], phi: [phi, phi + width], rho: [0.0, 0.0] };
            let directions = cell.corner_directions();
            let within =
                |range: [f64; 2], random: &mut Random| range[0] + (range[1] - range[0]) * (random.signed() * 0.5 + 0.5);
            let normal = direction(within(cell.theta, &mut random), within(cell.phi, &mut random));
            let piece = draw % pieces.len();
            let bound = f64::from(pieces.bound(piece));
            let corners = pieces.triangles(piece).iter().flat_map(|&t| foliage.corners(t as usize));
            let along: Vec<f64> = corners.map(|p| normal.dot(pieces.axes.to_canonical(p))).collect();
            let (low, high) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
            let middle = directions.iter().sum::<DVec3>().normalize();
            let gamma = directions.iter().map(|d| middle.angle_between(*d)).fold(0.0, f64::max);
            // All planes from high − bound to low + bound are valid; the interval must hold them, up to the bulge.
            if high - bound < low + bound {
                let [from, to] = valid(&pieces, piece, &directions);
                worst = worse(worst, (from - (high - bound)).max(low + bound - to) / (gamma * gamma + 1e-6));
            }
        }
        case(
            "Kernels",
            "ends of the interval of valid planes in a bin, in γ²",
            "the definition in f64; the stated bound",
        )
        .holds(worst, 1.0);
    }
}
