//! Finds the triangle that each sample of a tile shows: coverage, depth and alpha test, in blocks of samples.
//!
//! A block or a row of samples is skipped if the triangle is hidden or transparent in all of it. Most small triangles contain no sample: the
//! samples are tested before the surface of a small triangle is prepared.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::tiles::{middles, overlap, samples_of};
use super::{Edges, Fragment, ScreenTriangle, Thresholds, Tile, Window};
use crate::foliage::{BLOCK, Surface};

impl<'a> Tile<'a> {
    pub(super) fn add(&mut self, triangle: &ScreenTriangle<'a>, index: u32, origin: Vec2) {
        let scale = self.samples as f32;
        let corners = triangle.corners.map(|c| (c.truncate() - origin) * scale);
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        let Window { columns, rows, .. } = triangle.window;
        let rows = overlap(&middles(low.y, high.y, self.side), &samples_of(rows, origin.y, self.samples));
        let columns = overlap(&middles(low.x, high.x, self.side), &samples_of(columns, origin.x, self.samples));
        let depths = Vec3::from_array(triangle.corners.map(|c| c.z));
        // Interpolated depths may be a few roundings nearer than all corners.
        let nearest = triangle.nearest() + 8.0 * f32::EPSILON * depths.abs().max_element();
        if columns.is_empty() || rows.is_empty() || self.depths.hide(&columns, &rows, nearest) {
            return;
        }
        let Some(edges) = Edges::new(corners) else { return };
        let flat = Flat { edges, depths, reach: triangle.reach };
        let is_small = columns.len() <= BLOCK && rows.len() <= BLOCK;
        // Most small triangles lie between the samples, or are hidden.
        if is_small && !rows.clone().any(|y| flat.not_behind(columns.start, y, self.shown(&columns, y)).0 != 0) {
            return;
        }
        let steps = flat.edges.steps();
        let surface = Surface::spread(triangle.foliage, triangle.triangle as usize, steps, self.filter);
        if !flat.edges.front && !surface.double_sided() {
            return;
        }
        let threshold = Thresholds::new(self.samples, index);
        let mut drawing = Drawing { index, surface, flat, nearest, threshold, any: false };
        if is_small {
            self.add_block(&mut drawing, &columns, &rows, |_| columns.clone());
        } else {
            for top in rows.clone().step_by(BLOCK) {
                self.add_band(&mut drawing, &columns, top..(top + BLOCK).min(rows.end));
            }
        }
        if drawing.any {
            self.drawn.push(Fragment { index, edges: drawing.flat.edges, surface: drawing.surface });
        }
    }

    /// Draws the part of a triangle in at most [`BLOCK`] rows, block by block. Most of foliage is transparent or hidden; such blocks are
    /// skipped.
    fn add_band(&mut self, drawing: &mut Drawing<'a>, columns: &Range<usize>, rows: Range<usize>) {
        let mut spans: [Range<usize>; BLOCK] = std::array::from_fn(|_| 0..0);
        let mut whole = Range { start: usize::MAX, end: 0 };
        for (y, span) in rows.clone().zip(&mut spans) {
            *span = drawing.flat.edges.span(y as f32 + 0.5, columns);
            if span.start < span.end {
                whole = whole.start.min(span.start)..whole.end.max(span.end);
            }
        }
        for left in whole.clone().step_by(BLOCK) {
            let block = left..(left + BLOCK).min(whole.end);
            if !self.depths.hide(&block, &rows, drawing.nearest) {
                self.add_block(drawing, &block, &rows, |y| overlap(&block, &spans[y - rows.start]));
            }
        }
    }

    /// Draws the part of a triangle in a block of at most [`BLOCK`] × [`BLOCK`] samples, in these columns of each row.
    fn add_block(
        &mut self,
        drawing: &mut Drawing<'a>,
        block: &Range<usize>,
        rows: &Range<usize>,
        columns: impl Fn(usize) -> Range<usize>,
    ) {
        let centre = Vec2::new(0.5 * (block.start + block.end) as f32, 0.5 * (rows.start + rows.end) as f32);
        if !drawing.surface.block_may_pass(drawing.flat.edges.weights(centre)) {
            return;
        }
        let mut any = false;
        for y in rows.clone() {
            any |= self.add_run(drawing, columns(y), y);
        }
        if any {
            self.depths.note(block, rows);
            drawing.any = true;
        }
    }

    /// Returns the depths of at most [`BLOCK`] samples of a row, and ∞ after them.
    fn shown(&self, run: &Range<usize>, y: usize) -> [f32; BLOCK] {
        self.depths.run(y * self.side + run.start, run.len())
    }

    /// Draws the part of a triangle in at most [`BLOCK`] samples of a row. Returns whether any became visible.
    fn add_run(&mut self, drawing: &Drawing<'a>, run: Range<usize>, y: usize) -> bool {
        let Drawing { index, surface, flat, threshold, .. } = drawing;
        let edges = &flat.edges;
        let middle = Vec2::new(0.5 * (run.start + run.end) as f32, y as f32 + 0.5);
        if run.is_empty() || !surface.run_may_pass(edges.weights(middle)) {
            return false;
        }
        let sample = y * self.side + run.start;
        let (mut candidates, depths) = flat.not_behind(run.start, y, self.shown(&run, y));
        let uv = surface.uv(edges.weights(Vec2::new(run.start as f32 + 0.5, y as f32 + 0.5)));
        let mut any = false;
        while candidates != 0 {
            let i = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            let x = run.start + i;
            let weights = || edges.weights(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            let is_nearer = self.is_nearer(depths[i], *index, sample + i);
            if is_nearer && surface.passes_behind(uv, i, weights, || threshold.at(x, y)) {
                self.depths.set(sample + i, depths[i]);
                self.seen[sample + i] = self.drawn.len() as u32;
                any = true;
            }
        }
        any
    }

    /// Returns whether a triangle at a depth hides the triangle that a sample shows. At equal depths the first triangle hides the other.
    fn is_nearer(&self, depth: f32, index: u32, sample: usize) -> bool {
        let shown = self.depths.get(sample);
        depth > shown
            || depth == shown && self.drawn.get(self.seen[sample] as usize).is_some_and(|shown| index < shown.index)
    }
}

/// State while drawing a triangle on a tile.
struct Drawing<'a> {
    index: u32,
    surface: Surface<'a>,
    flat: Flat,
    /// No point of it is nearer.
    nearest: f32,
    threshold: Thresholds,
    /// Whether it became visible at any sample.
    any: bool,
}

/// A triangle without its surface.
struct Flat {
    edges: Edges,
    /// Depths of its corners.
    depths: Vec3,
    reach: f32,
}

impl Flat {
    /// Returns which of [`BLOCK`] samples from the column `x` on lie in the triangle, within its reach, and not behind the depths `shown`, as bits;
    /// and the depths of the triangle there.
    fn not_behind(&self, x: usize, y: usize, shown: [f32; BLOCK]) -> (u32, [f32; BLOCK]) {
        let [second, third] = self.edges.run(x, y as f32 + 0.5);
        let first: [f32; BLOCK] = std::array::from_fn(|i| 1.0 - second[i] - third[i]);
        let Vec3 { x: a, y: b, z: c } = self.depths;
        let depths: [f32; BLOCK] = std::array::from_fn(|i| first[i] * a + second[i] * b + third[i] * c);
        // Without branches and calls, so that it becomes vector instructions.
        let found: [u32; BLOCK] = std::array::from_fn(|i| {
            let inside = u32::from(first[i] >= 0.0) & u32::from(second[i] >= 0.0) & u32::from(third[i] >= 0.0);
            inside & u32::from(depths[i] >= shown[i]) & u32::from(depths[i].abs() <= self.reach)
        });
        let bits: [u32; BLOCK] = std::array::from_fn(|i| found[i] << i);
        (bits.iter().fold(0, |bits, bit| bits | bit), depths)
    }
}
