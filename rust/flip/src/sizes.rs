//! The image error of a level by the size of its pictures.
//!
//! A leaf that moves by a hundredth of the crown moves by two pixels in a large picture, and by nothing that one sees in a small one. So the
//! error falls with the size, and each level has a largest size at which nobody notices that it replaces the leaves.

use leafcloud::Image;
use leafcloud::metrics::{Comparison, PICTURE_RADIUS, Pictures};
use leafcloud::textures::mips;
use rayon::prelude::*;

use crate::flip;

/// Side of the pictures of the reported image error, in pixels.
pub const REPORTED_SIZE: usize = 128;

/// Side of the smallest pictures, in pixels. Smaller ones hardly tell a tree from a dot.
pub const SMALLEST: usize = 8;

/// Returns the diameter in pixels of the leaves' sphere in a picture of this side.
#[must_use]
pub fn crown_pixels(side: f64) -> f64 {
    side / PICTURE_RADIUS
}

/// Image errors by size: the side of the pictures in pixels, ascending, and the mean of [`flip`] over all views, rounded to three digits,
/// because further digits would differ between machines.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageErrors(pub Vec<(usize, f64)>);

impl ImageErrors {
    /// Returns the errors at the size of the pictures and at halves of it, down to [`SMALLEST`]: of flat-lit pictures or of those under a
    /// sun, whichever are larger.
    #[must_use]
    pub fn of(pictures: &Comparison) -> Self {
        let flat = Self::down_from_largest(&pictures.flat);
        let Some(lit) = pictures.lit.as_ref().map(Self::down_from_largest) else { return flat };
        let larger = |(&(size, flat), &(_, lit)): (&(usize, f64), &(usize, f64))| (size, flat.max(lit));
        Self(flat.0.iter().zip(&lit.0).map(larger).collect())
    }

    /// Returns the errors at the size of the pictures and at halves of it. The pictures keep them.
    fn down_from_largest(pictures: &Pictures) -> Self {
        Self(pictures.errors.get_or_init(|| Self::measured(pictures).0).clone())
    }

    fn measured(pictures: &Pictures) -> Self {
        let largest = pictures.base.first().map_or(0, Image::width);
        let mut sizes: Vec<usize> =
            std::iter::successors(Some(largest), |size| Some(size / 2)).take_while(|size| *size >= SMALLEST).collect();
        sizes.reverse();
        Self::at_sizes(pictures, &sizes)
    }

    /// Returns the error of flat-lit pictures at [`REPORTED_SIZE`].
    pub(crate) fn reported(pictures: &Comparison) -> f64 {
        let kept = Self::down_from_largest(&pictures.flat);
        let found = kept.0.iter().find(|(size, _)| *size == REPORTED_SIZE);
        found.map_or_else(|| Self::at_sizes(&pictures.flat, &[REPORTED_SIZE]).0[0].1, |(_, error)| *error)
    }

    /// Returns the errors at `sizes`: halves of the size of the pictures.
    fn at_sizes(pictures: &Pictures, sizes: &[usize]) -> Self {
        let pairs = pictures.base.par_iter().zip(pictures.level.par_iter());
        let errors_of = |(base, level): (&Image, &Image)| -> Vec<f64> {
            let [base, level] = [base, level].map(mips::means);
            let at = |size: usize| {
                let mut pairs = base.iter().zip(&level);
                pairs.find(|(base, _)| base.width() <= size).map_or(0.0, |(base, level)| flip(base, level))
            };
            sizes.iter().map(|&size| at(size)).collect()
        };
        let views: Vec<Vec<f64>> = pairs.map(errors_of).collect();
        let mean = |i: usize| views.iter().map(|errors| errors[i]).sum::<f64>() / views.len() as f64;
        Self(sizes.iter().enumerate().map(|(i, &size)| (size, (mean(i) * 1000.0).round() / 1000.0)).collect())
    }

    /// Returns the largest size in pixels up to which the error is at most `target`, or `None` if the smallest picture has a larger error.
    ///
    /// Between two sizes the error is taken as linear in the logarithm of the size; above the largest, it goes on as it grew before. The
    /// result is infinite if it did not grow.
    #[must_use]
    pub fn largest_size(&self, target: f64) -> Option<f64> {
        let errors = &self.0;
        let (&(smallest, least), rest) = errors.split_first()?;
        if least > target {
            return None;
        }
        let (mut below, mut before) = (smallest as f64, least);
        let mut growth = 0.0;
        for &(size, error) in rest {
            growth = (error - before).max(0.0) / libm::log2(size as f64 / below);
            if error > target {
                break;
            }
            (below, before) = (size as f64, error);
        }
        Some(if growth > 0.0 { below * libm::exp2((target - before) / growth) } else { f64::INFINITY })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn errors(all: &[(usize, f64)]) -> ImageErrors {
        ImageErrors(all.to_vec())
    }

    #[test]
    fn the_largest_size_is_where_the_error_crosses_the_target() {
        let rising = errors(&[(8, 0.02), (16, 0.04), (32, 0.08)]);
        assert_eq!(rising.largest_size(0.02), Some(8.0));
        assert!((rising.largest_size(0.06).unwrap() - 16.0 * 2f64.sqrt()).abs() < 1e-9, "half of an octave");
        assert!((rising.largest_size(0.12).unwrap() - 64.0).abs() < 1e-9, "as it grew before");
        assert_eq!(rising.largest_size(0.01), None);
    }

    #[test]
    fn the_first_crossing_counts() {
        let wavy = errors(&[(8, 0.02), (16, 0.06), (32, 0.04), (64, 0.09)]);
        assert!((wavy.largest_size(0.04).unwrap() - 8.0 * 2f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn an_error_that_does_not_grow_sets_no_size() {
        assert_eq!(errors(&[(8, 0.0), (16, 0.0)]).largest_size(0.06), Some(f64::INFINITY));
        assert_eq!(errors(&[(8, 0.05), (16, 0.03)]).largest_size(0.06), Some(f64::INFINITY));
    }

    /// A picture of columns of one pixel, shifted by `shift` pixels.
    fn comb(shift: usize) -> Image {
        let pixel = |i: usize| if (i % 64 + shift).is_multiple_of(2) { [20, 200, 40, 255] } else { [0; 4] };
        Image::new(64, 64, (0..64 * 64).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_shift_by_a_pixel_is_gone_at_half_of_the_size() {
        let flat = Pictures::new(Arc::from([comb(0)]), vec![comb(1)]);
        let pictures = Comparison { flat, lit: None };
        let ImageErrors(found) = ImageErrors::of(&pictures);
        assert_eq!(found.iter().map(|(size, _)| *size).collect::<Vec<_>>(), [8, 16, 32, 64]);
        assert!(found[3].1 > 0.05, "{found:?}");
        assert!(found[..3].iter().all(|(_, error)| *error == 0.0), "{found:?}");
    }
}
