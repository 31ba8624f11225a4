//! Refinement of a page for engines on its box-filtered mip levels.
//!
//! An engine makes the mip levels itself, so one image has to look like the leaves on all of them. Each step draws the billboards with each mip
//! level at the size where engines read it, and credits the differences to its texels, as for a page of the .blend file ([`super`]). A texel
//! of the image moves by the steps of all texels that contain it: the mean of a block answers to the pictures of a coarse level, its details to
//! those of finer ones. For files with mip levels of their own, each mip level is refined alone ([`OnMips::mips`] is 1).
//!
//! The leaves are drawn once for all levels of a chain: coarser levels are compared with halves of these pictures. Test views decide: the image
//! counts only if it is better in them on the whole, worse on no mip level, and keeps the coverage on all. Sums have a fixed order. O(steps ·
//! levels · views · (pixels + fragments)) plus O(texels) a step, for each part of a shared page. Known limits: no texel gets alpha that has
//! none; mip levels with texels finer than the pixels of all pictures get no credits of their own; mip levels that are smaller than all pictures
//! get none either.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::credit::{Credits, Drawn};
use super::gain::{Errors, Gain};
use super::leaf_views::{LeafPictures, LeafViews, Look};
use super::picture::Target;
use super::texels::{PRIOR, direction, mean_credit, slower};
use crate::atlas::Atlas;
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image, Material};
use crate::geometry::Frame;
use crate::lod::billboards::billboards;
use crate::metrics::View;
use crate::textures::{LightGrid, keeps_ratio};

/// Billboards with a page for engines.
pub struct OnMips<'a> {
    pub atlas: &'a Atlas,
    pub frame: &'a Frame,
    /// Their material, without an image.
    pub material: &'a Material,
    /// Least alpha that is drawn.
    pub cutoff: f32,
    pub pictures: &'a LeafPictures,
    /// Number of steps.
    pub steps: usize,
    /// Most mip levels that are made of the image, with itself: 1 for an image that is a mip level of a file.
    pub mips: usize,
}

/// Number of steps after which test views look at the image.
const UNTIL_TEST: usize = 2;

/// Most texels of an image: larger ones stay, because a step takes some 90 bytes for each.
const MOST_TEXELS: usize = 1 << 22;

/// Views of a step times the side of the pictures: smaller pictures show fewer texels, so more of them are drawn.
const VIEWS_BY_SIZE: usize = 640;
const LEAST_VIEWS: usize = 3;

/// Number by which the mip level that engines read exceeds the one that suits the size of texels, on average. They read the one for the
/// larger derivative: log2(1 / cos θ) more for a billboard at the angle θ to the picture, and any cos θ is as frequent as any other. The mean
/// weighted by the visible area, ∫ 2 c log2(1 / c) dc over c = cos θ from 0 to 1, is 1 / (2 ln 2).
const TILT: f64 = 0.72;

/// Points along a pixel's side at which the billboards are looked at.
const POINTS: usize = 2;

/// Share of the cutoff by which the lower and the higher cutoff of a step differ from it.
const BAND: f32 = 0.4;

/// Greatest factor on the mean of the color steps of all mip levels. Above 1, because each level has a step of its own.
const COLOR: f32 = 2.0;

/// Greatest change of alpha on each mip level, relative to alpha and half the cutoff.
const ALPHA: f32 = 0.2;

/// Least alpha of a texel that has any, so that it can come back.
const LEAST_ALPHA: f32 = 0.25 / 255.0;

/// The step of each texel of a mip level: of its color, and the direction of its alpha, from -1 to 1.
struct Moves {
    /// Number of the mip level.
    mip: usize,
    width: usize,
    texels: Vec<Vec4>,
}

/// Pictures of the leaves for one mip level.
struct Seen {
    /// Number of the mip level.
    mip: usize,
    steps: Vec<(View, Target)>,
    tests: LeafViews,
}

impl OnMips<'_> {
    /// Returns the image after refinement; unchanged if it did not become better, if it has more than [`MOST_TEXELS`], or if its texels are larger
    /// than the pixels of all pictures.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn refined(&self, image: Image) -> Result<Image> {
        if !self.sees(&image) {
            return Ok(image);
        }
        let seen = self.seen(&image);
        let mut grid = LightGrid::of(&image);
        let looks = self.looks(&image, &seen)?;
        let first = errors(&looks);
        let mut best = (image, Gain::none(&first));
        for step in 0..self.steps {
            self.move_texels(&mut grid, &seen, step)?;
            if (step + 1) % UNTIL_TEST != 0 {
                continue;
            }
            let image = grid.to_image();
            let now = self.looks(&image, &seen)?;
            let gain = Gain::over(&first, &errors(&now));
            let keeps_coverage = now.iter().zip(&looks).all(|(now, first)| now.keeps_coverage_of(first));
            if keeps_coverage && gain.is_better_than(&best.1) {
                best = (image, gain);
            }
        }
        Ok(best.0)
    }

    /// Returns whether the image has at most [`MOST_TEXELS`], and pictures for any of its mip levels.
    pub fn sees(&self, image: &Image) -> bool {
        image.pixels().len() <= MOST_TEXELS && !self.seen(image).is_empty()
    }

    /// Returns for each mip level the pictures in which its texels are nearest to a pixel, if there are any.
    fn seen(&self, image: &Image) -> Vec<Seen> {
        let LeafPictures { steps, tests } = self.pictures;
        let Some((view, _)) = steps.pictures().next() else { return Vec::new() };
        let texel = self.atlas.texel() * self.frame.radius * self.atlas.size.width as f64 / image.width() as f64;
        // Halvings of the pictures for mip level 0; below 0 for texels that are finer than their pixels.
        let halvings = (libm::log2(view.size as f64 * texel / (2.0 * view.radius)) + TILT).round() as isize;
        let of_mip = |mip: u32| {
            let size = *tests.sizes().get(usize::try_from(halvings.saturating_add(mip as isize)).ok()?)?;
            let own = steps.of_size(size);
            let own = own.pictures().map(|(view, image)| (*view, Target::of(image))).collect();
            Some(Seen { mip: mip as usize, steps: own, tests: tests.of_size(size) })
        };
        let count = image.width().max(image.height()).ilog2() + 1;
        (0..count).take(self.mips).filter_map(of_mip).collect()
    }

    /// Looks at each mip level in the test views.
    fn looks(&self, image: &Image, seen: &[Seen]) -> Result<Vec<Look>> {
        let look = |(level, seen): (LightGrid, &Seen)| seen.tests.look(&self.shown(level.to_image(), self.cutoff)?);
        with_levels(LightGrid::of(image), seen).map(look).collect()
    }

    fn shown(&self, image: Image, cutoff: f32) -> Result<Foliage> {
        let alpha_mode = AlphaMode::Mask(cutoff.clamp(1.0 / 255.0, 1.0));
        billboards(self.atlas, self.frame, Material { image: Some(image), alpha_mode, ..self.material.clone() })
    }

    /// Moves the texels of the image, less with each step, so that they come to rest although each step has other views.
    fn move_texels(&self, grid: &mut LightGrid, seen: &[Seen], step: usize) -> Result<()> {
        let moves = with_levels(grid.clone(), seen).map(|(level, seen)| self.moves(&level, seen, step));
        let moves: Vec<Moves> = moves.collect::<Result<_>>()?;
        let slower = slower(step);
        let color = slower * (COLOR / moves.len() as f32).min(1.0);
        let (alpha, width) = (slower * ALPHA, grid.0.width);
        grid.0.pixels.par_iter_mut().enumerate().for_each(|(texel, value)| {
            let at = |moves: &Moves| {
                // Texels beyond the last column or row of an odd side take its step.
                let column = ((texel % width) >> moves.mip).min(moves.width - 1);
                let row = ((texel / width) >> moves.mip).min(moves.texels.len() / moves.width - 1);
                moves.texels[row * moves.width + column]
            };
            let all: Vec4 = moves.iter().map(at).sum();
            let rgb = (value.truncate() + color * all.truncate()).clamp(Vec3::ZERO, Vec3::ONE);
            let moved = value.w + alpha * all.w * (value.w + 0.5 * self.cutoff);
            // A texel without alpha stays so: gutters, and places far from all leaves.
            *value = rgb.extend(if value.w > 0.0 { moved.clamp(LEAST_ALPHA, 1.0) } else { 0.0 });
        });
        Ok(())
    }

    /// Returns the step of one mip level. Views take turns.
    fn moves(&self, level: &LightGrid, seen: &Seen, step: usize) -> Result<Moves> {
        let image = level.to_image();
        let at = |share: f32| self.shown(image.clone(), share * self.cutoff);
        let drawn = Drawn { here: at(1.0)?, denser: at(1.0 - BAND)?, sparser: at(1.0 + BAND)? };
        let size = seen.steps[0].0.size;
        let count = (VIEWS_BY_SIZE / size).max(LEAST_VIEWS).min(seen.steps.len());
        let turn = (0..count).into_par_iter().map(|number| &seen.steps[(step * count + number) % seen.steps.len()]);
        let each = turn.map(|(view, target)| drawn.credits(level, target, view, POINTS));
        Ok(Moves::of(seen.mip, level, &Credits::joined(each.collect::<Result<_>>()?)))
    }
}

/// How far the coverage of a mip level may leave the range between that before and that of the leaves.
const COVERAGE_SLACK: f64 = 0.03;

/// How far the coverage may cross the coverage of the leaves, relative to its former distance from it.
const BEYOND: f64 = 0.5;

impl Look {
    /// Returns whether the coverage is about as near to that of the leaves as before, or nearer.
    fn keeps_coverage_of(&self, first: &Self) -> bool {
        let distance = (self.coverage - 1.0).abs();
        keeps_ratio(first.coverage, self.coverage, COVERAGE_SLACK) || distance <= BEYOND * (first.coverage - 1.0).abs()
    }
}

/// Returns the error on each mip level.
fn errors(looks: &[Look]) -> Errors {
    looks.iter().map(|look| look.error).enumerate().collect()
}

/// Returns each mip level of an image that has pictures, with these.
fn with_levels(grid: LightGrid, seen: &[Seen]) -> impl Iterator<Item = (LightGrid, &Seen)> {
    let of_mip = |(mip, level): (usize, LightGrid)| seen.iter().find(|seen| seen.mip == mip).map(|seen| (level, seen));
    let count = seen.last().map_or(0, |seen| seen.mip + 1);
    grid.levels(count).enumerate().filter_map(of_mip)
}

impl Moves {
    fn of(mip: usize, level: &LightGrid, credits: &Credits) -> Self {
        let mut colors = vec![Vec4::ZERO; level.0.pixels.len()];
        let mut alpha = vec![Vec2::ZERO; level.0.pixels.len()];
        credits.colors.iter().for_each(|credit| colors[credit.texel as usize] += credit.value);
        credits.alpha.iter().for_each(|credit| alpha[credit.texel as usize] += credit.value);
        let usual = mean_credit(&credits.alpha);
        let step =
            |(color, alpha): (&Vec4, &Vec2)| (color.truncate() / (color.w + PRIOR)).extend(direction(*alpha, usual));
        Self { mip, width: level.0.width, texels: colors.par_iter().zip(&alpha).map(step).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_comes_nearer_to_that_of_the_leaves_or_stays() {
        let look = |coverage: f64| Look { error: 0.1, coverage };
        let keeps = |before: f64, now: f64| look(now).keeps_coverage_of(&look(before));
        assert!(keeps(1.17, 1.0) && keeps(1.17, 1.19) && keeps(1.17, 0.92) && keeps(0.8, 1.09));
        assert!(!keeps(1.17, 0.84) && !keeps(1.17, 1.21) && !keeps(0.8, 0.76) && !keeps(0.8, 1.2));
    }
}
