//! Effect of pruning on a crown: its coverage, and the variation of its pixels. `make bench` prints tables in Markdown.

#[path = "../../tests/common/mod.rs"]
mod common;

use glam::{DVec3, Vec3, Vec4};
use leafcloud::Progress;
use leafcloud::foliage::{Foliage, Image, Material, Opacity};
use leafcloud::gltf;
use leafcloud::lod::{PruneSettings, prune_trends};
use leafcloud::metrics::{LeafSamples, Reference, View, Views, render, visibility};
use leafcloud::prune::{leaf_scale, order, pruned, toward_mean};
use leafcloud::textures::Samples;
use leafcloud::transition::leaf_pivots;

const SEEDS: u64 = 5;
const KEEPS: [f64; 7] = [0.97, 0.7, 0.4, 0.2, 0.1, 0.05, 0.02];
const SIZE: usize = 128;
/// Most triangles of a measured tree.
const LIMIT: usize = 200_000;
/// λ at which pixels are compared.
const KEEP: f64 = 0.1;

/// Returns views that differ from the views for measuring growth.
fn views() -> Views {
    Views { count: 8, size: SIZE, samples: Samples::default(), up: DVec3::Z, turn: 0.5 }
}

fn reference(foliage: &Foliage, views: Views) -> Reference {
    Reference::new(&[foliage], foliage.frame(), views).expect("pictures have pixels")
}

/// Prunes the leaves and scales them by r/λ, as Gomez does.
fn linearly(foliage: &Foliage, ranks: &[f32], keep: f64) -> Foliage {
    let pivots = leaf_pivots(foliage);
    let leaf = |t: u32| foliage.leaf_ids()[t as usize] as usize;
    let scale = |t: u32| leaf_scale(f64::from(ranks[leaf(t)]), keep) / keep;
    let triangles: Vec<u32> = (0..foliage.triangle_count() as u32).filter(|&t| scale(t) > 0.0).collect();
    let grown = |&t: &u32| foliage.corners(t as usize).map(|p| pivots[leaf(t)] + (p - pivots[leaf(t)]) * scale(t));
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(grown).collect();
    foliage.part(&triangles, &corners).expect("leaves with an area")
}

/// Returns the coverage over that of all leaves for each λ: with area scale and measured growth, with area scale alone, with linear scale.
/// Returns the visible share of each leaf.
fn shares(foliage: &Foliage) -> Vec<f64> {
    let leaves = visibility(foliage, &Opacity::of(foliage), DVec3::Z, 16, Progress::silent()).expect("pixels");
    leaves.iter().map(LeafSamples::share).collect()
}

fn coverages(foliage: &Foliage) -> [Vec<f64>; 3] {
    let reference = reference(foliage, views());
    let seen = |foliage: &Foliage| reference.agreement(foliage).expect("pixels").coverage / SEEDS as f64;
    let mut means = [const { Vec::new() }; 3].map(|_: Vec<f64>| vec![0.0; KEEPS.len()]);
    let visible = shares(foliage);
    for seed in 0..SEEDS {
        let ranks = order(foliage, &visible, seed);
        let growth = prune_trends::growth(foliage, &ranks, DVec3::Z, Progress::silent()).expect("pixels");
        for (i, &keep) in KEEPS.iter().enumerate() {
            let by_area = |growth: f64| pruned(foliage, &ranks, keep, growth).expect("leaves are left").foliage;
            means[0][i] += seen(&by_area(growth.factor(keep)));
            means[1][i] += seen(&by_area(1.0));
            means[2][i] += seen(&linearly(foliage, &ranks, keep));
        }
    }
    means
}

fn linear(code: u8) -> f64 {
    let x = f64::from(code) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Returns the mean color and the standard deviation of the luminance, both linear, of pixels covered by more than half.
fn colors(foliage: &Foliage, frame: &Foliage, size: usize) -> (Vec3, f64) {
    let Views { samples, up, .. } = views();
    let picture = |i: usize| {
        let angle = i as f64 * 2.4;
        let direction = DVec3::new(angle.cos(), angle.sin(), 0.3);
        let view =
            View { direction, up, centre: frame.frame().centre, radius: frame.frame().radius * 1.025, size, samples };
        render(&[foliage], &view).expect("pixels")
    };
    let pictures: Vec<Image> = (0..8).map(picture).collect();
    let covered = pictures.iter().flat_map(Image::pixels).filter(|p| p[3] > 127);
    let seen: Vec<[f64; 3]> = covered.map(|&[r, g, b, _]| [r, g, b].map(linear)).collect();
    let mean = |channel: usize| seen.iter().map(|c| c[channel]).sum::<f64>() / seen.len() as f64;
    let luminance = |[r, g, b]: [f64; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let means = [0, 1, 2].map(mean);
    let middle = luminance(means);
    let variance = seen.iter().map(|&c| (luminance(c) - middle).powi(2)).sum::<f64>() / seen.len() as f64;
    (Vec3::from_array(means.map(|m| m as f32)), variance.sqrt())
}

/// Returns the same leaves with their colors pulled toward a mean.
fn pulled(foliage: &Foliage, mean: Vec3, contrast: f64) -> Foliage {
    let code = |x: f32| {
        let x = if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
    };
    let toward = |color: Vec3| toward_mean(color, mean, contrast as f32);
    foliage.with_materials(|material| {
        let factor = material.base_color.truncate();
        let image = material.image.as_ref().map(|image| {
            image.mapped(|[r, g, b, a]| {
                let color = Vec3::from_array([r, g, b].map(|c| linear(c) as f32)) * factor;
                let [r, g, b] = toward(color).to_array().map(code);
                [r, g, b, a]
            })
        });
        let plain = if image.is_some() { Vec3::ONE } else { toward(factor) };
        let base_color: Vec4 = plain.extend(material.base_color.w);
        Material { image, base_color, ..material.clone() }
    })
}

fn row(name: &str, values: &[f64]) {
    println!("| {name} | {} |", values.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(" | "));
}

fn main() {
    let trees: Vec<(String, Foliage)> = common::trees()
        .into_iter()
        .map(|(name, path)| (name, gltf::read(&path, &gltf::DEFAULT_NAMES).expect("a tree")))
        .filter(|(_, foliage)| foliage.triangle_count() <= LIMIT)
        .collect();
    println!("Coverage of pruned leaves over that of all leaves, mean of {SEEDS} seeds:\n");
    println!("| λ | {} |", KEEPS.map(|keep| keep.to_string()).join(" | "));
    println!("|---|{}", "---|".repeat(KEEPS.len()));
    for (name, foliage) in &trees {
        let [fitted, by_area, linear] = coverages(foliage);
        row(name, &fitted);
        row("by area alone", &by_area);
        row("linear", &linear);
    }
    println!(
        "\nStandard deviation of the pixels' luminance at λ = {KEEP} over that of all leaves, at the distance of that λ, mean of \
         {SEEDS} seeds:\n"
    );
    println!("| | pixels across | κ | contrast corrected | uncorrected |\n|---|---|---|---|---|");
    for (name, foliage) in &trees {
        let settings = PruneSettings { keep: 1.0, leaf_pixels: 16.0, half: 0.5, contrast: true };
        let size = settings.crown_pixels(foliage, KEEP);
        let (mean, all) = colors(foliage, foliage, size);
        if all < 1e-3 {
            println!("| {name} | {size} | | its leaves have one color | |");
            continue;
        }
        let seen = shares(foliage);
        let found: Vec<[f64; 3]> = (0..SEEDS)
            .map(|seed| {
                let ranks = order(foliage, &seen, seed);
                let growth = prune_trends::growth(foliage, &ranks, DVec3::Z, Progress::silent()).expect("pixels");
                let trend = prune_trends::contrast(foliage, &ranks, growth, &settings, DVec3::Z, Progress::silent())
                    .expect("pixels");
                let kappa = trend.factor(KEEP).min(1.0);
                let pruned = pruned(foliage, &ranks, KEEP, growth.factor(KEEP)).expect("leaves are left").foliage;
                [
                    kappa,
                    colors(&pulled(&pruned, mean, kappa), foliage, size).1 / all,
                    colors(&pruned, foliage, size).1 / all,
                ]
            })
            .collect();
        let [kappa, kept, plain] = [0, 1, 2].map(|i| found.iter().map(|f| f[i]).sum::<f64>() / SEEDS as f64);
        println!("| {name} | {size} | {kappa:.2} | {kept:.3} | {plain:.3} |");
    }
}
