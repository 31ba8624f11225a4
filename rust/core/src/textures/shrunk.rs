//! Smaller pictures of any size: each pixel is the mean over its area.

use glam::Vec4;
use rayon::prelude::*;

use super::channels::Channel;
use super::raster::Canvas;
use crate::foliage::Image;

/// A pixel of the larger picture, and its share of a pixel of the smaller one.
type Part = (usize, f32);

/// Returns a picture with sides of at most its own, by means of linear light over the areas of pixels, weighted by alpha.
pub(crate) fn shrunk(image: &Image, width: usize, height: usize) -> Image {
    let canvas = Canvas::of_color(image);
    let (across, down) = (parts(canvas.width, width), parts(canvas.height, height));
    let row = |row: &[Vec4]| across.iter().map(|parts| mean(parts, |pixel| row[pixel])).collect();
    let rows: Vec<Vec<Vec4>> = canvas.pixels.par_chunks_exact(canvas.width).map(row).collect();
    let column = |parts: &[Part], x: usize| mean(parts, |row| rows[row][x]);
    let pixels = down.iter().flat_map(|parts| (0..width).map(|x| column(parts, x))).collect();
    Channel::BaseColor.to_image(&Canvas { width, height, pixels })
}

/// Returns the pixels of a line under each pixel of a line of the same length with fewer of them.
fn parts(many: usize, few: usize) -> Vec<Vec<Part>> {
    let of = |pixel: usize| {
        // In units of 1 / (many · few) of the line.
        let (from, to) = (pixel * many, (pixel + 1) * many);
        let part = |of: usize| (of, ((to.min((of + 1) * few) - from.max(of * few)) as f32 / many as f32));
        (from / few..to.div_ceil(few)).map(part).collect()
    };
    (0..few).map(of).collect()
}

fn mean(parts: &[Part], pixel: impl Fn(usize) -> Vec4) -> Vec4 {
    parts.iter().map(|&(number, share)| pixel(number) * share).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_the_lengths_under_a_pixel() {
        assert_eq!(parts(3, 2), [[(0, 2.0 / 3.0), (1, 1.0 / 3.0)], [(1, 1.0 / 3.0), (2, 2.0 / 3.0)]]);
        assert_eq!(parts(2, 2), [[(0, 1.0)], [(1, 1.0)]]);
        assert_eq!(parts(4, 1), [[0, 1, 2, 3].map(|pixel| (pixel, 0.25))]);
    }

    #[test]
    fn a_smaller_picture_keeps_light_and_coverage() {
        let red = |alpha| [255, 0, 0, alpha];
        let image = Image::new(3, 1, vec![red(255), red(0), [0, 0, 255, 255]]).unwrap();
        assert_eq!(shrunk(&image, 3, 1).pixels()[0], red(255));
        // Two thirds of the first pixel show the first texel, the rest shows nothing.
        assert_eq!(shrunk(&image, 2, 1).pixels(), [red(170), [0, 0, 255, 170]]);
        let [r, g, b, a] = shrunk(&image, 1, 1).pixels()[0];
        assert_eq!((r, g, b, a), (188, 0, 188, 170), "half the light of the drawn area is red, half is blue");
    }
}
