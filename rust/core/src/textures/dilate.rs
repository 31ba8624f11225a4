//! Colour under transparent texels, so that filtering and mips find no other: push-pull (Gortler, Grzeszczuk, Szeliski, Cohen,
//! "The Lumigraph", 1996). Averages of what is there are pulled up a pyramid and pushed down to where nothing is. O(texels).

use glam::{Vec3, Vec4};

use super::raster::Canvas;

/// Gives each pixel without coverage the colour of its surroundings; coverage stays 0. Without any covered pixel nothing changes.
pub fn fill_transparent(canvas: &mut Canvas) {
    let filled = fill(canvas);
    for (pixel, color) in canvas.pixels.iter_mut().zip(filled) {
        if pixel.w == 0.0 {
            *pixel = color.extend(0.0);
        }
    }
}

/// The straight colour of every pixel, those without coverage filled from coarser pictures.
fn fill(canvas: &Canvas) -> Vec<Vec3> {
    let own = |p: &Vec4| if p.w > 0.0 { Some(p.truncate() / p.w) } else { None };
    if (canvas.width == 1 && canvas.height == 1) || canvas.pixels.iter().all(|p| p.w > 0.0) {
        return canvas.pixels.iter().map(|p| own(p).unwrap_or(Vec3::ZERO)).collect();
    }
    let coarse = halve(canvas);
    let below = fill(&coarse);
    let surroundings = |i: usize| below[i / canvas.width / 2 * coarse.width + i % canvas.width / 2];
    canvas.pixels.iter().enumerate().map(|(i, p)| own(p).unwrap_or_else(|| surroundings(i))).collect()
}

/// Sums of 2 × 2 pixels; the last column and row of an odd side stand alone.
fn halve(canvas: &Canvas) -> Canvas {
    let (width, height) = (canvas.width.div_ceil(2), canvas.height.div_ceil(2));
    let mut pixels = vec![Vec4::ZERO; width * height];
    for (i, pixel) in canvas.pixels.iter().enumerate() {
        pixels[i / canvas.width / 2 * width + i % canvas.width / 2] += *pixel;
    }
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
