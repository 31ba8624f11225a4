//! The image error of a level by the size of its pictures.
//!
//! A leaf that moves by a hundredth of the crown moves by two pixels in a large picture, and by nothing that one sees in a small one. So the
//! error falls with the size, and each level has a largest size at which nobody notices that it replaces the leaves.

use std::cell::OnceCell;
use std::sync::PoisonError;

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

/// Image errors by size: the side of the pictures in pixels, ascending, and the mean of [`flip`] over all views, rounded to three digits:
/// further ones say nothing about what a viewer sees.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageErrors(pub Vec<(usize, f64)>);

impl ImageErrors {
    /// Returns the errors at the size of the pictures and at halves of it, down to [`SMALLEST`]: of flat-lit pictures or of those under a
    /// sun, whichever are larger.
    #[must_use]
    pub fn of(pictures: &Comparison) -> Self {
        Self::up_to(pictures, f64::INFINITY)
    }

    /// Returns the errors of [`Self::of`] up to the first one above `target`. They have the same [`Self::largest_size`] for this target as all
    /// errors. Large pictures take most of the time, and few levels are within a target in them.
    #[must_use]
    pub fn up_to(pictures: &Comparison, target: f64) -> Self {
        let all: Vec<Judged> = std::iter::once(&pictures.flat).chain(&pictures.lit).map(Judged::new).collect();
        let mut errors = Vec::new();
        for size in all[0].sizes() {
            let error = all.iter().map(|judged| judged.error(size)).fold(0.0, f64::max);
            errors.push((size, error));
            if error > target {
                break;
            }
        }
        Self(errors)
    }

    /// Returns the error of flat-lit pictures at [`REPORTED_SIZE`].
    pub(crate) fn reported(pictures: &Comparison) -> f64 {
        Judged::new(&pictures.flat).error(REPORTED_SIZE)
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

/// Pictures with errors that are measured size by size, and kept.
struct Judged<'a> {
    pictures: &'a Pictures,
    /// Pictures of the base and of the level in each view with their halves, made for the first size that is measured.
    halves: OnceCell<Vec<[mips::Levels; 2]>>,
}

impl<'a> Judged<'a> {
    fn new(pictures: &'a Pictures) -> Self {
        Self { pictures, halves: OnceCell::new() }
    }

    fn halves(&self) -> &[[mips::Levels; 2]] {
        self.halves.get_or_init(|| {
            let pairs = self.pictures.base.par_iter().zip(self.pictures.level.par_iter());
            pairs.map(|(base, level)| [base, level].map(mips::means)).collect()
        })
    }

    /// Returns the side of the pictures and halves of it, ascending from [`SMALLEST`].
    fn sizes(&self) -> impl Iterator<Item = usize> + use<> {
        let largest = self.pictures.base.first().map_or(0, Image::width);
        let sizes = std::iter::successors(Some(largest), |size| Some(size / 2)).take_while(|size| *size >= SMALLEST);
        sizes.collect::<Vec<_>>().into_iter().rev()
    }

    /// Returns the mean error over all views in pictures of at most this size, rounded to three digits.
    fn error(&self, size: usize) -> f64 {
        let kept = || self.pictures.errors.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = kept().get(&size) {
            return *error;
        }
        let of_view = |[base, level]: &[mips::Levels; 2]| {
            let mut pairs = base.iter().zip(level);
            pairs.find(|(base, _)| base.width() <= size).map_or(0.0, |(base, level)| flip(base, level))
        };
        let errors: Vec<f64> = self.halves().par_iter().map(of_view).collect();
        let error = (errors.iter().sum::<f64>() / errors.len() as f64 * 1000.0).round() / 1000.0;
        kept().insert(size, error);
        error
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

    #[test]
    fn errors_up_to_a_target_end_above_it() {
        // Half of the pixels of a block of 8 × 8 are lost: an error at every size.
        let block = |kept: usize| {
            let pixel = |i: usize| if i % 64 < 32 && i / 64 < kept { [20, 200, 40, 255] } else { [0; 4] };
            Image::new(64, 64, (0..64 * 64).map(pixel).collect::<Vec<_>>()).unwrap()
        };
        let pictures = |lit: bool| Comparison {
            flat: Pictures::new(Arc::from([comb(0)]), vec![comb(1)]),
            lit: lit.then(|| Pictures::new(Arc::from([block(64)]), vec![block(32)])),
        };
        for lit in [false, true] {
            let all = ImageErrors::of(&pictures(lit));
            for target in [0.0, 0.02, 0.1, 0.2, 0.9] {
                let some = ImageErrors::up_to(&pictures(lit), target);
                assert!(all.0.starts_with(&some.0), "{all:?} {some:?}");
                assert_eq!(some.largest_size(target), all.largest_size(target), "{all:?} {some:?}");
            }
        }
        assert_eq!(ImageErrors::up_to(&pictures(true), 0.0).0.len(), 1, "the smallest picture is above it");
    }
}
