//! The smallest page for rectangles of given sizes. They are not rotated, because their texels are already drawn.

use super::rectangles::{BoxSize, pack};
use super::{MANY, PageSize, on_shelves, orders};
use crate::limits;

/// Tried widths, in tenths of the side of a square page without waste. Heights grow by `GROWTH` until all boxes fit.
const WIDTHS: std::ops::RangeInclusive<u32> = 5..=20;
const GROWTH: f64 = 1.01;
const LARGEST: usize = limits::ATLAS_SIDE.high as usize;

/// Most orders tried on each page.
const ORDERS: usize = 20;

/// Returns the smallest page found and the upper left corners of boxes (width, height) on it. Its sides are multiples of 4, for compressed
/// textures. `None` without boxes, or if the largest page does not hold them. O(n²) for each tried page, of which there are some hundreds;
/// above [`MANY`] boxes O(n log n), on shelves.
#[must_use]
pub fn tightest(boxes: &[BoxSize]) -> Option<(PageSize, Vec<(usize, usize)>)> {
    let area: usize = boxes.iter().map(|&(width, height)| width * height).sum();
    let widest = boxes.iter().map(|b| b.0).max()?;
    let highest = boxes.iter().map(|b| b.1).max()?;
    let mut best: Option<(PageSize, Vec<(usize, usize)>)> = None;
    for tenth in WIDTHS {
        let width = in_fours(((area as f64).sqrt() * f64::from(tenth) / 10.0) as usize).max(in_fours(widest));
        let mut height = in_fours(area.div_ceil(width)).max(in_fours(highest));
        while width.max(height) <= LARGEST && best.as_ref().is_none_or(|(least, _)| width * height < least.texels()) {
            if let Some(places) = places(boxes, width, height) {
                best = Some((PageSize { width, height }, places));
            }
            height = in_fours((height as f64 * GROWTH) as usize + 1);
        }
    }
    best
}

fn in_fours(length: usize) -> usize {
    length.div_ceil(4).max(1) * 4
}

fn places(boxes: &[BoxSize], width: usize, height: usize) -> Option<Vec<(usize, usize)>> {
    let page = PageSize { width, height };
    let packed = if boxes.len() > MANY {
        on_shelves(boxes, page)?
    } else {
        pack(boxes, page, false, orders(boxes.len(), ORDERS))?
    };
    Some(packed.iter().map(|region| (region.x, region.y)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_that_fill_a_page_get_that_page() {
        let (size, places) = tightest(&[(64, 64), (64, 32), (64, 32)]).unwrap();
        assert_eq!(size.texels(), 8192);
        assert_eq!(places.len(), 3);
    }

    #[test]
    fn a_page_need_not_be_square() {
        let (size, _) = tightest(&[(400, 20), (400, 24)]).unwrap();
        assert_eq!((size.width, size.height), (400, 44));
        let many = vec![(8, 8); MANY + 1];
        let (size, places) = tightest(&many).unwrap();
        assert!(size.texels() < 65 * 65 * 64 && places.len() == MANY + 1);
        assert!(tightest(&[(20_000, 1)]).is_none() && tightest(&[]).is_none());
    }
}
