use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::Error;
use crate::foliage::Attributes;

/// Makes a foliage from separate triangles.
fn soup(corners: &[[DVec3; 3]]) -> Foliage {
    let positions: Vec<DVec3> = corners.iter().flatten().copied().collect();
    let triangles = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
}

fn triangle_at(place: DVec3, normal: DVec3) -> [DVec3; 3] {
    let (x, y) = normal.normalize().any_orthonormal_pair();
    [place, place + x * 0.1, place + y * 0.1]
}

/// Asserts the guaranteed bound from its definition: f64, caller's coordinates.
fn assert_held(foliage: &Foliage, cloud: &Cloud, bound: f64) {
    let frame = foliage.frame();
    for (t, &parent) in cloud.parents.iter().enumerate() {
        let plane = cloud.planes[parent as usize].to_caller(frame);
        for p in foliage.corners(t).map(|p| frame.to_caller(p)) {
            assert!((plane.normal.dot(p) - plane.distance).abs() <= bound, "triangle {t}");
        }
    }
}

fn settings(epsilon: f64) -> FitSettings {
    FitSettings { epsilon, candidates: 50, ..FitSettings::default() }
}

#[test]
fn one_triangle_gets_one_plane_through_it() {
    let foliage = soup(&[triangle_at(DVec3::ONE, DVec3::new(1.0, 2.0, 3.0))]);
    let cloud = fit(&foliage, &settings(0.04), Progress::silent()).unwrap();
    assert_eq!((cloud.planes.len(), cloud.parents.as_slice()), (1, &[0][..]));
    assert_held(&foliage, &cloud, 0.04 * foliage.frame().radius);
}

#[test]
fn coplanar_triangles_share_a_plane() {
    let corners: Vec<_> = (0..20).map(|i| triangle_at(DVec3::X * f64::from(i), DVec3::Z)).collect();
    let cloud = fit(&soup(&corners), &settings(0.01), Progress::silent()).unwrap();
    assert_eq!(cloud.planes.len(), 1);
}

#[test]
fn layers_farther_apart_than_the_slab_get_a_plane_each() {
    // Three layers, R a little above 5: 4 apart is more than 2 · 0.1 · R.
    let layer = |z: f64| (0..10).map(move |i| triangle_at(DVec3::new(f64::from(i), 0.0, z), DVec3::Z));
    let corners: Vec<_> = [0.0, 4.0, 8.0].into_iter().flat_map(layer).collect();
    let foliage = soup(&corners);
    let cloud = fit(&foliage, &FitSettings { facing: 1.0, ..settings(0.1) }, Progress::silent()).unwrap();
    assert!(cloud.planes.len() >= 3);
    assert_held(&foliage, &cloud, 0.1 * foliage.frame().radius);
}

#[test]
fn every_piece_takes_the_nearest_plane_without_facing() {
    let corners: Vec<_> = (0..60)
        .map(|i| triangle_at(DVec3::new(f64::from(i % 8), f64::from(i / 8), f64::from(i % 5) * 0.2), DVec3::Z))
        .collect();
    let foliage = soup(&corners);
    let cloud = fit(&foliage, &FitSettings { facing: 0.0, ..settings(0.05) }, Progress::silent()).unwrap();
    let rms = |t: usize, k: usize| {
        let h = foliage.corners(t).map(|p| cloud.planes[k].height(p).powi(2));
        h.iter().sum::<f64>()
    };
    let bound = 0.05 * (1.0 - 1e-4);
    for (t, &parent) in cloud.parents.iter().enumerate() {
        for k in 0..cloud.planes.len() {
            let holds = foliage.corners(t).iter().all(|&p| cloud.planes[k].height(p).abs() <= bound);
            assert!(!holds || rms(t, parent as usize) <= rms(t, k) + 1e-15);
        }
    }
}

#[test]
fn a_leaf_stays_whole_when_a_plane_can_hold_it_and_parts_when_none_can() {
    // Two triangles of one leaf, folded by 90° along a shared edge, and a third far away that sets the scale.
    let folded = |size: f64| {
        let [a, b] = [DVec3::ZERO, DVec3::X * size];
        let positions = [
            a,
            b,
            DVec3::Y * size,
            DVec3::Z * size,
            DVec3::new(9., 9., 9.),
            DVec3::new(9., 9., 8.),
            DVec3::new(9., 8., 9.),
        ];
        let triangles = vec![[0, 1, 2], [0, 1, 3], [4, 5, 6]];
        Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
    };
    // The corner of a cube is thinnest across the face opposite its tip: 1/√3.
    let radius = folded(1.0).frame().radius;
    let needed = 1.0 / (2.0 * 3f64.sqrt()) / radius;
    for (epsilon, whole) in [(needed * 1.01, true), (needed * 0.99, false)] {
        let settings = FitSettings { whole_leaves: true, ..settings(epsilon) };
        let cloud = fit(&folded(1.0), &settings, Progress::silent()).unwrap();
        assert_eq!(cloud.parents[0] == cloud.parents[1], whole, "ε = {epsilon}");
        assert_held(&folded(1.0), &cloud, epsilon * radius);
    }
}

#[test]
fn triangles_without_area_find_a_plane() {
    let needle = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
    let point = [DVec3::ONE; 3];
    let foliage = soup(&[triangle_at(DVec3::ZERO, DVec3::Z), needle, point]);
    let cloud = fit(&foliage, &settings(0.01), Progress::silent()).unwrap();
    assert!(cloud.planes.iter().all(|p| p.normal.is_finite() && p.distance.is_finite()));
    assert_held(&foliage, &cloud, 0.01 * foliage.frame().radius);
}

#[test]
fn slivers_in_any_direction_find_a_plane() {
    // The third corner is the midpoint of an edge, at exact coordinates: the area is 0, or rounding noise in the local frame.
    let place = |i: u32| {
        DVec3::new(f64::from(i * 577 % 1024), f64::from(i * 331 % 1024), f64::from(i * 769 % 1024)) / 256.0 - 2.0
    };
    let corners: Vec<_> = (1..400).map(|i| [place(i), (place(i) + place(i + 7)) / 2.0, place(i + 7)]).collect();
    let foliage = soup(&[corners.clone(), vec![triangle_at(DVec3::splat(0.123), DVec3::Z)]].concat());
    let cloud = fit(&foliage, &FitSettings { candidates: 1, ..settings(0.01) }, Progress::silent()).unwrap();
    assert_held(&foliage, &cloud, 0.01 * foliage.frame().radius);
}

#[test]
fn one_leaf_of_many_directions_is_no_trouble() {
    let corners: Vec<_> = (0..20_000)
        .map(|i| {
            let t = f64::from(i) * 0.7;
            triangle_at(
                DVec3::new(t.cos() * 3.0, t.sin() * 3.0, f64::from(i) * 1e-4),
                DVec3::new(t.sin(), 1.0, t.cos()),
            )
        })
        .collect();
    let positions: Vec<DVec3> = corners.iter().flatten().copied().collect();
    let triangles = (0..20_000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let one = Attributes { leaf_ids: vec![7; 20_000], ..Attributes::default() };
    let foliage = Foliage::new(&positions, triangles, one, vec![]).unwrap();
    let cloud = fit(&foliage, &FitSettings { candidates: 4, ..settings(0.3) }, Progress::silent()).unwrap();
    assert_held(&foliage, &cloud, 0.3 * foliage.frame().radius);
}

#[test]
fn settings_are_checked() {
    let foliage = soup(&[triangle_at(DVec3::ZERO, DVec3::Z)]);
    let wrong = [
        settings(0.0),
        settings(1e-12),
        settings(-1.0),
        settings(f64::NAN),
        settings(1.5),
        FitSettings { candidates: 0, ..settings(0.1) },
        FitSettings { facing: -1.0, ..settings(0.1) },
    ];
    for s in wrong {
        assert!(fit(&foliage, &s, Progress::silent()).is_err(), "{s:?}");
    }
    assert!(Method::from_name("guess").unwrap_err().to_string().contains("stochastic"));
}

#[test]
fn cancelling_ends_the_fit() {
    let foliage = soup(&[triangle_at(DVec3::ZERO, DVec3::Z)]);
    let stop = |_: &str, _: f64| false;
    assert!(matches!(fit(&foliage, &settings(0.1), Progress::new(&stop)), Err(Error::Cancelled)));
}

/// Random triangles: up to 60, of any size and direction, anywhere.
fn random_soup() -> impl Strategy<Value = Vec<[DVec3; 3]>> {
    let point = (-1.0..1.0, -1.0..1.0, -1.0..1.0).prop_map(|(x, y, z): (f64, f64, f64)| DVec3::new(x, y, z));
    let corner = (point.clone(), point).prop_map(|(place, offset)| (place, offset));
    prop::collection::vec((corner.clone(), corner.clone(), 1e-4..0.5), 1..60).prop_map(|triangles| {
        let build = |((place, a), (_, b), size): ((DVec3, DVec3), (DVec3, DVec3), f64)| {
            [place, place + a * size, place + b * size]
        };
        triangles.into_iter().map(build).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn epsilon_is_a_hard_bound(corners in random_soup(), epsilon in 0.005..0.5, far in 0.0..1e6, scale in -3..3) {
        let move_to = |p: DVec3| (p + DVec3::splat(far)) * 10f64.powi(scale);
        let moved: Vec<_> = corners.iter().map(|c| c.map(move_to)).collect();
        let foliage = soup(&moved);
        let cloud = fit(&foliage, &settings(epsilon), Progress::silent()).unwrap();
        assert_held(&foliage, &cloud, epsilon * foliage.frame().radius);
        prop_assert!(cloud.max_deviation() <= cloud.bound);
    }

    #[test]
    fn threads_do_not_matter(corners in random_soup()) {
        let foliage = soup(&corners);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| fit(&foliage, &settings(0.05), Progress::silent()).unwrap())
        };
        let (one, five) = (on(1), on(5));
        prop_assert_eq!(one.planes, five.planes);
        prop_assert_eq!(one.parents, five.parents);
    }
}
