//! The fit beside literal Algorithm 1, both in one run: `make bench`. Prints a table in Markdown; means over the seeds.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use leafcloud::fit::{FitSettings, fit};
use leafcloud::{Foliage, Progress, gltf};

const SEEDS: std::ops::Range<u64> = 0..5;

/// Literal search on more triangles than this takes minutes.
const LITERAL_LIMIT: usize = 200_000;

/// Billboards and seconds, means over the seeds.
fn measure(run: impl Fn(u64) -> usize) -> (f64, f64) {
    let count = (SEEDS.end - SEEDS.start) as f64;
    let started = Instant::now();
    let billboards: usize = SEEDS.map(run).sum();
    (billboards as f64 / count, started.elapsed().as_secs_f64() / count)
}

fn planes(foliage: &Foliage, seed: u64, whole_leaves: bool) -> usize {
    let settings = FitSettings { seed, whole_leaves, ..FitSettings::default() };
    fit(foliage, &settings, Progress::silent()).expect("the defaults fit any foliage").planes.len()
}

fn main() {
    let trees = common::trees();
    if trees.is_empty() {
        println!("no trees to measure: they are expected in shared/foliage beside the repository");
    }
    println!(
        "| tree | triangles | literal: billboards, s | triangles may part: billboards, s | whole leaves: billboards, s |"
    );
    println!("|---|---|---|---|---|");
    for (name, path) in trees {
        let foliage = gltf::read(&path, &gltf::DEFAULT_NAMES).expect("a readable tree");
        let FitSettings { epsilon, candidates, .. } = FitSettings::default();
        let cell = |(billboards, seconds): (f64, f64)| format!("{billboards:.1}, {seconds:.3}");
        let literal = if foliage.triangle_count() <= LITERAL_LIMIT {
            cell(measure(|seed| common::literal::search(&foliage, epsilon, candidates, seed).len()))
        } else {
            "–".to_owned()
        };
        let parted = cell(measure(|seed| planes(&foliage, seed, false)));
        let whole = cell(measure(|seed| planes(&foliage, seed, true)));
        println!("| {name} | {} | {literal} | {parted} | {whole} |", foliage.triangle_count());
    }
}
