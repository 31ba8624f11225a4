//! The tiles of a canvas, with the triangles that touch each.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{Samples, ScreenTriangle, TILE};

/// The grid of tiles.
pub(super) struct Tiles {
    pub columns: usize,
    pub rows: usize,
}

impl Tiles {
    pub fn origin(&self, tile: usize) -> Vec2 {
        Vec2::new((tile % self.columns * TILE) as f32, (tile / self.columns * TILE) as f32)
    }

    /// Returns, for each tile, the triangles with bounds that touch it, near ones first; without those that lie between the samples.
    pub fn lists(&self, triangles: &[ScreenTriangle], samples: Samples) -> Vec<Vec<u32>> {
        let of_chunk = |(i, chunk): (usize, &[ScreenTriangle])| self.touched(chunk, (i * CHUNK) as u32, samples);
        let parts: Vec<Vec<Vec<Near>>> = triangles.par_chunks(CHUNK).enumerate().map(of_chunk).collect();
        let list = |tile: usize| {
            let mut list: Vec<Near> = parts.iter().flat_map(|part| &part[tile]).copied().collect();
            list.sort_unstable();
            list.into_iter().map(|near| near as u32).collect()
        };
        (0..self.columns * self.rows).into_par_iter().map(list).collect()
    }

    /// Returns, for each tile, those of some triangles that touch it. `first`: number of the first triangle.
    fn touched(&self, triangles: &[ScreenTriangle], first: u32, samples: Samples) -> Vec<Vec<Near>> {
        let mut lists = vec![Vec::new(); self.columns * self.rows];
        let scale = samples.side() as f32;
        let is_between = |low: f32, high: f32| middles(low * scale, high * scale, usize::MAX).is_empty();
        for (index, triangle) in (first..).zip(triangles) {
            let (low, high) = bounds(&triangle.corners);
            if is_between(low.x, high.x) || is_between(low.y, high.y) {
                continue;
            }
            let within = |cells: Range<usize>, pixels: &Range<usize>| {
                overlap(&cells, &(pixels.start / TILE..pixels.end.div_ceil(TILE)))
            };
            let columns = within(covered(low.x, high.x, TILE as f32, self.columns), &triangle.window.columns);
            for row in within(covered(low.y, high.y, TILE as f32, self.rows), &triangle.window.rows) {
                for column in columns.clone() {
                    lists[row * self.columns + column].push(near(triangle.nearest(), index));
                }
            }
        }
        lists
    }
}

/// Triangles for which a thread makes lists of its own.
const CHUNK: usize = 1 << 15;

/// The number of a triangle in the lower half, above it a number that is smaller for a nearer triangle.
type Near = u64;

fn near(depth: f32, index: u32) -> Near {
    // Bits of floats are ordered like them once those of negative ones are turned over, as in `f32::total_cmp`.
    let bits = depth.to_bits();
    let ascending = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
    u64::from(!ascending) << 32 | u64::from(index)
}

pub(super) fn bounds([a, b, c]: &[Vec3; 3]) -> (Vec2, Vec2) {
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    (low.truncate(), high.truncate())
}

/// Returns the cells that the interval touches, among `count` cells of `size`.
pub(super) fn covered(low: f32, high: f32, size: f32, count: usize) -> Range<usize> {
    // Casts of negative numbers and NaN give 0.
    (low / size).floor() as usize..(((high / size).floor() + 1.0) as usize).min(count)
}

/// Error of a place on the canvas in samples, at most.
const OFF: f32 = 1.0 / 16.0;

/// Returns the samples, of `count` from 0 on, with middles in an interval.
pub(super) fn middles(low: f32, high: f32, count: usize) -> Range<usize> {
    // Casts of negative numbers and NaN give 0.
    (low - (0.5 + OFF)).ceil() as usize..((high + (0.5 + OFF)).floor() as usize).min(count)
}

pub(super) fn overlap(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// Returns the samples of a range of pixels in a tile that begins at the pixel `origin`.
pub(super) fn samples_of(pixels: &Range<usize>, origin: f32, samples: usize) -> Range<usize> {
    let sample = |pixel: usize| pixel.saturating_sub(origin as usize).saturating_mul(samples);
    sample(pixels.start)..sample(pixels.end)
}
