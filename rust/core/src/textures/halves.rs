//! Means of 2 × 2 texels.

use glam::Vec4;
use rayon::prelude::*;

use super::raster::Canvas;
use crate::atlas::Region;

/// Returns means of 2 × 2 texels. The last column and row of an odd side are left out, as graphics APIs define mip levels. A side of 1
/// stays.
pub fn halved(canvas: &Canvas) -> Canvas {
    let (width, height) = ((canvas.width / 2).max(1), (canvas.height / 2).max(1));
    let (across, down) = (canvas.width.min(2), canvas.height.min(2));
    let mean = |x: usize, y: usize| {
        let texel = |i: usize| canvas.pixels[(down * y + i / across) * canvas.width + across * x + i % across];
        (0..across * down).map(texel).sum::<Vec4>() / (across * down) as f32
    };
    let mut pixels = vec![Vec4::ZERO; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = mean(x, y);
        }
    });
    Canvas { width, height, pixels }
}

/// Returns the texels of a smaller level, by the factor `scale`, that lie mostly in a region of level 0; at least one.
pub fn smaller(region: Region, scale: usize, width: usize, height: usize) -> Region {
    let along = |start: usize, length: usize, side: usize| {
        let round = |at: usize| (at + scale / 2) / scale;
        let first = round(start).min(side - 1);
        (first, round(start + length).min(side).saturating_sub(first).max(1))
    };
    let ((x, width), (y, height)) = (along(region.x, region.width, width), along(region.y, region.height, height));
    Region { x, y, width, height }
}

/// Returns the indices of a region's texels.
pub fn texels(region: Region, width: usize) -> impl Iterator<Item = usize> {
    (region.y..region.y + region.height)
        .flat_map(move |y| (region.x..region.x + region.width).map(move |x| y * width + x))
}
