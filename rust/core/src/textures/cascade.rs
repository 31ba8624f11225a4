//! Alpha whose area above the cutoff stays the same on box-filtered mip levels, as an engine makes them from a PNG.
//!
//! A box-filtered mip level is the mean of four texels of the level before. So alpha can be built from the coarsest level that counts down
//! to level 0: each texel hands its alpha to its four children in any proportion, and the coarser levels stay as they are. The proportions
//! follow the children's own coverage, raised to a power. The power is one number per level: 0 copies the parent, larger powers give more
//! detail and less area. It is the largest power at which the level keeps the area of level 0. (A multiplicative cascade; compare the
//! thresholds of Castaño, "Computing Alpha Mipmaps", 2010, which need mip levels of their own in the file.)
//!
//! `docs/bench/three.md` lists the coverage of cross impostors on screen. O(texels) for each area, of which some hundred are measured: for
//! small pages. Known limits: a crown that is one or two texels wide at level [`LEVELS`] cannot keep its area there; shapes at level 0
//! follow those of the coarse levels, so silhouettes are softer than those of the page itself. [`super::plain`] suits a page that is seen
//! at one texel per pixel better.

use crate::foliage::{Image, mask};

use super::plain::{halved, table};

/// Mip levels behind level 0 that keep the area. Both sides of the page are multiples of 2^`LEVELS`.
pub const LEVELS: u32 = 4;

/// Cutoffs that are compared: lower ones leave too little room below the cutoff, higher ones too little above.
const CUTOFFS: [f32; 4] = [0.3, 0.35, 0.4, 0.45];

/// Powers of the coverage that are compared, from copies to more contrast than the coverage has.
const POWERS: usize = 12;
const GREATEST_POWER: f32 = 3.0;

/// Halvings of an interval of powers, or of pivots.
const HALVINGS: usize = 8;

/// The least coverage that counts, so that powers of it are numbers.
const LEAST: f32 = 1e-4;

/// Returns the page with alpha that keeps its area on box-filtered mip levels, and the cutoff to draw it with. `cutoff` is that of the page
/// itself.
///
/// # Panics
/// A side that is no multiple of 2^[`LEVELS`].
#[must_use]
pub fn keeping_area(page: &Image, cutoff: f32) -> (Image, f32) {
    let sides = [page.width(), page.height()];
    assert!(sides.iter().all(|side| side.is_multiple_of(1 << LEVELS)), "sides {sides:?}, multiples of {}", 1 << LEVELS);
    let area = mask::area(&page.alpha(), page.width(), cutoff, 1);
    let first = AlphaGrid { width: page.width(), values: page.alpha().iter().map(|&a| f32::from(a) / 255.0).collect() };
    let truth: Vec<AlphaGrid> = (0..LEVELS).fold(vec![first], |mut levels, _| {
        levels.push(levels[levels.len() - 1].halved());
        levels
    });
    let tried = CUTOFFS.map(|cutoff| {
        let alpha = cascade(&truth, area, cutoff);
        (worst_error(&alpha, page.width(), area, cutoff), alpha, cutoff)
    });
    let [first, others @ ..] = tried;
    let (_, alpha, cutoff) = others.into_iter().fold(first, |best, other| if other.0 < best.0 { other } else { best });
    (page.clone().with_alpha(alpha), cutoff)
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
        self.values.iter().map(|&alpha| crate::color::quantise(alpha)).collect()
    }

    fn area(&self, cutoff: f32) -> f64 {
        mask::area(&self.codes(), self.width, cutoff, 1)
    }
}

/// Returns alpha of level 0, built from the coarsest level of `truth` down.
fn cascade(truth: &[AlphaGrid], area: f64, cutoff: f32) -> Vec<u8> {
    let (coarsest, finer) = truth.split_last().expect("there is a level");
    let pivot = least(0.0, 1.0, |pivot| remapped(coarsest, pivot, cutoff).area(cutoff) <= area);
    let mut level = remapped(coarsest, pivot, cutoff);
    for coverage in finer.iter().rev() {
        let excess = |power: f32| divided(&level, coverage, power).area(cutoff) - area;
        level = divided(&level, coverage, keeping_power(excess));
    }
    level.codes()
}

/// Returns the least value in (`low`, `high`] from which on `holds` is true.
fn least(mut low: f32, mut high: f32, holds: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Returns alpha remapped by two lines through the pivot, which moves to the cutoff.
fn remapped(grid: &AlphaGrid, pivot: f32, cutoff: f32) -> AlphaGrid {
    let table = table(pivot, cutoff);
    let codes = grid.codes().into_iter();
    AlphaGrid { width: grid.width, values: codes.map(|code| f32::from(table[code as usize]) / 255.0).collect() }
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
    least(power(step - 1), power(step), |power| (excess(power) > 0.0) != dense_first)
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

/// Returns the greatest error of the area over levels 0 to [`LEVELS`], as a share of `area`.
fn worst_error(alpha: &[u8], width: usize, area: f64, cutoff: f32) -> f64 {
    let (mut alpha, mut width) = (alpha.to_vec(), width);
    let mut worst = 0.0f64;
    for _ in 0..=LEVELS {
        worst = worst.max((mask::area(&alpha, width, cutoff, 1) / area.max(1e-9) - 1.0).abs());
        (alpha, width) = halved(&alpha, width);
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::textures::mips;

    const SIDE: usize = 128;

    fn page(alpha: impl Fn(usize, usize) -> u8) -> Image {
        let pixels: Vec<[u8; 4]> = (0..SIDE * SIDE).map(|i| [30, 90, 20, alpha(i % SIDE, i / SIDE)]).collect();
        Image::new(SIDE, SIDE, pixels).unwrap()
    }

    /// Returns the area above the cutoff on the mip levels that an engine makes.
    fn areas(image: &Image, cutoff: f32) -> Vec<f64> {
        let area = |level: &Image| mask::area(&level.alpha(), level.width(), cutoff, 1);
        mips::means(image).iter().take(LEVELS as usize + 1).map(area).collect()
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
    fn crowns_keep_their_area_on_all_levels() {
        for share in [0.3, 0.6, 0.9] {
            let page = crown(share);
            let own = areas(&page, 0.2)[0];
            let worst = |areas: &[f64]| areas.iter().map(|area| (area / own - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst(&areas(&page, 0.2)) > 0.1, "box filtering changes the area: {:?}", areas(&page, 0.2));
            let (kept, cutoff) = keeping_area(&page, 0.2);
            assert!(worst(&areas(&kept, cutoff)) < 0.06, "{share}: {own} {:?}", areas(&kept, cutoff));
        }
    }

    #[test]
    fn opaque_and_empty_pages_stay() {
        for code in [0, 255] {
            let page = page(|_, _| code);
            assert_eq!(keeping_area(&page, 0.5).0, page);
        }
    }

    #[test]
    fn colors_stay() {
        let page = crown(0.5);
        let (kept, _) = keeping_area(&page, 0.3);
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
