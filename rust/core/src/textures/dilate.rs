//! Color under transparent texels, so that filters and mip levels find no other color: push-pull (Gortler, Grzeszczuk, Szeliski, Cohen,
//! "The Lumigraph", 1996). Averages of covered texels are pulled up a pyramid and pushed down into the gaps. O(texels).

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::raster::Canvas;
use crate::error::Result;
use crate::foliage::Image;

/// Gives each pixel without coverage the color of its surroundings; coverage stays 0. A canvas without covered pixels stays unchanged.
pub fn fill_transparent(canvas: &mut Canvas) {
    if canvas.pixels.par_iter().all(|p| p.w > 0.0) || (canvas.width == 1 && canvas.height == 1) {
        return;
    }
    let mut coarse = halve(canvas);
    fill_transparent(&mut coarse);
    canvas.pixels.par_chunks_mut(canvas.width).enumerate().for_each(|(y, row)| {
        let below = &coarse.pixels[y / 2 * coarse.width..][..coarse.width];
        for (x, pixel) in row.iter_mut().enumerate().filter(|(_, pixel)| pixel.w == 0.0) {
            *pixel = straight(below[x / 2]).extend(0.0);
        }
    });
}

/// Returns an image of the known pixels, unchanged whatever their alpha. The others become transparent, with the mean color of their
/// surroundings. `width` is the row length.
pub fn fill_gaps(width: usize, pixels: &[Option<[u8; 4]>]) -> Image {
    let color = |[r, g, b, _]: [u8; 4]| Vec3::new(f32::from(r), f32::from(g), f32::from(b));
    let known = pixels.iter().map(|pixel| pixel.map_or(Vec4::ZERO, |code| color(code).extend(1.0)));
    let mut canvas = Canvas { width, height: pixels.len() / width, pixels: known.collect() };
    fill_transparent(&mut canvas);
    let filled = |(pixel, around): (&Option<[u8; 4]>, &Vec4)| {
        let [r, g, b, _] = around.to_array().map(|code| code.round() as u8);
        pixel.unwrap_or([r, g, b, 0])
    };
    let filled: Vec<[u8; 4]> = pixels.iter().zip(&canvas.pixels).map(filled).collect();
    Image::new(width, canvas.height, filled).expect("whole rows")
}

/// Fills texels of an alpha below `cutoff`, from 0 to 255, with the mean color of the nearest other texels. Alpha stays unchanged.
///
/// # Errors
///
/// Those of [`Image::new`], which an image of the same size never has.
pub fn fill_below(image: &Image, cutoff: f32) -> Result<Image> {
    let known: Vec<_> = image.pixels().iter().map(|pixel| (f32::from(pixel[3]) >= cutoff).then_some(*pixel)).collect();
    let filled = fill_gaps(image.width(), &known);
    let whole = filled.pixels().iter().zip(image.pixels()).map(|([r, g, b, _], own)| [*r, *g, *b, own[3]]);
    Image::new(image.width(), image.height(), whole.collect::<Vec<_>>())
}

/// Returns the straight color of a pixel. Pixels without coverage hold it unweighted.
fn straight(pixel: Vec4) -> Vec3 {
    if pixel.w > 0.0 { pixel.truncate() / pixel.w } else { pixel.truncate() }
}

/// Returns the sums of 2 × 2 pixels; the last column and row of an odd side are not paired.
fn halve(canvas: &Canvas) -> Canvas {
    let (width, height) = (canvas.width.div_ceil(2), canvas.height.div_ceil(2));
    let mut pixels = vec![Vec4::ZERO; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for source in canvas.pixels[2 * y * canvas.width..].chunks(canvas.width).take(2) {
            for (sum, pair) in row.iter_mut().zip(source.chunks(2)) {
                for pixel in pair {
                    *sum += *pixel;
                }
            }
        }
    });
    Canvas { width, height, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_pixels_take_the_only_colour() {
        let mut pixels = vec![Vec4::ZERO; 7 * 5];
        pixels[9] = Vec4::new(0.25, 0.5, 0.0, 0.5);
        let mut canvas = Canvas { width: 7, height: 5, pixels };
        fill_transparent(&mut canvas);
        for (i, p) in canvas.pixels.iter().enumerate() {
            let expected = if i == 9 { Vec4::new(0.25, 0.5, 0.0, 0.5) } else { Vec4::new(0.5, 1.0, 0.0, 0.0) };
            assert_eq!(*p, expected, "pixel {i}");
        }
    }

    #[test]
    fn colors_below_the_cutoff_are_those_around_and_alpha_stays() {
        let pixels = vec![[10, 200, 30, 255], [255, 255, 255, 100], [255, 255, 255, 0], [10, 200, 30, 128]];
        let filled = fill_below(&Image::new(4, 1, pixels).unwrap(), 127.5).unwrap();
        assert_eq!(filled.pixels(), [[10, 200, 30, 255], [10, 200, 30, 100], [10, 200, 30, 0], [10, 200, 30, 128]]);
    }

    #[test]
    fn the_nearest_colour_wins_within_a_quad() {
        let (red, blue) = (Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 0.0, 1.0, 1.0));
        let mut canvas = Canvas { width: 4, height: 1, pixels: vec![red, Vec4::ZERO, Vec4::ZERO, blue] };
        fill_transparent(&mut canvas);
        assert_eq!(canvas.pixels[1].truncate(), red.truncate());
        assert_eq!(canvas.pixels[2].truncate(), blue.truncate());
    }

    #[test]
    fn nothing_to_fill_from() {
        let mut canvas = Canvas { width: 3, height: 2, pixels: vec![Vec4::ZERO; 6] };
        fill_transparent(&mut canvas);
        assert!(canvas.pixels.iter().all(|p| *p == Vec4::ZERO));
    }
}
