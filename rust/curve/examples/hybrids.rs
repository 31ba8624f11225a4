//! Measures hybrids of meshes and billboards as level 1: `cargo run --release -p leafcloud-curve --example hybrids TREE.glb …`.
//!
//! The leaves that billboards change most for each triangle stay meshes, all others are fitted again. Prints a table in Markdown: ε, the
//! share of leaves that stay meshes, billboards, triangles of the meshes, the size of the crown in pixels up to which FLIP stays below the
//! target, and the cost of drawing the tree at all distances in shares of that of the leaves alone. The last row of a tree is of simplified
//! leaves alone, at all distances.

use std::path::Path;

use glam::DVec3;
use leafcloud::fit::FitSettings;
use leafcloud::lod::{ChainSettings, Drafts};
use leafcloud::metrics::{Reference, Views, drawing_cost};
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress, gltf};
use leafcloud_flip::{ImageErrors, crown_pixels};
use leafcloud_simplify::simplified_leaves;

const TARGET: f64 = 0.06;
const EPSILONS: [f64; 5] = [0.028, 0.04, 0.056, 0.08, 0.11];
const SHARES: [f64; 6] = [0.0, 0.02, 0.05, 0.1, 0.2, 0.4];

/// Bound of simplified leaves in R.
const BOUND: f64 = 0.008;

/// Octaves of sizes: the smallest diameter of the crown in pixels, and the number.
const FARTHEST: f64 = 8.0;
const OCTAVES: i32 = 6;

fn main() {
    println!("| tree | ε, meshes | billboards | triangles | size | cost |");
    println!("|---|---|---|---|---|---|");
    let names = gltf::DEFAULT_NAMES.map(str::to_owned);
    for tree in std::env::args().skip(1) {
        let leaves = gltf::read(Path::new(&tree), &names).expect("a glTF file with leaves");
        let simpler = simplified_leaves(&leaves, BOUND, Progress::silent()).expect("leaves");
        let finest = simpler.map_or_else(|| leaves.clone(), |found| found.foliage);
        let name = Path::new(&tree).file_stem().unwrap_or_default().display().to_string();
        let tree = Tree::new(&leaves, &finest);
        for hybrid in EPSILONS.iter().flat_map(|&epsilon| tree.hybrids(epsilon)) {
            println!("| {name} | {}", hybrid.row());
        }
        println!("| {name} | all | 0 | {} | – | {:.3} |", finest.triangle_count(), tree.cost(f64::INFINITY, &finest));
    }
}

/// A level with meshes and billboards.
struct Hybrid {
    epsilon: f64,
    meshes: f64,
    billboards: usize,
    triangles: usize,
    size: f64,
    cost: f64,
}

impl Hybrid {
    fn row(&self) -> String {
        let Self { epsilon, meshes, billboards, triangles, size, cost } = self;
        format!("{epsilon}, {meshes} | {billboards} | {triangles} | {size:.0} | {cost:.3} |")
    }
}

struct Tree<'a> {
    leaves: &'a Foliage,
    finest: &'a Foliage,
    pictures: Reference,
    whole: Vec<f64>,
}

impl<'a> Tree<'a> {
    fn new(leaves: &'a Foliage, finest: &'a Foliage) -> Self {
        let views = Views { count: 3, size: 256, samples: Samples::new(2).expect("two"), up: DVec3::Z, turn: 0.25 };
        let pictures = Reference::new(&[leaves], leaves.frame(), views).expect("views of leaves");
        let mut tree = Self { leaves, finest, pictures, whole: Vec::new() };
        tree.whole = tree.costs(leaves);
        tree
    }

    fn costs(&self, shown: &Foliage) -> Vec<f64> {
        let radius = self.leaves.frame().radius;
        let cost = |pixels: f64| drawing_cost(&[shown], pixels / radius, DVec3::Z, Progress::silent()).expect("cost");
        middles().map(|pixels| cost(pixels).total()).collect()
    }

    /// Returns the cost of the leaves above `size` pixels and of `shown` below, as [`Self::share_of_all`].
    fn cost(&self, size: f64, shown: &Foliage) -> f64 {
        self.share_of_all(size, &self.costs(shown))
    }

    /// Returns the cost of the leaves above `size` pixels and the level below, in shares of the leaves' at all sizes.
    fn share_of_all(&self, size: f64, level: &[f64]) -> f64 {
        let octave = |(middle, (leaves, level)): (f64, (&f64, &f64))| {
            let share = ((size / (2.0 * middle)).log2() + 0.5).clamp(0.0, 1.0);
            share * level + (1.0 - share) * leaves
        };
        let sum: f64 = middles().zip(self.whole.iter().zip(level)).map(octave).sum();
        sum / self.whole.iter().sum::<f64>()
    }

    fn hybrids(&self, epsilon: f64) -> Vec<Hybrid> {
        let order = self.by_change(epsilon);
        SHARES.iter().map(|&meshes| self.hybrid(epsilon, meshes, &order)).collect()
    }

    /// Returns the leaves, those first that billboards change most for each of their triangles.
    fn by_change(&self, epsilon: f64) -> Vec<u32> {
        let draft = draft(self.finest, epsilon);
        let mut change = vec![(0.0, 0.0); self.finest.leaf_count()];
        for (triangle, &leaf) in self.finest.leaf_ids().iter().enumerate() {
            let [from, to] = [self.finest, &draft.first.collapsed].map(|shown| places(shown, triangle));
            let moved: f64 = from.iter().zip(to).map(|(a, b)| a.distance(b)).sum();
            let sum = &mut change[leaf as usize];
            *sum = (sum.0 + moved * self.finest.area_vector(triangle).length(), sum.1 + 1.0);
        }
        let mut order: Vec<u32> = (0..change.len() as u32).collect();
        let value = |leaf: u32| change[leaf as usize].0 / change[leaf as usize].1;
        order.sort_by(|&a, &b| value(b).total_cmp(&value(a)));
        order
    }

    fn hybrid(&self, epsilon: f64, meshes: f64, order: &[u32]) -> Hybrid {
        let count = (meshes * order.len() as f64).round() as usize;
        let mut is_mesh = vec![false; order.len()];
        order[..count].iter().for_each(|&leaf| is_mesh[leaf as usize] = true);
        let of = |mesh: bool| -> Vec<u32> {
            let leaf_ids = self.finest.leaf_ids();
            (0..leaf_ids.len() as u32).filter(|&t| is_mesh[leaf_ids[t as usize] as usize] == mesh).collect()
        };
        let (kept, rest) = (of(true), of(false));
        let part = |triangles: &[u32]| {
            let corners: Vec<[DVec3; 3]> = triangles.iter().map(|&t| self.finest.corners(t as usize)).collect();
            self.finest.part(triangles, &corners).expect("leaves")
        };
        let others = part(&rest);
        let share = others.frame().radius / self.leaves.frame().radius;
        let draft = draft(&others, epsilon / share).first;
        let mut level: Vec<f64> = middles().map(|pixels| draft.cost(pixels * share)).collect();
        if !kept.is_empty() {
            level.iter_mut().zip(self.costs(&part(&kept))).for_each(|(sum, own)| *sum += own);
        }
        let mut corners: Vec<[DVec3; 3]> =
            (0..self.finest.triangle_count()).map(|triangle| self.finest.corners(triangle)).collect();
        for (i, &triangle) in rest.iter().enumerate() {
            corners[triangle as usize] = places(&draft.collapsed, i).map(|p| self.finest.frame().to_local(p));
        }
        let shown = self.finest.with_corners(&corners).expect("leaves");
        let errors = ImageErrors::of(&self.pictures.compare(&[&shown]).expect("pictures"));
        let size = errors.largest_size(TARGET).map_or(0.0, crown_pixels);
        let cost = self.share_of_all(size, &level);
        Hybrid { epsilon, meshes, billboards: draft.billboards(), triangles: kept.len(), size, cost }
    }
}

fn draft(leaves: &Foliage, epsilon: f64) -> Drafts<'_> {
    let fit = FitSettings { epsilon, ..FitSettings::default() };
    let settings = ChainSettings { fit, pixels: 2.0, ..ChainSettings::default() };
    Drafts::new(&settings, leaves, None, Progress::silent()).expect("a fit")
}

fn places(foliage: &Foliage, triangle: usize) -> [DVec3; 3] {
    foliage.corners(triangle).map(|p| foliage.frame().to_caller(p))
}

/// Returns R in pixels in the middle of each octave.
fn middles() -> impl Iterator<Item = f64> {
    (0..OCTAVES).map(|octave| 0.5 * FARTHEST * (f64::from(octave) + 0.5).exp2())
}
