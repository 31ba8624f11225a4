//! The gain of a refinement: errors of pictures in test views, which no step uses, at several sizes.
//!
//! The error of a picture is the sum of absolute differences of codes over gray, for each pixel of the leaves: sums in a fixed order, so it is the
//! same on any machine, which FLIP is not. Sizes count alike: the gain is the mean of the ratios.

use glam::Vec3;
use rayon::prelude::*;

use super::picture::{light, over_gray};
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::metrics::{View, render};
use crate::textures::mips;

/// Number of test views.
pub const VIEWS: usize = 8;

/// Side of the smallest pictures, in pixels.
const SMALLEST: usize = 32;

/// Pictures of the leaves in the test views, each with its halves.
pub struct TestViews {
    views: Vec<View>,
    leaves: Vec<Vec<Image>>,
}

/// Errors by the side of the pictures, in pixels.
pub type Errors = Vec<(usize, f64)>;

/// Errors relative to those before the refinement.
pub struct Gain {
    pub errors: Errors,
}

impl TestViews {
    pub fn new(leaves: &Foliage, views: Vec<View>) -> Result<Self> {
        let leaves = pictures(leaves, &views)?;
        Ok(Self { views, leaves })
    }

    /// Returns the errors of a level, with factors on its colors.
    pub fn errors(&self, level: &Foliage, tone: Vec3) -> Result<Errors> {
        let level = pictures(level, &self.views)?;
        let sizes = self.leaves[0].len();
        let of_size = |size: usize| {
            let pairs = self.leaves.par_iter().zip(&level);
            let each: Vec<f64> = pairs.map(|(leaves, level)| error(&leaves[size], &level[size], tone)).collect();
            (self.leaves[0][size].width(), each.iter().sum::<f64>() / each.len() as f64)
        };
        Ok((0..sizes).map(of_size).collect())
    }
}

fn pictures(foliage: &Foliage, views: &[View]) -> Result<Vec<Vec<Image>>> {
    let halves = |image: Image| mips::means(&image).into_iter().take_while(|half| half.width() >= SMALLEST).collect();
    views.par_iter().map(|view| render(&[foliage], view).map(halves)).collect()
}

/// Returns the sum of absolute differences over the number of pixels that show the leaves.
fn error(leaves: &Image, level: &Image, tone: Vec3) -> f64 {
    let (mut sum, mut count) = (0.0, 0u32);
    for (&wanted, &found) in leaves.pixels().iter().zip(level.pixels()) {
        let difference = over_gray(light(wanted)) - over_gray(light(found) * tone.extend(1.0));
        sum += f64::from(difference.abs().element_sum());
        count += u32::from(wanted[3] > 0);
    }
    sum / f64::from(count.max(1))
}

impl Gain {
    /// Returns the gain of no change.
    pub fn none(first: &Errors) -> Self {
        Self { errors: first.iter().map(|(size, _)| (*size, 1.0)).collect() }
    }

    pub fn over(first: &Errors, now: &Errors) -> Self {
        let ratio = |(&(size, before), &(_, after)): (&(usize, f64), &(usize, f64))| {
            (size, if before > 0.0 { after / before } else { 1.0 + after })
        };
        Self { errors: first.iter().zip(now).map(ratio).collect() }
    }

    /// Returns whether no size is worse than before the refinement, and all together are better than in another try.
    pub fn is_better_than(&self, other: &Self) -> bool {
        self.errors.iter().all(|(_, ratio)| *ratio <= 1.0) && self.mean() < other.mean()
    }

    /// Returns the mean over the sizes.
    pub fn mean(&self) -> f64 {
        self.errors.iter().map(|(_, ratio)| ratio).sum::<f64>() / self.errors.len() as f64
    }
}
