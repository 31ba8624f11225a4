//! Simplified leaves stay within the bound, keep their area and their texture. Oracles are closed forms and distances measured here.

use glam::{DVec3, Vec2};
use leafcloud::{Attributes, Foliage, Material, Progress};
use leafcloud_simplify::{SimplifiedLeaves, simplified_leaves};

/// Strips of `count` segments from (0, 0) to (1, 0.1) in the unit square, bent by `height`, one for each place; without common vertices.
fn blades(places: &[DVec3], count: u32, height: impl Fn(f64) -> f64) -> Foliage {
    let (mut positions, mut triangles, mut attributes) = (Vec::new(), Vec::new(), Attributes::default());
    for place in places {
        for i in 0..count {
            let ends = [i, i + 1].map(|k| f64::from(k) / f64::from(count));
            let corner = |x: f64, y: f64| *place + DVec3::new(x, y, height(x));
            let uv = |x: f64, y: f64| Vec2::new(x as f32, 10.0 * y as f32);
            let [a, b] = ends;
            let square = [(a, 0.0), (b, 0.0), (b, 0.1), (a, 0.1)];
            let first = positions.len() as u32;
            positions.extend(square.map(|(x, y)| corner(x, y)));
            let uvs = square.map(|(x, y)| uv(x, y));
            triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| first + k)));
            attributes.uvs.extend([[uvs[0], uvs[1], uvs[2]], [uvs[0], uvs[2], uvs[3]]]);
        }
    }
    Foliage::new(&positions, triangles, attributes, vec![Material::default()]).expect("blades")
}

const APART: [DVec3; 2] = [DVec3::ZERO, DVec3::new(0.0, 1.0, 0.3)];

fn simpler(foliage: &Foliage, bound: f64) -> Option<SimplifiedLeaves> {
    simplified_leaves(foliage, bound, Progress::silent()).expect("leaves")
}

fn area(foliage: &Foliage) -> f64 {
    let radius = foliage.frame().radius;
    (0..foliage.triangle_count()).map(|t| foliage.area_vector(t).length()).sum::<f64>() * radius * radius
}

#[test]
fn a_flat_strip_becomes_a_rectangle() {
    let foliage = blades(&APART, 6, |_| 0.0);
    let found = simpler(&foliage, 1e-9).expect("fewer triangles");
    assert_eq!((found.foliage.triangle_count(), found.foliage.leaf_count()), (4, 2), "two triangles for each strip");
    assert!(found.deviation < 1e-9, "{}", found.deviation);
    assert!((area(&found.foliage) - 0.2).abs() < 1e-9);
    // The texture stays where it was: u = x and v = 10 y, from the strip's own corner.
    let frame = found.foliage.frame();
    for (t, uvs) in found.foliage.attributes().uvs.iter().enumerate() {
        let place = APART[found.foliage.leaf_ids()[t] as usize];
        for (p, uv) in found.foliage.corners(t).into_iter().zip(uvs) {
            let at = frame.to_caller(p) - place;
            assert!((at.x - f64::from(uv.x)).abs() < 1e-6 && (10.0 * at.y - f64::from(uv.y)).abs() < 1e-6);
        }
    }
}

#[test]
fn a_leaf_of_thousands_of_triangles_is_simplified() {
    let foliage = blades(&APART, 2000, |_| 0.0);
    let found = simpler(&foliage, 1e-9).expect("fewer triangles");
    assert_eq!(found.foliage.triangle_count(), 4);
    assert!((area(&found.foliage) - 0.2).abs() < 1e-9);
}

#[test]
fn a_strip_that_bends_by_more_than_the_bound_keeps_its_bend() {
    // The strip is a ridge: its middle is 0.2 above its ends, the leaves' R is about 0.9.
    let foliage = blades(&APART, 2, |x| 0.2 * (1.0 - (2.0 * x - 1.0).abs()));
    assert!(simpler(&foliage, 0.1).is_none(), "0.2 R is above the bound");
    let found = simpler(&foliage, 0.4).expect("fewer triangles");
    assert!(found.foliage.triangle_count() < 8);
}

#[test]
fn every_corner_moves_to_its_leaf_within_the_bound() {
    let arch = |x: f64| 0.1 * (std::f64::consts::PI * x).sin();
    let foliage = blades(&APART, 12, arch);
    let mut before = foliage.triangle_count();
    for bound in [0.002, 0.01, 0.05] {
        let found = simpler(&foliage, bound).expect("fewer triangles");
        let moved = (0..foliage.triangle_count())
            .flat_map(|t| foliage.corners(t).into_iter().zip(found.targets[t]))
            .map(|(p, q)| p.distance(q))
            .fold(0.0, f64::max);
        assert!((moved - found.deviation).abs() < 1e-12);
        // Leaves grow a little to keep their area.
        assert!(moved <= 1.1 * bound, "{moved} at a bound of {bound}");
        assert!(found.foliage.triangle_count() < before, "a larger bound leaves fewer triangles");
        before = found.foliage.triangle_count();
        assert!((area(&found.foliage) / area(&foliage) - 1.0).abs() < 1e-9, "the area stays");
        assert_eq!(found.foliage.leaf_count(), foliage.leaf_count());
    }
}

#[test]
fn tips_stay_and_notches_are_not_filled() {
    // A star with four points: its inner corners are 0.2 from the middle, its tips 1.
    let ring = |i: u32| {
        let angle = f64::from(i) * std::f64::consts::TAU / 8.0;
        DVec3::new(angle.cos(), angle.sin(), 0.0) * if i.is_multiple_of(2) { 1.0 } else { 0.2 }
    };
    let positions: Vec<DVec3> = (0..8).map(ring).chain([DVec3::ZERO]).collect();
    let triangles = (0..8).map(|i| [8, i, (i + 1) % 8]).collect();
    let star = Foliage::new(&positions, triangles, Attributes::default(), vec![Material::default()]).expect("a star");
    let found = simpler(&star, 0.05).expect("the middle is no corner of the outline");
    assert!((area(&found.foliage) - area(&star)).abs() < 1e-9);
    let kept: Vec<DVec3> = found.places.iter().flatten().copied().collect();
    let is_kept = |i: u32| kept.iter().any(|p| p.distance(star.frame().to_local(ring(i))) < 1e-9);
    assert!((0..8).all(is_kept), "all tips and notches");
}

#[test]
fn the_same_on_any_number_of_threads() {
    let places: Vec<DVec3> = (0..40).map(|i| DVec3::new(0.0, f64::from(i), 0.1 * f64::from(i % 7))).collect();
    let foliage = blades(&places, 9, |x| 0.1 * x * x);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| simpler(&foliage, 0.002)).expect("fewer triangles")
    };
    let (one, many) = (with(1), with(5));
    assert_eq!((one.corners, one.places, one.targets), (many.corners, many.places, many.targets));
}

#[test]
fn needles_and_points_among_leaves_stay_finite() {
    let mut positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
    positions.extend([DVec3::new(0.5, 1e-12, 0.0), DVec3::new(0.5, 0.0, 1e-300)]);
    // A leaf, a needle, a triangle without area, and one on a single point.
    let triangles = vec![[0, 1, 2], [1, 2, 3], [0, 1, 4], [0, 1, 5], [3, 3, 3]];
    let foliage =
        Foliage::new(&positions, triangles, Attributes::default(), vec![Material::default()]).expect("leaves");
    for bound in [0.0, 1e-12, 0.01, 1.0] {
        let Some(found) = simpler(&foliage, bound) else { continue };
        assert!(found.places.iter().flatten().chain(found.targets.as_flattened()).all(|p| p.is_finite()));
        assert!(found.foliage.triangle_count() >= 1);
    }
}

#[test]
fn leaves_that_no_surface_is_like_stay_finite() {
    // Triangles of random corners share edges three at a time and meet at single points.
    for seed in 0..60u64 {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) + 1;
        let mut next = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        let vertices = 8 + next(16);
        let place = |i: u64| DVec3::new((i % 4) as f64, (i / 4 % 3) as f64, 0.1 * (i / 12) as f64);
        let positions: Vec<DVec3> = (0..vertices).map(place).collect();
        let triangles: Vec<[u32; 3]> = (0..30).map(|_| [0; 3].map(|_| next(vertices) as u32)).collect();
        let attributes = Attributes { leaf_ids: vec![0; 30], ..Attributes::default() };
        let Ok(soup) = Foliage::new(&positions, triangles, attributes, vec![Material::default()]) else { continue };
        for bound in [0.01, 0.3, 2.0] {
            let Some(found) = simpler(&soup, bound) else { continue };
            assert!(found.targets.as_flattened().iter().all(|p| p.is_finite()), "seed {seed}");
        }
    }
}
