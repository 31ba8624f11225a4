//! Color correction of a page for its alpha cutoff.
//!
//! A cutoff draws full texels and drops those along the edges of leaves. If edges have another color than the inside (the lit fringe of
//! needles, the pale rim of a leaf), this shifts the mean color of a crown, by 5 % of its light on a pine, although every single texel is
//! right. So texels below the cutoff give their color to adjacent texels that reach it, in proportion to their alpha: then the mean color
//! of the drawn texels is that of all texels. Texels below the cutoff take the color of drawn texels around them, so that bilinear
//! filtering and box-filtered mip levels find no other color. O(texels).
//!
//! Known limit: the color of a texel without a drawn neighbor is lost.
//!
//! A factor of 1 or 2 % moves a dark color by less than half a code, so rounding each code to the nearest one would lose the factor. So some
//! codes take the second nearest code, by the number of texels that have them: error diffusion (Floyd and Steinberg 1976) over the histogram
//! instead of over the picture. All texels of one code stay alike, so that PNG files stay small: random rounding of each texel makes noise.
//! O(texels). Known limit: the mean of a channel of one or few codes keeps an error of up to half a code.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::channels::Channel;
use super::dilate;
use super::raster::Canvas;
use crate::color::{decode_table, encode};
use crate::foliage::Image;

/// Returns the image with the color of texels below the cutoff given to adjacent texels that reach it. Alpha stays.
#[must_use]
pub fn gathered(image: &Image, cutoff: f32) -> Image {
    let around = Around { width: image.width(), height: image.height() };
    let passes = |texel: usize| f32::from(image.pixels()[texel][3]) / 255.0 >= cutoff;
    let texels = 0..image.pixels().len();
    if !texels.clone().any(passes) {
        return image.clone();
    }
    let seen = Canvas::of_color(image);
    // The color that each texel below the cutoff gives to each of its takers.
    let gift = |texel: usize| {
        let takers = if seen.pixels[texel].w > 0.0 && !passes(texel) { around.count(texel, passes) } else { 0 };
        if takers == 0 { Vec4::ZERO } else { seen.pixels[texel] / takers as f32 }
    };
    let gifts: Vec<Vec4> = texels.clone().into_par_iter().map(gift).collect();
    let taken = |texel: usize| {
        if !passes(texel) {
            return Vec4::ZERO;
        }
        let given: Vec4 = around.texels(texel).map(|i| gifts[i]).sum();
        seen.pixels[texel] + given
    };
    let pixels = texels.into_par_iter().map(taken).collect();
    let mut canvas = Canvas { width: image.width(), height: image.height(), pixels };
    dilate::fill_transparent(&mut canvas);
    let colors = Channel::BaseColor.to_image(&canvas);
    let kept = colors.pixels().iter().zip(image.pixels()).map(|(&[r, g, b, _], &[.., alpha])| [r, g, b, alpha]);
    Image::new(image.width(), image.height(), kept.collect::<Vec<_>>()).expect("as many texels as before")
}

/// Returns the image with its linear colors multiplied and clamped at full scale. The mean color, weighted by alpha, has the same factors
/// in spite of rounding.
#[must_use]
pub fn scaled(image: &Image, factors: Vec3) -> Image {
    let mut weights = [[0; 256]; 3];
    for &[colors @ .., alpha] in image.pixels() {
        for (weights, color) in weights.iter_mut().zip(colors) {
            weights[usize::from(color)] += u64::from(alpha);
        }
    }
    let [red, green, blue]: [_; 3] = std::array::from_fn(|channel| scaled_codes(&weights[channel], factors[channel]));
    image.mapped(|[r, g, b, a]| [red[r as usize], green[g as usize], blue[b as usize], a])
}

/// Returns a code for each code, of the two nearest to its multiplied light, so that the sum of the light of all weights is as wanted.
fn scaled_codes(weights: &[u64; 256], factor: f32) -> [u8; 256] {
    let light = |code: u8| f64::from(decode_table()[usize::from(code)]);
    let mut codes = decode_table().map(|linear| encode(linear * factor));
    let mut excess = 0.0;
    let mut changes = Vec::new();
    for (code, &linear) in decode_table().iter().enumerate() {
        let (nearest, wanted) = (codes[code], f64::from((linear * factor).min(1.0)));
        let other = if light(nearest) < wanted { nearest.saturating_add(1) } else { nearest.saturating_sub(1) };
        excess += weights[code] as f64 * (light(nearest) - wanted);
        changes.push((code, other, weights[code] as f64 * (light(other) - light(nearest))));
    }
    // The largest changes first: small ones correct the rest. The sort is stable, so equal changes keep their order.
    changes.sort_by(|(.., a), (.., b)| b.abs().total_cmp(&a.abs()));
    for (code, other, change) in changes {
        if (excess + change).abs() < excess.abs() {
            excess += change;
            codes[code] = other;
        }
    }
    codes
}

/// The up to eight texels around a texel.
#[derive(Clone, Copy)]
struct Around {
    width: usize,
    height: usize,
}

impl Around {
    fn texels(self, texel: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (texel % self.width, texel / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * self.width + x)).filter(move |&i| i != texel)
    }

    fn count(self, texel: usize, counts: impl Fn(usize) -> bool) -> usize {
        self.texels(texel).filter(|&i| counts(i)).count()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::random::Stream;

    #[test]
    fn a_fringe_gives_its_colour_to_what_it_surrounds() {
        // One opaque black texel, with white texels of alpha ¼ around it.
        let pixels: Vec<[u8; 4]> = (0..9).map(|i| if i == 4 { [0, 0, 0, 255] } else { [255, 255, 255, 64] }).collect();
        let settled = gathered(&Image::new(3, 3, pixels).unwrap(), 0.5);
        let linear = decode_table()[settled.pixels()[4][0] as usize];
        let expected = 8.0 * 64.0 / (8.0 * 64.0 + 255.0);
        assert!((linear - expected).abs() < 0.01, "{linear} instead of {expected}");
        assert!(settled.pixels().iter().all(|p| p[0] == settled.pixels()[4][0]), "all show one color");
        assert_eq!([settled.pixels()[0][3], settled.pixels()[4][3]], [64, 255]);
    }

    #[test]
    fn an_image_below_the_cutoff_stays() {
        let image = Image::new(2, 1, vec![[9, 8, 7, 20], [1, 2, 3, 90]]).unwrap();
        assert_eq!(gathered(&image, 0.5), image);
    }

    #[test]
    fn scaling_is_in_linear_light() {
        let image = Image::new(1, 1, vec![[188, 188, 255, 7]]).unwrap();
        assert_eq!(scaled(&image, Vec3::new(0.5, 1.0, 2.0)).pixels()[0], [137, 188, 255, 7]);
    }

    /// Light of a code by the standard's formula.
    fn light(code: u8) -> f64 {
        let x = f64::from(code) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    }

    fn mean_light(image: &Image, channel: usize) -> f64 {
        let sum: f64 = image.pixels().iter().map(|p| f64::from(p[3]) * light(p[channel])).sum();
        sum / image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>()
    }

    #[test]
    fn the_mean_of_a_dark_texture_changes_by_the_factor() {
        // Codes of up to 42, most of them about 21. Every fourth texel is transparent and bright: it does not count.
        let mut random = Stream::new(1, 0, 0);
        let dark = |random: &mut Stream| (random.below(22) + random.below(22)) as u8;
        let texel = |i: usize| match i % 4 {
            0 => [250, 250, 250, 0],
            _ => [dark(&mut random), dark(&mut random), dark(&mut random), 255 - 40 * (i % 3) as u8],
        };
        let image = Image::new(64, 64, (0..64 * 64).map(texel).collect::<Vec<_>>()).unwrap();
        for factor in [0.85, 0.97, 0.99, 0.995, 1.005, 1.02, 1.2] {
            let changed = scaled(&image, Vec3::new(factor, 1.0, 2.0 - factor));
            for (channel, factor) in [factor, 1.0, 2.0 - factor].map(f64::from).into_iter().enumerate() {
                let ratio = mean_light(&changed, channel) / mean_light(&image, channel);
                assert!((ratio / factor - 1.0).abs() < 0.002, "{ratio} instead of {factor}");
            }
            for (new, old) in changed.pixels().iter().zip(image.pixels()) {
                // One of the two codes around the exact light.
                let exact = light(old[0]) * f64::from(factor);
                let around = light(new[0].saturating_sub(1))..=light(new[0].saturating_add(1));
                assert!(exact >= 1.0 || around.contains(&exact), "{} instead of {exact}", light(new[0]));
                assert_eq!([new[1], new[3]], [old[1], old[3]]);
            }
        }
    }

    proptest! {
        /// In blocks of 3 × 3 where only the middle passes, the middle gets the mean of its block, weighted by alpha, and the whole block
        /// shows it.
        #[test]
        fn each_block_has_its_mean(texels in prop::collection::vec((any::<[u8; 3]>(), 1u8..127), 81)) {
            let middle = |i: usize| i % 9 % 3 == 1 && i / 9 % 3 == 1;
            let texel = |i: usize| {
                let ([r, g, b], alpha) = texels[i];
                [r, g, b, if middle(i) { 255 } else { alpha }]
            };
            let image = Image::new(9, 9, (0..81).map(texel).collect::<Vec<_>>()).unwrap();
            let settled = gathered(&image, 0.5);
            let linear = |code: u8| f64::from(decode_table()[code as usize]);
            for i in (0..81).filter(|&i| middle(i)) {
                let block = || [0, 1, 2, 9, 10, 11, 18, 19, 20].map(|step| image.pixels()[i - 10 + step]).into_iter();
                let alpha: f64 = block().map(|p| f64::from(p[3])).sum();
                let mean = block().map(|p| f64::from(p[3]) * linear(p[0])).sum::<f64>() / alpha;
                let code = settled.pixels()[i][0];
                let nearest = (linear(code.saturating_sub(1)), linear(code.saturating_add(1)));
                prop_assert!(nearest.0 <= mean && mean <= nearest.1, "{mean} became {}", linear(code));
            }
        }
    }
}
