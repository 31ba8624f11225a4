//! Alpha whose area above the cutoff stays the same on box-filtered mip levels, as an engine makes them from a PNG.
//!
//! A box-filtered mip level is the mean of four texels of the level before. So alpha can be built from the coarsest level that counts down
//! to level 0: each texel hands its alpha to its four children in any proportion, and the coarser levels stay as they are. The proportions
//! follow the children's own coverage, raised to a power. The power is one number per level: 0 copies the parent, larger powers give more
//! detail and less area. It is the largest power at which the level keeps the area of level 0. (A multiplicative cascade; compare the
//! thresholds of Castaño, "Computing Alpha Mipmaps", 2010, which need mip levels of their own in the file.)
//!
//! Which levels count and which cutoff is best depends on the page, so several are tried. A sparse page needs a low cutoff: a texel of a
//! coarse level reaches it then although leaves cover little of it. O(texels) for each area; some thousand areas are measured. The area does
//! not tell how a page looks: pictures decide between the best pages of all cutoffs.
//!
//! `docs/bench/engines.md` lists the coverage on screen. Known limits: on sparse pages of thin leaves one of the first three levels may be
//! two fifths too dense, and the fourth is too thin; shapes at level 0 follow those of the coarser levels, so silhouettes are softer
//! than those of the page itself.

use rayon::prelude::*;

use super::mips::code_at_least;
use super::on_polygons::OnPolygons;
use super::recut::{least, table};
use crate::color::quantise;
use crate::foliage::Image;

/// All combinations are compared: numbers of mip levels behind the first seen one that keep the area, cutoffs, and gains.
const LEVELS: [usize; 2] = [2, 3];
const CUTOFFS: [f32; 4] = [0.08, 0.14, 0.24, 0.4];
const GAINS: [f64; 4] = [1.0, 0.8, 0.6, 1.3];

/// The same for pages of more texels than `MANY`, because time grows with them.
const MANY: usize = 1 << 17;
const CUTOFFS_OF_MANY: [f32; 3] = [0.08, 0.14, 0.24];

/// Factors on the cutoff that are tried once alpha is known.
const NUDGES: [f32; 7] = [1.0, 0.95, 1.05, 0.9, 1.1, 0.85, 1.15];

/// What an error of the area counts on the first seen mip level, halfway to the next, on the next, and so on.
const WEIGHTS: [f64; 7] = [0.8, 1.0, 1.0, 0.9, 0.7, 0.5, 0.3];

/// Error of the area beyond which it counts three times.
const LARGE: f64 = 0.2;

/// Weight of the area that only one of level and page shows.
const ELSEWHERE: f64 = 0.2;

/// Powers of the coverage that are compared, from copies to more contrast than the coverage has.
const POWERS: usize = 6;
const GREATEST_POWER: f32 = 3.0;

/// Halvings of an interval of powers, or of pivots.
const HALVINGS: usize = 6;

/// The least coverage that counts, so that powers of it are numbers.
const LEAST: f32 = 1e-4;

/// How a cascade is made.
#[derive(Clone, Copy)]
struct Recipe {
    /// Mip levels behind level 0 that keep the area.
    levels: usize,
    /// Least alpha that is drawn.
    cutoff: f32,
    /// Factor on the area of the coarsest of these levels: trilinear filters lose some between levels.
    gain: f64,
}

/// Returns the recipes that are tried for a page of so many texels.
fn recipes(texels: usize, first_seen: usize) -> Vec<Recipe> {
    if texels > MANY {
        return CUTOFFS_OF_MANY
            .map(|cutoff| Recipe { levels: LEVELS[1] + first_seen, cutoff, gain: GAINS[1] })
            .to_vec();
    }
    let with = |levels| CUTOFFS.into_iter().flat_map(move |cutoff| GAINS.map(|gain| Recipe { levels, cutoff, gain }));
    LEVELS.into_iter().flat_map(|levels| with(levels + first_seen)).collect()
}

/// A page that shows the same area of its polygons on all its box-filtered mip levels.
pub struct Kept {
    pub image: Image,
    /// The cutoff to draw it with.
    pub cutoff: f32,
    /// How much its mip levels differ from that area and from the page's shape.
    pub error: f64,
    recipe: Recipe,
}

/// What a page for engines keeps: the share `area` of its polygons.
pub struct Keeping<'a> {
    pub page: &'a Image,
    /// The alpha cutoff of `page`, and the number of the first mip level with texels as large as pixels.
    pub seen: (f32, usize),
    pub polygons: &'a OnPolygons,
}

impl Keeping<'_> {
    /// Returns the best page of each cutoff that is tried, the best of all first.
    #[must_use]
    pub fn best_of_cutoffs(&self, area: f64) -> Vec<Kept> {
        let recipes = recipes(self.page.pixels().len(), self.seen.1).into_par_iter();
        let mut tried: Vec<Kept> = recipes.map(|recipe| self.tried(area, recipe)).collect();
        tried.sort_by(|one, other| one.error.total_cmp(&other.error));
        let mut best: Vec<Kept> = Vec::new();
        for kept in tried {
            if best.iter().all(|better| better.recipe.cutoff.to_bits() != kept.recipe.cutoff.to_bits()) {
                best.push(kept);
            }
        }
        best
    }

    /// Returns a page that shows another area, made as `kept`.
    #[must_use]
    pub fn with_area(&self, area: f64, kept: &Kept) -> Kept {
        self.tried(area, kept.recipe)
    }

    fn tried(&self, area: f64, recipe: Recipe) -> Kept {
        let own = Own::new(self.page, self.polygons, area, recipe.levels);
        let alpha = own.cascade(recipe);
        let cutoffs = NUDGES.map(|nudge| nudge * recipe.cutoff);
        let errors = own.errors(&alpha, cutoffs.map(code_at_least), self.seen);
        let best = (0..NUDGES.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
        let image = self.page.clone().with_alpha(alpha);
        Kept { image, cutoff: cutoffs[best], error: errors[best], recipe }
    }
}

/// Alpha in [0, 1], rows from the top.
#[derive(Clone)]
struct AlphaGrid {
    width: usize,
    values: Vec<f32>,
}

impl AlphaGrid {
    /// Returns the sum of each block of 2 × 2.
    fn block_sums(&self) -> Vec<f32> {
        let (columns, rows) = (self.width / 2, self.values.len() / self.width / 2);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let sum = |x: usize, y: usize| at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1);
        (0..rows).flat_map(|y| (0..columns).map(move |x| sum(2 * x, 2 * y))).collect()
    }

    fn halved(&self) -> Self {
        Self { width: self.width / 2, values: self.block_sums().into_iter().map(|sum| sum / 4.0).collect() }
    }

    /// Returns the index of a value's block of 2 × 2.
    fn block(&self, index: usize) -> usize {
        index / self.width / 2 * (self.width / 2) + index % self.width / 2
    }

    fn codes(&self) -> Vec<u8> {
        self.values.iter().map(|&alpha| quantise(alpha)).collect()
    }
}

/// A page's own alpha on its mip levels, and the share of its polygons that is to show.
struct Own<'a> {
    levels: Vec<AlphaGrid>,
    polygons: &'a OnPolygons,
    area: f64,
}

impl<'a> Own<'a> {
    /// `most`: mip levels behind level 0; fewer for a page with a side that is no multiple of 2^`most`.
    fn new(page: &Image, polygons: &'a OnPolygons, area: f64, most: usize) -> Self {
        let halvings = page.width().trailing_zeros().min(page.height().trailing_zeros()) as usize;
        let values = page.alpha().iter().map(|&alpha| f32::from(alpha) / 255.0).collect();
        let first = AlphaGrid { width: page.width(), values };
        let levels = std::iter::successors(Some(first), |level| Some(level.halved()));
        Self { levels: levels.take(halvings.min(most) + 1).collect(), polygons, area }
    }

    /// Returns alpha of level 0, built from the coarsest level down.
    fn cascade(&self, Recipe { cutoff, gain, .. }: Recipe) -> Vec<u8> {
        let excess = |level: &AlphaGrid, number: usize| {
            let share = number as f64 / (self.levels.len() - 1).max(1) as f64;
            let shown = self.polygons.share(&level.codes(), level.width, code_at_least(cutoff));
            shown - self.area * libm::pow(gain, share)
        };
        let (coarsest, finer) = self.levels.split_last().expect("there is a level");
        let fits = |pivot| excess(&remapped(coarsest, pivot, cutoff), finer.len()) <= 0.0;
        let mut level = remapped(coarsest, least(0.0, 1.0, HALVINGS, fits), cutoff);
        for (number, coverage) in finer.iter().enumerate().rev() {
            let power = keeping_power(|power| excess(&divided(&level, coverage, power), number));
            level = divided(&level, coverage, power);
        }
        level.codes()
    }

    /// Returns for each cutoff the error on the mip levels that an engine makes, and between them: the greatest weighted one of the area, as
    /// a share of the area, plus the area that only one of level and page shows: coarse blocks would keep the area best.
    fn errors<const N: usize>(&self, alpha: &[u8], cutoffs: [u8; N], (own, first_seen): (f32, usize)) -> [f64; N] {
        let (mut fine, mut width) = (alpha.to_vec(), self.levels[0].width);
        for _ in 0..first_seen {
            (fine, width) = halved(&fine, width);
        }
        let page = (&self.levels[0].codes()[..], self.levels[0].width, code_at_least(own));
        let elsewhere = self.polygons.differences(page, (&fine, width), cutoffs);
        let mut shares = vec![self.polygons.shares_slanting(&fine, width, cutoffs)];
        while shares.len() < WEIGHTS.len() {
            let (coarse, half) = halved(&fine, width);
            shares.push(self.polygons.shares_between([(&fine, width), (&coarse, half)], cutoffs));
            shares.push(self.polygons.shares_slanting(&coarse, half, cutoffs));
            (fine, width) = (coarse, half);
        }
        let of_area = |share: f64| share / self.area.max(1e-9);
        std::array::from_fn(|n| {
            let error = |(shares, weight): (&[f64; N], f64)| weight * (of_area(shares[n]) - 1.0).abs();
            let error = shares.iter().zip(WEIGHTS).map(error).fold(0.0, f64::max);
            error + 2.0 * (error - LARGE).max(0.0) + ELSEWHERE * of_area(elsewhere[n])
        })
    }
}

fn halved(alpha: &[u8], width: usize) -> (Vec<u8>, usize) {
    let (columns, rows) = ((width / 2).max(1), (alpha.len() / width / 2).max(1));
    let at = |x: usize, y: usize| u32::from(alpha[y.min(alpha.len() / width - 1) * width + x.min(width - 1)]);
    let mean = |x: usize, y: usize| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4;
    let half = (0..rows).flat_map(|y| (0..columns).map(move |x| mean(2 * x, 2 * y) as u8)).collect();
    (half, columns)
}

/// Returns alpha remapped by two lines through the pivot, which moves to the cutoff. Alpha below the cutoff is then lowered until the mean is
/// that of before: some texels gain alpha, so others must lose it, or finer levels would have too much to divide.
fn remapped(grid: &AlphaGrid, pivot: f32, cutoff: f32) -> AlphaGrid {
    let table = table(pivot, cutoff);
    let values: Vec<f32> = grid.codes().into_iter().map(|code| f32::from(table[code as usize]) / 255.0).collect();
    let sum = |wanted: &dyn Fn(f32) -> bool| values.iter().filter(|&&alpha| wanted(alpha)).sum::<f32>();
    let (passing, failing) = (sum(&|alpha| alpha >= cutoff), sum(&|alpha| alpha < cutoff));
    let lower = ((grid.values.iter().sum::<f32>() - passing) / failing.max(LEAST)).clamp(0.0, 1.0);
    let lowered = |alpha: f32| if alpha < cutoff { alpha * lower } else { alpha };
    AlphaGrid { width: grid.width, values: values.into_iter().map(lowered).collect() }
}

/// Returns the largest power at which `excess` changes its sign, or the power of the least |excess| if the sign never changes.
fn keeping_power(excess: impl Fn(f32) -> f64) -> f32 {
    let power = |step: usize| GREATEST_POWER * step as f32 / POWERS as f32;
    let all: Vec<f64> = (0..=POWERS).map(|step| excess(power(step))).collect();
    let crossing = (1..=POWERS).rev().find(|&step| (all[step] > 0.0) != (all[step - 1] > 0.0));
    let Some(step) = crossing else {
        let least = (0..=POWERS).min_by(|&a, &b| all[a].abs().total_cmp(&all[b].abs()));
        return power(least.unwrap_or(0));
    };
    let dense_first = all[step - 1] > 0.0;
    least(power(step - 1), power(step), HALVINGS, |power| (excess(power) > 0.0) != dense_first)
}

/// Returns the next finer level: each texel's alpha is divided among its four children in proportion to a power of their coverage. Alpha
/// above 1 goes to the other three children, so that the mean stays.
fn divided(parent: &AlphaGrid, coverage: &AlphaGrid, power: f32) -> AlphaGrid {
    let weights = coverage.values.iter().map(|value| libm::powf(value.max(LEAST), power)).collect();
    let weights = AlphaGrid { width: coverage.width, values: weights };
    let sums = weights.block_sums();
    let share = |(i, weight): (usize, &f32)| 4.0 * parent.values[weights.block(i)] * weight / sums[weights.block(i)];
    let mut level = AlphaGrid { width: weights.width, values: weights.values.iter().enumerate().map(share).collect() };
    // Four children: after three rounds nothing is left over.
    for _ in 0..3 {
        let over = AlphaGrid { width: level.width, values: level.values.iter().map(|v| (v - 1.0).max(0.0)).collect() };
        let room = AlphaGrid { width: level.width, values: level.values.iter().map(|v| (1.0 - v).max(0.0)).collect() };
        let (left, free) = (over.block_sums(), room.block_sums());
        for i in 0..level.values.len() {
            let block = level.block(i);
            let part = if free[block] > 0.0 { (left[block] / free[block]).min(1.0) } else { 0.0 };
            level.values[i] = level.values[i].min(1.0) + part * room.values[i];
        }
    }
    level
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::mask;
    use crate::textures::mips;

    const SIDE: usize = 128;

    fn page(alpha: impl Fn(usize, usize) -> u8) -> Image {
        let pixels: Vec<[u8; 4]> = (0..SIDE * SIDE).map(|i| [30, 90, 20, alpha(i % SIDE, i / SIDE)]).collect();
        Image::new(SIDE, SIDE, pixels).unwrap()
    }

    /// Returns the area above the cutoff on the mip levels that an engine makes.
    fn areas(image: &Image, cutoff: f32) -> Vec<f64> {
        let area = |level: &Image| mask::area(&level.alpha(), level.width(), cutoff, 1);
        mips::means(image).iter().take(4).map(area).collect()
    }

    /// Keeps the area that a page with polygons everywhere shows at a cutoff.
    fn kept(page: &Image, cutoff: f32) -> (Image, f32) {
        let polygons = OnPolygons::new(&vec![1.0; SIDE * SIDE], SIDE, 1 << 14);
        let keeping = Keeping { page, seen: (cutoff, 0), polygons: &polygons };
        let Kept { image, cutoff, .. } =
            keeping.best_of_cutoffs(mask::area(&page.alpha(), SIDE, cutoff, 1)).swap_remove(0);
        (image, cutoff)
    }

    /// A crown: randomly covered texels, fewer toward the rim of a disc.
    fn crown(share: f64) -> Image {
        page(|x, y| {
            let from_center = (x as f64 - 63.5).hypot(y as f64 - 63.5) / 56.0;
            let chance = (x * 7919 + y * 104_729 + x * y * 31) % 997;
            let covered = share * (1.0 - from_center * from_center).max(0.0);
            if (chance as f64) < 997.0 * covered { 255 } else { (180.0 * covered) as u8 }
        })
    }

    #[test]
    fn crowns_keep_their_area() {
        for share in [0.3, 0.6, 0.9] {
            let page = crown(share);
            let own = areas(&page, 0.2)[0];
            let worst = |areas: &[f64]| areas.iter().map(|area| (area / own - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst(&areas(&page, 0.2)) > 0.08, "box filtering changes the area: {:?}", areas(&page, 0.2));
            let (kept, cutoff) = kept(&page, 0.2);
            assert!(worst(&areas(&kept, cutoff)) < 0.08, "{share}: {own} {:?}", areas(&kept, cutoff));
        }
    }

    #[test]
    fn needles_keep_their_area() {
        // Needles two texels wide with soft edges, in three directions, on a sixth of the page.
        let soft = |at: usize| [0u8, 110, 255, 200, 90, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0][at % 22];
        let page = page(|x, y| soft(x).max(soft(y + x)).max(if x.is_multiple_of(3) { soft(y) } else { 0 }));
        let own = areas(&page, 0.5)[0];
        assert!(areas(&page, 0.5)[2] < 0.6 * own, "box filtering loses much: {:?}", areas(&page, 0.5));
        let (kept, cutoff) = kept(&page, 0.5);
        let found = areas(&kept, cutoff);
        assert!(found[..3].iter().all(|area| (area / own - 1.0).abs() < 0.1), "{own} {found:?}");
    }

    #[test]
    fn opaque_and_empty_pages_stay() {
        for code in [0, 255] {
            let page = page(|_, _| code);
            assert!(kept(&page, 0.5).0 == page, "{code}");
        }
    }

    #[test]
    fn colors_stay() {
        let page = crown(0.5);
        let (kept, _) = kept(&page, 0.3);
        assert!(kept.pixels().iter().zip(page.pixels()).all(|(a, b)| a[..3] == b[..3]));
    }

    #[test]
    fn children_have_the_mean_of_their_parent() {
        let parent = AlphaGrid { width: 2, values: vec![0.2, 0.5, 0.9, 1.0] };
        let coverage = (0..16).map(|i| (i * 5 % 16) as f32 / 15.0).collect();
        let coverage = AlphaGrid { width: 4, values: coverage };
        for power in [0.0, 1.0, 3.0] {
            let children = divided(&parent, &coverage, power);
            assert!(children.values.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
            for (mean, alpha) in children.halved().values.iter().zip(&parent.values) {
                assert!((mean - alpha).abs() < 1e-5, "power {power}: {mean} for {alpha}");
            }
        }
    }
}
