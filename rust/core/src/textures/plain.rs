//! Alpha for engines that make box-filtered mip levels themselves, as from a PNG.
//!
//! Box filtering keeps the sum of alpha, not the area above the cutoff: crowns drawn at a cutoff of ½ lose half after two mip levels.
//! Engines draw a level only where its texels are about a pixel or smaller, so its mip levels 0 to 3 count. Alpha is remapped by two lines
//! through a pivot, which moves to a new, lower cutoff. Pivot and cutoff keep the area above the cutoff at mip level 0 and, in the mean, at
//! levels 1 to 3. (Full alpha for all texels above the cutoff does no better and has coarser edges.) Known limit: no cutoff suits all mip
//! levels. The first ones become up to a quarter denser (needles more), the fourth is sparse, and beyond it thin leaves still dissolve.

use crate::foliage::{Image, mask};

/// Lowest cutoff. Below it, the blurred surroundings of a leaf count as leaf.
const LEAST: f32 = 0.1;

/// Mip levels after level 0 that keep the area.
const LEVELS: usize = 3;

/// Halvings in the search for cutoff and pivot, and rows of the page that it measures.
const HALVINGS: usize = 6;
const ROWS: usize = 512;

fn area_of_some(alpha: &[u8], width: usize, cutoff: f32) -> f64 {
    mask::area(alpha, width, cutoff, (alpha.len() / width / ROWS).max(1))
}

/// Returns the page with remapped alpha, and the cutoff to draw it with in place of `cutoff`.
#[must_use]
pub fn for_plain_means(page: &Image, cutoff: f32) -> (Image, f32) {
    let (alpha, width) = (page.alpha(), page.width());
    let area = area_of_some(&alpha, width, cutoff);
    let (mut low, mut high) = (LEAST.min(cutoff), cutoff);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let remapped = remapped(&alpha, width, middle, (cutoff, area));
        if area_of_means(remapped, width, middle) > area {
            low = middle;
        } else {
            high = middle;
        }
    }
    let found = 0.5 * (low + high);
    (page.clone().with_alpha(remapped(&alpha, width, found, (cutoff, area))), found)
}

/// Returns alpha remapped to the new cutoff with the pivot that keeps the area above it. The pivot is the old cutoff or more, because edges
/// grow as the cutoff falls.
fn remapped(alpha: &[u8], width: usize, cutoff: f32, (old, area): (f32, f64)) -> Vec<u8> {
    let at = |pivot: f32| {
        let table = table(pivot, cutoff);
        alpha.iter().map(|&code| table[code as usize]).collect::<Vec<u8>>()
    };
    let (mut low, mut high) = (old, 0.99f32.max(old));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if area_of_some(&at(middle), width, cutoff) > area {
            low = middle;
        } else {
            high = middle;
        }
    }
    at(0.5 * (low + high))
}

/// Returns the table that maps alpha linearly: 0 to the pivot becomes 0 to `cutoff`, the pivot to 1 becomes `cutoff` to 1.
pub(super) fn table(pivot: f32, cutoff: f32) -> [u8; 256] {
    std::array::from_fn(|code| {
        let alpha = code as f32 / 255.0;
        let moved = if alpha < pivot {
            alpha / pivot * cutoff
        } else {
            cutoff + (alpha - pivot) / (1.0 - pivot).max(1e-3) * (1.0 - cutoff)
        };
        crate::color::quantise(moved)
    })
}

/// Returns the mean area above the cutoff on mip levels 1 to [`LEVELS`].
fn area_of_means(alpha: Vec<u8>, width: usize, cutoff: f32) -> f64 {
    let (mut alpha, mut width) = (alpha, width);
    let mut sum = 0.0;
    for _ in 0..LEVELS {
        (alpha, width) = halved(&alpha, width);
        sum += mask::area(&alpha, width, cutoff, 1);
    }
    sum / LEVELS as f64
}

pub(super) fn halved(alpha: &[u8], width: usize) -> (Vec<u8>, usize) {
    let (columns, rows) = ((width / 2).max(1), (alpha.len() / width / 2).max(1));
    let at = |x: usize, y: usize| u32::from(alpha[y.min(alpha.len() / width - 1) * width + x.min(width - 1)]);
    let mean = |x: usize, y: usize| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4;
    let half = (0..rows).flat_map(|y| (0..columns).map(move |x| mean(2 * x, 2 * y) as u8)).collect();
    (half, columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::textures::mips;

    /// Returns the area above the cutoff over that of level 0, for each box-filtered mip level.
    fn areas(image: &Image, cutoff: f32, whole: f64) -> Vec<f64> {
        let area = |level: &Image| mask::area(&level.alpha(), level.width(), cutoff, 1) / whole;
        mips::means(image).iter().take(4).map(area).collect()
    }

    #[test]
    fn needles_outlast_three_levels() {
        // Needles two texels wide with soft edges, in three directions, on a sixth of the page.
        let soft = |at: usize| [0u8, 110, 255, 200, 90, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0][at % 22];
        let needle = |x: usize, y: usize| soft(x).max(soft(y + x)).max(if x.is_multiple_of(3) { soft(y) } else { 0 });
        let pixels: Vec<[u8; 4]> = (0..256 * 256).map(|i| [30, 90, 20, needle(i % 256, i / 256)]).collect();
        let page = Image::new(256, 256, pixels).unwrap();
        let (engine, cutoff) = for_plain_means(&page, 0.5);
        assert!(cutoff < 0.45, "{cutoff}");
        let whole = mask::area(&page.alpha(), 256, 0.5, 1);
        let (before, after) = (areas(&page, 0.5, whole), areas(&engine, cutoff, whole));
        assert!((after[0] - 1.0).abs() < 0.03, "level 0 keeps its area: {after:?}");
        let mean = |areas: &[f64]| areas[1..].iter().sum::<f64>() / 3.0;
        assert!(mean(&before) < 0.7, "box filtering loses much: {before:?}");
        assert!((mean(&after) - 1.0).abs() < 0.05, "{after:?}");
    }

    #[test]
    fn opaque_and_empty_pages_stay() {
        for code in [0, 255] {
            let page = Image::new(64, 64, vec![[1, 2, 3, code]; 64 * 64]).unwrap();
            let (engine, cutoff) = for_plain_means(&page, 0.5);
            assert!((LEAST..=0.5).contains(&cutoff));
            assert_eq!(engine, page);
        }
    }
}
