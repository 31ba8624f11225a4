//! Constant-time test for opaque texels in a rectangle: a summed-area table (Crow 1984) with a flag for each texel.
//!
//! The test never misses anything that bilinear filtering finds: a point depends on the four texels around it, so the rectangle grows by
//! one texel on every side. The one exception is the strip, half a texel wide, into which a repeating image blends its opposite edge.
//! Nobody intends that blending, and a leaf with its stalk at the lower edge would otherwise extend to the upper edge. Large images are
//! tested in blocks of texels, which only adds false positives.

use std::ops::Range;

use glam::Vec2;

use super::Image;

/// Tolerance, in texture coordinates, for places on an image's edge.
const WHOLE_PERIOD: f32 = 2e-6;

/// Greatest number of blocks along each side of an image.
const MOST_BLOCKS: usize = 1024;

/// Summed-area table of the blocks with an opaque texel.
pub struct TexelMask {
    /// Width and height of the image, in texels.
    size: [usize; 2],
    /// Texels along the side of a block.
    block: usize,
    columns: usize,
    rows: usize,
    sums: Vec<u32>,
}

impl TexelMask {
    /// Builds the table of texels with an alpha, in [0, 1], of at least `least`.
    pub fn new(image: &Image, least: f32) -> Self {
        let size = [image.width(), image.height()];
        let block = size[0].max(size[1]).div_ceil(MOST_BLOCKS);
        let (columns, rows) = (size[0].div_ceil(block), size[1].div_ceil(block));
        let least = code_of(least);
        let mut any = vec![0u32; columns * rows];
        for (y, row) in image.pixels().chunks(size[0]).enumerate() {
            let blocks = &mut any[y / block * columns..][..columns];
            for (texels, found) in row.chunks(block).zip(blocks) {
                *found |= u32::from(texels.iter().any(|texel| u16::from(texel[3]) >= least));
            }
        }
        let mut sums = vec![0u32; (columns + 1) * (rows + 1)];
        for row in 0..rows {
            let mut left = 0;
            for column in 0..columns {
                left += any[row * columns + column];
                sums[(row + 1) * (columns + 1) + column + 1] = sums[row * (columns + 1) + column + 1] + left;
            }
        }
        Self { size, block, columns, rows, sums }
    }

    /// Returns whether filtering can find an opaque texel between two texture coordinates (v up) of a repeating image.
    pub fn any_within(&self, low: Vec2, high: Vec2) -> bool {
        let columns = self.blocks(low.x, high.x, self.size[0], self.columns);
        let rows = self.blocks(1.0 - high.y, 1.0 - low.y, self.size[1], self.rows);
        columns.iter().any(|c| rows.iter().any(|r| self.count(c.clone(), r.clone()) > 0))
    }

    /// Returns the blocks of an axis that touch an interval, extended by a texel on both sides: one range, and a second after a wrap.
    fn blocks(&self, low: f32, high: f32, size: usize, blocks: usize) -> [Range<usize>; 2] {
        let (start, texels) = ((low + WHOLE_PERIOD).floor(), size as f32);
        let first = ((low - start) * texels - 1.5).floor().max(0.0);
        let last = ((high - start) * texels + 1.5).floor();
        let part = |first: usize, last: usize| first / self.block..last / self.block + 1;
        if last - first < texels && high <= start + 1.0 + WHOLE_PERIOD {
            [part(first as usize, (last as usize).min(size - 1)), 0..0]
        } else if last - first < texels {
            [part(first as usize, size - 1), part(0, last as usize % size)]
        } else {
            [0..blocks, 0..0] // the whole axis, also for NaN
        }
    }

    fn count(&self, columns: Range<usize>, rows: Range<usize>) -> u32 {
        let at = |row: usize, column: usize| self.sums[row * (self.columns + 1) + column];
        (at(rows.end, columns.end) + at(rows.start, columns.start))
            - (at(rows.start, columns.end) + at(rows.end, columns.start))
    }
}

/// Returns the least code with a share of at least `share`; 256 if there is none.
fn code_of(share: f32) -> u16 {
    (0..=255).find(|&code| f32::from(code) / 255.0 >= share).unwrap_or(256)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// An image with one opaque texel, row 0 on top.
    fn one_texel(width: usize, height: usize, x: usize, y: usize) -> Image {
        let alpha = |i: usize| if i == y * width + x { 255 } else { 0 };
        Image::new(width, height, (0..width * height).map(|i| [0, 0, 0, alpha(i)]).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn finds_a_texel_and_its_neighbours_only() {
        let mask = TexelMask::new(&one_texel(64, 32, 40, 5), 0.5);
        let middle = |x: f32, y: f32| Vec2::new((x + 0.5) / 64.0, 1.0 - (y + 0.5) / 32.0);
        let at = |x: f32, y: f32| mask.any_within(middle(x, y), middle(x, y));
        assert!(at(40.0, 5.0) && at(39.1, 5.0) && at(40.0, 5.9));
        assert!(!at(36.0, 5.0) && !at(44.0, 5.0) && !at(40.0, 9.0));
        assert!(at(40.0 - 64.0, 5.0) && at(40.0 + 128.0, 5.0 + 32.0), "the image repeats");
        assert!(mask.any_within(Vec2::splat(f32::NAN), Vec2::ONE), "unknown places count as opaque");
    }

    proptest! {
        /// From the definition: an opaque texel within reach of the filter.
        #[test]
        fn never_denies_what_filtering_finds(
            (width, height) in (1usize..40, 1usize..40), place in (0.0f32..1.0, 0.0f32..1.0),
            low in (-2.0f32..2.0, -2.0f32..2.0), size in (0.0f32..1.2, 0.0f32..1.2), inside in (0.0f32..1.0, 0.0f32..1.0),
        ) {
            let (x, y) = ((place.0 * width as f32) as usize, (place.1 * height as f32) as usize);
            let image = one_texel(width, height, x.min(width - 1), y.min(height - 1));
            let (low, size) = (Vec2::from(low), Vec2::from(size));
            let uv = low + size * Vec2::from(inside);
            // Bilinear: the distance from the texel's middle, within one period of the image, is below one texel.
            let apart = |u: f32, texel: usize, size: usize| {
                (u.rem_euclid(1.0) * size as f32 - (texel as f32 + 0.5)).abs()
            };
            let found = apart(uv.x, x.min(width - 1), width) < 1.0 && apart(1.0 - uv.y, y.min(height - 1), height) < 1.0;
            if found {
                prop_assert!(TexelMask::new(&image, 0.5).any_within(low, low + size));
            }
        }
    }

    #[test]
    fn blocks_of_a_large_image_still_find_a_texel() {
        let mask = TexelMask::new(&one_texel(3000, 2, 2999, 0), 0.5);
        assert!(mask.any_within(Vec2::new(2999.4 / 3000.0, 0.75), Vec2::new(2999.6 / 3000.0, 0.75)));
        assert!(!mask.any_within(Vec2::new(0.3, 0.0), Vec2::new(0.6, 1.0)));
    }
}
