//! Compares drafts with the levels that they stand for: `cargo run --release -p leafcloud-curve --example drafts TREE.glb …`. Prints a table
//! in Markdown: the image error at 128 pixels, and the size of the crown in pixels where the level may take over.

use std::path::Path;

use leafcloud::fit::FitSettings;
use leafcloud::lod::{ChainSettings, Drafts, build_chain};
use leafcloud::metrics::{Comparison, Reference, Views};
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress, gltf};
use leafcloud_flip::{ImageErrors, crown_pixels, image_error};

const TARGET: f64 = 0.06;

fn main() {
    println!("| tree | ε | billboards of the draft | error: draft, level | size: draft, level |");
    println!("|---|---|---|---|---|");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    for tree in std::env::args().skip(1) {
        let foliage = gltf::read(Path::new(&tree), &names).expect("a glTF file with leaves");
        for epsilon in [0.014, 0.02, 0.028, 0.04, 0.056, 0.08] {
            let fit = FitSettings { epsilon, ..FitSettings::default() };
            let settings = ChainSettings {
                fit,
                pixels: 2.0,
                levels: 1,
                cross: false,
                every_level: true,
                ..ChainSettings::default()
            };
            println!("| {tree} {}", row(&foliage, &settings));
        }
    }
}

fn row(foliage: &Foliage, settings: &ChainSettings) -> String {
    let views = Views { count: 8, size: 256, samples: Samples::new(2).expect("two"), up: settings.up, turn: 0.5 };
    let leaves = Reference::new(&[foliage], foliage.frame(), views).expect("views of leaves");
    let drafts = Drafts::new(settings, foliage, None, Progress::silent()).expect("a fit");
    let drafted = leaves.compare(&[&drafts.first.collapsed]).expect("pictures of a draft");
    let chain = build_chain(foliage, None, settings, Progress::silent()).expect("a chain");
    let built = &chain.levels[0].pictures;
    let size = |pictures: &Comparison| ImageErrors::of(pictures).largest_size(TARGET).map_or(0.0, crown_pixels);
    format!(
        "| {} | {} | {:.3}, {:.3} | {:.0}, {:.0} |",
        settings.fit.epsilon,
        drafts.first.billboards(),
        image_error(&drafted),
        image_error(built),
        size(&drafted),
        size(built)
    )
}
