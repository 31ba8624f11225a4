//! The samples of a pixel: their number, and coverage and alpha test at each.
//!
//! Coverage follows from barycentric weights, which are affine in the position (Pineda, "A Parallel Algorithm for Polygon Rasterization",
//! 1988). Alpha is compared with thresholds that are spread over a pixel's samples, so that alpha becomes a share of the samples.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::error::Result;
use crate::foliage::BLOCK;
use crate::limits;

/// Sub-samples along each side of a texel.
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    pub(super) side: usize,
    /// Parts along each side of a texel that are shaded separately.
    pub(super) parts: usize,
    /// Width of the texture filter, as a multiple of the distance between samples.
    pub(super) filter: f32,
}

impl Samples {
    /// Returns `samples` × `samples` samples.
    ///
    /// # Errors
    /// A number outside [`limits::SAMPLES`].
    pub fn new(samples: usize) -> Result<Self> {
        limits::SAMPLES.check("samples", samples as f64)?;
        Ok(Self { side: samples, ..Self::default() })
    }

    /// Returns the number of samples along each side.
    #[must_use]
    pub const fn side(self) -> usize {
        self.side
    }

    /// Shades each sample separately, as a renderer does. Otherwise a texel shades each triangle once, in the middle of its samples there.
    #[must_use]
    pub fn each(self) -> Self {
        Self { parts: self.side, ..self }
    }

    /// Reads textures at points, as a renderer with many samples does. Means over whole pictures need no filter, and a filter would bias
    /// them: it does not know which colors of a texel belong to its drawn part, and makes pines a few percent too dark.
    #[must_use]
    pub fn unfiltered(self) -> Self {
        Self { filter: 0.0, ..self }
    }
}

impl Default for Samples {
    /// 4 × 4.
    fn default() -> Self {
        Self { side: 4, parts: 1, filter: 1.0 }
    }
}

/// Pixels along each side of a tile: a tile fits a core's cache.
pub(super) const TILE: usize = 32;

/// Barycentric weights as affine functions of the position.
pub(super) struct Edges {
    origin: Vec2,
    /// Gradients of the second and third weight.
    second: Vec2,
    third: Vec2,
    /// Whether the visible side is the one with counter-clockwise winding.
    pub(super) front: bool,
}

impl Edges {
    /// Returns `None` for a triangle with an area that is 0 or beyond f32.
    pub(super) fn new([a, b, c]: [Vec2; 3]) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let twice_area = u.perp_dot(v);
        let inverse = 1.0 / twice_area;
        (twice_area.is_finite() && inverse.is_finite()).then(|| Self {
            origin: a,
            second: Vec2::new(v.y, -v.x) * inverse,
            third: Vec2::new(-u.y, u.x) * inverse,
            // y is down: counter-clockwise to the viewer is negative here.
            front: twice_area < 0.0,
        })
    }

    pub(super) fn weights(&self, point: Vec2) -> Vec3 {
        let q = point - self.origin;
        let (second, third) = (self.second.dot(q), self.third.dot(q));
        Vec3::new(1.0 - second - third, second, third)
    }

    /// Returns second and third weight at [`BLOCK`] samples of a row, from the sample in column `x` on.
    pub(super) fn run(&self, x: usize, y: f32) -> [[f32; BLOCK]; 2] {
        let down = y - self.origin.y;
        let across: [f32; BLOCK] = std::array::from_fn(|i| (x + i) as f32 + 0.5 - self.origin.x);
        [self.second, self.third].map(|gradient| across.map(|across| gradient.x * across + gradient.y * down))
    }

    /// Returns the change of the weights from sample to sample along a row and a column.
    pub(super) fn steps(&self) -> [Vec3; 2] {
        let step = |second: f32, third: f32| Vec3::new(-second - third, second, third);
        [step(self.second.x, self.third.x), step(self.second.y, self.third.y)]
    }

    /// Returns the samples of a row within `columns` at which all weights may be at least 0, with one more at each end for rounding.
    pub(super) fn span(&self, y: f32, columns: &Range<usize>) -> Range<usize> {
        let start = columns.start as f32 + 0.5;
        let at = self.weights(Vec2::new(start, y));
        let [step, _] = self.steps();
        let (mut low, mut high) = (0.0f32, columns.len() as f32);
        for (weight, step) in at.to_array().into_iter().zip(step.to_array()) {
            // weight + x · step ≥ 0; a constant weight sets no limit here.
            let crossing = -weight / step;
            if step > 0.0 {
                low = low.max(crossing);
            } else if step < 0.0 {
                high = high.min(crossing);
            }
        }
        // Casts saturate, and the range is clipped.
        let first = columns.start.saturating_add((low - 1.0) as usize);
        let end = columns.start.saturating_add((high + 2.0) as usize);
        first.min(columns.end)..end.min(columns.end)
    }
}

/// Alpha thresholds. The samples of a pixel have evenly spaced thresholds, in an order that depends on triangle and pixel, and all shifted
/// by a share of a step that also depends on both. So alpha at multiples of a step is exact, and other alpha is right in the mean of some
/// pixels. Transmittance through two triangles is the product of theirs in the mean of some pixels. (With an order that depended on the
/// triangle alone, two triangles would relate the same way in all pixels, and crowns would be a few percent too dense or too thin.)
pub(super) struct Thresholds {
    samples: usize,
    count: u32,
    step: u32,
    triangle: u32,
}

impl Thresholds {
    pub(super) fn new(samples: usize, triangle: u32) -> Self {
        Self {
            samples,
            count: (samples * samples) as u32,
            // A full-period walk through the samples needs a step coprime to their number, the square of 1 … 16: 5, or 7 for multiples of
            // 5.
            step: if samples.is_multiple_of(5) { 7 } else { 5 },
            triangle: triangle.wrapping_mul(0x9E37_79B9),
        }
    }

    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        let place = (y % self.samples * self.samples + x % self.samples) as u32;
        let pixel = (y / self.samples * TILE + x / self.samples) as u32;
        let mixed = mixed(self.triangle ^ pixel.wrapping_mul(0x85EB_CA6B));
        let share = ((mixed >> 20) as f32 + 0.5) / 4096.0;
        (((place * self.step + (mixed & 0xFFFF)) % self.count) as f32 + share) / self.count as f32
    }
}

/// Returns a hash in which each bit depends on all bits (C. Wellons, "Prospecting for Hash Functions", 2018: lowbias32).
fn mixed(mut bits: u32) -> u32 {
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x7FEB_352D);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x846C_A68B);
    bits ^ (bits >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittances_of_two_triangles_multiply() {
        for samples in 2..=16 {
            let side = 16 * samples;
            for (apart, alpha) in [(1, 0.2), (2, 0.2), (3, 0.5), (4, 0.5), (6, 0.8), (8, 0.2)] {
                let pairs = (0..40).map(|i| [i, i + apart].map(|triangle| Thresholds::new(samples, triangle)));
                let clear = |[a, b]: [Thresholds; 2]| {
                    let places = (0..side * side).map(|i| (i % side, i / side));
                    places.filter(|&(x, y)| a.at(x, y) >= alpha && b.at(x, y) >= alpha).count()
                };
                let worst = pairs.map(clear).map(|clear| clear as f32 / (side * side) as f32 - (1.0 - alpha).powi(2));
                let worst = worst.fold(0.0, |worst: f32, off| worst.max(off.abs()));
                assert!(worst < 0.06, "{samples}² samples, triangles {apart} apart, alpha {alpha}: {worst} off");
            }
        }
    }
}
