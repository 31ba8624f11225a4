use std::path::Path;
use glam::DVec3;
use leafcloud::lod::octahedral::{Octahedral, Size};
use leafcloud::lod::{ChainSettings, References};
use leafcloud::metrics::{Reference, Views, Pictures};
use leafcloud::textures::{Samples, mips};
use leafcloud::{Foliage, Image, Progress, gltf};
use leafcloud_choose::sway::{motion, swayed};
use leafcloud_choose::looks::Looks;
use leafcloud_flip::crown_pixels;

fn halved(i: &Image, side: usize) -> Image { mips::means(i).into_iter().find(|l| l.width() <= side).unwrap() }
fn mean_color(image: &Image) -> [f64; 3] {
    let covered: f64 = image.pixels().iter().map(|p| f64::from(p[3])).sum();
    std::array::from_fn(|i| image.pixels().iter().map(|p| f64::from(p[i]) * f64::from(p[3]) / 255.0).sum::<f64>() / covered)
}
fn show(tag: &str, p: &Pictures, c: &Pictures, side: usize) {
    let (mut f, mut g) = (0.0, 0.0);
    let mut s = String::new();
    for (k, (a, b)) in p.base.iter().zip(p.level.iter()).enumerate() {
        let (a, b, cc) = (halved(a, side), halved(b, side), halved(&c.level[k], side));
        let (x, y) = (mean_color(&a), mean_color(&b));
        let l = Looks::of(&a, &b).unwrap(); let m = Looks::of(&a, &cc).unwrap();
        f += l.flip; g += m.flip;
        s += &format!(" [{:+.3} {:+.3} {:+.3} of {:.2} cov {:.3} con {:.2}]", y[0]-x[0], y[1]-x[1], y[2]-x[2], x[1], l.coverage, l.contrast[0]);
    }
    println!("  {tag} {side} flip {:.2} ({:.3}){s}", f / g, f/4.0);
}
fn main() {
    let texels: usize = std::env::var("TEX").ok().map_or(32, |t| t.parse().unwrap());
    for tree in std::env::args().skip(1) {
        let path = Path::new(&tree);
        let names = gltf::DEFAULT_NAMES.map(str::to_owned);
        let leaves = gltf::read(path, &names).or_else(|_| gltf::read(path, &["leaves".to_owned()])).unwrap();
        let trunk = gltf::read(path, &["stem","bark","trunk","wood"].map(str::to_owned)).ok();
        let parts: Vec<&Foliage> = std::iter::once(&leaves).chain(trunk.as_ref()).collect();
        let settings = ChainSettings::default();
        let mut references = None;
        println!("{}", path.file_stem().unwrap().to_string_lossy());
        let r = references.get_or_insert_with(|| References::new(&parts, &parts, leaves.frame(), &settings).unwrap());
        let o = Octahedral::build(&parts, None, Size { grid: 16, texels }, r, &settings, Progress::silent()).unwrap();
        for side in [64usize, 32, 16] {
            let views = Views { count: 4, size: 2 * side, samples: Samples::new(2).unwrap(), up: settings.up, turn: 0.5 };
            let reference = Reference::lit(&parts, leaves.frame(), views).unwrap();
            let control = swayed(&leaves, motion(crown_pixels(side as f64))).unwrap();
            let mut cs: Vec<&Foliage> = vec![&control]; cs.extend(trunk.as_ref());
            let c = reference.compare(&cs).unwrap();
            let p = o.compare(&reference).unwrap();
            show("flat", &p.flat, &c.flat, side);
            show("lit ", p.lit.as_ref().unwrap(), c.lit.as_ref().unwrap(), side);
        }
    }
    let _ = DVec3::Z;
}
