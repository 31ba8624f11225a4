//! Tests of each kernel of the fit against its stated error bound: exact fractions, f64, and the scalar version bit for bit.

use glam::{DVec3, Vec3};
use num_traits::{Signed, ToPrimitive};

use super::assign::{self, ParentCost};
use super::bounds::Bounds;
use super::lanes::{Kernel, LANES, Plain, dispatch};
use super::pieces::{COST_ERROR, FACING_ERROR, HEIGHT_ERROR, Held, Pieces, Slab, WholeLeaves};
use super::seeds::perturbed_plane;
use super::sweep::{Add, Bins, Guard, Highest, Octet, hemisphere};
use crate::common::exact::{dot, exact};
use crate::common::random::Random;
use crate::common::stability::{case, worse};
use crate::foliage::{Attributes, Foliage, Opacity};
use crate::geometry::Plane;
use crate::random::Stream;

const GROUP: &str = "Kernels";

/// Quads of many sizes in a ball; each is a leaf.
pub(super) fn foliage(count: u32, size: f64) -> Foliage {
    let mut random = Random(41);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for quad in 0..count {
        let (at, u, v) = (random.in_ball(), random.in_ball() * size, random.in_ball() * size);
        positions.extend([at, at + u, at + u + v, at + v]);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * quad + i);
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
}

pub(super) fn pieces(foliage: &Foliage, bound: f64) -> Pieces<'_> {
    Pieces::of(foliage, WholeLeaves::Always, &Bounds { greatest: bound, image: None }, &Opacity::ignored())
}

fn slabs(count: usize) -> impl Iterator<Item = Slab> {
    let mut random = Random(42);
    (0..count).map(move |_| {
        let plane = Plane { normal: random.in_ball().normalize(), distance: random.signed() };
        Slab { plane, centre: Vec3::ZERO, reach: f32::INFINITY }
    })
}

/// Tests slabs with a piece's farthest vertex at its bound, or slightly off it: too close for f32, so f64 must decide.
#[test]
fn heights() {
    let foliage = foliage(300, 0.05);
    let pieces = pieces(&foliage, 0.04);
    let (mut wrong, mut asked) = (0, 0);
    for (i, mut slab) in (0..pieces.len()).zip(slabs(300)) {
        let Plane { normal, .. } = slab.plane;
        let vertices = || {
            let corners = pieces.triangles(i).iter().flat_map(|&t| foliage.corners(t as usize));
            corners.map(|p| pieces.axes.to_canonical(p)).collect::<Vec<_>>()
        };
        let highest = vertices().into_iter().map(|p| normal.dot(p)).fold(f64::NEG_INFINITY, f64::max);
        let bound = f64::from(pieces.bound(i));
        for off in [0.0, 1e-13, 1e-9, 1e-7, 5e-7, 9e-7, 1.1e-6, 3e-6].into_iter().flat_map(|off| [off, -off]) {
            slab.plane.distance = highest - bound + off;
            let height = |p: &DVec3| (dot(normal, *p) - exact(slab.plane.distance)).abs();
            let farthest = vertices().iter().map(height).max().expect("it has vertices");
            let beyond = (farthest - exact(bound)).to_f64().expect("a number");
            // f64 itself is exact only up to a few roundings.
            if beyond.abs() > 1e-15 {
                asked += 1;
                wrong += usize::from(pieces.held_in(&slab, 0..pieces.len()).contains(&(i as u32)) != (beyond < 0.0));
            }
        }
    }
    assert!(asked > 3000);
    case(
        GROUP,
        "leaves at their bound, up to 3·10⁻⁶ off, that a slab holds wrongly",
        "exact fractions; f32 is sure only beyond its stated bound",
    )
    .holds(wrong as f64, 0.0);
    let mut random = Random(43);
    let mut worst: f64 = 0.0;
    for slab in slabs(3000) {
        let p = random.in_ball();
        let Plane { normal, distance } = slab.plane;
        let found = normal.as_vec3().dot(p.as_vec3()) - distance as f32;
        let expected = dot(normal, p) - exact(distance);
        worst = worse(worst, (exact(f64::from(found)) - expected).to_f64().unwrap().abs());
    }
    case(GROUP, "height of a point over a plane in f32, local units", "exact fractions; the stated bound")
        .holds(worst, f64::from(HEIGHT_ERROR));
}

#[test]
fn shares_of_area() {
    let foliage = foliage(400, 0.2);
    let pieces = pieces(&foliage, 0.04);
    let mut worst: f64 = 0.0;
    for slab in slabs(50) {
        for i in 0..pieces.len() {
            let vectors =
                pieces.triangles(i).iter().map(|&t| pieces.axes.to_canonical(foliage.area_vector(t as usize)));
            let (kept, whole) =
                vectors.fold((0.0, 0.0), |(k, w), a| (k + a.dot(slab.plane.normal).abs(), w + a.length()));
            worst = worse(worst, (f64::from(pieces.facing(i, slab.plane.normal.as_vec3())) - kept / whole).abs());
        }
    }
    case(GROUP, "share of area that a plane keeps, f32", "f64; the stated bound").holds(worst, f64::from(FACING_ERROR));
}

#[test]
fn costs() {
    let foliage = foliage(400, 0.1);
    let mut worst: f64 = 0.0;
    for bound in [0.2, 0.04, 1e-3] {
        let pieces = pieces(&foliage, bound);
        let parent_cost = ParentCost::new(1.0, 0.0);
        for slab in slabs(400) {
            for i in pieces.held_in(&slab, 0..pieces.len()).into_iter().map(|i| i as usize) {
                let Plane { normal, distance } = slab.plane;
                let mut vertices: Vec<DVec3> =
                    pieces.triangles(i).iter().flat_map(|&t| foliage.corners(t as usize)).collect();
                vertices.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
                vertices.dedup();
                let squares: f64 =
                    vertices.iter().map(|&p| (normal.dot(pieces.axes.to_canonical(p)) - distance).powi(2)).sum();
                let vectors =
                    pieces.triangles(i).iter().map(|&t| pieces.axes.to_canonical(foliage.area_vector(t as usize)));
                let (kept, whole) = vectors.fold((0.0, 0.0), |(k, w), a| (k + a.dot(normal).abs(), w + a.length()));
                let expected = squares / (vertices.len() as f64 * bound * bound) + 1.0 - kept / whole;
                worst = worse(worst, (f64::from(parent_cost.cost(&pieces, i, &slab, 0)) - expected).abs() * bound);
            }
        }
    }
    case(GROUP, "cost of a plane for a leaf, f32, times ε", "f64; the stated bound")
        .holds(worst, f64::from(COST_ERROR));
}

#[test]
fn the_processors_best_is_the_plain_one() {
    let foliage = foliage(3000, 0.1);
    let mut differ = 0;
    for bound in [0.3, 0.04, 1e-3, 1e-6] {
        let pieces = pieces(&foliage, bound);
        let all = 0..pieces.len();
        for slab in slabs(60) {
            let held = || Held { pieces: &pieces, slab: &slab, range: all.clone() };
            differ += usize::from(dispatch(held()) != held().run(Plain));
        }
        let members: Vec<(u32, i32)> = all.clone().map(|i| (i as u32, 1 + i as i32 % 977)).collect();
        let bins = Bins::over(1.1, bound as f32 / 8.0);
        for normals in hemisphere(6) {
            let octet = Octet::new(&normals, Vec3::ZERO, 1.1, |_| 1.0);
            let swept = |plain: bool| {
                let mut rows = vec![[0i32; LANES]; bins.count + 1];
                let guard = Guard { facing: 0.1, slope: 0.5 };
                let add = Add { rows: &mut rows, octet: &octet, pieces: &pieces, bins, guard, members: &members };
                if plain {
                    add.run(Plain);
                } else {
                    dispatch(add);
                }
                let highest = if plain { Highest(&rows).run(Plain) } else { dispatch(Highest(&rows)) };
                (rows, highest)
            };
            differ += usize::from(swept(true) != swept(false));
        }
    }
    case(GROUP, "held pieces and swept weights, eight lanes against scalars", "invariance: bit for bit")
        .holds(differ as f64, 0.0);
}

#[test]
fn seeds_that_come_out_collinear() {
    // Needles as long as R, and no wider than the motion of their corners within ε: often all three corners become collinear.
    let mut random = Random(44);
    let corners: Vec<DVec3> = (0..200)
        .flat_map(|i| {
            let (at, along) = (random.in_ball() * 0.1, random.in_ball().normalize());
            let aside = along.any_orthonormal_vector() * 10f64.powi(-(i % 17));
            [at, at + along * 0.5, at + along * 0.25 + aside * 1e-3]
        })
        .collect();
    let triangles = (0..200).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let foliage = Foliage::new(&corners, triangles, Attributes::default(), vec![]).unwrap();
    let mut worst: f64 = 0.0;
    for bound in [0.5, 0.04, 1e-9] {
        let pieces = pieces(&foliage, bound);
        for draw in 0..20_000 {
            let mut stream = Stream::new(1, draw, 0);
            let piece = stream.below(pieces.len());
            if let Some(plane) = perturbed_plane(&pieces, piece, &mut stream) {
                let finite = plane.normal.is_finite() && plane.distance.is_finite();
                worst = worse(worst, if finite { (plane.normal.length() - 1.0).abs() } else { f64::INFINITY });
            }
        }
    }
    case(GROUP, "planes through perturbed corners of needles", "definition: unit normals or none").holds(worst, 4e-16);
}

#[test]
fn parents_of_equal_cost() {
    // Two equal slabs: the first wins, on any number of threads.
    let foliage = foliage(500, 0.02);
    let pieces = pieces(&foliage, 1.0);
    let slab = slabs(1).next().unwrap();
    let parents = assign::parents(&pieces, &[slab, slab], &ParentCost::new(1.0, 0.0));
    case(GROUP, "two planes that cost a leaf the same", "definition: the earlier one")
        .equals(parents.iter().all(|p| p.is_none_or(|k| k == 0)), true);
}
