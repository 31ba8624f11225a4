//! Prints what simplified and pruned leaves save: `cargo run --release -p leafcloud-simplify --example leaves TREE.glb …`. A table in
//! Markdown: bound, share of leaves, triangles, the size of the crown in pixels up to which FLIP stays below the target, and the cost of
//! drawing at 128 and 32 pixels in shares of the leaves'.

use std::path::Path;

use glam::DVec3;
use leafcloud::lod::prune_trends::growth;
use leafcloud::metrics::{Reference, Views, drawing_cost};
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress, gltf, prune};
use leafcloud_flip::{ImageErrors, crown_pixels};
use leafcloud_simplify::simplified_leaves;

const TARGET: f64 = 0.06;

fn main() {
    println!("| tree | bound | leaves | triangles | size | cost at 128, 32 | seconds |");
    println!("|---|---|---|---|---|---|---|");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    for tree in std::env::args().skip(1) {
        let foliage = gltf::read(Path::new(&tree), &names).expect("a glTF file with leaves");
        let views = Views { count: 3, size: 256, samples: Samples::new(2).expect("two"), up: DVec3::Z, turn: 0.25 };
        let pictures = Reference::new(&[&foliage], foliage.frame(), views).expect("views of leaves");
        let cost = |leaves: &Foliage, pixels: f64| {
            drawing_cost(&[leaves], 0.5 * pixels / foliage.frame().radius, DVec3::Z, Progress::silent())
                .expect("cost")
                .total()
        };
        for bound in [0.0, 0.004, 0.008, 0.016, 0.032] {
            let begin = std::time::Instant::now();
            let simpler = simplified_leaves(&foliage, bound, Progress::silent()).expect("leaves");
            let seconds = begin.elapsed().as_secs_f64();
            if simpler.is_none() && bound > 0.0 {
                continue;
            }
            let leaves = simpler.map_or_else(|| foliage.clone(), |found| found.foliage);
            let ranks = prune::order(&leaves, &[], 0);
            let trend = growth(&leaves, &ranks, DVec3::Z, Progress::silent()).expect("growth");
            for keep in [1.0, 0.5, 0.25] {
                let pruned = prune::pruned(&leaves, &ranks, keep, trend.factor(keep)).expect("leaves");
                let errors = ImageErrors::of(&pictures.compare(&[&pruned.foliage]).expect("pictures"));
                let ratio = |pixels: f64| cost(&pruned.foliage, pixels) / cost(&foliage, pixels);
                println!(
                    "| {} | {bound} | {keep} | {} | {:.0} | {:.2}, {:.2} | {seconds:.2} |",
                    Path::new(&tree).file_stem().unwrap_or_default().display(),
                    pruned.foliage.triangle_count(),
                    errors.largest_size(TARGET).map_or(0.0, crown_pixels),
                    ratio(128.0),
                    ratio(32.0),
                );
            }
        }
    }
}
