//! Refinement of a page for engines on its box-filtered mip levels.
//!
//! An engine makes the mip levels itself, so one image has to look like the leaves on all of them. Each step draws the billboards with each mip
//! level at the size where its texels are about a pixel, and credits the differences to its texels, as for a page of the .blend file
//! ([`super`]). A texel of the image moves by the steps of all texels that contain it: the mean of a block answers to the pictures of a coarse
//! level, its details to those of finer ones.
//!
//! The leaves are not drawn again: pictures of the refinement before serve, at a half, a quarter and an eighth of their size, too. Test views
//! decide: the image counts only if it is better in them on the whole and worse on no mip level. Sums have a fixed order. O(steps · levels · views ·
//! (pixels + fragments)). Known limit: no texel gets alpha that has none.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::credit::{Credits, Drawn};
use super::gain::{Errors, Gain};
use super::leaf_views::LeafViews;
use super::picture::Target;
use super::texels::mean_credit;
use crate::atlas::Atlas;
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image, Material};
use crate::geometry::Frame;
use crate::lod::billboards::billboards;
use crate::metrics::{PICTURE_RADIUS, View};
use crate::textures::LightGrid;

/// Pictures of the leaves that a refinement has drawn.
#[derive(Clone, Debug)]
pub struct LeafPictures {
    /// In the views of its steps.
    pub steps: LeafViews,
    /// In test views.
    pub tests: LeafViews,
}

/// Billboards with a page for engines.
pub struct OnMips<'a> {
    pub atlas: &'a Atlas,
    pub frame: &'a Frame,
    /// Their material, without an image.
    pub material: &'a Material,
    /// Least alpha that is drawn.
    pub cutoff: f32,
    pub pictures: &'a LeafPictures,
}

/// Number of steps, and after how many steps test views look at the image.
const STEPS: usize = 8;
const TESTED: usize = 2;

/// Views of a step times the side of the pictures: smaller pictures show fewer texels, so more of them are drawn.
const VIEWS_BY_SIZE: usize = 640;
const LEAST_VIEWS: usize = 3;

/// Points along a pixel's side at which the billboards are looked at. Only two lowered the error much less for one.
const POINTS: usize = 2;

/// Share of the cutoff by which the lower and the higher cutoff of a step differ from it.
const BAND: f32 = 0.4;

/// Share of the way to the color that the leaves have, for the mean over the mip levels.
const COLOR: f32 = 2.0;

/// Greatest change of alpha on each mip level, relative to alpha and half the cutoff.
const ALPHA: f32 = 0.2;

/// Weight of staying as it is, beside the credits of a texel.
const PRIOR: f32 = 2.0;

/// Least alpha of a texel that has any, so that it can come back.
const LEAST_ALPHA: f32 = 0.25 / 255.0;

/// A mip level, with the step of each texel: of its color, and the direction of its alpha, from -1 to 1.
struct Moves {
    width: usize,
    texels: Vec<Vec4>,
}

/// Pictures of the leaves for one mip level.
struct Seen {
    steps: Vec<(View, Target)>,
    tests: LeafViews,
}

impl OnMips<'_> {
    /// Returns the image after refinement; unchanged if it did not become better, or if its texels are larger than the pixels of all pictures.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn refined(&self, image: Image) -> Result<Image> {
        let seen = self.seen(&image);
        if seen.is_empty() {
            return Ok(image);
        }
        let mut grid = LightGrid::of(&image);
        let first = self.errors(&image, &seen)?;
        let mut best = (image, Gain::none(&first));
        for step in 0..STEPS {
            self.move_texels(&mut grid, &seen, step)?;
            if (step + 1) % TESTED == 0 {
                let image = grid.image(|_, texel| texel.w);
                let gain = Gain::over(&first, &self.errors(&image, &seen)?);
                if gain.is_better_than(&best.1) {
                    best = (image, gain);
                }
            }
        }
        Ok(best.0)
    }

    /// Returns the pictures for each mip level: those in which its texels are nearest to a pixel, for the first one, and their halves.
    fn seen(&self, image: &Image) -> Vec<Seen> {
        let texel = self.atlas.texel() * self.frame.radius * self.atlas.size.width as f64 / image.width() as f64;
        let wanted = 2.0 * PICTURE_RADIUS * self.frame.radius / texel;
        let sizes = self.pictures.tests.sizes();
        let of_size = |size: usize| {
            let steps = self.pictures.steps.of_size(size);
            let steps = steps.pictures().map(|(view, image)| (*view, Target::of(image))).collect();
            Seen { steps, tests: self.pictures.tests.of_size(size) }
        };
        // Half an octave: the next smaller size is nearer.
        let near = sizes.iter().skip_while(|&&size| size as f64 > std::f64::consts::SQRT_2 * wanted);
        near.map(|&size| of_size(size)).collect()
    }

    /// Returns the error on each mip level in the test views.
    fn errors(&self, image: &Image, seen: &[Seen]) -> Result<Errors> {
        let levels = LightGrid::of(image).levels(seen.len()).zip(seen);
        let error = |(level, seen): (LightGrid, &Seen)| {
            let shown = self.shown(level.image(|_, texel| texel.w), self.cutoff)?;
            Ok(seen.tests.errors(&shown, Vec3::ONE)?[0])
        };
        levels.map(error).collect()
    }

    fn shown(&self, image: Image, cutoff: f32) -> Result<Foliage> {
        let alpha_mode = AlphaMode::Mask(cutoff.clamp(1.0 / 255.0, 1.0));
        billboards(self.atlas, self.frame, Material { image: Some(image), alpha_mode, ..self.material.clone() })
    }

    /// Moves the texels of the image, less with each step, so that they come to rest although each step has other views.
    fn move_texels(&self, grid: &mut LightGrid, seen: &[Seen], step: usize) -> Result<()> {
        let levels = grid.clone().levels(seen.len()).zip(seen);
        let moves: Vec<Moves> = levels.map(|(level, seen)| self.moves(&level, seen, step)).collect::<Result<_>>()?;
        let slower = 1.0 / (1.0 + 0.25 * step as f32);
        let color = slower * COLOR / moves.len() as f32;
        let (alpha, width) = (slower * ALPHA, grid.0.width);
        grid.0.pixels.par_iter_mut().enumerate().for_each(|(texel, value)| {
            let at = |(number, moves): (usize, &Moves)| {
                // A level without the last column or row of the level before has no texel there.
                let column = ((texel % width) >> number).min(moves.width - 1);
                let row = ((texel / width) >> number).min(moves.texels.len() / moves.width - 1);
                moves.texels[row * moves.width + column]
            };
            let all: Vec4 = moves.iter().enumerate().map(at).sum();
            let rgb = (value.truncate() + color * all.truncate()).clamp(Vec3::ZERO, Vec3::ONE);
            let moved = value.w + alpha * all.w * (value.w + 0.5 * self.cutoff);
            // A texel without alpha stays so: gutters, and places far from all leaves.
            *value = rgb.extend(if value.w > 0.0 { moved.clamp(LEAST_ALPHA, 1.0) } else { 0.0 });
        });
        Ok(())
    }

    /// Returns the step of one mip level. Views take turns.
    fn moves(&self, level: &LightGrid, seen: &Seen, step: usize) -> Result<Moves> {
        let image = level.image(|_, texel| texel.w);
        let at = |share: f32| self.shown(image.clone(), share * self.cutoff);
        let drawn = Drawn { here: at(1.0)?, denser: at(1.0 - BAND)?, sparser: at(1.0 + BAND)? };
        let size = seen.steps[0].0.size;
        let count = (VIEWS_BY_SIZE / size).max(LEAST_VIEWS).min(seen.steps.len());
        let turn = (0..count).into_par_iter().map(|number| &seen.steps[(step * count + number) % seen.steps.len()]);
        let each = turn.map(|(view, target)| drawn.credits(level, target, view, POINTS));
        Ok(Moves::of(level, &Credits::joined(each.collect::<Result<_>>()?)))
    }
}

impl Moves {
    fn of(level: &LightGrid, credits: &Credits) -> Self {
        let mut colors = vec![Vec4::ZERO; level.0.pixels.len()];
        let mut alpha = vec![Vec2::ZERO; level.0.pixels.len()];
        credits.colors.iter().for_each(|credit| colors[credit.texel as usize] += credit.value);
        credits.alpha.iter().for_each(|credit| alpha[credit.texel as usize] += credit.value);
        let usual = mean_credit(&credits.alpha).max(f32::MIN_POSITIVE);
        let step = |(color, alpha): (&Vec4, &Vec2)| {
            let mean = alpha.x / (alpha.y + PRIOR);
            (color.truncate() / (color.w + PRIOR)).extend(mean / (mean.abs() + usual))
        };
        Self { width: level.0.width, texels: colors.par_iter().zip(&alpha).map(step).collect() }
    }
}
