//! Foliage far from the origin, very small or very large: the result must follow the input.

use glam::DVec3;
use leafcloud::fit::{FitSettings, Method, fit};
use leafcloud::{Cloud, Foliage, Progress};

use crate::common::promise::farthest_share;
use crate::common::soups::{all_settings, fitted, quick, random_corners, soup};
use crate::common::stability::{case, worse};

const GROUP: &str = "Placement";

/// Triangles with coordinates that are multiples of 2⁻¹², so that moving and scaling them by powers of two rounds nothing. R is about 1.
fn on_a_grid(count: usize) -> Vec<[DVec3; 3]> {
    let grid = |p: DVec3| (p * 4096.0).round() / 4096.0;
    random_corners(count, 11).into_iter().map(|t| t.map(grid)).collect()
}

fn moved(corners: &[[DVec3; 3]], to: impl Fn(DVec3) -> DVec3) -> Foliage {
    soup(&corners.iter().map(|t| t.map(&to)).collect::<Vec<_>>())
}

fn decided(cloud: &Cloud) -> (Vec<[f64; 4]>, Vec<u32>) {
    let planes = cloud.planes.iter().map(|p| [p.normal.x, p.normal.y, p.normal.z, p.distance]);
    (planes.collect(), cloud.parents.clone())
}

/// Checks that every method gives bit-identical planes, in the local frame, and parents after the move `to`.
fn follows(name: &'static str, to: impl Fn(DVec3) -> DVec3) {
    let corners = on_a_grid(250);
    let (plain, there) = (soup(&corners), moved(&corners, to));
    let mut differ = 0;
    for settings in all_settings() {
        differ += usize::from(decided(&fitted(&plain, &settings)) != decided(&fitted(&there, &settings)));
    }
    case(GROUP, name, "invariance: nothing is rounded on the way, so the same bits").holds(differ as f64, 0.0);
}

#[test]
fn exact_offsets_and_scales() {
    follows("offset by 2²⁰ R (10⁶), every method", |p| p + DVec3::new(1.0, -1.0, 0.5) * 2f64.powi(20));
    follows("offset by 2²⁷ R (10⁸), every method", |p| p + DVec3::new(1.0, -1.0, 0.5) * 2f64.powi(27));
    follows("scene of size 2⁻²⁰ (10⁻⁶), every method", |p| p * 2f64.powi(-20));
    follows("scene of size 2²⁰ (10⁶), every method", |p| p * 2f64.powi(20));
    follows("scene of size 2⁻¹⁰⁰, every method", |p| p * 2f64.powi(-100));
    follows("scene of size 2¹⁰⁰, every method", |p| p * 2f64.powi(100));
}

#[test]
fn offsets_that_round() {
    let corners = random_corners(250, 12);
    for (name, far) in
        [("offset by 10⁸ R, coordinates rounded there", 1e8), ("offset by 10¹² R, coordinates rounded there", 1e12)]
    {
        let foliage = moved(&corners, |p| p + DVec3::new(0.7, -0.9, 1.0) * far);
        let worst = all_settings().iter().map(|s| farthest_share(&foliage, &fitted(&foliage, s), s)).fold(0.0, worse);
        case(GROUP, name, "exact fractions: every vertex, as it is stored, within ε").holds(worst, 1.0);
    }
}

#[test]
fn in_the_callers_coordinates() {
    // In the caller's coordinates a plane's distance is rounded at the size of the offset: an ulp of it, and three ulps of the products.
    for (name, far) in [
        ("planes in the caller's coordinates, 10⁶ R away", 1e6),
        ("planes in the caller's coordinates, 10⁸ R away", 1e8),
    ] {
        let foliage = moved(&on_a_grid(250), |p| p + DVec3::new(0.7, -0.9, 1.0) * far);
        let settings = &all_settings()[1];
        assert!(settings.method == Method::Stochastic);
        let cloud = fitted(&foliage, settings);
        let frame = foliage.frame();
        let mut worst = f64::NEG_INFINITY;
        for (t, &parent) in cloud.parents.iter().enumerate() {
            let plane = cloud.planes[parent as usize].to_caller(frame);
            for p in foliage.corners(t) {
                worst = worse(worst, plane.height(frame.to_caller(p)).abs() - cloud.bound);
            }
        }
        case(GROUP, name, "definition: ε, and eight roundings of coordinates of that size")
            .holds(worst, 8.0 * far * 2f64.powi(-53));
    }
}

#[test]
fn too_far_for_epsilon() {
    let foliage = moved(&on_a_grid(20), |p| p + DVec3::X * 2f64.powi(40));
    let settings = FitSettings { epsilon: 1e-6, ..quick() };
    let found = fit(&foliage, &settings, Progress::silent()).map(|_| ());
    case(GROUP, "ε of 10⁻⁶ R at 10¹² R, below what f64 can hold there", "a named error")
        .refuses(found, "from the origin");
}
