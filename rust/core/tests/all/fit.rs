//! Promises of every fit method, and effects of the settings. Oracles: definitions, closed forms, invariances.

use std::sync::Mutex;

use crate::common::soups::{all_settings, fitted, quick, shrub, soup};
use glam::DVec3;
use leafcloud::fit::{Effort, FitSettings, ImageBound, Method, Preference, fit, fit_watched};
use leafcloud::foliage::Attributes;
use leafcloud::{Cloud, Foliage, Progress};
use proptest::prelude::*;

/// Ten small triangles in a plane at height `z`, all facing up.
fn layer(z: f64) -> Vec<[DVec3; 3]> {
    let place = |i: u32| DVec3::new(f64::from(i % 5), f64::from(i / 5) * 2.0, z);
    (0..10).map(|i| [place(i), place(i) + DVec3::X * 0.1, place(i) + DVec3::Y * 0.1]).collect()
}

/// Checks that every vertex lies within the bound of its triangle's plane: f64, caller's coordinates.
fn assert_held(foliage: &Foliage, cloud: &Cloud) {
    assert_eq!(cloud.parents.len(), foliage.triangle_count());
    let frame = foliage.frame();
    for (t, &parent) in cloud.parents.iter().enumerate() {
        let plane = cloud.planes[parent as usize].to_caller(frame);
        assert!((plane.normal.length() - 1.0).abs() < 1e-9);
        for p in foliage.corners(t).map(|p| frame.to_caller(p)) {
            let height = (plane.normal.dot(p) - plane.distance).abs();
            assert!(height <= cloud.bound, "triangle {t}: {height} > {}", cloud.bound);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn every_triangle_has_one_parent_within_the_bound(
        places in prop::collection::vec((-1.0..1.0, -1.0..1.0, -1.0..1.0), 3..90), size in 0.01..0.5,
    ) {
        let points: Vec<DVec3> = places.into_iter().map(|(x, y, z): (f64, f64, f64)| DVec3::new(x, y, z)).collect();
        let near = |a: DVec3, b: DVec3| a + (b - a) * size;
        let corners: Vec<_> = points.windows(3).map(|w| [w[0], near(w[0], w[1]), near(w[0], w[2])]).collect();
        for settings in all_settings() {
            let foliage = soup(&corners);
            let cloud = fitted(&foliage, &settings);
            assert_held(&foliage, &cloud);
            if settings.method != Method::KMeans {
                prop_assert_eq!(cloud.bound, settings.epsilon * foliage.frame().radius);
            }
        }
    }
}

#[test]
fn all_methods_hold_the_shrub_on_any_number_of_threads() {
    let foliage = shrub();
    for settings in all_settings() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| fitted(&foliage, &settings))
        };
        let (one, three) = (on(1), on(3));
        assert_held(&foliage, &one);
        assert_eq!((&one.planes, &one.parents), (&three.planes, &three.parents), "{settings:?}");
    }
}

/// Returns the foliage with moved corners and reordered triangles.
fn moved(foliage: &Foliage, order: &[usize], to: impl Fn(DVec3) -> DVec3) -> Foliage {
    let corners = order.iter().flat_map(|&t| foliage.corners(t).map(|p| to(foliage.frame().to_caller(p))));
    let leaf_ids = order.iter().map(|&t| i64::from(foliage.leaf_ids()[t])).collect();
    let triangles = (0..order.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let attributes = Attributes { leaf_ids, ..Attributes::default() };
    Foliage::new(&corners.collect::<Vec<_>>(), triangles, attributes, vec![]).unwrap()
}

type Turn = fn(DVec3) -> DVec3;

#[test]
fn results_follow_the_foliage() {
    let shrub = shrub();
    let count = shrub.triangle_count();
    let plain: Vec<usize> = (0..count).collect();
    let shuffled: Vec<usize> = (0..count).map(|i| i * 7919 % count).collect();
    assert_eq!(shuffled.iter().collect::<std::collections::HashSet<_>>().len(), count, "a permutation");
    let foliage = moved(&shrub, &plain, |p| p);
    let turns: [(&str, Turn); 5] = [
        ("a quarter turn about z", |p| DVec3::new(-p.y, p.x, p.z)),
        ("a quarter turn about x", |p| DVec3::new(p.x, -p.z, p.y)),
        ("half a turn about y", |p| DVec3::new(-p.x, p.y, -p.z)),
        ("twice the size", |p| p * 2.0),
        ("elsewhere", |p| p + DVec3::new(64.0, -32.0, 16.0)),
    ];
    for settings in [quick(), FitSettings { effort: Effort::Final, ..quick() }] {
        let cloud = fitted(&foliage, &settings);
        for (what, turn) in turns {
            let other = moved(&shrub, &plain, turn);
            let turned = fitted(&other, &settings);
            assert_eq!(turned.parents, cloud.parents, "{what}");
            // The points have the same heights over the same planes.
            let scale = other.frame().radius / foliage.frame().radius;
            for (a, b) in cloud.deviations.iter().zip(&turned.deviations) {
                assert!((a * scale - b).abs() < 1e-6 * other.frame().radius, "{what}");
            }
        }
        let other = fitted(&moved(&shrub, &shuffled, |p| p), &settings);
        assert_eq!(other.planes, cloud.planes);
        for (i, &t) in shuffled.iter().enumerate() {
            assert_eq!(other.parents[i], cloud.parents[t]);
        }
    }
}

#[test]
fn more_candidates_do_no_harm() {
    let foliage = shrub();
    let counts = |candidates: usize| -> Vec<f64> {
        let of =
            |seed| fitted(&foliage, &FitSettings { seed, candidates, ..FitSettings::default() }).planes.len() as f64;
        (0..20).map(of).collect()
    };
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let variance = |x: &[f64]| x.iter().map(|v| (v - mean(x)).powi(2)).sum::<f64>() / (x.len() - 1) as f64;
    for candidates in [100, 300] {
        let (few, many) = (counts(candidates), counts(2 * candidates));
        let noise = ((variance(&few) + variance(&many)) / 20.0).sqrt();
        assert!(mean(&many) <= mean(&few) + 2.0 * noise, "{candidates}: {} → {}", mean(&few), mean(&many));
    }
}

#[test]
fn effort_buys_billboards() {
    let foliage = shrub();
    let count = |effort| fitted(&foliage, &FitSettings { effort, ..FitSettings::default() }).planes.len();
    let (literal, default, last) = (count(Effort::Literal), count(Effort::Default), count(Effort::Final));
    assert!(default <= literal && last <= default && last < literal, "{literal}, {default}, {last}");
}

#[test]
fn planes_do_not_hold_leaves_edge_on() {
    // Three layers of leaves that one plane holds edge-on.
    let foliage = soup(&[layer(0.0), layer(2.0), layer(4.0)].concat());
    for method in [Method::Stochastic, Method::Density] {
        for effort in [Effort::Default, Effort::Final] {
            let cloud = fitted(&foliage, &FitSettings { method, effort, epsilon: 0.1, ..quick() });
            assert_held(&foliage, &cloud);
            let facing = |t: usize| {
                let area = foliage.area_vector(t);
                area.dot(cloud.planes[cloud.parents[t] as usize].normal).abs() / area.length()
            };
            let kept = (0..30).map(facing).sum::<f64>() / 30.0;
            assert!(kept > 0.9, "{method:?}, {effort:?}: {kept}");
        }
    }
}

#[test]
fn clusters_find_layers() {
    let foliage = soup(&[layer(0.0), layer(2.0), layer(4.0)].concat());
    let cloud = fitted(&foliage, &FitSettings { method: Method::KMeans, max_billboards: Some(3), ..quick() });
    assert_eq!(cloud.planes.len(), 3);
    assert!(cloud.max_deviation() < 1e-6, "each layer lies in its plane");
    assert_held(&foliage, &cloud);
    let refused = fit(&foliage, &FitSettings { method: Method::KMeans, ..quick() }, Progress::silent());
    assert!(refused.unwrap_err().to_string().contains("max_billboards"));
}

#[test]
#[ignore = "long: make test-night runs it"]
fn extremes_end_soon_and_hold() {
    let foliage = shrub();
    let tiny = Some(ImageBound { angle: 1e-4, distance: 1.0001 });
    let extremes = [
        FitSettings { epsilon: 1e-9, ..quick() },
        FitSettings { image: tiny, ..quick() },
        FitSettings { image: tiny, method: Method::Density, ..quick() },
        FitSettings { candidates: 1_000_000, ..quick() },
        FitSettings { candidates: 1_000_000, method: Method::Density, ..quick() },
        FitSettings { facing: 1e6, gather: 1e6, ..quick() },
    ];
    for settings in extremes {
        assert_held(&foliage, &fitted(&foliage, &settings));
    }
    let refused = |settings: FitSettings| fit(&foliage, &settings, Progress::silent()).unwrap_err().to_string();
    assert!(refused(FitSettings { gather: 1e300, ..quick() }).contains("gather"));
    let clusters = FitSettings { method: Method::KMeans, max_billboards: Some(3), compact: Some(0.1), ..quick() };
    assert!(refused(clusters).contains("compact"));
}

#[test]
fn clusters_report_a_bound_that_holds() {
    let foliage = shrub();
    let cloud = fitted(&foliage, &FitSettings { method: Method::KMeans, max_billboards: Some(20), ..quick() });
    assert!(cloud.planes.len() <= 20);
    assert_held(&foliage, &cloud);
}

#[test]
fn the_smallest_epsilon_for_so_many_billboards() {
    let foliage = shrub();
    for most in [12, 40] {
        let settings = FitSettings { max_billboards: Some(most), extra_error: 0.0, ..FitSettings::default() };
        let cloud = fitted(&foliage, &settings);
        assert_held(&foliage, &cloud);
        assert!(cloud.planes.len() <= most);
        let epsilon = cloud.bound / foliage.frame().radius;
        let finer = fitted(&foliage, &FitSettings { epsilon: epsilon / 1.25, ..FitSettings::default() });
        assert!(finer.planes.len() > most, "ε = {epsilon} could have been a quarter less");
    }
}

#[test]
fn extra_error_brings_leaves_nearer_in_the_mean() {
    let foliage = shrub();
    let of = |extra_error| {
        let settings = FitSettings { max_billboards: Some(40), extra_error, ..FitSettings::default() };
        let cloud = fitted(&foliage, &settings);
        assert_held(&foliage, &cloud);
        assert!(cloud.planes.len() <= 40);
        cloud
    };
    let (tight, loose) = (of(0.0), of(0.25));
    assert!((loose.bound / tight.bound - 1.25).abs() < 1e-12);
    // The quantity that refits minimize, over the area, relative to the bound of the tight cloud.
    let cost = |cloud: &Cloud| {
        let (mut sum, mut total) = (0.0, 0.0);
        for (t, &parent) in cloud.parents.iter().enumerate() {
            let plane = cloud.planes[parent as usize];
            let area = foliage.area_vector(t);
            let squares: f64 = foliage.corners(t).map(|p| plane.height(p).powi(2)).iter().sum();
            let away = squares / 3.0 * (foliage.frame().radius / tight.bound).powi(2);
            sum += area.length() * away + (area.length() - area.dot(plane.normal).abs());
            total += area.length();
        }
        sum / total
    };
    let (far, near) = (cost(&tight), cost(&loose));
    assert!(near < 0.97 * far, "{far} to {near}");
    let mean = |seed| {
        let settings = FitSettings { max_billboards: Some(40), extra_error: 0.25, seed, ..FitSettings::default() };
        fitted(&foliage, &settings).mean_deviation(&foliage)
    };
    let means: Vec<f64> = (0..4).map(mean).collect();
    let (least, most) =
        (means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(0.0, f64::max));
    assert!(most < 1.06 * least, "the best of several seeds is taken, so that seeds matter little: {means:?}");
    let texels = FitSettings { max_texels: Some(100_000), extra_error: 0.25, ..FitSettings::default() };
    let without = FitSettings { extra_error: 0.0, ..texels.clone() };
    assert_eq!(fitted(&foliage, &texels).bound, fitted(&foliage, &without).bound, "a budget of texels has its own ε");
}

#[test]
fn fewer_texels_make_a_coarser_cloud() {
    let foliage = shrub();
    let bound = |most| fitted(&foliage, &FitSettings { max_texels: Some(most), ..FitSettings::default() }).bound;
    let free = fitted(&foliage, &FitSettings::default()).bound;
    assert_eq!(bound(1 << 39), free, "a wide budget changes nothing");
    assert!(bound(100_000) > bound(400_000) && bound(400_000) >= free);
}

#[test]
fn billboards_of_a_limited_size() {
    let foliage = shrub();
    let size = 0.4;
    let cloud = fitted(&foliage, &FitSettings { max_size: Some(size), effort: Effort::Final, ..quick() });
    assert_held(&foliage, &cloud);
    let mut points: Vec<Vec<DVec3>> = vec![Vec::new(); cloud.planes.len()];
    for (t, &parent) in cloud.parents.iter().enumerate() {
        points[parent as usize].extend(foliage.corners(t));
    }
    for points in points {
        let farthest = points.iter().flat_map(|a| points.iter().map(move |b| a.distance(*b))).fold(0.0, f64::max);
        assert!(farthest <= 2.0 * size + 1e-5, "{farthest}");
    }
}

#[test]
fn a_leaf_larger_than_the_size_limit_keeps_its_size() {
    let large = |z: f64| [DVec3::new(0.0, 0.0, z), DVec3::new(9.0, 0.0, z), DVec3::new(0.0, 9.0, z)];
    let foliage = soup(&[layer(0.0), vec![large(0.5), large(3.0)]].concat());
    for settings in all_settings().into_iter().filter(|s| s.method != Method::KMeans) {
        assert_held(&foliage, &fitted(&foliage, &FitSettings { max_size: Some(0.05), ..settings }));
    }
}

#[test]
fn gaps_split_billboards() {
    // Two layers in one plane, far apart: one billboard, or two.
    let far = |c: &[DVec3; 3]| c.map(|p| p + DVec3::X * 40.0);
    let foliage = soup(&[layer(0.0), layer(0.0).iter().map(far).collect()].concat());
    assert_eq!(fitted(&foliage, &quick()).planes.len(), 1);
    let parted = fitted(&foliage, &FitSettings { compact: Some(0.5), ..quick() });
    assert_eq!(parted.planes.len(), 2);
    assert_eq!(parted.planes[0], parted.planes[1]);
    assert!(parted.parents[..10].iter().all(|&p| p == parted.parents[0]) && parted.parents[0] != parted.parents[10]);
}

#[test]
fn preferences_turn_planes() {
    let foliage = shrub();
    let mean_along = |settings: &FitSettings, axis: DVec3| {
        let cloud = fitted(&foliage, settings);
        cloud.parents.iter().map(|&k| cloud.planes[k as usize].normal.dot(axis).abs()).sum::<f64>()
            / cloud.parents.len() as f64
    };
    let plain = FitSettings { facing: 0.0, ..quick() };
    let upright = FitSettings { preference: Preference { vertical: 0.9, ..Preference::default() }, ..plain.clone() };
    let (turned, before) = (mean_along(&upright, DVec3::Z), mean_along(&plain, DVec3::Z));
    assert!(turned < before - 0.05, "{before} → {turned}");
    let views = Preference { views: vec![DVec3::new(3.0, 0.0, 0.0)], facing_views: 0.9, ..Preference::default() };
    let seen = FitSettings { preference: views, ..plain.clone() };
    let (turned, before) = (mean_along(&seen, DVec3::X), mean_along(&plain, DVec3::X));
    assert!(turned > before + 0.05, "{before} → {turned}");
}

#[test]
fn visible_motion_is_at_most_the_angle() {
    let foliage = shrub();
    let image = ImageBound { angle: 0.02, distance: 1.5 };
    let cloud = fitted(&foliage, &FitSettings { image: Some(image), ..quick() });
    let mut farthest_in = 0f64;
    for (t, &parent) in cloud.parents.iter().enumerate() {
        for p in foliage.corners(t) {
            let height = cloud.planes[parent as usize].height(p).abs();
            // The viewer's least distance to the point.
            assert!(height <= image.angle * (image.distance - p.length()) + 1e-9);
            farthest_in = farthest_in.max(height);
        }
    }
    assert!(farthest_in > image.angle * 0.6, "the inside uses most of the limit");
    assert!(farthest_in <= FitSettings::default().epsilon);
}

#[test]
fn intermediate_results_are_complete_and_improve() {
    let foliage = shrub();
    let answers = Mutex::new(Vec::new());
    let settings = FitSettings { effort: Effort::Final, ..FitSettings::default() };
    let last =
        fit_watched(&foliage, &settings, Progress::silent(), &|cloud| answers.lock().unwrap().push(cloud)).unwrap();
    let answers = answers.into_inner().unwrap();
    assert!(answers.len() > 1);
    for cloud in &answers {
        assert_held(&foliage, cloud);
    }
    let counts: Vec<usize> = answers.iter().map(|cloud| cloud.planes.len()).collect();
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    assert_eq!(*counts.last().unwrap(), last.planes.len());
}

#[test]
fn within_a_budget_the_last_intermediate_result_is_the_result() {
    let foliage = shrub();
    for extra_error in [0.0, 0.25] {
        let answers = Mutex::new(Vec::new());
        let settings = FitSettings { max_billboards: Some(40), extra_error, ..FitSettings::default() };
        let told = |cloud| answers.lock().unwrap().push(cloud);
        let result = fit_watched(&foliage, &settings, Progress::silent(), &told).unwrap();
        let answers = answers.into_inner().unwrap();
        for cloud in &answers {
            assert_held(&foliage, cloud);
            assert!(cloud.planes.len() <= 40);
        }
        let last = answers.last().unwrap();
        assert_eq!(last.parents, result.parents, "refits are reported, too");
        assert!(last.mean_deviation(&foliage) < answers[0].mean_deviation(&foliage));
    }
}

#[test]
fn a_job_stopped_early_has_a_result() {
    let foliage = shrub();
    let answers = Mutex::new(0);
    let settings = FitSettings { effort: Effort::Best, ..FitSettings::default() };
    let stop = |_: &str, _: f64| *answers.lock().unwrap() < 2;
    let result = fit_watched(&foliage, &settings, Progress::new(&stop), &|_| *answers.lock().unwrap() += 1);
    assert!(matches!(result, Err(leafcloud::Error::Cancelled)));
    assert!(*answers.lock().unwrap() >= 2);
}

#[test]
fn large_foliage_is_fitted_by_a_core_set_within_the_bound() {
    // A ball of 50 000 small leaves, more than one search takes.
    let place = |i: u32| {
        let t = f64::from(i);
        DVec3::new((t * 12.9898).sin(), (t * 78.233).sin(), (t * 37.719).sin()) * ((t * 0.618).fract().cbrt() * 0.7)
    };
    let corners: Vec<_> = (0..50_000u32)
        .map(|i| {
            let (p, q) = (place(i), place(i + 50_000).normalize_or(DVec3::X) * 0.02);
            [p, p + q, p + q.any_orthogonal_vector().normalize() * 0.02]
        })
        .collect();
    let foliage = soup(&corners);
    for effort in [Effort::Default, Effort::Final] {
        let cloud = fitted(&foliage, &FitSettings { effort, epsilon: 0.1, ..quick() });
        assert_held(&foliage, &cloud);
        assert!(cloud.planes.len() < 60, "{}", cloud.planes.len());
    }
}
