//! Pictures of the leaves in some views, and the errors of a level in them.
//!
//! The error of a picture is the sum of absolute differences of codes over gray, for each pixel of the leaves: sums in a fixed order, so it is the
//! same on any machine.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::gain::Errors;
use super::picture::over_gray;
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::metrics::{View, Views, render};
use crate::textures::{Samples, light, mips};

/// Side of the smallest pictures that decide on a level, in pixels.
const SMALLEST: usize = 32;

/// A view, and the picture of the leaves in it.
pub type LeafView = (View, Image);

/// Pictures of the leaves in some views of one size, each with its halves.
pub struct LeafViews {
    views: Vec<View>,
    leaves: Vec<Vec<Image>>,
}

/// Returns `count` views; `turn` rotates them.
pub fn views(around: &Frame, up: DVec3, size: usize, (count, turn): (usize, f64)) -> Result<Vec<View>> {
    let views = Views { count, size, samples: Samples::new(3)?.unfiltered(), up, turn };
    Ok(views.around(around).collect())
}

/// Draws the leaves.
pub fn drawn(leaves: &Foliage, views: Vec<View>) -> Result<Vec<LeafView>> {
    views.into_par_iter().map(|view| Ok((view, render(&[leaves], &view)?))).collect()
}

impl LeafViews {
    /// Pictures that decide on a level.
    pub fn of(drawn: Vec<LeafView>) -> Self {
        let (views, pictures): (Vec<View>, Vec<Image>) = drawn.into_iter().unzip();
        let halves = |picture: &Image| halves(picture).take_while(|half| half.width() >= SMALLEST).collect();
        Self { views, leaves: pictures.iter().map(halves).collect() }
    }

    /// Returns the sides of the pictures in pixels, the largest first.
    pub fn sizes(&self) -> Vec<usize> {
        self.leaves.first().map_or(Vec::new(), |halves| halves.iter().map(Image::width).collect())
    }

    /// Returns the errors of a level, with factors on its colors.
    pub fn errors(&self, level: &Foliage, tone: Vec3) -> Result<Errors> {
        let sizes = self.sizes();
        let of_view = |view: &View| Ok(halves(&render(&[level], view)?).take(sizes.len()).collect());
        let level = self.views.par_iter().map(of_view).collect::<Result<Vec<Vec<Image>>>>()?;
        let of_size = |(number, size): (usize, usize)| {
            let pairs = self.leaves.par_iter().zip(&level);
            let each: Vec<f64> = pairs.map(|(leaves, level)| error(&leaves[number], &level[number], tone)).collect();
            (size, each.iter().sum::<f64>() / each.len() as f64)
        };
        Ok(sizes.into_iter().enumerate().map(of_size).collect())
    }
}

/// Returns the picture, its half, the half of that, and so on.
fn halves(image: &Image) -> impl Iterator<Item = Image> {
    mips::means(image).into_iter()
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
