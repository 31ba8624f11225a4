//! The yardstick: whether a level looks like its leaves, by what an equally good tree passes.
//!
//! FLIP asks whether each leaf is in its own place, and nobody who looks at a tree asks that. So a level is compared with the leaves, and its
//! figures with those of a *control*: the same leaves as a light breeze has moved them ([`crate::sway`]). Without light and under a sun, it may
//! have FLIP of q times the control's; contrast of the three finest octaves, coverage and mean color must be those of the leaves; and from
//! [`CELLS_FROM`] pixels on the cells of the crown must be covered as in the control.
//!
//! Pictures have the diameters of the crown that halve from [`LARGEST`]. O(views · pixels) for each.

use leafcloud::Foliage;
use leafcloud::Image;
use leafcloud::error::Result;
use leafcloud::metrics::{Comparison, Pictures, Reference, Views};
use leafcloud::textures::{Samples, mips};
use leafcloud_flip::crown_pixels;
use rayon::prelude::*;

use crate::looks::Looks;
use crate::sway::{motion, swayed};

/// Side of the largest pictures in pixels, half of a usual screen's height, and of the smallest.
pub const LARGEST: usize = 512;
const SMALLEST: usize = 16;

/// Contrast over the leaves'.
const CONTRAST: (f64, f64) = (0.75, 1.15);

/// Difference of coverage from the leaves', for crowns of at least [`SMALL`] pixels and for smaller ones.
const COVERAGE: (f64, f64) = (0.03, 0.05);
const SMALL: f64 = 40.0;

/// Difference of the mean color.
const COLOR: f64 = 0.01;

/// Side of the smallest picture whose cells are compared.
const CELLS_FROM: usize = 64;

/// What a level has of its allowance in pictures of one size; at most 1 is allowed for each.
#[derive(Clone, Copy, Debug)]
pub struct Judgement {
    /// Diameter of the crown in pixels.
    pub crown: f64,
    /// The figures without light and under a sun; of the light with the larger excess.
    pub looks: Looks,
    /// FLIP over the control's.
    pub flip: f64,
    /// Cells over the control's; 0 where they are not compared.
    pub cells: f64,
}

impl Judgement {
    /// Returns the greatest share of an allowance that is used, and its name. `q`: allowed FLIP over the control's.
    #[must_use]
    pub fn excess(&self, q: f64) -> (f64, &'static str) {
        let Looks { contrast, coverage, color, .. } = self.looks;
        let contrast = contrast.map(|ratio| if ratio < 1.0 { (1.0 - ratio) / (1.0 - CONTRAST.0) } else { (ratio - 1.0) / (CONTRAST.1 - 1.0) });
        let cover = if self.crown < SMALL { COVERAGE.1 } else { COVERAGE.0 };
        let all = [
            (self.flip / q, "difference"),
            (contrast.into_iter().fold(0.0, f64::max), "contrast"),
            ((coverage - 1.0).abs() / cover, "coverage"),
            (self.cells, "places"),
            (color / COLOR, "color"),
        ];
        all.into_iter().fold((0.0, "difference"), |most, each| if each.0 > most.0 { each } else { most })
    }
}

/// Pictures of the leaves and of the control.
pub struct Yardstick {
    reference: Reference,
    /// Pictures of one size each, from the largest.
    sizes: Vec<Size>,
}

struct Size {
    side: usize,
    /// The leaves in each view, for each light.
    base: Vec<Vec<Image>>,
    /// The control, for each light.
    control: Vec<Looks>,
}

impl Yardstick {
    /// Renders the leaves and the control. `still`: parts that no breeze moves, which levels show, too.
    ///
    /// # Errors
    /// Those of a render.
    pub fn new(leaves: &Foliage, still: Option<&Foliage>, views: Views, lit: bool) -> Result<Self> {
        let frame = leaves.frame();
        let render = if lit { Reference::lit } else { Reference::new };
        let reference = render(&with(leaves, still), frame, views)?;
        let mut sizes: Vec<Size> = Vec::new();
        let mut known: Option<(f64, Comparison)> = None;
        let sides = std::iter::successors(Some(views.size), |side| Some(side / 2)).take_while(|side| *side >= SMALLEST);
        for side in sides {
            let motion = motion(crown_pixels(side as f64));
            if known.as_ref().is_none_or(|(last, _)| *last != motion) {
                let control = swayed(leaves, motion)?;
                // Controls for small pictures are rendered small: twice as large, so that their pixels are means.
                let smaller = Views { size: (2 * side).min(views.size), ..views };
                let small = render(&with(leaves, still), frame, smaller)?;
                known = Some((motion, small.compare(&with(&control, still))?));
            }
            let Some((_, control)) = &known else { continue };
            let base = lights(control).map(|pictures| at(&pictures.base, side)).collect::<Vec<_>>();
            let looks = lights(control).zip(&base).filter_map(|(pictures, base)| mean(base, &at(&pictures.level, side)));
            sizes.push(Size { side, control: looks.collect(), base });
        }
        Ok(Self { reference, sizes })
    }

    /// Returns the views with the samples of a picture.
    ///
    /// # Errors
    /// None.
    pub fn views(count: usize, up: glam::DVec3) -> Result<Views> {
        Ok(Views { count, size: LARGEST, samples: Samples::new(2)?, up, turn: 0.5 })
    }

    /// Renders a level in all views.
    ///
    /// # Errors
    /// Those of a render.
    pub fn pictures(&self, level: &Foliage) -> Result<Comparison> {
        self.reference.compare(&[level])
    }

    /// Returns the pictures' views.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    /// Returns the sides of the pictures, from the largest.
    pub fn sides(&self) -> impl Iterator<Item = usize> + '_ {
        self.sizes.iter().map(|size| size.side)
    }

    /// Judges pictures of a level where they are `side` pixels wide. `None` for a size without pictures.
    #[must_use]
    pub fn judge(&self, level: &Comparison, side: usize, q: f64) -> Option<Judgement> {
        let size = self.sizes.iter().find(|size| size.side == side)?;
        let crown = crown_pixels(side as f64);
        let of_light = |((pictures, base), control): ((&Pictures, &Vec<Image>), &Looks)| {
            let looks = mean(base, &at(&pictures.level, side))?;
            let cells = if side < CELLS_FROM { 0.0 } else { looks.cells / control.cells.max(1e-6) };
            Some(Judgement { crown, looks, flip: looks.flip / control.flip.max(1e-6), cells })
        };
        let judged = lights(level).zip(&size.base).zip(&size.control).filter_map(of_light);
        judged.max_by(|a, b| a.excess(q).0.total_cmp(&b.excess(q).0))
    }

    /// Returns the largest diameter of the crown in pixels at which a level passes, and its judgement in the largest pictures in which it does;
    /// `None` if it passes in none. Between two sizes the excess is taken as linear in the logarithm of the size.
    #[must_use]
    pub fn largest(&self, level: &Comparison, q: f64) -> Option<(f64, Judgement)> {
        let mut above: Option<Judgement> = None;
        for side in self.sides() {
            let Some(judged) = self.judge(level, side, q) else { continue };
            let (excess, _) = judged.excess(q);
            if excess <= 1.0 {
                let over = above.map(|above| (above.crown, above.excess(q).0));
                let size = over.map_or(judged.crown, |(crown, larger)| {
                    judged.crown * libm::pow(crown / judged.crown, (1.0 - excess) / (larger - excess))
                });
                return Some((size, judged));
            }
            above = Some(judged);
        }
        None
    }
}

fn with<'a>(leaves: &'a Foliage, still: Option<&'a Foliage>) -> Vec<&'a Foliage> {
    std::iter::once(leaves).chain(still).collect()
}

/// Returns the pictures without light, and under a sun if there are any.
fn lights(pictures: &Comparison) -> impl Iterator<Item = &Pictures> {
    std::iter::once(&pictures.flat).chain(&pictures.lit)
}

/// Returns the pictures halved to a side.
fn at(pictures: &[Image], side: usize) -> Vec<Image> {
    let halved = |image: &Image| mips::means(image).into_iter().find(|level| level.width() <= side);
    pictures.par_iter().filter_map(halved).collect()
}

fn mean(base: &[Image], others: &[Image]) -> Option<Looks> {
    let views: Vec<Looks> = base.par_iter().zip(others).filter_map(|(base, other)| Looks::of(base, other)).collect();
    Looks::mean(&views)
}
