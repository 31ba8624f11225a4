//! Means of 2 × 2 texels, separately for each region.
//!
//! On small levels regions are less than a texel apart, and a texel that reaches into two regions would mix them. So each texel has an
//! owner region, and is the mean of the part of the four texels that its owner covers.

use glam::Vec4;
use rayon::prelude::*;

use super::raster::Canvas;
use crate::atlas::Region;

/// A mip level, and the region of each of its texels.
pub struct Owned {
    /// Premultiplied.
    pub means: Canvas,
    owners: Vec<u32>,
}

impl Owned {
    /// Returns level 0.
    pub fn new(means: Canvas, regions: &[Region]) -> Self {
        let owners = owners(regions, means.width, means.height);
        Self { means, owners }
    }

    /// Returns the next level; `regions` are the regions there.
    pub fn halved(&self, regions: &[Region]) -> Self {
        let (width, height) = half_size(&self.means);
        let mut owners = owners(regions, width, height);
        settle(&mut owners, &self.owners, &self.means);
        let means = halved_where(&self.means, |here, of| self.owners[of] == owners[here]);
        Self { means, owners }
    }
}

/// Returns the width and height of the next level.
pub fn half_size(canvas: &Canvas) -> (usize, usize) {
    ((canvas.width / 2).max(1), (canvas.height / 2).max(1))
}

/// Returns means of 2 × 2 texels. The last column and row of an odd side are left out, as graphics APIs define mip levels. A side of 1
/// stays.
pub fn halved(canvas: &Canvas) -> Canvas {
    halved_where(canvas, |_, _| true)
}

/// Returns means of 2 × 2 texels, with 0 for texels where `counts(target, texel)` is false.
fn halved_where(canvas: &Canvas, counts: impl Fn(usize, usize) -> bool + Sync) -> Canvas {
    let (width, height) = half_size(canvas);
    let mean = |x: usize, y: usize| {
        let counting = children(canvas, x, y).filter(|&texel| counts(y * width + x, texel));
        let count = canvas.width.min(2) * canvas.height.min(2);
        counting.fold(Vec4::ZERO, |sum, texel| sum + canvas.pixels[texel]) / count as f32
    };
    let mut pixels = vec![Vec4::ZERO; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = mean(x, y);
        }
    });
    Canvas { width, height, pixels }
}

/// Returns the texels that are averaged into the texel (x, y) of the next level.
fn children(canvas: &Canvas, x: usize, y: usize) -> impl Iterator<Item = usize> {
    let (width, across, down) = (canvas.width, canvas.width.min(2), canvas.height.min(2));
    (0..across * down).map(move |i| (down * y + i / across) * width + across * x + i % across)
}

/// Owner of texels outside all regions.
const NONE: u32 = u32::MAX;

fn owners(regions: &[Region], width: usize, height: usize) -> Vec<u32> {
    let mut owners = vec![NONE; width * height];
    for (number, region) in (0..).zip(regions) {
        texels(*region, width).for_each(|texel| owners[texel] = number);
    }
    owners
}

/// Assigns each texel outside all regions to the region that covers most of it.
fn settle(owners_here: &mut [u32], owners: &[u32], canvas: &Canvas) {
    let width = (canvas.width / 2).max(1);
    owners_here.par_iter_mut().enumerate().filter(|(_, owner)| **owner == NONE).for_each(|(here, owner)| {
        let candidates = children(canvas, here % width, here / width);
        let covered = |of: u32| -> f32 {
            let own = children(canvas, here % width, here / width).filter(|&texel| owners[texel] == of);
            own.map(|texel| canvas.pixels[texel].w).sum()
        };
        // The first region wins a tie.
        let most =
            |(best, most): (u32, f32), of: u32| if covered(of) > most { (of, covered(of)) } else { (best, most) };
        *owner = candidates.map(|texel| owners[texel]).fold((NONE, 0.0), most).0;
    });
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
