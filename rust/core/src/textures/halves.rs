//! Means of 2 × 2 texels, of each region by itself.
//!
//! On small levels regions lie nearer to one another than a texel is wide; one that reached into two would be a mean of both. So each texel
//! has an owner, and is the mean of what its owner has of the four.

use glam::Vec4;
use rayon::prelude::*;

use super::raster::Canvas;
use crate::sheet::Region;

/// A level, and in which region each of its texels lies.
pub struct Owned {
    /// Premultiplied.
    pub means: Canvas,
    owners: Vec<u32>,
}

impl Owned {
    /// Level 0.
    pub fn new(means: Canvas, regions: &[Region]) -> Self {
        let owners = owners(regions, means.width, means.height);
        Self { means, owners }
    }

    /// The next, on which the regions are these.
    pub fn halved(&self, regions: &[Region]) -> Self {
        let (width, height) = half_size(&self.means);
        let mut owners = owners(regions, width, height);
        settle(&mut owners, &self.owners, &self.means);
        let means = halved_where(&self.means, |here, of| self.owners[of] == owners[here]);
        Self { means, owners }
    }
}

/// How many texels the next level has.
pub fn half_size(canvas: &Canvas) -> (usize, usize) {
    ((canvas.width / 2).max(1), (canvas.height / 2).max(1))
}

/// Means of 2 × 2; the last column and row of an odd side are left out, as graphics interfaces define levels. A side of 1 stays.
pub fn halved(canvas: &Canvas) -> Canvas {
    halved_where(canvas, |_, _| true)
}

/// The same, of those texels that count for the one that they become; others count as nothing.
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

/// The texels that become one.
fn children(canvas: &Canvas, x: usize, y: usize) -> impl Iterator<Item = usize> {
    let (width, across, down) = (canvas.width, canvas.width.min(2), canvas.height.min(2));
    (0..across * down).map(move |i| (down * y + i / across) * width + across * x + i % across)
}

/// In which region a texel lies.
const NONE: u32 = u32::MAX;

fn owners(regions: &[Region], width: usize, height: usize) -> Vec<u32> {
    let mut owners = vec![NONE; width * height];
    for (number, region) in (0..).zip(regions) {
        texels(*region, width).for_each(|texel| owners[texel] = number);
    }
    owners
}

/// Texels of which no region has most show the one that covers most of them.
fn settle(owners_here: &mut [u32], owners: &[u32], canvas: &Canvas) {
    let width = (canvas.width / 2).max(1);
    owners_here.par_iter_mut().enumerate().filter(|(_, owner)| **owner == NONE).for_each(|(here, owner)| {
        let candidates = children(canvas, here % width, here / width);
        let covered = |of: u32| -> f32 {
            let own = children(canvas, here % width, here / width).filter(|&texel| owners[texel] == of);
            own.map(|texel| canvas.pixels[texel].w).sum()
        };
        // The first of those that cover as much.
        let most =
            |(best, most): (u32, f32), of: u32| if covered(of) > most { (of, covered(of)) } else { (best, most) };
        *owner = candidates.map(|texel| owners[texel]).fold((NONE, 0.0), most).0;
    });
}

/// The texels of a level of which most lies in a region of level 0; at least one.
pub fn smaller(region: Region, scale: usize, width: usize, height: usize) -> Region {
    let along = |start: usize, length: usize, side: usize| {
        let round = |at: usize| (at + scale / 2) / scale;
        let first = round(start).min(side - 1);
        (first, round(start + length).min(side).saturating_sub(first).max(1))
    };
    let ((x, width), (y, height)) = (along(region.x, region.width, width), along(region.y, region.height, height));
    Region { x, y, width, height }
}

/// The texels of a region.
pub fn texels(region: Region, width: usize) -> impl Iterator<Item = usize> {
    (region.y..region.y + region.height)
        .flat_map(move |y| (region.x..region.x + region.width).map(move |x| y * width + x))
}
