//! Texels in linear light with alpha. Colors are not weighted by alpha, as in engines that filter the texture of a PNG file.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::raster::Canvas;
use crate::color::{decode_table, encode, quantise};
use crate::foliage::Image;

/// Colors that are not multiplied by alpha; row 0 on top.
#[derive(Clone)]
pub struct LightGrid(pub Canvas);

/// Returns the linear light of a pixel, with alpha.
pub fn light([r, g, b, alpha]: [u8; 4]) -> Vec4 {
    let light = Vec3::from_array([r, g, b].map(|code| decode_table()[code as usize]));
    light.extend(f32::from(alpha) / 255.0)
}

impl LightGrid {
    pub fn of(image: &Image) -> Self {
        let pixels = image.pixels().par_iter().copied().map(light).collect();
        Self(Canvas { width: image.width(), height: image.height(), pixels })
    }

    /// Returns the image with the alpha that a function makes of each texel and its index.
    pub fn image(&self, alpha: impl Fn(usize, &Vec4) -> f32 + Sync) -> Image {
        let code = |(index, texel): (usize, &Vec4)| {
            [encode(texel.x), encode(texel.y), encode(texel.z), quantise(alpha(index, texel))]
        };
        let pixels: Vec<[u8; 4]> = self.0.pixels.par_iter().enumerate().map(code).collect();
        Image::new(self.0.width, self.0.height, pixels).expect("as many texels as before")
    }

    /// Returns the index of the texel at a point, given by its texture coordinates.
    pub fn nearest(&self, point: &Vec4) -> u32 {
        let Canvas { width, height, .. } = self.0;
        let column = (point.x * width as f32) as usize;
        let row = ((1.0 - point.y) * height as f32) as usize;
        (row.min(height - 1) * width + column.min(width - 1)) as u32
    }

    /// Returns the color at a point, between its four texels, with 1; zeros where nothing is drawn.
    pub fn color_at(&self, point: &Vec4) -> Vec4 {
        if point.w == 0.0 { Vec4::ZERO } else { self.at(point.x, 1.0 - point.y).truncate().extend(1.0) }
    }

    /// Returns the bilinearly filtered texel at a place: its distances from the left and the upper side, relative to the sides of the image.
    fn at(&self, right: f32, down: f32) -> Vec4 {
        let Canvas { width, height, pixels } = &self.0;
        let place = |share: f32, size: usize| (share * size as f32 - 0.5).clamp(0.0, (size - 1) as f32);
        let (x, y) = (place(right, *width), place(down, *height));
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let texel = |column: usize, row: usize| pixels[row * width + column];
        let across = |row: usize| texel(left, row).lerp(texel(right, row), x - left as f32);
        across(top).lerp(across(bottom), y - top as f32)
    }
}
