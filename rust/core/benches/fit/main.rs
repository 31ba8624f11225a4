//! Compares the fit with Algorithm 1 as published ("literal"), all in one run: `make bench`. Prints tables in Markdown and writes the
//! figures as JSON to the file that `LEAFCLOUD_BENCH_JSON` names. Figures are means over the seeds. Fits use all cores, or one thread if
//! noted.

#[path = "../bandwidth.rs"]
mod bandwidth;
#[path = "../../tests/common/mod.rs"]
mod common;
mod lower_bound;
mod machine;
mod report;

use std::time::Instant;

use glam::DVec3;
use leafcloud::fit::{Effort, FitSettings, fit};
use leafcloud::foliage::{Attributes, Opacity};
use leafcloud::geometry::Plane;
use leafcloud::outlines::outlines;
use leafcloud::{Cloud, Foliage, Progress, gltf};
use report::{Figure, Report};

const SEEDS: std::ops::Range<u64> = 0..5;

/// Most triangles for the literal search; it takes minutes on more.
const LITERAL_LIMIT: usize = 200_000;

/// Number of copies of the largest tree in the largest fit.
const COPIES: usize = 10;

fn settings(seed: u64, effort: Effort) -> FitSettings {
    FitSettings { seed, effort, ..FitSettings::default() }
}

fn fitted(foliage: &Foliage, settings: &FitSettings) -> (Cloud, f64) {
    let started = Instant::now();
    let cloud = fit(foliage, settings, Progress::silent()).expect("the settings fit any foliage");
    (cloud, started.elapsed().as_secs_f64())
}

/// Returns the cloud of the literal algorithm: each triangle's parent is the first plane that holds it.
fn captured(foliage: &Foliage, planes: Vec<Plane>, epsilon: f64) -> Cloud {
    let parent = |t: usize| {
        let corners = foliage.corners(t);
        planes.iter().position(|plane| corners.iter().all(|&p| plane.height(p).abs() < epsilon)).unwrap_or(0) as u32
    };
    let parents = (0..foliage.triangle_count()).map(parent).collect();
    Cloud::new(foliage, planes, parents, epsilon * foliage.frame().radius)
}

/// Returns the share of the triangles' area that projection onto the parent planes keeps.
fn kept_share(foliage: &Foliage, cloud: &Cloud) -> f64 {
    let area = |t: usize| foliage.area_vector(t);
    let kept = |t: usize| area(t).dot(cloud.planes[cloud.parents[t] as usize].normal).abs();
    let sum = |f: &dyn Fn(usize) -> f64| (0..foliage.triangle_count()).map(f).sum::<f64>();
    sum(&kept) / sum(&|t| area(t).length())
}

/// Returns the area of all outlines in R². Averaged over all views, half of it is drawn. The covered area is that of the crown, the same
/// for all clouds, so the ratio of two outline areas is the ratio of their overdraws.
fn drawn(foliage: &Foliage, cloud: &Cloud, opacity: &Opacity) -> f64 {
    let onto = |t: usize| foliage.corners(t).map(|p| cloud.planes[cloud.parents[t] as usize].project(p));
    let shapes = outlines(&cloud.planes, &cloud.parents, onto, opacity);
    shapes.iter().map(leafcloud::geometry::Outline::area).sum()
}

/// Returns billboards, seconds, share of area kept, mean deviation as a share of ε, and area of the outlines, as means over the seeds.
fn measure(foliage: &Foliage, opacity: &Opacity, run: impl Fn(u64) -> (Cloud, f64)) -> Figure {
    let mut figure = Figure::default();
    for seed in SEEDS {
        let (cloud, seconds) = run(seed);
        figure.add(&Figure { seconds, ..measure_one(foliage, &cloud, opacity) });
    }
    figure.over((SEEDS.end - SEEDS.start) as f64)
}

/// Returns the same figures of one cloud, without the seconds.
fn measure_one(foliage: &Foliage, cloud: &Cloud, opacity: &Opacity) -> Figure {
    let scale = foliage.frame().radius * FitSettings::default().epsilon;
    Figure {
        billboards: cloud.planes.len() as f64,
        seconds: 0.0,
        kept: kept_share(foliage, cloud),
        deviation: cloud.mean_deviation(foliage) / scale,
        drawn: drawn(foliage, cloud, opacity),
    }
}

/// Adds all figures of a tree that is small enough for the literal search.
fn compare(name: &str, foliage: &Foliage, report: &mut Report) {
    let FitSettings { epsilon, candidates, .. } = FitSettings::default();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let (seen, whole) = (Opacity::of(foliage), Opacity::ignored());
    let literal = measure(foliage, &whole, |seed| {
        let started = Instant::now();
        let planes = common::literal::search(foliage, epsilon, candidates, seed);
        (captured(foliage, planes, epsilon), started.elapsed().as_secs_f64())
    });
    let with = |effort| move |seed| fitted(foliage, &settings(seed, effort));
    let row = report.row(name, foliage.triangle_count(), literal);
    row.push("default, one thread", measure(foliage, &seen, |seed| one.install(|| with(Effort::Default)(seed))));
    row.push("default", measure(foliage, &seen, with(Effort::Default)));
    row.push("final", measure(foliage, &seen, with(Effort::Final)));
    row.push(
        "whole leaves",
        measure(foliage, &seen, |seed| {
            fitted(foliage, &FitSettings { whole_leaves: true, ..settings(seed, Effort::Default) })
        }),
    );
    row.push(
        "gather 4",
        measure(foliage, &seen, |seed| {
            fitted(foliage, &FitSettings { gather: 4.0, ..settings(seed, Effort::Default) })
        }),
    );
    let count = literal.billboards.round() as usize;
    row.push(
        "at literal's count, nearest planes",
        measure(foliage, &seen, |seed| {
            let tight = FitSettings { max_billboards: Some(count), extra_error: 0.0, ..settings(seed, Effort::Final) };
            fitted(foliage, &FitSettings { facing: 0.0, ..tight })
        }),
    );
    let (best, seconds) = fitted(foliage, &settings(0, Effort::Best));
    row.best = Some((best.planes.len(), seconds, lower_bound::billboards(foliage, epsilon)));
}

/// Adds the gains and costs of settings that reduce transparent overdraw.
fn transparency(name: &str, foliage: &Foliage, report: &mut Report) {
    let FitSettings { epsilon, candidates, .. } = FitSettings::default();
    let (seen, whole) = (Opacity::of(foliage), Opacity::ignored());
    let planes = common::literal::search(foliage, epsilon, candidates, 0);
    let literal = measure_one(foliage, &captured(foliage, planes, epsilon), &whole);
    let plain = settings(0, Effort::Default);
    let mut add = |what: &str, opacity: &Opacity, settings: &FitSettings| {
        let figure = measure_one(foliage, &fitted(foliage, settings).0, opacity);
        report.transparency(name, what, figure, literal);
    };
    add("rectangles around everything", &whole, &plain);
    add("rectangles around opaque parts", &seen, &plain);
    for gather in [1.0, 2.0, 4.0] {
        add(&format!("gather {gather}"), &seen, &FitSettings { gather, ..plain.clone() });
    }
    for gap in [0.3, 0.1] {
        add(&format!("compact {gap}"), &seen, &FitSettings { compact: Some(gap), ..plain.clone() });
    }
    for size in [0.7, 0.4] {
        add(&format!("max_size {size}"), &seen, &FitSettings { max_size: Some(size), ..plain.clone() });
    }
}

/// Returns a foliage with `count` copies, each slightly moved.
fn copies(foliage: &Foliage, count: usize) -> Foliage {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for copy in 0..count {
        let offset = DVec3::new(0.31, 0.17, 0.23) * (copy as f64 * 0.01);
        for t in 0..foliage.triangle_count() {
            let first = positions.len() as u32;
            positions.extend(foliage.corners(t).map(|p| foliage.frame().to_caller(p + offset)));
            triangles.push([first, first + 1, first + 2]);
        }
    }
    let leaves = foliage.leaf_count() as i64;
    let ids =
        (0..count as i64).flat_map(|copy| foliage.leaf_ids().iter().map(move |&leaf| copy * leaves + i64::from(leaf)));
    let attributes = Attributes { leaf_ids: ids.collect(), ..Attributes::default() };
    Foliage::new(&positions, triangles, attributes, vec![]).expect("copies of a foliage are one")
}

fn main() {
    let trees = common::trees();
    let mut report = Report::default();
    for (name, path) in &trees {
        let foliage = gltf::read(path, &gltf::DEFAULT_NAMES).expect("a readable tree");
        if foliage.triangle_count() <= LITERAL_LIMIT {
            eprintln!("{name} …");
            compare(name, &foliage, &mut report);
            transparency(name, &foliage, &mut report);
            if foliage.triangle_count() > LITERAL_LIMIT / 2 {
                report.large(name, foliage.triangle_count(), fitted(&foliage, &settings(0, Effort::Default)));
            }
            continue;
        }
        eprintln!("{name} and {COPIES} copies …");
        for effort in [Effort::Default, Effort::Final] {
            let found = fitted(&foliage, &settings(0, effort));
            report.large(&format!("{name}, {effort:?}"), foliage.triangle_count(), found);
        }
        let many = copies(&foliage, COPIES);
        drop(foliage);
        machine::forget_peak();
        let found = fitted(&many, &settings(0, Effort::Default));
        report.large(&format!("{name} × {COPIES}"), many.triangle_count(), found);
        report.peak_bytes_per_triangle = Some(machine::peak_bytes() as f64 / many.triangle_count() as f64);
    }
    report.roofline = trees
        .iter()
        .find(|(name, _)| name.contains("pine"))
        .map(|(_, path)| machine::roofline(&gltf::read(path, &gltf::DEFAULT_NAMES).expect("a readable tree")));
    report.print();
    report.save();
}
