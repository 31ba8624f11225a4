//! Refinement of a page for engines on its box-filtered mip levels.
//!
//! An engine makes the mip levels itself, so one image has to look like the leaves on all of them. Each step draws the billboards with each mip
//! level at the size where engines read it, and credits the differences to its texels, as for a page of the .blend file ([`super`]). A texel
//! of the image moves by the steps of all texels that contain it: the mean of a block answers to the pictures of a coarse level, its details to
//! those of finer ones. For files with mip levels of their own, each mip level is refined alone ([`OnMips::mips`] is 1).
//!
//! The leaves are drawn once for all levels of a chain: mip levels are compared with smaller copies of these pictures. Test views decide: the
//! image counts only if it is better in them on the whole, worse on no mip level ([`FIRST_WORSE`] tells of the first), and keeps the coverage
//! on all. Coarse levels gain most by more alpha in all their texels; fine levels then cover too much. So alpha of the whole image is balanced
//! between them before each test ([`OnMips::balanced`]). Sums have a fixed order. O(steps · levels · views · (pixels + fragments)) plus O(texels) a step, for each
//! part of a shared page. Known limits: no texel gets alpha that has none; mip levels with texels finer than the pixels of all pictures get no
//! credits of their own; mip levels that are smaller than all pictures get none either.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::credit::{Credits, Drawn};
use super::gain::{Errors, Gain};
use super::leaf_views::{LeafPictures, LeafView, Look, coverage_in, of_size};
use super::picture::Target;
use super::texels::{PRIOR, direction, mean_credit, slower};
use crate::atlas::Atlas;
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image, Material};
use crate::geometry::Frame;
use crate::lod::billboards::billboards;
use crate::lod::tune::{self, MIP_COVERAGE, MIP_COVERAGE_ERROR};
use crate::metrics::View;
use crate::textures::{LightGrid, bent};

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
const UNTIL_TEST: usize = 4;

/// Most texels of an image: larger ones stay, because a step takes some 90 bytes for each.
const MOST_TEXELS: usize = 1 << 22;

/// Views of a step times the side of the pictures: smaller pictures show fewer texels, so more of them are drawn.
const VIEWS_BY_SIZE: usize = 640;
const LEAST_VIEWS: usize = 3;

/// Number by which the mip level that engines read exceeds the one that suits the size of texels, on average. They read the one for the longer
/// of the steps in texels to the next pixel in a row and in a column: log2(1 + t² max(cos² φ, sin² φ)) / 2 more for a billboard at the angle θ to
/// the picture, with t = tan θ, that is slanted in the direction φ. The mean over φ, and over c = cos θ from 0 to 1 with the visible area 2 c, is
/// 0.647.
const TILT: f64 = 0.65;

/// Side of the smallest pictures that refine a mip level, in pixels.
const SMALLEST: usize = 8;

/// Points along a pixel's side at which the billboards are looked at.
const POINTS: usize = 2;

/// Share of the cutoff by which the lower and the higher cutoff of a step differ from it.
const BAND: f32 = 0.4;

/// Greatest factor on the mean of the color steps of all mip levels. Above 1, because each level has a step of its own.
const COLOR: f32 = 2.0;

/// Greatest change of alpha for each mip level, before its weight, relative to alpha and half the cutoff.
const ALPHA: f32 = 0.2;

/// Weight of the first of several mip levels with pictures in the direction of alpha: the other ones move the texels of a block together, and
/// would win where an edge of the first one lies between them.
const FIRST_WEIGHT: f32 = 2.0;

/// Least alpha of a texel that has any, so that it can come back.
const LEAST_ALPHA: f32 = 0.25 / 255.0;

/// Lower bound of a mip level's coverage: an empty level has a finite error.
const LEAST_COVERAGE: f64 = 1e-3;

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
    tests: Vec<LeafView>,
}

impl OnMips<'_> {
    /// Returns the image after refinement; `None` if it does not become better, if it has more than [`MOST_TEXELS`], or if its texels are larger
    /// than the pixels of all pictures.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn refined(&self, image: &Image) -> Result<Option<Image>> {
        if !self.sees(image) {
            return Ok(None);
        }
        let seen = self.seen(image, &self.pictures.steps);
        let mut grid = LightGrid::of(image);
        let looks = self.looks(image, &seen)?;
        let first = errors(&looks);
        let mut best = (None, Gain::none(&first));
        for step in 0..self.steps {
            self.move_texels(&mut grid, &seen, step)?;
            if (step + 1) % UNTIL_TEST != 0 && step + 1 != self.steps {
                continue;
            }
            let image = grid.to_image();
            // Mip levels of files get the coverage of their tree afterwards, with those that are mixed with them.
            let image = if self.mips > 1 { self.balanced(&image, &seen)? } else { image };
            let now = self.looks(&image, &seen)?;
            let gain = Gain::over(&first, &errors(&now));
            let keeps_coverage = now.iter().zip(&looks).all(|(now, first)| now.keeps_coverage_of(first));
            if keeps_coverage && keeps_errors(&gain) && gain.mean() < best.1.mean() {
                best = (Some(image), gain);
            }
        }
        Ok(best.0)
    }

    /// Returns how much the mip levels with pictures differ from the leaves; `None` without any: the mean of ln (error · r), where r is the
    /// larger of coverage and [`MIP_COVERAGE`] over the smaller. The error alone of a sparse level that shows nothing is small.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn error(&self, image: &Image) -> Result<Option<f64>> {
        if !self.sees(image) {
            return Ok(None);
        }
        let looks = self.looks(image, &self.seen(image, &[]))?;
        let off = |look: &Look| libm::log(look.coverage.max(LEAST_COVERAGE) / MIP_COVERAGE).abs();
        let of_level = |look: &Look| libm::log(look.error.max(1e-9)) + off(look);
        Ok(Some(looks.iter().map(of_level).sum::<f64>() / looks.len() as f64))
    }

    /// Returns whether the image has at most [`MOST_TEXELS`], and pictures for any of its mip levels.
    pub fn sees(&self, image: &Image) -> bool {
        image.pixels().len() <= MOST_TEXELS && self.sizes(image).next().is_some()
    }

    /// Returns the mip levels that have pictures, each with the size of a picture in pixels at which engines read it.
    pub fn sizes(&self, image: &Image) -> impl Iterator<Item = (usize, usize)> {
        let (most, radius) = self.pictures.tests.first().map_or((0, 0.0), |(view, _)| (view.size, view.radius));
        let texel = self.atlas.texel() * self.frame.radius * self.atlas.size.width as f64 / image.width() as f64;
        let size = move |mip: usize| (2.0 * radius / texel * libm::exp2(TILT - mip as f64)).round() as usize;
        let count = (image.width().max(image.height()).ilog2() as usize + 1).min(self.mips);
        (0..count).map(move |mip| (mip, size(mip))).filter(move |(_, size)| (SMALLEST..=most).contains(size))
    }

    /// Returns the pictures for each mip level, if it has any: these for steps, and those of the test views.
    fn seen(&self, image: &Image, steps: &[LeafView]) -> Vec<Seen> {
        let of_mip = |(mip, size)| {
            let steps = of_size(steps, size).into_iter();
            Seen {
                mip,
                steps: steps.map(|(view, image)| (view, Target::of(&image))).collect(),
                tests: of_size(&self.pictures.tests, size),
            }
        };
        self.sizes(image).map(of_mip).collect()
    }

    /// Returns the image with other alpha, so that as many mip levels cover more than [`MIP_COVERAGE`] as cover less.
    fn balanced(&self, image: &Image, seen: &[Seen]) -> Result<Image> {
        let recut = |pivot: f64| bent(image, pivot as f32, self.cutoff);
        let excess = |pivot: f64| {
            let covered = |(level, seen): (LightGrid, &Seen)| {
                coverage_in(&seen.tests, &self.shown(level.to_image(), self.cutoff)?)
            };
            let mut covered: Vec<f64> =
                with_levels(LightGrid::of(&recut(pivot)), seen).map(covered).collect::<Result<_>>()?;
            covered.sort_by(f64::total_cmp);
            let middle = 0.5 * (covered[(covered.len() - 1) / 2] + covered[covered.len() / 2]);
            Ok(libm::log(middle.max(1e-9) / MIP_COVERAGE))
        };
        let pivot = tune::least_excess(f64::from(self.cutoff), tune::CUTOFF_RANGE, MIP_COVERAGE_ERROR, excess)?;
        Ok(recut(pivot))
    }

    /// Looks at each mip level in the test views.
    fn looks(&self, image: &Image, seen: &[Seen]) -> Result<Vec<Look>> {
        let look =
            |(level, seen): (LightGrid, &Seen)| Look::at(&self.shown(level.to_image(), self.cutoff)?, &seen.tests);
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
        let more_of_first = if moves.len() > 1 { FIRST_WEIGHT - 1.0 } else { 0.0 };
        grid.0.pixels.par_iter_mut().enumerate().for_each(|(texel, value)| {
            let at = |moves: &Moves| {
                // Texels beyond the last column or row of an odd side take its step.
                let column = ((texel % width) >> moves.mip).min(moves.width - 1);
                let row = ((texel / width) >> moves.mip).min(moves.texels.len() / moves.width - 1);
                moves.texels[row * moves.width + column]
            };
            let all: Vec4 = moves.iter().map(at).sum();
            let rgb = (value.truncate() + color * all.truncate()).clamp(Vec3::ZERO, Vec3::ONE);
            let direction = all.w + more_of_first * at(&moves[0]).w;
            let moved = value.w + alpha * direction * (value.w + 0.5 * self.cutoff);
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

/// How far the coverage of a mip level, relative to [`MIP_COVERAGE`], may leave the range between that before and 1.
const COVERAGE_SLACK: f64 = 0.05;

/// How far the coverage may cross [`MIP_COVERAGE`], relative to its former distance from it.
const BEYOND: f64 = 0.5;

impl Look {
    /// Returns whether the coverage is about as near to [`MIP_COVERAGE`] as before, or nearer.
    fn keeps_coverage_of(&self, first: &Self) -> bool {
        let [before, now] = [first, self].map(|look| look.coverage / MIP_COVERAGE);
        let (low, high) = (before.min(1.0) - COVERAGE_SLACK, before.max(1.0) + COVERAGE_SLACK);
        (low..=high).contains(&now) || (now - 1.0).abs() <= BEYOND * (before - 1.0).abs()
    }
}

/// Largest error of the first mip level with pictures, relative to that before. Trilinear filters mix it in where it is too fine, up to the
/// distance at which the next one suits; other mip levels may not become worse.
const FIRST_WORSE: f64 = 1.05;

/// Returns whether no mip level becomes worse, but for the first within [`FIRST_WORSE`].
fn keeps_errors(gain: &Gain) -> bool {
    gain.errors
        .iter()
        .zip([FIRST_WORSE].into_iter().chain(std::iter::repeat(1.0)))
        .all(|((_, ratio), most)| *ratio <= most)
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
        let look = |coverage: f64| Look { error: 0.1, coverage: coverage * MIP_COVERAGE };
        let keeps = |before: f64, now: f64| look(now).keeps_coverage_of(&look(before));
        assert!(keeps(1.17, 1.0) && keeps(1.17, 1.21) && keeps(1.17, 0.92) && keeps(0.8, 1.09));
        assert!(!keeps(1.17, 0.84) && !keeps(1.17, 1.23) && !keeps(0.8, 0.74) && !keeps(0.8, 1.2));
    }

    #[test]
    fn only_the_first_mip_level_may_become_a_little_worse() {
        let keeps = |ratios: [f64; 3]| keeps_errors(&Gain { errors: ratios.into_iter().enumerate().collect() });
        assert!(keeps([1.0, 0.9, 1.0]) && keeps([1.04, 0.7, 0.6]));
        assert!(!keeps([1.06, 0.7, 0.6]) && !keeps([0.7, 1.01, 0.6]) && !keeps([0.7, 0.7, 1.01]));
    }
}
