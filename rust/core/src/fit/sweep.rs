//! The sweep: for a direction, the best of all offsets in one pass.
//!
//! For a fixed unit normal n, a piece with bound ε is held by the planes whose offset lies in `[max − ε, min + ε]`, where max and min are
//! those of n·p over its points. Each piece adds its weight to a difference histogram at the interval's first bin and takes it away behind
//! the last; the prefix sum is the weight held by the plane in the middle of each bin. So a search over planes falls from three
//! dimensions to two. (It is the density of Décoret et al. 2003, exact in ρ and sparse in direction.)
//!
//! Eight directions go at once, a piece at a time: points are broadcast, nothing is padded, lanes never meet in a bin. Per piece and direction:
//! 5 flops and a minimum and maximum a point, 6 an area vector, some 12 for the interval, and two read-modify-writes.
//! Weights are whole numbers, so sums do not depend on their order, and what was added can be taken away exactly.
//!
//! Error bound: a height is within [`HEIGHT_ERROR`] of its value in f64, and intervals are shorter by that on both sides: a sweep never counts
//! a piece that the plane does not hold, and may miss one that it just holds.

use glam::{DVec3, Vec3};

pub use super::lanes::LANES;
use super::lanes::{Eight, Kernel, dispatch};
use super::pieces::{HEIGHT_ERROR, Pieces, SMALLEST_AREA, Slab};
use crate::geometry::Plane;

/// Bins of a histogram, at most.
const MOST_BINS: usize = 4096;

/// Eight unit normals, and where their offsets are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Octet {
    x: [f32; LANES],
    y: [f32; LANES],
    z: [f32; LANES],
    /// The offset at which the first bin begins.
    low: [f32; LANES],
    /// What a normal's score counts; 1 unless some directions are preferred.
    favour: [f32; LANES],
}

/// The bins of offsets.
#[derive(Clone, Copy, Debug)]
pub struct Bins {
    pub width: f32,
    pub count: usize,
}

/// Weight differences by bin; a row of directions each.
#[derive(Clone, Debug)]
pub struct Histogram(Vec<[i32; LANES]>);

/// A plane's place in a histogram.
#[derive(Clone, Copy, Debug, Default)]
pub struct Peak {
    /// The weight that it holds, times its direction's favour.
    pub score: f32,
    pub lane: usize,
    bin: usize,
}

/// What keeps the search from planes that see leaves edge-on.
#[derive(Clone, Copy, Debug)]
pub struct Guard {
    /// The least share of its area that a piece keeps on a plane that serves it.
    pub facing: f32,
    /// The share of a piece's weight that counts only as far as its area is kept, in [0, 1].
    pub slope: f32,
}

impl Octet {
    /// Eight normals; the offsets of each are looked for around the plane through `centre`, `range` to either side.
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

    /// The plane of a peak.
    pub fn plane(&self, peak: &Peak, bins: Bins) -> Plane {
        let normal = self.normal(peak.lane).as_dvec3();
        let distance = f64::from(self.low[peak.lane] + (peak.bin as f32 + 0.5) * bins.width);
        let length = normal.length();
        Plane { normal: normal / length, distance: distance / length }
    }
}

impl Bins {
    /// Bins of `width` over `range` to either side; wider ones where there would be more than [`MOST_BINS`].
    pub fn over(range: f32, width: f32) -> Self {
        let width = width.max(2.0 * range / MOST_BINS as f32);
        Self { width, count: (2.0 * range / width).ceil().max(1.0) as usize }
    }

    /// Whether [`Self::over`] keeps the width.
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

    /// Adds the weights of pieces, each as (piece, weight).
    pub fn add(&mut self, octet: &Octet, pieces: &Pieces, bins: Bins, guard: Guard, members: &[(u32, i32)]) {
        dispatch(Add { rows: &mut self.0, octet, pieces, bins, guard, members });
    }

    /// Where the most is held.
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

    /// The middle of the run of bins that begins at `first` and holds as much: the farther from its ends, the less the pieces deviate.
    fn middle_of_plateau(&self, lane: usize, first: usize) -> usize {
        let longer = self.0[first + 1..].iter().take_while(|row| row[lane] == 0).count();
        (first + longer / 2).min(self.0.len() - 2)
    }
}

/// Adds pieces to the rows of a histogram.
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
            // Bin b stands for its middle, so that the nearest whole numbers are the first middle in the interval and the first behind it.
            let from = e.mul(e.sub(e.sub(greatest, reach), low), scale);
            let to = e.mul(e.sub(e.add(least, reach), low), scale);
            let (from, to) = (e.nearest(e.min(e.max(from, zero), limit)), e.nearest(e.min(e.max(to, zero), limit)));
            let size = weight.abs() as f32;
            // A piece without area has nothing to lose.
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

/// n·v for eight normals.
#[inline(always)]
#[allow(clippy::inline_always)] // see `lanes`
fn dot<E: Eight>(e: E, [x, y, z]: [E::Floats; 3], v: &Vec3) -> E::Floats {
    e.add(e.add(e.mul(x, e.splat(v.x)), e.mul(y, e.splat(v.y))), e.mul(z, e.splat(v.z)))
}

/// For each lane the greatest prefix sum and the first bin that has it.
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

/// Directions spread evenly over a hemisphere (a Fibonacci lattice), eight at a time.
pub fn hemisphere(octets: usize) -> Vec<[Vec3; LANES]> {
    let count = octets * LANES;
    let direction = |i: usize| {
        let z = (i as f64 + 0.5) / count as f64;
        let (sin, cos) = libm::sincos(i as f64 * GOLDEN_ANGLE);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z).as_vec3()
    };
    // Neighbours in number are far apart in direction.
    (0..octets).map(|o| std::array::from_fn(|l| direction(l * octets + o))).collect()
}

/// Directions in a cone around `axis`, denser towards it: a disc of Vogel's spiral, whose farthest lies at `spread` (tangent), turned by `turn`.
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

/// Looks for the plane around `slab` that holds the most weight: in all of the `normals`, offsets up to `range` off the plane's centre.
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

/// How planes are looked for.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    pub guard: Guard,
    /// Width of a bin.
    pub bin: f32,
    /// How far from where it was found a slab holds pieces.
    pub reach: f32,
    /// What a plane's score counts, by its normal.
    pub favour: &'a (dyn Fn(Vec3) -> f32 + Sync),
    /// Of all randomness.
    pub seed: u64,
}

impl Search<'_> {
    /// The pieces that a slab holds and may serve, in ascending order.
    pub fn served(&self, pieces: &Pieces, slab: &Slab) -> Vec<u32> {
        self.served_in(pieces, slab, 0..pieces.len())
    }

    /// Those whose number lies in `range`; see [`Pieces::held_in`].
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
    use super::super::pieces::Whole;
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
            let pieces = Pieces::of(&foliage, Whole::WhereCheap, &bounds, &Opacity::ignored());
            let members: Vec<(u32, i32)> = (0..pieces.len() as u32).map(|i| (i, 100 + 7 * (i as i32 % 11))).collect();
            let normals = hemisphere(2);
            let search = search(Guard { facing, slope }, &|_| 1.0);
            let origin = Slab {
                plane: Plane { normal: DVec3::Z, distance: 0.0 },
                centre: Vec3::ZERO,
                reach: f32::INFINITY,
            };
            let (score, slab) = best_near(&pieces, &members, &origin, &normals, 1.1, &search);
            // From the definition, in f64: what the plane in the middle of each bin holds, by its own sums.
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
        let pieces = Pieces::of(&foliage, Whole::WhereCheap, &bounds, &Opacity::ignored());
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
