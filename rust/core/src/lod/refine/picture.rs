//! Pictures for refinement: linear light, and codes over gray, both with alpha beside them.

use std::ops::AddAssign;

use glam::{Vec3, Vec4};

use crate::color::encode;
use crate::foliage::Image;
use crate::textures::light;

/// Share of the background's light, as a code. The image error (FLIP) has the same background.
const GRAY: f32 = 0.5;

/// Returns straight linear light, with alpha, as codes over the background.
pub fn over_gray(light: Vec4) -> Vec4 {
    let codes = light.truncate().map(|light| f32::from(encode(light)) / 255.0);
    (codes * light.w + Vec3::splat(GRAY * (1.0 - light.w))).extend(light.w)
}

/// A picture of the leaves.
pub struct Target {
    /// Straight linear light, with alpha; row by row from the top.
    pub pixels: Vec<Vec4>,
}

impl Target {
    pub fn of(image: &Image) -> Self {
        Self { pixels: image.pixels().iter().copied().map(light).collect() }
    }
}

/// Radius of the blocks of pixels in which differences count, and their weight beside single pixels. Errors in blocks are much smaller, and
/// are what one sees from afar.
const RADIUS: usize = 2;
pub const BLOCK_WEIGHT: f32 = 8.0;

/// Returns a square picture plus its means over blocks, weighted, and divided by the sum of the weights. Beyond the edges nothing differs.
pub fn at_both_scales(picture: &[Vec4], size: usize) -> Vec<Vec4> {
    let count = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    let blocks = box_sums(&box_sums(picture, size, RADIUS), size, RADIUS);
    let mixed = |(own, block): (&Vec4, Vec4)| (*own + block * (BLOCK_WEIGHT / count / count)) / (1.0 + BLOCK_WEIGHT);
    picture.iter().zip(blocks).map(mixed).collect()
}

/// Returns the sums over the squares of `2 · reach + 1` values around each value, in rows of this width.
pub fn box_sums<T: Copy + Default + AddAssign>(values: &[T], width: usize, reach: usize) -> Vec<T> {
    let mut along = vec![T::default(); values.len()];
    for (row, sums) in values.chunks_exact(width).zip(along.chunks_exact_mut(width)) {
        for (place, sum) in sums.iter_mut().enumerate() {
            row[place.saturating_sub(reach)..(place + reach + 1).min(width)].iter().for_each(|&value| *sum += value);
        }
    }
    let mut all = vec![T::default(); values.len()];
    for (number, sums) in all.chunks_exact_mut(width).enumerate() {
        let first = number.saturating_sub(reach);
        for row in along.chunks_exact(width).skip(first).take(number + reach + 1 - first) {
            sums.iter_mut().zip(row).for_each(|(sum, &value)| *sum += value);
        }
    }
    all
}
