//! Refines level 1 of trees and prints the errors in other views: `cargo run --release -p leafcloud-curve --example refined TREE.glb …`.
use std::path::Path;
use std::time::Instant;

use leafcloud::fit::FitSettings;
use leafcloud::lod::{ChainSettings, Refinement, build_chain};
use leafcloud::metrics::{Comparison, Reference, Views};
use leafcloud::textures::{Samples, mips};
use leafcloud::{Progress, gltf};
use leafcloud_flip::flip;

fn errors(c: &Comparison) -> [f64; 4] {
    let n = c.flat.base.len() as f64;
    let mut e = [0.0; 4];
    for (a, b) in c.flat.base.iter().zip(c.flat.level.iter()) {
        let (a, b) = (mips::means(a), mips::means(b));
        for k in 0..4 { e[k] += flip(&a[k], &b[k]) / n; }
    }
    e
}

fn l1(c: &Comparison) -> [f64; 4] {
    let mut e = [0.0; 4];
    for (a, b) in c.flat.base.iter().zip(c.flat.level.iter()) {
        let (a, b) = (mips::means(a), mips::means(b));
        for k in 0..4 {
            let (mut s, mut n) = (0.0, 0.0);
            for (p, q) in a[k].pixels().iter().zip(b[k].pixels()) {
                if p[3] > 0 || q[3] > 0 {
                    let g = |p: &[u8; 4], i: usize| { let a = f64::from(p[3]) / 255.0; f64::from(p[i]) * a + 127.5 * (1.0 - a) };
                    s += (0..3).map(|i| (g(p, i) - g(q, i)).abs()).sum::<f64>() + (f64::from(p[3]) - f64::from(q[3])).abs();
                    n += 1.0;
                }
            }
            e[k] += s / n / c.flat.base.len() as f64;
        }
    }
    e
}

fn arg<T: std::str::FromStr>(name: &str, default: T) -> T {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

fn main() {
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    let billboards_of = |t: &str| match () { () if t.contains("ash") => 245, () if t.contains("fir") => 56, () if t.contains("maple") => 52, () if t.contains("oak") => 130, () if t.contains("pine") => 104, () => 90 };
    for tree in std::env::args().skip(1) {
        let foliage = gltf::read(Path::new(&tree), &names).expect("leaves");
        let side: usize = arg("PAGE", 2896);
        let fit = FitSettings { max_billboards: Some(billboards_of(&tree)), extra_error: 0.25, ..FitSettings::default() };
        let effort = match arg("EFFORT", 2) { 0 => Refinement::Off, 1 => Refinement::Short, _ => Refinement::Long };
        let mut settings = ChainSettings { fit, levels: 1, cross: false, texture_size: side.into(), fitting_pages: false, tight_pages: false, ..ChainSettings::default() };
        let views = Views { count: 8, size: 256, samples: Samples::new(8).expect("8").unfiltered(), up: settings.up, turn: 0.0 };
        let reference = Reference::new(&[&foliage], foliage.frame(), views).expect("views");
        let other = Reference::new(&[&foliage], foliage.frame(), Views { turn: 0.4, ..views }).expect("views");
        let mut more: Vec<[[f64; 4]; 3]> = Vec::new();
        let mut all = Vec::new();
        let mut times = Vec::new();
        for effort in [Refinement::Off, effort] {
            settings.refine = effort;
            let started = Instant::now();
            let chain = build_chain(&foliage, None, &settings, Progress::silent()).expect("chain");
            times.push(started.elapsed().as_secs_f64());
            let level = &chain.levels[0];
            let c = reference.compare(&level.foliage().expect("f")).expect("pictures");
            all.push(errors(&c));
            let d = other.compare(&level.foliage().expect("f")).expect("pictures");
            more.push([l1(&c), errors(&d), l1(&d)]);
            eprintln!("  tone {:?} {:?} coverage {:.4} {:.4}", c.tone(), d.tone(), c.coverage(), d.coverage());
            if let Some(refined) = &level.refined { eprintln!("  judge {:?} coverage {:.3} cutoff {:.3}", refined.errors, c.coverage(), level.alpha_cutoff); }
        }
        let r: Vec<f64> = (0..4).map(|k| all[1][k] / all[0][k]).collect();
        for (name, i) in [("l1 at 0", 0), ("flip at 0.4", 1), ("l1 at 0.4", 2)] {
            let r: Vec<f64> = (0..4).map(|k| more[1][i][k] / more[0][i][k]).collect();
            println!("  {name} {r:.3?}");
        }
        println!("{tree}: +{:.1} s of {:.1}; {:.4} {:.4} {:.4} {:.4} x {:.3} {:.3} {:.3} {:.3}", times[1] - times[0], times[0], all[0][0], all[0][1], all[0][2], all[0][3], r[0], r[1], r[2], r[3]);
    }
}
