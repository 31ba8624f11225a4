//! How far two pictures of the same view differ: coverage, silhouettes, and FLIP (Andersson et al., "FLIP: A Difference Evaluator
//! for Alternating Images", 2020; the crate `nv-flip` wraps NVIDIA's own).

use crate::foliage::Image;

/// FLIP counts only this close to a silhouette, so that empty ground does not dilute it.
const REACH: usize = 4;

/// What one picture is beside another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgement {
    /// See [`coverage`].
    pub coverage: f64,
    /// Intersection over union of alpha > ½.
    pub overlap: f64,
    /// Mean FLIP over mid-grey, within 4 pixels of either silhouette; in [0, 1].
    pub error: f64,
}

impl Judgement {
    /// The mean of each figure.
    ///
    /// # Panics
    /// Without judgements.
    #[must_use]
    pub fn mean(of: &[Self]) -> Self {
        assert!(!of.is_empty(), "the judge looks at least once");
        let mean = |figure: fn(&Self) -> f64| of.iter().map(figure).sum::<f64>() / of.len() as f64;
        Self { coverage: mean(|j| j.coverage), overlap: mean(|j| j.overlap), error: mean(|j| j.error) }
    }
}

/// Sum of alpha over that of the base; 1 when both are empty.
pub fn coverage(base: &Image, other: &Image) -> f64 {
    let alpha = |image: &Image| image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>();
    match (alpha(base), alpha(other)) {
        (0.0, 0.0) => 1.0,
        (base, other) => other / base,
    }
}

/// Compares two pictures of one size.
#[must_use]
pub fn compare(base: &Image, other: &Image) -> Judgement {
    let inside = |image: &Image| image.pixels().iter().map(|p| p[3] > 127).collect::<Vec<bool>>();
    let (a, b) = (inside(base), inside(other));
    let count = |keep: fn(bool, bool) -> bool| a.iter().zip(&b).filter(|(a, b)| keep(**a, **b)).count() as f64;
    let (both, either) = (count(|a, b| a && b), count(|a, b| a || b));
    Judgement {
        coverage: coverage(base, other),
        overlap: if either > 0.0 { both / either } else { 1.0 },
        error: flip_near(base, other, &a, &b),
    }
}

fn flip_near(base: &Image, other: &Image, a: &[bool], b: &[bool]) -> f64 {
    let (width, height) = (base.width() as u32, base.height() as u32);
    let over_grey = |image: &Image| -> Vec<u8> {
        let blend =
            |c: u8, alpha: u8| (u32::from(c) * u32::from(alpha) + 128 * (255 - u32::from(alpha))).div_ceil(255) as u8;
        image.pixels().iter().flat_map(|p| [0, 1, 2].map(|i| blend(p[i], p[3]))).collect()
    };
    let picture = |image| nv_flip::FlipImageRgb8::with_data(width, height, &over_grey(image));
    let errors = nv_flip::flip(picture(base), picture(other), nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
    let either: Vec<bool> = a.iter().zip(b).map(|(a, b)| *a || *b).collect();
    let near = grown(&either, base.width(), base.height());
    let (sum, count) = errors
        .iter()
        .zip(&near)
        .filter(|(_, near)| **near)
        .fold((0.0, 0usize), |(sum, count), (error, _)| (sum + f64::from(*error), count + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// All pixels within [`REACH`] steps (along rows and columns) of one inside.
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
