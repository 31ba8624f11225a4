//! Alpha moved to another cutoff, with the same area on the polygons of the page.
//!
//! Two lines through a pivot: alpha from 0 to the pivot becomes 0 to the new cutoff, alpha from there to 1 becomes the new cutoff to 1.
//! Edges have another slope then, and bilinear filtering moves them. So the pivot is the one that keeps the area: within the step of a code.
//! Where alpha goes from 0 to 1 between two texels, no pivot moves the edge. Then alpha becomes smaller in proportion to the cutoffs, which keeps
//! all edges if the new cutoff is the lower one, but spends fewer codes on them.

use super::mips::code_at_least;
use super::parts::{PagePart, apart, together};
use crate::color::quantise;
use crate::foliage::Image;

/// Halvings in the search for the pivot.
const HALVINGS: usize = 8;

/// Most places on the polygons at which alpha is looked up.
const PLACES: usize = 1 << 16;

/// Returns the page with alpha for one cutoff for each part in place of its own.
#[must_use]
pub fn recut(page: &Image, parts: &[PagePart], cutoffs: &[f32]) -> Image {
    let pages = apart(page, parts).into_iter().zip(parts).zip(cutoffs);
    together(pages.map(|((page, part), &cutoff)| recut_part(page, part, cutoff)).collect(), parts, 0)
}

fn recut_part(page: Image, part: &PagePart, cutoff: f32) -> Image {
    let (alpha, width, polygons) = (page.alpha(), page.width(), part.polygons(page.width(), PLACES));
    let area = polygons.share(&alpha, width, code_at_least(part.alpha_cutoff));
    let code = code_at_least(cutoff);
    let mapped = |table: [u8; 256]| alpha.iter().map(|&code| table[code as usize]).collect::<Vec<u8>>();
    let share = |alpha: &[u8]| polygons.share(alpha, width, code);
    let pivot = least(0.0, 1.0, HALVINGS, |pivot| share(&mapped(table(pivot, cutoff))) <= area);
    let [bent, scaled] = [table(pivot, cutoff), scale(cutoff / part.alpha_cutoff)].map(mapped);
    let error = |alpha: &[u8]| (share(alpha) - area).abs();
    let kept = if error(&bent) <= error(&scaled) { bent } else { scaled };
    page.with_alpha(kept)
}

/// Returns the table that multiplies codes of alpha.
fn scale(factor: f32) -> [u8; 256] {
    std::array::from_fn(|code| quantise(factor * code as f32 / 255.0))
}

/// Returns the image with alpha mapped linearly: 0 to the pivot becomes 0 to `cutoff`, the pivot to 1 becomes `cutoff` to 1.
pub fn bent(image: &Image, pivot: f32, cutoff: f32) -> Image {
    let table = table(pivot, cutoff);
    image.mapped(|[r, g, b, alpha]| [r, g, b, table[alpha as usize]])
}

/// Returns the table that maps codes of alpha linearly: 0 to the pivot becomes 0 to `cutoff`, the pivot to 1 becomes `cutoff` to 1.
pub(super) fn table(pivot: f32, cutoff: f32) -> [u8; 256] {
    std::array::from_fn(|code| {
        let alpha = code as f32 / 255.0;
        let moved = if alpha < pivot {
            alpha / pivot * cutoff
        } else {
            cutoff + (alpha - pivot) / (1.0 - pivot).max(1e-3) * (1.0 - cutoff)
        };
        quantise(moved)
    })
}

/// Returns the least value in (`low`, `high`] from which on `holds` is true, after so many halvings.
pub fn least(mut low: f32, mut high: f32, halvings: usize, holds: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Region;
    use crate::foliage::mask;

    #[test]
    fn each_part_keeps_its_area_at_another_cutoff() {
        // A soft disc in each half of the page, with different cutoffs.
        check(|x, y| 1.3 - (x - 31.5).hypot(y - 31.5) / 20.0, [0.6, 0.1]);
        // Hard discs.
        check(|x, y| f64::from(u8::from((x - 31.5).hypot(y - 31.5) < 5.0)), [0.1, 0.2]);
    }

    fn check(disc: impl Fn(f64, f64) -> f64, cutoffs: [f32; 2]) {
        let pixels = |i: usize| [30, 90, 20, quantise(disc((i % 128 % 64) as f64, (i / 128) as f64) as f32)];
        let page = Image::new(128, 64, (0..128 * 64).map(pixels).collect::<Vec<_>>()).unwrap();
        let part = |x: usize, alpha_cutoff: f32| PagePart {
            regions: vec![Region { x, y: 0, width: 64, height: 64 }],
            gutter: 0,
            alpha_cutoff,
            drawn: (0..128 * 64).map(|i| f32::from(u8::from(i % 128 / 64 == x / 64))).collect(),
            first_seen: 0,
        };
        let other = recut(&page, &[part(0, 0.3), part(64, 0.8)], &cutoffs);
        let half = |image: &Image, x: usize| -> Vec<u8> {
            let rows = image.pixels().chunks(128);
            rows.flat_map(|row| row[x..x + 64].iter().map(|pixel| pixel[3])).collect()
        };
        for (x, before, after) in [(0, 0.3, cutoffs[0]), (64, 0.8, cutoffs[1])] {
            let [own, found] =
                [(&page, before), (&other, after)].map(|(image, cutoff)| mask::area(&half(image, x), 64, cutoff, 1));
            assert!((found / own - 1.0).abs() < 0.02, "{found} beside {own}");
        }
        assert_ne!(page, other);
    }
}
