//! Sweep: finds the best of all offsets for a direction in one pass.
//!
//! For a fixed unit normal n, the planes that hold a piece with bound ε have offsets in `[max − ε, min + ε]`, where max and min are the
//! extremes of n·p over its points. Each piece adds its weight to a difference histogram at the interval's first bin and subtracts it after
//! the last. The prefix sum at a bin is the weight held by the plane in the middle of the bin. This reduces the search over planes from
//! three dimensions to two. (It is the density of Décoret et al. 2003, exact in ρ and sparse in direction.)
//!
//! Eight directions are swept at once, piece by piece: points are broadcast, nothing is padded, lanes never share a bin. Per piece and
//! direction: 5 flops, a minimum and a maximum per point, 6 flops per area vector, some 12 for the interval, and two read-modify-writes.
//! Weights are integers, so sums do not depend on their order and added weights can be subtracted exactly.
//!
//! Error bound: a height is within [`HEIGHT_ERROR`] of its value in f64, and intervals are shorter by that on both sides. So a sweep never
//! counts a piece that the plane does not hold, and may miss one that it just holds.

use glam::{DVec3, Vec3};

pub use super::lanes::LANES;
use super::lanes::{Eight, Kernel, dispatch};
use super::pieces::{HEIGHT_ERROR, Pieces, SMALLEST_AREA, Slab};
use crate::geometry::Plane;

/// Greatest number of bins in a histogram.
const MOST_BINS: usize = 4096;

/// Eight unit normals and the ranges of their offsets.
#[derive(Clone, Copy, Debug)]
pub struct Octet {
    x: [f32; LANES],
    y: [f32; LANES],
    z: [f32; LANES],
    /// Offset at the start of the first bin.
    low: [f32; LANES],
    /// Factor of a normal's score; 1 unless some directions are preferred.
    favour: [f32; LANES],
}

/// Bins of offsets.
#[derive(Clone, Copy, Debug)]
pub struct Bins {
    pub width: f32,
    pub count: usize,
}

/// Weight differences; one row per bin, with eight directions each.
#[derive(Clone, Debug)]
pub struct Histogram(Vec<[i32; LANES]>);

/// Position of a plane in a histogram.
#[derive(Clone, Copy, Debug, Default)]
pub struct Peak {
    /// Held weight times the direction's factor.
    pub score: f32,
    pub lane: usize,
    bin: usize,
}

/// Limits that keep the search from planes that see leaves edge-on.
#[derive(Clone, Copy, Debug)]
pub struct Guard {
    /// Least share of its area that a piece must keep on a plane that serves it.
    pub facing: f32,
    /// Share of a piece's weight that is scaled by its kept area, in [0, 1].
    pub slope: f32,
}

impl Octet {
    /// Makes an octet of eight normals. Offsets range around the plane through `centre`, by `range` to either side.
    pub fn new(normals: &[Vec3; LANES], centre: Vec3, range: f32, favour: impl Fn(Vec3) -> f32) -> Self {
        Self {
            x: normals.map(|n| n.x),
            y: normals.map(|n| n.y),
            z: normals.map(|n| n.z),
            low: normals.map(|n| n.dot(centre) - range),
            favour: normals.map(favour),
        }
    }

    pub fn normal(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Returns the plane of a peak.
    pub fn plane(&self, peak: &Peak, bins: Bins) -> Plane {
        let normal = self.normal(peak.lane).as_dvec3();
        let distance = f64::from(self.low[peak.lane] + (peak.bin as f32 + 0.5) * bins.width);
        let length = normal.length();
        Plane { normal: normal / length, distance: distance / length }
    }
}

impl Bins {
    /// Returns bins of `width` over `range` to either side; wider ones if there would be more than [`MOST_BINS`].
    pub fn over(range: f32, width: f32) -> Self {
        let width = width.max(2.0 * range / MOST_BINS as f32);
        Self { width, count: (2.0 * range / width).ceil().max(1.0) as usize }
    }

    /// Returns whether [`Self::over`] keeps the width.
    pub fn are_enough(range: f32, width: f32) -> bool {
        2.0 * range <= width * MOST_BINS as f32
    }
}

impl Histogram {
    pub fn new(bins: Bins) -> Self {
        Self(vec![[0; LANES]; bins.count + 1])
    }

    pub fn clear(&mut self) {
        self.0.fill([0; LANES]);
    }

    /// Adds the weights of pieces, given as (piece, weight).
    pub fn add(&mut self, octet: &Octet, pieces: &Pieces, bins: Bins, guard: Guard, members: &[(u32, i32)]) {
        dispatch(Add { rows: &mut self.0, octet, pieces, bins, guard, members });
    }

    /// Returns the position of the greatest score.
    pub fn peak(&self, octet: &Octet) -> Peak {
        let (sum, bin) = dispatch(Highest(&self.0));
        let mut best = Peak::default();
        for lane in 0..LANES {
            let score = sum[lane] as f32 * octet.favour[lane];
            if score > best.score {
                best = Peak { score, lane, bin: bin[lane] as usize };
            }
        }
        if best.score > 0.0 {
            best.bin = self.middle_of_plateau(best.lane, best.bin);
        }
        best
    }

    /// Returns the middle of the run of equal bins that starts at `first`: far from its ends, pieces deviate less.
    fn middle_of_plateau(&self, lane: usize, first: usize) -> usize {
        let longer = self.0[first + 1..].iter().take_while(|row| row[lane] == 0).count();
        (first + longer / 2).min(self.0.len() - 2)
    }
}

/// Kernel that adds pieces to the rows of a histogram.
pub struct Add<'a> {
    pub rows: &'a mut [[i32; LANES]],
    pub octet: &'a Octet,
    pub pieces: &'a Pieces<'a>,
    pub bins: Bins,
    pub guard: Guard,
    pub members: &'a [(u32, i32)],
}

#[allow(clippy::inline_always)] // see `lanes`
impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run<E: Eight>(self, e: E) {
        let Self { rows, octet, pieces, bins, guard, members } = self;
        let normals = [e.load(octet.x), e.load(octet.y), e.load(octet.z)];
        let low = e.load(octet.low);
        let scale = e.splat(1.0 / bins.width);
        let last_row = rows.len() - 1;
        let (zero, limit) = (e.splat(0.0), e.splat(last_row as f32));
        for &(piece, weight) in members {
            let piece = piece as usize;
            let (mut least, mut greatest) = (e.splat(f32::INFINITY), e.splat(f32::NEG_INFINITY));
            for p in pieces.points(piece) {
                let height = dot(e, normals, p);
                least = e.min(height, least);
                greatest = e.max(height, greatest);
            }
            let mut projected = zero;
            for a in pieces.areas(piece) {
                projected = e.add(projected, e.abs(dot(e, normals, a)));
            }
            let reach = e.splat(pieces.bound(piece) - HEIGHT_ERROR);
            let wanted = e.splat(guard.facing * pieces.area(piece));
            // Bin b represents its middle, so rounding to the nearest integers gives the first middle in the interval and the first after
            // it.
            let from = e.mul(e.sub(e.sub(greatest, reach), low), scale);
            let to = e.mul(e.sub(e.add(least, reach), low), scale);
            let (from, to) = (e.nearest(e.min(e.max(from, zero), limit)), e.nearest(e.min(e.max(to, zero), limit)));
            let size = weight.abs() as f32;
            // A piece without area cannot lose any.
            let slope = if pieces.area(piece) > SMALLEST_AREA { guard.slope } else { 0.0 };
            let sloped = e.mul(projected, e.splat(size * slope / pieces.area(piece).max(SMALLEST_AREA)));
            let value = e.nearest(e.add(sloped, e.splat(size * (1.0 - slope))));
            let held = e.chosen(value, from, to, projected, wanted);
            if held == [0; LANES] {
                continue;
            }
            let signed = held.map(|h| h * weight.signum());
            for l in 0..LANES {
                rows[(from[l] as usize).min(last_row)][l] += signed[l];
                rows[(to[l] as usize).min(last_row)][l] -= signed[l];
            }
        }
    }
}

/// Returns n·v for eight normals.
#[inline(always)]
#[allow(clippy::inline_always)] // see `lanes`
fn dot<E: Eight>(e: E, [x, y, z]: [E::Floats; 3], v: &Vec3) -> E::Floats {
    e.add(e.add(e.mul(x, e.splat(v.x)), e.mul(y, e.splat(v.y))), e.mul(z, e.splat(v.z)))
}

/// Kernel that finds the greatest prefix sum of each lane, and its first bin.
pub struct Highest<'a>(pub &'a [[i32; LANES]]);

#[allow(clippy::inline_always)] // see `lanes`
impl Kernel for Highest<'_> {
    type Output = ([i32; LANES], [i32; LANES]);

    #[inline(always)]
    fn run<E: Eight>(self, _: E) -> Self::Output {
        let (mut sum, mut most, mut at) = ([0i32; LANES], [0i32; LANES], [0i32; LANES]);
        for (bin, row) in (0i32..).zip(self.0) {
            for l in 0..LANES {
                sum[l] += row[l];
                at[l] = if sum[l] > most[l] { bin } else { at[l] };
                most[l] = if sum[l] > most[l] { sum[l] } else { most[l] };
            }
        }
        (most, at)
    }
}

/// Returns directions spread evenly over a hemisphere (a Fibonacci lattice), in groups of eight.
pub fn hemisphere(octets: usize) -> Vec<[Vec3; LANES]> {
    let count = octets * LANES;
    let direction = |i: usize| {
        let z = (i as f64 + 0.5) / count as f64;
        let (sin, cos) = libm::sincos(i as f64 * GOLDEN_ANGLE);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z).as_vec3()
    };
    // Directions with successive numbers are far apart.
    (0..octets).map(|o| std::array::from_fn(|l| direction(l * octets + o))).collect()
}

/// Returns directions in a cone around `axis`: a disc of Vogel's spiral with its farthest point at `spread` (tangent), turned by `turn`.
pub fn cone(axis: DVec3, spread: f64, turn: f64, octets: usize) -> Vec<[Vec3; LANES]> {
    let (u, v) = axis.any_orthonormal_pair();
    let count = (octets * LANES) as f64;
    let direction = |i: usize| {
        let radius = spread * (i as f64 / (count - 1.0)).sqrt();
        let (sin, cos) = libm::sincos(turn + i as f64 * GOLDEN_ANGLE);
        (axis + (u * cos + v * sin) * radius).normalize().as_vec3()
    };
    (0..octets).map(|o| std::array::from_fn(|l| direction(o * LANES + l))).collect()
}

/// π (3 − √5).
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Returns the plane near `slab` that holds the most weight, with its score. Tries all `normals`, with offsets up to `range` from the
/// plane through the slab's center.
pub fn best_near(
    pieces: &Pieces,
    members: &[(u32, i32)],
    slab: &Slab,
    normals: &[[Vec3; LANES]],
    range: f32,
    search: &Search,
) -> (f32, Slab) {
    let bins = Bins::over(range, search.bin);
    let mut histogram = Histogram::new(bins);
    let mut best = (0.0, *slab);
    for directions in normals {
        histogram.clear();
        let octet = Octet::new(directions, slab.centre, range, search.favour);
        histogram.add(&octet, pieces, bins, search.guard, members);
        let peak = histogram.peak(&octet);
        if peak.score > best.0 {
            best = (peak.score, Slab { plane: octet.plane(&peak, bins), ..*slab });
        }
    }
    best
}

/// Settings of the search for planes.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    pub guard: Guard,
    /// Width of a bin.
    pub bin: f32,
    /// Greatest distance of a slab's pieces from the place where it was found.
    pub reach: f32,
    /// Factor of a plane's score, by its normal.
    pub favour: &'a (dyn Fn(Vec3) -> f32 + Sync),
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Search<'_> {
    /// Returns the pieces that a slab holds and may serve, in ascending order.
    pub fn served(&self, pieces: &Pieces, slab: &Slab) -> Vec<u32> {
        self.served_in(pieces, slab, 0..pieces.len())
    }

    /// Returns the served pieces with numbers in `range`; see [`Pieces::held_in`].
    pub fn served_in(&self, pieces: &Pieces, slab: &Slab, range: std::ops::Range<usize>) -> Vec<u32> {
        let mut served = pieces.held_in(slab, range);
        if self.guard.facing > 0.0 {
            let normal = slab.plane.normal.as_vec3();
            served.retain(|&i| pieces.facing(i as usize, normal) >= self.guard.facing);
        }
        served
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::bounds::Bounds;
    use super::super::pieces::WholeLeaves;
    use super::*;
    use crate::foliage::{Attributes, Foliage, Opacity};

    fn soup(places: &[(f64, f64, f64)]) -> Foliage {
        let points: Vec<DVec3> = places.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect();
        let corners = points.windows(3).flat_map(|w| [w[0], w[0] + (w[1] - w[0]) * 0.1, w[0] + (w[2] - w[0]) * 0.1]);
        let positions: Vec<DVec3> = corners.collect();
        let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
    }

    fn search(guard: Guard, favour: &(dyn Fn(Vec3) -> f32 + Sync)) -> Search<'_> {
        Search { guard, bin: 0.01, reach: f32::INFINITY, favour, seed: 0 }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn finds_the_best_offset(
            places in prop::collection::vec((-1.0..1.0, -1.0..1.0, -1.0..1.0), 4..60), facing in 0.0f32..0.5, slope in 0.0f32..1.0,
        ) {
            let foliage = soup(&places);
            let bounds = Bounds { greatest: 0.08, image: None };
            let pieces = Pieces::of(&foliage, WholeLeaves::WhereCheap, &bounds, &Opacity::ignored());
            let members: Vec<(u32, i32)> = (0..pieces.len() as u32).map(|i| (i, 100 + 7 * (i as i32 % 11))).collect();
            let normals = hemisphere(2);
            let search = search(Guard { facing, slope }, &|_| 1.0);
            let origin = Slab {
                plane: Plane { normal: DVec3::Z, distance: 0.0 },
                centre: Vec3::ZERO,
                reach: f32::INFINITY,
            };
            let (score, slab) = best_near(&pieces, &members, &origin, &normals, 1.1, &search);
            // From the definition, in f64: the weight that the plane in the middle of each bin holds, summed directly.
            let weight = |normal: Vec3, distance: f64, margin: f64| -> f64 {
                let held = |&&(i, _): &&(u32, i32)| {
                    let high = pieces.points(i as usize).iter().map(|p| (normal.as_dvec3().dot(p.as_dvec3()) - distance).abs());
                    high.fold(0.0, f64::max) <= 0.08 + margin && f64::from(pieces.facing(i as usize, normal)) >= f64::from(facing) - 10.0 * margin
                };
                let value = |&(i, w): &(u32, i32)| {
                    f64::from(w) * (1.0 - f64::from(slope) * (1.0 - f64::from(pieces.facing(i as usize, normal))))
                };
                members.iter().filter(held).map(value).sum()
            };
            let best_by = |margin: f64| {
                let offsets = (0..220).map(|b| -1.1 + (f64::from(b) + 0.5) * 0.01);
                let each = normals.iter().flatten().flat_map(|&n| offsets.clone().map(move |d| (n, d)));
                each.map(|(n, d)| weight(n, d, margin)).fold(0.0, f64::max)
            };
            let slack = members.len() as f64; // each value is rounded to a whole number
            let score = f64::from(score);
            prop_assert!(score <= best_by(1e-5) + slack, "{score} is more than there is");
            prop_assert!(score >= best_by(-1e-5) - slack, "{score} misses something");
            let claimed = weight(slab.plane.normal.as_vec3(), slab.plane.distance, 1e-5);
            prop_assert!(score <= claimed + slack, "the plane does not hold what was counted");
        }
    }

    #[test]
    fn what_is_taken_out_leaves_nothing() {
        let foliage = soup(&[(0.1, 0.2, 0.3), (0.5, -0.4, 0.2), (-0.7, 0.1, 0.0), (0.3, 0.3, -0.9), (0.0, 0.8, 0.1)]);
        let bounds = Bounds { greatest: 0.08, image: None };
        let pieces = Pieces::of(&foliage, WholeLeaves::WhereCheap, &bounds, &Opacity::ignored());
        let bins = Bins::over(1.1, 0.01);
        let octet = Octet::new(&hemisphere(1)[0], Vec3::ZERO, 1.1, |_| 1.0);
        let mut histogram = Histogram::new(bins);
        let guard = Guard { facing: 0.0, slope: 1.0 };
        histogram.add(&octet, &pieces, bins, guard, &[(0, 1001), (1, 77), (2, 5)]);
        histogram.add(&octet, &pieces, bins, guard, &[(2, -5), (0, -1001), (1, -77)]);
        assert_eq!(histogram.0, Histogram::new(bins).0);
    }

    #[test]
    fn directions_are_unit_and_spread() {
        let all: Vec<Vec3> = hemisphere(8).into_iter().flatten().collect();
        assert!(all.iter().all(|n| (n.length() - 1.0).abs() < 1e-6 && n.z > 0.0));
        let nearest =
            |i: usize| (0..64).filter(|&j| j != i).map(|j| all[i].distance(all[j])).fold(f32::INFINITY, f32::min);
        assert!((0..64).all(|i| nearest(i) > 0.15), "64 on a hemisphere have room for 0.3 each");
        let turned = cone(DVec3::X, 0.1, 1.0, 2);
        assert!(turned.into_iter().flatten().all(|n| n.x > 0.99 && (n.length() - 1.0).abs() < 1e-6));
    }
}
