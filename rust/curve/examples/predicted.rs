//! Compares predicted with measured seconds and errors: `cargo run --release -p leafcloud-curve --example predicted TREE.glb …`. Prints a
//! table in Markdown. With `LEAFCLOUD_STAGES` set, it also prints each stage.

use std::path::Path;
use std::time::Instant;

use leafcloud::lod::ChainSettings;
use leafcloud::{Progress, gltf};
use leafcloud_curve::{Choice, Model, Sweep, measure, sweep};

fn main() {
    println!(
        "| tree | quick curve, s | ε, page, samples | seconds: predicted, measured | off | error: predicted, measured | off |"
    );
    println!("|---|---|---|---|---|---|---|");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    let (mut within, mut all) = (0, 0);
    for tree in std::env::args().skip(1) {
        let foliage = gltf::read(Path::new(&tree), &names).expect("a glTF file with leaves");
        let asked = ChainSettings::default();
        let started = Instant::now();
        let curve = sweep(&foliage, None, &asked, Sweep::Quick, Progress::silent()).expect("leaves have a curve");
        let quick = started.elapsed().as_secs_f64();
        if std::env::var_os("LEAFCLOUD_STAGES").is_some() {
            for point in &curve.points {
                eprintln!("{:?}\n  {:?} {}", point.choice, point.seconds, point.image_error);
            }
        }
        let model = Model::new(&curve);
        for (epsilon, texture_size, samples) in [(0.04, 2048, 4), (0.08, 1024, 2), (0.03, 1024, 4)] {
            let choice = Choice { epsilon, texture_size, samples, ..Choice::of(&asked) };
            let told = model.predict(&choice);
            let settings = choice.applied(&asked).expect("samples within their range");
            let (_, point) =
                measure(&foliage, None, &settings, Progress::silent()).expect("the settings are within their ranges");
            if std::env::var_os("LEAFCLOUD_STAGES").is_some() {
                for ((stage, told), (_, took)) in model.stages(&choice).named().into_iter().zip(point.seconds.named()) {
                    eprintln!("  {stage}: {told:.2} {took:.2}");
                }
            }
            let (took, error) = (point.seconds.total(), point.image_error);
            let off = |told: f64, found: f64| 100.0 * (told / found - 1.0);
            all += 1;
            within += usize::from(off(told.seconds, took).abs() <= 25.0);
            println!(
                "| {} | {quick:.1} | {epsilon}, {texture_size}, {samples} | {:.2}, {took:.2} | {:+.0} % | {:.3}, {error:.3} | {:+.0} % |",
                Path::new(&tree).file_stem().unwrap_or_default().display(),
                told.seconds,
                off(told.seconds, took),
                told.image_error,
                off(told.image_error, error)
            );
            if std::env::var_os("LEAFCLOUD_STAGES").is_some() {
                eprintln!("measured {:?}\npredicted {:?}", point.seconds, model.stages(&choice));
            }
        }
    }
    println!("\n{within} of {all} within 25 %");
}
