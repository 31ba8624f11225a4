//! Cost in time of each safeguard of accuracy, measured against a variant without it: `make bench`, or
//! `cargo bench --bench safeguards TREE.glb …`. Prints a table in Markdown.
//!
//! The variants without safeguards exist only here. Times are the best of several runs on one thread.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use glam::{DVec3, Vec3};
use leafcloud::fit::{FitSettings, fit};
use leafcloud::lod::{ChainSettings, build_chain};
use leafcloud::{Cloud, Foliage, Progress, gltf};

const RUNS: usize = 7;

fn best<T>(mut run: impl FnMut() -> T) -> f64 {
    let time = |_| {
        let started = Instant::now();
        black_box(run());
        started.elapsed().as_secs_f64()
    };
    (0..RUNS).map(time).fold(f64::INFINITY, f64::min)
}

/// Returns the greatest distance of each triangle from its plane in single precision: `Cloud::new` without f64.
fn single(corners: &[[Vec3; 3]], planes: &[(Vec3, f32)], parents: &[u32]) -> Vec<f32> {
    let distance = |(corners, &parent): (&[Vec3; 3], &u32)| {
        let (normal, distance) = planes[parent as usize];
        corners.iter().map(|p| (normal.dot(*p) - distance).abs()).fold(0.0, f32::max)
    };
    corners.iter().zip(parents).map(distance).collect()
}

/// Returns the mean deviation by plain additions: `Cloud::mean_deviation` without compensation for rounding.
fn plain_mean(foliage: &Foliage, deviations: &[f64]) -> f64 {
    let (mut moved, mut whole) = (0.0, 0.0);
    for (t, deviation) in deviations.iter().enumerate() {
        let area = foliage.area_vector(t).length();
        moved += area * deviation;
        whole += area;
    }
    moved / whole
}

/// Computes powers, sines and cosines with the given functions: those of a library with the same results everywhere, or the platform's.
fn transcendental(values: &[f64], pow: fn(f64, f64) -> f64, sin: fn(f64) -> f64, cos: fn(f64) -> f64) -> f64 {
    values.iter().map(|&x| pow(x, 1.7) + sin(x) * cos(x)).sum()
}

fn main() {
    println!(
        "Made by `make bench`: milliseconds with and without each safeguard, one thread, best of {RUNS}. A bake is the whole chain with the defaults.\n"
    );
    println!(
        "| tree | check of ε in f64 | in f32 | mean deviation, exact sums | plain sums | 10⁵ powers, sines, cosines: same everywhere | platform's | fit | chain |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let trees = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    let mut shares = Vec::new();
    for tree in trees {
        let foliage = gltf::read(Path::new(&tree), &names).expect("a glTF file with leaves");
        let settings = FitSettings::default();
        let cloud = fit(&foliage, &settings, Progress::silent()).expect("the settings are within their ranges");
        let Cloud { planes, parents, deviations, bound } = &cloud;
        let check = best(|| Cloud::new(&foliage, planes.clone(), parents.clone(), *bound));
        let corners: Vec<[Vec3; 3]> =
            (0..foliage.triangle_count()).map(|t| foliage.corners(t).map(DVec3::as_vec3)).collect();
        let narrow: Vec<(Vec3, f32)> = planes.iter().map(|p| (p.normal.as_vec3(), p.distance as f32)).collect();
        let unchecked = best(|| (narrow.clone(), parents.clone(), single(&corners, &narrow, parents)));
        let exact = best(|| cloud.mean_deviation(&foliage));
        let plain = best(|| plain_mean(&foliage, deviations));
        let values: Vec<f64> = (1..=100_000).map(|i| DVec3::splat(f64::from(i)).length() * 1e-3).collect();
        let same = best(|| transcendental(&values, libm::pow, libm::sin, libm::cos));
        let platform = best(|| transcendental(&values, f64::powf, f64::sin, f64::cos));
        let fitted = one.install(|| best(|| fit(&foliage, &settings, Progress::silent())));
        let started = Instant::now();
        let chain = one.install(|| build_chain(&foliage, None, &ChainSettings::default(), Progress::silent()));
        black_box(chain.expect("the defaults build a chain"));
        let whole = started.elapsed().as_secs_f64();
        let name = Path::new(&tree).file_stem().unwrap_or_default().display().to_string();
        let [check, unchecked, exact, plain, same, platform, fitted, whole] =
            [check, unchecked, exact, plain, same, platform, fitted, whole].map(|seconds| 1e3 * seconds);
        println!(
            "| {name} | {check:.2} | {unchecked:.2} | {exact:.2} | {plain:.2} | {same:.2} | {platform:.2} | {fitted:.0} | {whole:.0} |"
        );
        shares.push((name, [check / fitted, check / whole, (check - unchecked) / whole, (exact - plain) / whole]));
    }
    println!(
        "\n| tree | whole check, share of the fit | share of a bake | its f64, share of a bake | exact sums, share of a bake |\n|---|---|---|---|---|"
    );
    for (name, shares) in shares {
        let cells = shares.map(|share| format!("{:.3} %", 100.0 * share));
        println!("| {name} | {} |", cells.join(" | "));
    }
    println!(
        "\nThe check of ε is all of `Cloud::new`. In f32 the corners also lie side by side in memory, so the difference is \
         an upper bound of the cost of f64. Exact sums are Neumaier's."
    );
}
