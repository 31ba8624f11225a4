//! Mip pyramids of leaf textures: small textures are filtered, not sampled at single points (Williams, "Pyramidal Parametrics", 1983).
//!
//! Each level has half the texels of the previous level along both axes (rounded up), as means of 2 × 2. The last column or row of an odd
//! side is averaged with itself. Level 0 is the image and is not stored. O(texels) time, a third of the image's texels in memory.

use glam::Vec2;

use super::{AlphaMode, Image, mask};
use crate::color::{decode_table, quantise};

/// One level of `width` × `height` texels, row 0 on top.
#[derive(Debug)]
pub struct PyramidLevel<T> {
    pub width: usize,
    pub height: usize,
    /// The image's sides in texels of this level: less than `width` and `height`, by less than one, if a side was odd.
    pub scale: Vec2,
    pub texels: Vec<T>,
}

impl<T: Copy> PyramidLevel<T> {
    /// Returns the texel at a place on a repeating image; both coordinates in [0, 1), rows down.
    pub fn at(&self, column: f32, row: f32) -> T {
        let x = ((column * self.scale.x) as usize).min(self.width - 1);
        let y = ((row * self.scale.y) as usize).min(self.height - 1);
        self.texels[y * self.width + x]
    }
}

/// Levels 1, 2 … down to one texel; empty for an image of one texel.
#[derive(Debug)]
pub struct Pyramid<T>(Vec<PyramidLevel<T>>);

/// Weighted color and its weight (alpha; for a mask, 1 or nearly 0), in 1/65535: 8-bit linear codes would lose dark colors.
pub type Texel = [u16; 4];

const FULL: f32 = 65_535.0;

/// Returns whether points `footprint` texels apart sample the image itself.
pub fn is_near(footprint: f32) -> bool {
    footprint.is_nan() || footprint < std::f32::consts::SQRT_2
}

impl<T> Pyramid<T> {
    /// Returns the first level with texels at least `length` image texels wide, or else the last; `None` for an image of one texel.
    pub fn wider_than(&self, length: f32) -> Option<&PyramidLevel<T>> {
        // Casts turn NaN into 0.
        let level = (libm::log2f(length.max(2.0)).ceil() as usize).clamp(1, self.0.len().max(1));
        self.0.get(level - 1)
    }

    /// Returns the level with the texel size nearest to `footprint` image texels; `None` means the image itself.
    pub fn level(&self, footprint: f32) -> Option<&PyramidLevel<T>> {
        // Level k has texels of 2^k: the nearest in ratio. NaN counts as near.
        if is_near(footprint) {
            return None;
        }
        let level = (libm::log2f(footprint) + 0.5) as usize;
        level.min(self.0.len()).checked_sub(1).map(|index| &self.0[index])
    }
}

impl<T: Copy> Pyramid<T> {
    /// Builds all levels from the image's texels, read with `of`, and the mean of four.
    fn new<S: Copy>(width: usize, height: usize, source: &[S], of: impl Fn(S) -> T, mean: fn([T; 4]) -> T) -> Self {
        let mut levels: Vec<PyramidLevel<T>> = Vec::new();
        let mut scale = Vec2::new(width as f32, height as f32);
        if width * height > 1 {
            scale /= 2.0;
            levels.push(halved(width, scale, source, |texels| mean(texels.map(&of))));
        }
        while let Some(last) = levels.last().filter(|level| level.texels.len() > 1) {
            scale /= 2.0;
            let next = halved(last.width, scale, &last.texels, mean);
            levels.push(next);
        }
        Self(levels)
    }
}

fn halved<S: Copy, T>(width: usize, scale: Vec2, source: &[S], mean: impl Fn([S; 4]) -> T) -> PyramidLevel<T> {
    let (columns, rows) = (width.div_ceil(2), (source.len() / width).div_ceil(2));
    let mut texels = Vec::with_capacity(columns * rows);
    for both in source.chunks(2 * width) {
        let (upper, lower) = if both.len() > width { both.split_at(width) } else { (both, both) };
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        texels.extend(pairs.map(|(upper, lower)| mean([upper[0], upper[1], lower[0], lower[1]])));
        if width % 2 == 1 {
            let (right, lower_right) = (upper[width - 1], lower[width - 1]);
            texels.push(mean([right, right, lower_right, lower_right]));
        }
    }
    PyramidLevel { width: columns, height: rows, scale, texels }
}

/// Encoding of an image's codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Colors, as sRGB.
    Srgb,
    /// Directions and shares: the code over 255.
    Linear,
}

/// Decodes a code to a share in [0, 1].
pub fn decoded(code: u8, encoding: Encoding) -> f32 {
    match encoding {
        Encoding::Srgb => decode_table()[code as usize],
        Encoding::Linear => f32::from(code) / 255.0,
    }
}

/// Decodes a fractional code to a share in [0, 1] by linear interpolation, within 10⁻⁵ of the curve.
pub fn decoded_between(code: f32, encoding: Encoding) -> f32 {
    let below = code as u8;
    let above = below.saturating_add(1);
    decoded(below, encoding) + (code - f32::from(below)) * (decoded(above, encoding) - decoded(below, encoding))
}

/// Builds the pyramid of an image's colors, weighted by each texel's weight.
pub fn of_colors(image: &Image, encoding: Encoding) -> Pyramid<Texel> {
    let table: [f32; 256] = std::array::from_fn(|code| decoded(code as u8, encoding));
    let weights: [f32; 256] = std::array::from_fn(|alpha| image.weight(alpha as u8));
    let of = |[r, g, b, a]: [u8; 4]| {
        let weight = weights[a as usize];
        let part = |code: u8| (table[code as usize] * weight * FULL + 0.5) as u16;
        [part(r), part(g), part(b), (weight * FULL + 0.5) as u16]
    };
    let mean =
        |t: [Texel; 4]| std::array::from_fn(|i| ((t.iter().map(|t| u32::from(t[i])).sum::<u32>() + 2) / 4) as u16);
    Pyramid::new(image.width(), image.height(), image.pixels(), of, mean)
}

/// Builds the pyramid of the drawn share of each texel, in codes: alpha times `factor`, or for a mask the share above the cutoff.
pub fn of_coverage(image: &Image, mode: AlphaMode, factor: f32) -> Pyramid<u8> {
    let shares: Vec<u8> = match mode {
        AlphaMode::Opaque => vec![255; image.pixels().len()],
        // A cutoff of 0 draws everything, also at a factor of 0.
        AlphaMode::Mask(cutoff) => {
            mask::shares(&image.alpha(), image.width(), if cutoff > 0.0 { cutoff / factor } else { 0.0 })
        }
        AlphaMode::Blend => image.pixels().iter().map(|p| quantise(f32::from(p[3]) / 255.0 * factor)).collect(),
    };
    let mean = |t: [u8; 4]| ((t.iter().map(|&t| u32::from(t)).sum::<u32>() + 2) / 4) as u8;
    Pyramid::new(image.width(), image.height(), &shares, |share| share, mean)
}

/// Builds the pyramid of the greatest alpha on each texel and its neighbors, also across the edges of a repeating image.
pub fn of_greatest_alpha(image: &Image) -> Pyramid<u8> {
    let greatest = |t: [u8; 4]| t.into_iter().max().unwrap_or(0);
    let Pyramid(levels) = Pyramid::new(image.width(), image.height(), image.pixels(), |p: [u8; 4]| p[3], greatest);
    Pyramid(levels.into_iter().map(spread).collect())
}

/// Returns the maximum of each texel and its neighbors, across the edges. If an edge cuts the last texel, two neighbors count.
fn spread(level: PyramidLevel<u8>) -> PyramidLevel<u8> {
    let PyramidLevel { width, height, scale, mut texels } = level;
    let reach = |cells: usize, scale: f32| if scale == cells as f32 { 1 } else { 2 };
    let reach_along = reach(width, scale.x);
    let mut around = vec![0; width + 2 * reach_along];
    for row in texels.chunks_exact_mut(width) {
        for (place, texel) in around.iter_mut().enumerate() {
            *texel = row[(place + 2 * width - reach_along) % width];
        }
        for step in 0..=2 * reach_along {
            raise(row, &around[step..][..width]);
        }
    }
    let (reach_down, along) = (reach(height, scale.y), texels.clone());
    for (y, row) in texels.chunks_exact_mut(width).enumerate() {
        for step in 0..=2 * reach_down {
            raise(row, &along[(y + 2 * height + step - reach_down) % height * width..][..width]);
        }
    }
    PyramidLevel { width, height, scale, texels }
}

/// Raises values to those of another row.
fn raise(row: &mut [u8], other: &[u8]) {
    row.iter_mut().zip(other).for_each(|(value, &other)| *value = (*value).max(other));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Material;

    fn image(width: usize, height: usize, pixel: impl Fn(usize) -> [u8; 4]) -> Image {
        Image::new(width, height, (0..width * height).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_checkerboard_is_grey_in_linear_light() {
        let board = image(8, 8, |i| if (i % 8 + i / 8) % 2 == 0 { [255, 0, 0, 255] } else { [0, 0, 255, 255] });
        let pyramid = of_colors(&board, Encoding::Srgb);
        assert_eq!(pyramid.0.len(), 3);
        for level in &pyramid.0 {
            assert!(level.texels.iter().all(|t| *t == [32_768, 0, 32_768, 65_535]), "{level:?}");
        }
    }

    #[test]
    fn transparent_texels_do_not_tint() {
        let half = image(2, 2, |i| if i == 0 { [200, 0, 0, 255] } else { [0, 255, 0, 0] });
        let top = &of_colors(&half, Encoding::Linear).0[0].texels[0];
        // 200/255 of 65535 is 51400; a quarter of it, with a quarter of alpha.
        assert_eq!(*top, [12_850, 0, 0, 16_384]);
    }

    #[test]
    fn what_a_mask_draws_colours_it_alike_whatever_its_alpha() {
        let texels = [[200, 0, 0, 255], [0, 100, 0, 130], [0, 0, 0, 0], [0, 0, 250, 120]];
        let image = image(2, 2, |i| texels[i]);
        let material = Material { image: Some(image), alpha_mode: AlphaMode::Mask(0.5), ..Material::default() };
        let [r, g, b, whole] = of_colors(&material.settled().image.unwrap(), Encoding::Linear).0[0].texels[0];
        let share = |part: u16| f32::from(part) / f32::from(whole) * 255.0;
        assert!((share(r) - 100.0).abs() < 1.0 && (share(g) - 50.0).abs() < 1.0, "{} {}", share(r), share(g));
        assert!(share(b) < 1.0, "texels below the cutoff count for nothing beside drawn ones: {}", share(b));
    }

    #[test]
    fn coverage_keeps_the_share_that_is_drawn() {
        let quarter = image(64, 16, |i| [0, 0, 0, if i % 4 == 0 { 255 } else { 0 }]);
        let pyramid = of_coverage(&quarter, AlphaMode::Mask(0.5), 1.0);
        let last = pyramid.0.last().unwrap();
        assert!((62..=66).contains(&last.texels[0]), "a quarter of 255, each level rounds: {}", last.texels[0]);
        assert!(pyramid.level(0.3).is_none() && pyramid.level(1.3).is_none());
        assert_eq!(pyramid.level(4.0).unwrap().width, 16);
        assert_eq!(pyramid.level(1e9).unwrap().width, 1);
    }

    #[test]
    fn a_cutoff_of_0_draws_all_whatever_the_factor() {
        let clear = image(8, 8, |_| [0; 4]);
        assert_eq!(of_coverage(&clear, AlphaMode::Mask(0.0), 0.0).0.last().unwrap().texels, [255]);
    }

    #[test]
    fn odd_sides_and_one_texel() {
        assert_eq!(
            of_colors(&image(5, 3, |_| [9; 4]), Encoding::Linear)
                .0
                .iter()
                .map(|l| (l.width, l.height))
                .collect::<Vec<_>>(),
            [(3, 2), (2, 1), (1, 1)]
        );
        assert!(of_colors(&image(1, 1, |_| [9; 4]), Encoding::Linear).0.is_empty());
    }

    #[test]
    fn the_greatest_alpha_is_that_of_each_texel_and_its_neighbours() {
        for (width, height) in [(1, 1), (2, 1), (8, 4), (7, 5), (5, 16), (33, 2)] {
            let image = image(width, height, |i| [0, 0, 0, (i * i * 37 % 251) as u8]);
            let of = |column: isize, row: isize| {
                let (x, y) = (column.rem_euclid(width as isize), row.rem_euclid(height as isize));
                image.pixels()[y as usize * width + x as usize][3]
            };
            for (number, level) in of_greatest_alpha(&image).0.iter().enumerate() {
                let texel = 2isize << number;
                for (index, &found) in level.texels.iter().enumerate() {
                    let [x, y] = [index % level.width, index / level.width].map(|place| place as isize * texel);
                    let near = (y - texel..y + 2 * texel)
                        .flat_map(|row| (x - texel..x + 2 * texel).map(move |column| (column, row)));
                    let least = near.map(|(column, row)| of(column, row)).max().unwrap();
                    assert!(found >= least, "{width} × {height}, level {number}, texel {index}: {found} below {least}");
                }
            }
        }
        let single = image(16, 16, |i| [0, 0, 0, if i == 5 * 16 + 9 { 200 } else { 0 }]);
        let first = &of_greatest_alpha(&single).0[0];
        let shown = |i: usize| [3, 4, 5].contains(&(i % 8)) && [1, 2, 3].contains(&(i / 8));
        assert!((0..64).all(|i| first.texels[i] == if shown(i) { 200 } else { 0 }));
    }
}
