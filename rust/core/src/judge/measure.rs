//! Image metrics of two renders of the same view: coverage, silhouette overlap, and FLIP (Andersson et al., "FLIP: A Difference Evaluator
//! for Alternating Images", 2020; through the crate `nv-flip`, a wrapper of NVIDIA's code).

use crate::color::decode_table;
use crate::foliage::Image;

/// FLIP counts within this many pixels of a silhouette: empty background must not dilute the mean.
const REACH: usize = 4;

/// Metrics of an image against a base image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgement {
    /// Sum of alpha over the base's sum, as the mean over the views; 1 if the base is empty.
    pub coverage: f64,
    /// Intersection over union of alpha > ½.
    pub overlap: f64,
    /// Mean FLIP over mid-gray, within 4 pixels of either silhouette; in [0, 1]. The mean over views is rounded to three digits, because
    /// FLIP's code uses the platform's `pow` and further digits would differ between machines.
    pub error: f64,
}

impl Judgement {
    /// Returns the mean of each metric.
    ///
    /// # Panics
    /// If `of` is empty.
    #[must_use]
    pub fn mean(of: &[Self]) -> Self {
        assert!(!of.is_empty(), "metrics need at least one view");
        let mean = |figure: fn(&Self) -> f64| of.iter().map(figure).sum::<f64>() / of.len() as f64;
        let error = (mean(|j| j.error) * 1000.0).round() / 1000.0;
        Self { coverage: mean(|j| j.coverage), overlap: mean(|j| j.overlap), error }
    }
}

/// Least alpha sum of a base image, as a share of the greatest among the views. Smaller ones are ignored: flat foliage seen edge-on.
const LEAST_SEEN: f64 = 0.05;

/// Returns the ratio of summed alpha to the base's, as the mean over the images; 1 if all bases are empty. The mean of ratios weighs all
/// views alike: too dense from above and too thin from the side cancel out, however much more is visible from above.
pub fn coverage<'a>(pairs: impl Iterator<Item = (&'a Image, &'a Image)>) -> f64 {
    let alpha = |image: &Image| image.pixels().iter().map(|p| u64::from(p[3])).sum::<u64>() as f64;
    let sums: Vec<(f64, f64)> = pairs.map(|(base, other)| (alpha(base), alpha(other))).collect();
    let most = sums.iter().map(|(base, _)| *base).fold(0.0, f64::max);
    let told = sums.iter().filter(|(base, _)| *base > 0.0 && *base >= LEAST_SEEN * most);
    let ratios: Vec<f64> = told.map(|(base, other)| other / base).collect();
    if ratios.is_empty() { 1.0 } else { ratios.iter().sum::<f64>() / ratios.len() as f64 }
}

/// Returns the intersection over union of alpha > ½ over all images together; 1 if all are empty.
pub fn overlap<'a>(pairs: impl Iterator<Item = (&'a Image, &'a Image)>) -> f64 {
    let inside = |p: &[u8; 4]| p[3] > 127;
    let pixels = pairs.flat_map(|(a, b)| a.pixels().iter().zip(b.pixels()));
    let (both, either) = pixels.fold((0u64, 0u64), |(both, either), (a, b)| {
        (both + u64::from(inside(a) && inside(b)), either + u64::from(inside(a) || inside(b)))
    });
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// Returns the intersection over union of alpha itself: Σ min / Σ max. It also counts foliage that is too thin for silhouettes.
pub fn soft_overlap<'a>(pairs: impl Iterator<Item = (&'a Image, &'a Image)>) -> f64 {
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

/// Composites a color code over mid-gray by its alpha.
fn over_grey(code: u8, alpha: u8) -> u8 {
    let (code, alpha) = (u32::from(code), u32::from(alpha));
    ((code * alpha + 128 * (255 - alpha) + 127) / 255) as u8
}

/// Compares two images of the same size.
#[must_use]
pub fn compare(base: &Image, other: &Image) -> Judgement {
    let pair = || std::iter::once((base, other));
    Judgement { coverage: coverage(pair()), overlap: overlap(pair()), error: flip_near(base, other) }
}

fn flip_near(base: &Image, other: &Image) -> f64 {
    let (width, height) = (base.width() as u32, base.height() as u32);
    let shown = |image: &Image| -> Vec<u8> {
        image.pixels().iter().flat_map(|p| [0, 1, 2].map(|i| over_grey(p[i], p[3]))).collect()
    };
    let picture = |image| nv_flip::FlipImageRgb8::with_data(width, height, &shown(image));
    let errors = nv_flip::flip(picture(base), picture(other), nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
    let pixels = base.pixels().iter().zip(other.pixels());
    let either: Vec<bool> = pixels.map(|(a, b)| a[3].max(b[3]) > 127).collect();
    let near = grown(&either, base.width(), base.height());
    let (sum, count) = errors
        .iter()
        .zip(&near)
        .filter(|(_, near)| **near)
        .fold((0.0, 0usize), |(sum, count), (error, _)| (sum + f64::from(*error), count + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// Dilates a mask by [`REACH`] steps along rows and columns.
fn grown(inside: &[bool], width: usize, height: usize) -> Vec<bool> {
    let mut grown = inside.to_vec();
    for _ in 0..REACH {
        let last = grown.clone();
        for y in 0..height {
            for x in 0..width {
                let i = y * width + x;
                grown[i] = last[i]
                    || (x > 0 && last[i - 1])
                    || (x + 1 < width && last[i + 1])
                    || (y > 0 && last[i - width])
                    || (y + 1 < height && last[i + width]);
            }
        }
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixel: impl Fn(usize) -> [u8; 4]) -> Image {
        Image::new(32, 32, (0..1024).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_picture_is_like_itself() {
        let half = picture(|i| if i % 32 < 16 { [20, 200, 40, 255] } else { [0; 4] });
        assert_eq!(compare(&half, &half), Judgement { coverage: 1.0, overlap: 1.0, error: 0.0 });
    }

    #[test]
    fn half_the_cover_is_half() {
        let columns = |n: usize| picture(move |i| if i % 32 < n { [20, 200, 40, 255] } else { [0; 4] });
        let judged = compare(&columns(16), &columns(8));
        assert_eq!((judged.coverage, judged.overlap), (0.5, 0.5));
        assert!(judged.error > 0.05);
    }

    #[test]
    fn empty_pictures_agree() {
        let empty = picture(|_| [9, 9, 9, 0]);
        assert_eq!(compare(&empty, &empty), Judgement { coverage: 1.0, overlap: 1.0, error: 0.0 });
    }
}
