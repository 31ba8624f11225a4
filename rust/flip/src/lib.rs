//! The image error of a level: FLIP of its pictures against those of the leaves (`map`).
//!
//! The error of a level in the report is rounded to three digits; a viewer sees no others. By it `leafcloud-curve` chooses settings for a wish (`seconds`,
//! `image_error` or a `preset`), and the add-on sets LOD distances where no quality decides.

mod map;
mod sizes;

use leafcloud::Image;
use std::ops::Range;

use leafcloud::metrics::Comparison;

use map::Viewed;
pub use sizes::{ImageErrors, REPORTED_SIZE, SMALLEST, crown_pixels};

/// Returns the image error of a level against its base at [`REPORTED_SIZE`], in [0, 1]; see [`ImageErrors`].
#[must_use]
pub fn image_error(pictures: &Comparison) -> f64 {
    ImageErrors::reported(pictures)
}

/// FLIP counts within this many pixels of a silhouette: empty background must not dilute the mean.
const REACH: usize = 4;

/// FLIP of a pixel depends on the pixels within this many rows and columns: its filters end at 10.
const FILTERED: usize = 16;

/// Returns FLIP of each pixel of two images of the same size over mid-gray, row by row from the top; in [0, 1].
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn flip_map(base: &Image, other: &Image) -> Vec<f32> {
    let viewed = check_sizes(base, other).map(Viewed::of);
    (0..base.pixels().len()).map(|pixel| viewed[0].difference(&viewed[1], pixel)).collect()
}

/// Returns the mean FLIP of two images of the same size over mid-gray, within 4 pixels of either silhouette; in [0, 1]. 0 if both are
/// empty. A silhouette is where alpha is above a half, or above half of the greatest alpha of plants so thin that none is.
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn flip(base: &Image, other: &Image) -> f64 {
    let Some(seen) = seen(base, other) else { return 0.0 };
    let [base, other] = check_sizes(base, other).map(|image| cropped(image, &seen));
    Base::of(&base).flip(&other)
}

/// An image that others are compared with.
pub struct Base {
    image: Image,
    viewed: Viewed,
}

impl Base {
    /// Prepares an image.
    #[must_use]
    pub fn of(image: &Image) -> Self {
        Self { image: image.clone(), viewed: Viewed::of(image) }
    }

    /// Returns the mean FLIP of another image, as [`flip`] does.
    ///
    /// # Panics
    /// If the sizes differ.
    #[must_use]
    pub fn flip(&self, other: &Image) -> f64 {
        let [base, other] = check_sizes(&self.image, other);
        let pixels = base.pixels().iter().zip(other.pixels());
        let either: Vec<u8> = pixels.map(|(a, b)| a[3].max(b[3])).collect();
        let least = either.iter().max().map_or(127, |most| 127.min(most / 2));
        let either: Vec<bool> = either.into_iter().map(|alpha| alpha > least).collect();
        let near = grown(&either, base.width(), base.height()).into_iter().enumerate().filter(|(_, near)| *near);
        let other = Viewed::of(other);
        let (sum, count) = near.fold((0.0, 0usize), |(sum, count), (pixel, _)| {
            (sum + f64::from(self.viewed.difference(&other, pixel)), count + 1)
        });
        if count == 0 { 0.0 } else { sum / count as f64 }
    }
}

fn check_sizes<'a>(base: &'a Image, other: &'a Image) -> [&'a Image; 2] {
    assert_eq!((base.width(), base.height()), (other.width(), other.height()), "images of one size");
    [base, other]
}

/// Returns the columns and rows that can count: those of the plant in either image, with a margin. `None` if both are empty.
fn seen(base: &Image, other: &Image) -> Option<[Range<usize>; 2]> {
    let (width, height) = (base.width(), base.height());
    let drawn = |x: usize, y: usize| base.pixels()[y * width + x][3] > 0 || other.pixels()[y * width + x][3] > 0;
    let around = |count: usize, any: &dyn Fn(usize) -> bool| {
        let (first, last) = ((0..count).find(|&i| any(i))?, (0..count).rfind(|&i| any(i))?);
        let margin = REACH + FILTERED;
        Some(first.saturating_sub(margin)..(last + 1 + margin).min(count))
    };
    let columns = around(width, &|x| (0..height).any(|y| drawn(x, y)))?;
    let rows = around(height, &|y| (0..width).any(|x| drawn(x, y)))?;
    Some([columns, rows])
}

fn cropped(image: &Image, [columns, rows]: &[Range<usize>; 2]) -> Image {
    let row = |y: usize| &image.pixels()[y * image.width()..][columns.clone()];
    let pixels: Vec<[u8; 4]> = rows.clone().flat_map(row).copied().collect();
    Image::new(columns.len(), rows.len(), pixels).expect("a part of an image")
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

    fn columns(count: usize) -> Image {
        let pixel = |i: usize| if i % 32 < count { [20, 200, 40, 255] } else { [0; 4] };
        Image::new(32, 32, (0..1024).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_picture_is_like_itself() {
        assert_eq!(flip(&columns(16), &columns(16)), 0.0);
        assert_eq!(flip(&columns(0), &columns(0)), 0.0);
    }

    #[test]
    fn a_thin_plant_that_is_lost_is_off() {
        let faint = |alpha: u8| Image::new(32, 32, vec![[20, 200, 40, alpha]; 1024]).unwrap();
        assert!(flip(&faint(60), &faint(0)) > 0.05, "{}", flip(&faint(60), &faint(0)));
        assert_eq!(flip(&faint(60), &faint(60)), 0.0);
    }

    /// `image` in the middle of an empty image with this side.
    fn within(image: &Image, side: usize) -> Image {
        let first = (side - image.width()) / 2;
        let mut pixels = vec![[0; 4]; side * side];
        for (y, row) in image.pixels().chunks(image.width()).enumerate() {
            pixels[(first + y) * side + first..][..row.len()].copy_from_slice(row);
        }
        Image::new(side, side, pixels).unwrap()
    }

    #[test]
    fn the_background_does_not_count() {
        let near = flip(&within(&columns(16), 80), &within(&columns(8), 80));
        let far = flip(&within(&columns(16), 200), &within(&columns(8), 200));
        assert_eq!(near, far);
        let [base, other] = [columns(16), columns(8)].map(|image| within(&image, 200));
        let map = flip_map(&base, &other);
        let near = grown(&base.pixels().iter().map(|p| p[3] > 0).collect::<Vec<_>>(), 200, 200);
        let counted: Vec<f64> = map.iter().zip(&near).filter(|(_, near)| **near).map(|(e, _)| f64::from(*e)).collect();
        assert!((far - counted.iter().sum::<f64>() / counted.len() as f64).abs() < 1e-6, "{far}");
    }

    #[test]
    fn half_a_picture_is_off() {
        let error = flip(&columns(16), &columns(8));
        assert!(error > 0.05 && error <= 1.0, "{error}");
    }

    #[test]
    fn the_map_shows_the_missing_columns() {
        let map = flip_map(&columns(16), &columns(8));
        assert_eq!(map.len(), 1024);
        let column = |x: usize| (0..32).map(|y| map[32 * y + x]).sum::<f32>() / 32.0;
        assert!(column(12) > 0.05 && column(12) < 1.0, "{}", column(12));
        // FLIP blurs, so a few columns beside the missing ones differ too.
        assert!(column(2) < 0.5 * column(12), "{} {}", column(2), column(12));
        assert!(column(30) < 0.1 * column(12), "{}", column(30));
        assert!(flip_map(&columns(16), &columns(16)).iter().all(|error| *error == 0.0));
    }
}
