//! Accuracy of sums, and independence of the number of threads.

use glam::DVec3;
use leafcloud::foliage::{Attributes, area_vector};
use leafcloud::geometry::Plane;
use leafcloud::{Cloud, Foliage};

use crate::common::exact::{sum, ulps};
use crate::common::random::Random;
use crate::common::soups::{all_settings, fitted, random_corners, soup};
use crate::common::stability::{case, worse};

const GROUP: &str = "Arithmetic";

/// Number of triangles in the sums.
const MANY: u32 = 10_000_000;

#[test]
fn areas_of_ten_million_triangles() {
    // A fan, with one new vertex for each triangle: needles and broad leaves, with areas over nine orders of magnitude.
    let mut random = Random(31);
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..=MANY).map(|i| {
        let angle = f64::from(i) * 2.399_963_229_728_653;
        DVec3::new(angle.cos(), angle.sin(), random.signed()) * 10f64.powf(random.signed() * 2.0)
    }));
    let triangles: Vec<[u32; 3]> = (0..MANY).map(|i| [0, i + 1, i + 2]).collect();
    let attributes = Attributes { leaf_ids: vec![0; MANY as usize], ..Attributes::default() };
    let foliage = Foliage::new(&positions, triangles, attributes, vec![]).unwrap();
    let plane = Plane { normal: DVec3::Z, distance: 0.25 };
    let cloud = Cloud::new(&foliage, vec![plane], vec![0; MANY as usize], 1.0);
    let found = cloud.mean_deviation(&foliage);
    // The same products, summed without rounding as multiples of 2⁻¹⁰⁰: the last bits of all products are above that.
    let whole = |x: f64| (x * 2f64.powi(100)) as i128;
    let (mut moved, mut area) = (0i128, 0i128);
    for t in 0..MANY as usize {
        let a = area_vector(foliage.corners(t)).length();
        moved += whole(a * cloud.deviations[t]) >> 8;
        area += whole(a) >> 8;
    }
    let expected = moved as f64 / area as f64;
    case(GROUP, "mean deviation over 10⁷ triangles, relative error", "sums of whole numbers, exact")
        .holds((found / expected - 1.0).abs(), 1e-14);
}

#[test]
fn sums_that_cancel() {
    // Kahan's example, 1 beside 10¹⁰⁰ and −10¹⁰⁰, here as areas that differ by sixteen orders of magnitude.
    let corners: Vec<[DVec3; 3]> = (0..4001)
        .map(|i| {
            let size = if i == 0 { 1.0 } else { 1e-8 };
            [DVec3::ZERO, DVec3::X * size, DVec3::Y * size].map(|p| p + DVec3::Z * 0.01 * f64::from(i % 2))
        })
        .collect();
    let foliage = soup(&corners);
    let plane = Plane { normal: DVec3::Z, distance: 0.0 };
    let count = foliage.triangle_count();
    let cloud = Cloud::new(&foliage, vec![plane], vec![0; count], 1.0);
    let areas: Vec<f64> = (0..count).map(|t| foliage.area_vector(t).length()).collect();
    let expected = sum(areas.iter().zip(&cloud.deviations).map(|(a, d)| a * d)) / sum(areas.iter().copied());
    case(GROUP, "mean deviation of areas over sixteen orders of magnitude, in ulps", "exact sums")
        .holds(ulps(cloud.mean_deviation(&foliage), expected), 4.0);
}

#[test]
fn threads_do_not_matter() {
    let corners = random_corners(3000, 32);
    let foliage = soup(&corners);
    let mut differ = 0;
    for settings in all_settings() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let cloud = pool.install(|| fitted(&foliage, &settings));
            (
                cloud
                    .planes
                    .iter()
                    .flat_map(|p| [p.normal.x, p.normal.y, p.normal.z, p.distance])
                    .map(f64::to_bits)
                    .collect::<Vec<_>>(),
                cloud.parents,
            )
        };
        let one = on(1);
        differ += [2, 16].into_iter().filter(|&threads| on(threads) != one).count();
    }
    case(GROUP, "1, 2 and 16 threads, every method", "invariance: the same bits").holds(differ as f64, 0.0);
}

#[test]
fn frames_there_and_back() {
    let mut random = Random(33);
    let mut worst: f64 = 0.0;
    for exponent in [-30, -6, 0, 6, 30] {
        let size = 10f64.powi(exponent);
        for offset in [0.0, 1.0, 1e6] {
            let at = DVec3::new(1.0, -2.0, 0.5) * (offset * size);
            let corners: Vec<_> = (0..50).map(|_| [0; 3].map(|_| at + random.in_ball() * size)).collect();
            let foliage = soup(&corners);
            let largest = corners.iter().flatten().map(|p| p.abs().max_element()).fold(0.0, worse);
            for (t, corner) in corners.iter().enumerate() {
                for (p, q) in corner.iter().zip(foliage.corners(t)) {
                    worst = worse(worst, foliage.frame().to_caller(q).distance(*p) / largest);
                }
            }
        }
    }
    case(
        GROUP,
        "to the local frame and back, sizes 10⁻³⁰ to 10³⁰, offsets to 10⁶ R, relative error",
        "definition: four roundings per axis",
    )
    .holds(worst, 4.0 * 3f64.sqrt() * 2f64.powi(-53));
}
