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
        let mut lists = vec![Vec::new(); self.columns * self.rows];
        let scale = samples.side() as f32;
        let is_between = |low: f32, high: f32| middles(low * scale, high * scale, usize::MAX).is_empty();
        for (index, triangle) in (0u32..).zip(triangles) {
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
                    lists[row * self.columns + column].push(index);
                }
            }
        }
        let nearest: Vec<f32> = triangles.iter().map(ScreenTriangle::nearest).collect();
        let nearer_first = |a: &u32, b: &u32| nearest[*b as usize].total_cmp(&nearest[*a as usize]);
        lists.par_iter_mut().for_each(|list| list.sort_by(nearer_first));
        lists
    }
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
