//! Pages and the judge: how full, how fast. `make bench` prints it as a table in Markdown and writes the figures as JSON to the file that
//! `LEAFCLOUD_BENCH_JSON` names.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use leafcloud::fit::{FitSettings, fit};
use leafcloud::foliage::Opacity;
use leafcloud::judge::{Judge, Views};
use leafcloud::outlines::{OutlineSettings, outlines};
use leafcloud::sheet::{Sheet, SheetSettings};
use leafcloud::textures::{Channels, Drawn, Samples, bake};
use leafcloud::transition::Projection;
use leafcloud::{Progress, gltf};

fn main() {
    for (name, path) in common::trees()
        .into_iter()
        .filter(|(n, _)| std::env::args().nth(1).is_none_or(|w| w.starts_with("--") || n.contains(&w)))
    {
        let foliage = gltf::read(&path, &gltf::DEFAULT_NAMES).expect("a readable tree");
        let cloud = fit(&foliage, &FitSettings::default(), Progress::silent()).unwrap();
        let projection = Projection::new(&foliage, &cloud, 1.25);
        let shape = OutlineSettings { corners: 4 };
        let found = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], &Opacity::of(&foliage), shape);
        let started = Instant::now();
        let sheet = Sheet::pack(&cloud.planes, &found, SheetSettings::of_size(2048, true)).unwrap();
        let packed = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let groups = leafcloud::groups::Groups::by_key(&cloud.parents, cloud.planes.len());
        let channels = Channels { normal: Some(0.0), ..Channels::default() };
        let page = bake(&sheet, Samples::default(), &channels, |p| {
            groups
                .get(p as usize)
                .iter()
                .map(|&t| {
                    let t = t as usize;
                    Drawn {
                        foliage: &foliage,
                        triangle: t,
                        targets: projection.targets[t],
                        corners: foliage.corners(t),
                    }
                })
                .collect()
        });
        let baked = started.elapsed().as_secs_f64();
        let covered =
            page.base_color.pixels().iter().filter(|p| p[3] > 0).count() as f64 / page.base_color.pixels().len() as f64;
        let started = Instant::now();
        let views = Views { count: 12, size: 64, samples: Samples::default(), turn: 0.0 };
        let judge = Judge::new(&[&foliage], foliage.frame(), views).unwrap();
        let base = started.elapsed().as_secs_f64();
        let _ = judge.judge(&foliage);
        let judged = started.elapsed().as_secs_f64();
        println!(
            "{name}: {} planes, pack {packed:.3} s, occupancy {:.3}, covered {covered:.3}, bake {baked:.3} s, judge {base:.3} {judged:.3}",
            cloud.planes.len(),
            sheet.occupancy()
        );
    }
}
