//! Pictures of the leaves in some views, and the errors of a level in them.
//!
//! The error of a picture is the sum of absolute differences of codes over gray, for each pixel of the leaves: sums in a fixed order, so it is the
//! same on any machine, which FLIP is not.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::gain::Errors;
use super::picture::over_gray;
use super::{TEST_TURN, TEST_VIEWS, turn_of};
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::metrics::{View, Views, coverage, render, silhouette};
use crate::progress::Progress;
use crate::textures::{Samples, light, mips, shrunk};

/// Side of the smallest pictures that decide on a level, in pixels.
const SMALLEST: usize = 32;

/// A view, and the picture of the leaves in it.
pub type LeafView = (View, Image);

/// Pictures of the leaves in some views of one size, each with its halves.
pub struct LeafViews {
    views: Vec<View>,
    leaves: Vec<Vec<Image>>,
}

/// Pictures of a tree by which its pages for engines are refined.
#[derive(Clone, Debug)]
pub struct LeafPictures {
    /// In the views of the steps.
    pub steps: Vec<LeafView>,
    /// In test views.
    pub tests: Vec<LeafView>,
}

/// Number of turns for steps, and of views in each turn.
const STEP_VIEWS: (usize, usize) = (6, 4);

impl LeafPictures {
    /// Draws the parts of the tree.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub fn of(parts: &[&Foliage], around: &Frame, up: DVec3, size: usize, progress: Progress) -> Result<Self> {
        // One after the other: the triangles of large trees take as much memory as all pictures.
        let pictures = |views: Vec<View>| {
            let picture = |view| {
                progress.tell("measure", 0.0)?;
                Ok((view, render(parts, &view)?))
            };
            views.into_iter().map(picture).collect::<Result<Vec<_>>>()
        };
        let of_turn = |step: usize| views(around, up, size, (STEP_VIEWS.1, turn_of(step)));
        let steps = (0..STEP_VIEWS.0).map(of_turn).collect::<Result<Vec<_>>>()?.concat();
        Ok(Self { steps: pictures(steps)?, tests: pictures(views(around, up, size, (TEST_VIEWS, TEST_TURN))?)? })
    }
}

/// Returns `count` views; `turn` rotates them.
pub fn views(around: &Frame, up: DVec3, size: usize, (count, turn): (usize, f64)) -> Result<Vec<View>> {
    let views = Views { count, size, samples: Samples::new(3)?.unfiltered(), up, turn };
    Ok(views.around(around).collect())
}

/// Returns the views with smaller pictures.
pub fn of_size(pictures: &[LeafView], size: usize) -> Vec<LeafView> {
    pictures.iter().map(|(view, picture)| (View { size, ..*view }, shrunk(picture, size, size))).collect()
}

/// What test views tell of a level.
pub struct Look {
    pub error: f64,
    pub coverage: f64,
}

impl Look {
    /// Returns the error of a level and its coverage relative to the leaves.
    pub fn at(level: &Foliage, tests: &[LeafView]) -> Result<Self> {
        let shown = tests.par_iter().map(|(view, _)| render(&[level], view)).collect::<Result<Vec<_>>>()?;
        let pairs = || tests.iter().map(|(_, leaves)| leaves).zip(&shown);
        let errors = pairs().map(|(leaves, level)| error(leaves, level, Vec3::ONE));
        Ok(Self { error: errors.sum::<f64>() / shown.len() as f64, coverage: coverage(pairs()) })
    }
}

/// Returns the coverage of a level relative to the leaves, as [`Look::at`] does, without colors, which take most of the time.
pub fn coverage_in(tests: &[LeafView], level: &Foliage) -> Result<f64> {
    let shown = tests.par_iter().map(|(view, _)| silhouette(&[level], view)).collect::<Result<Vec<_>>>()?;
    Ok(coverage(tests.iter().map(|(_, leaves)| leaves).zip(&shown)))
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
