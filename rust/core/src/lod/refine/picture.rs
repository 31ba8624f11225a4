//! Pictures for refinement: linear light, and codes over gray, both with alpha beside them.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::color::{decode_table, encode};
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::metrics::{View, render};

/// Share of the background's light, as a code. The image error (FLIP) has the same background.
const GRAY: f32 = 0.5;

/// Returns straight linear light, with alpha, as codes over the background.
pub fn over_gray(light: Vec4) -> Vec4 {
    let codes = light.truncate().map(|light| f32::from(encode(light)) / 255.0);
    (codes * light.w + Vec3::splat(GRAY * (1.0 - light.w))).extend(light.w)
}

/// Returns the linear light of a pixel, with alpha.
pub fn light([r, g, b, alpha]: [u8; 4]) -> Vec4 {
    let light = Vec3::from_array([r, g, b].map(|code| decode_table()[code as usize]));
    light.extend(f32::from(alpha) / 255.0)
}

/// A picture of the leaves.
pub struct Target {
    /// Straight linear light, with alpha; row by row from the top.
    pub pixels: Vec<Vec4>,
}

impl Target {
    /// Draws the leaves.
    pub fn new(leaves: &Foliage, view: &View) -> Result<Self> {
        Ok(Self::of(&render(&[leaves], view)?))
    }

    fn of(image: &Image) -> Self {
        Self { pixels: image.pixels().iter().copied().map(light).collect() }
    }
}

/// Radius of the blocks of pixels in which differences count, and their weight beside single pixels. Errors in blocks are much smaller, and
/// are what one sees from afar.
const RADIUS: usize = 2;
pub const BLOCK_WEIGHT: f32 = 8.0;

/// Returns a square picture plus its means over blocks, weighted, and divided by the sum of the weights.
pub fn at_both_scales(picture: &[Vec4], size: usize) -> Vec<Vec4> {
    let mut blocks = picture.to_vec();
    for _ in 0..2 {
        blocks = means(&means(&blocks, size, 1), size, size);
    }
    let mixed = |(own, block): (&Vec4, Vec4)| (*own + block * BLOCK_WEIGHT) / (1.0 + BLOCK_WEIGHT);
    picture.iter().zip(blocks).map(mixed).collect()
}

/// Returns means of `2 · RADIUS + 1` pixels along an axis; beyond the edges nothing differs.
fn means(picture: &[Vec4], size: usize, stride: usize) -> Vec<Vec4> {
    let count = (2 * RADIUS + 1) as f32;
    sums(picture, size, stride, RADIUS).into_iter().map(|sum| sum / count).collect()
}

/// Returns the sum of the `2 · reach + 1` values around each value, along an axis of `length` values with this stride.
pub fn sums(values: &[Vec4], length: usize, stride: usize, reach: usize) -> Vec<Vec4> {
    let sum = |index: usize| {
        let place = index / stride % length;
        let (first, last) = (place.saturating_sub(reach), (place + reach).min(length - 1));
        let start = index - place * stride;
        (first..=last).map(|i| values[start + i * stride]).sum()
    };
    (0..values.len()).into_par_iter().with_min_len(1 << 12).map(sum).collect()
}
