//! Figures of renders of the same views: coverage, overlap, mean color and spread. They are sums of counts and table values in a fixed
//! order, so they are exact on any machine, and settings may be chosen by them.

use glam::Vec3;

use crate::color::decode_table;
use crate::foliage::Image;

/// Least alpha sum of a base image, as a share of the greatest among the views. Smaller ones are ignored: flat foliage seen edge-on.
const LEAST_SEEN: f64 = 0.05;

/// Returns the ratio of summed alpha to the base's, as the mean over the images; 1 if all bases are empty. The mean of ratios weighs all
/// views alike: too dense from above and too thin from the side cancel out, however much more is visible from above.
pub fn coverage<'a>(pairs: impl Iterator<Item = (&'a Image, &'a Image)>) -> f64 {
    let (bases, others): (Vec<_>, Vec<_>) = pairs.unzip();
    coverage_of(bases.into_iter(), others.into_iter().map(alpha_sum))
}

/// As [`coverage`], with the alpha sums of the other images.
pub fn coverage_of<'a>(bases: impl Iterator<Item = &'a Image>, others: impl Iterator<Item = f64>) -> f64 {
    let sums: Vec<(f64, f64)> = bases.map(alpha_sum).zip(others).collect();
    let most = sums.iter().map(|(base, _)| *base).fold(0.0, f64::max);
    let told = sums.iter().filter(|(base, _)| *base > 0.0 && *base >= LEAST_SEEN * most);
    let ratios: Vec<f64> = told.map(|(base, other)| other / base).collect();
    if ratios.is_empty() { 1.0 } else { ratios.iter().sum::<f64>() / ratios.len() as f64 }
}

fn alpha_sum(image: &Image) -> f64 {
    image.pixels().iter().map(|p| u64::from(p[3])).sum::<u64>() as f64
}

/// Returns the intersection over union of alpha itself: Σ min / Σ max. It also counts foliage that is too thin for silhouettes.
pub fn overlap<'a>(pairs: impl Iterator<Item = (&'a Image, &'a Image)>) -> f64 {
    let pixels = pairs.flat_map(|(a, b)| a.pixels().iter().zip(b.pixels()));
    let (both, either) = pixels.fold((0u64, 0u64), |(both, either), (a, b)| {
        (both + u64::from(a[3].min(b[3])), either + u64::from(a[3].max(b[3])))
    });
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// Returns the mean linear color, weighted by alpha, of all images together; black if they are empty.
pub fn mean_color(pictures: &[Image]) -> [f64; 3] {
    let table = decode_table();
    let (mut sums, mut covered) = ([0.0; 3], 0.0);
    for &[r, g, b, alpha] in pictures.iter().flat_map(Image::pixels) {
        let alpha = f64::from(alpha);
        for (sum, code) in sums.iter_mut().zip([r, g, b]) {
            *sum += alpha * f64::from(table[code as usize]);
        }
        covered += alpha;
    }
    sums.map(|sum| if covered > 0.0 { sum / covered } else { 0.0 })
}

/// Returns the ratio of mean linear colors, base over other, per channel; 1 if either is black.
pub fn tone(base: &[Image], other: &[Image]) -> Vec3 {
    let (base, other) = (mean_color(base), mean_color(other));
    let ratio = |(a, b): (f64, f64)| if a > 0.0 && b > 0.0 { (a / b) as f32 } else { 1.0 };
    Vec3::from_array(std::array::from_fn(|i| ratio((base[i], other[i]))))
}

/// Returns the standard deviation of linear luminance over pixels with alpha > ½, all images together; 0 without such pixels.
pub fn spread(pictures: &[Image]) -> f64 {
    let table = decode_table();
    let luminance = |&[r, g, b, _]: &[u8; 4]| {
        let [r, g, b] = [r, g, b].map(|code| f64::from(table[code as usize]));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let seen: Vec<f64> =
        pictures.iter().flat_map(Image::pixels).filter(|pixel| pixel[3] > 127).map(luminance).collect();
    let count = seen.len().max(1) as f64;
    let mean = seen.iter().sum::<f64>() / count;
    (seen.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixel: impl Fn(usize) -> [u8; 4]) -> Image {
        Image::new(32, 32, (0..1024).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    fn figures(base: &Image, other: &Image) -> [f64; 2] {
        let pair = || std::iter::once((base, other));
        [coverage(pair()), overlap(pair())]
    }

    #[test]
    fn half_the_cover_is_half() {
        let columns = |n: usize| picture(move |i| if i % 32 < n { [20, 200, 40, 255] } else { [0; 4] });
        assert_eq!(figures(&columns(16), &columns(16)), [1.0, 1.0]);
        assert_eq!(figures(&columns(16), &columns(8)), [0.5, 0.5]);
    }

    #[test]
    fn empty_pictures_agree() {
        let empty = picture(|_| [9, 9, 9, 0]);
        assert_eq!(figures(&empty, &empty), [1.0, 1.0]);
    }
}
