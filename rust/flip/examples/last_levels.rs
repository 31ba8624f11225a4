//! Compares candidates for the last level: `cargo run --release -p leafcloud-flip --example last_levels TREE.glb …`. Prints a table in
//! Markdown: the image error in pictures of 8 to 64 pixels, the texture (base color; for octahedral impostors also normals and depth) in KiB
//! without compression, and the cost of drawing by the model of `metrics::drawing_cost` at a crown of 32 pixels. Leaves only, without trunk.

use std::path::Path;

use leafcloud::lod::octahedral::{Octahedral, Shown, Size};
use leafcloud::lod::{ChainSettings, References, build_chain};
use leafcloud::metrics::{Comparison, drawing_cost};
use leafcloud::{Foliage, Progress, gltf};
use leafcloud_flip::ImageErrors;

/// Diameter of the crown in pixels, for the cost.
const CROWN: f64 = 32.0;

fn main() {
    println!("| tree | last level | error at 8, 16, 32, 64 pixels | KiB | cost |");
    println!("|---|---|---|---|---|");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    for tree in std::env::args().skip(1) {
        let path = Path::new(&tree);
        let foliage = gltf::read(path, &names).expect("a glTF file with leaves");
        let name = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        for planes in 2..=5 {
            let settings = ChainSettings { levels: 0, upright_planes: planes, ..ChainSettings::default() };
            println!("| {name} | {planes} + 1 planes | {}", cross(&foliage, &settings));
        }
        let settings = ChainSettings::default();
        let parts = [&foliage];
        let references = References::new(&parts, &parts, foliage.frame(), &settings).expect("pictures");
        let shown = Shown { parts: &parts, simpler: None };
        let found =
            Octahedral::build(shown, Size::default(), &references, &settings, Progress::silent()).expect("an impostor");
        let bytes = found.color.pixels().len() * 8;
        let scale = 0.5 * CROWN / found.frame.radius;
        let cost = found.layout.cost(&found.frame, scale, settings.up).expect("a cost").total();
        println!("| {name} | octahedral | {}", row(&found.pictures, bytes, cost));
    }
}

fn cross(foliage: &Foliage, settings: &ChainSettings) -> String {
    let chain = build_chain(foliage, None, settings, Progress::silent()).expect("a chain");
    let level = &chain.levels[0];
    let shown = level.foliage().expect("billboards");
    let scale = 0.5 * CROWN / level.frame.radius;
    let cost = drawing_cost(&[&shown], scale, settings.up, Progress::silent()).expect("a cost").total();
    row(&level.pictures, level.page.base_color.pixels().len() * 4, cost)
}

fn row(pictures: &Comparison, bytes: usize, cost: f64) -> String {
    let errors = ImageErrors::of(pictures).0;
    let errors: Vec<String> = errors.iter().take(4).map(|(_, error)| format!("{error:.3}")).collect();
    format!("{} | {} | {cost:.0} |", errors.join(", "), bytes / 1024)
}
