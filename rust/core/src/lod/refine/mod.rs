//! Refinement by pictures: first of planes and of the leaves on them ([`planes`]), then of texels, which this module changes.
//!
//! The texels of a level are changed until its pictures look like those of the leaves.
//! The bake projects leaves onto planes and chooses one cutoff. A leaf on its plane appears beside its true place, at another side in each
//! view, and covers other leaves there. The best color and outline from all sides follow from no rule, but from pictures. So each step
//! draws the leaves and the level from new directions, and credits the difference to the texels that show it:
//!
//! - *Color*: each visible texel moves towards the mean color that the leaves have where it is seen.
//! - *Alpha*: near the cutoff, a texel is drawn or not. The level is also drawn at a lower and at a higher cutoff. Where a texel appears or
//!   vanishes, the picture becomes better or worse; alpha moves accordingly.
//!
//! The steps are those of a simultaneous iterative reconstruction (SIRT; Gilbert, "Iterative methods for the three-dimensional
//! reconstruction of an object from projections", 1972): each texel moves by the mean over all points that show it. Differences count twice, in
//! single pixels and in blocks of some five pixels: single pixels alone would blur the texture and change its mean. Hasselgren et al.
//! ("Appearance-Driven Automatic 3D Model Simplification", 2021) let pictures decide by gradients; Deliot et al. ("Transforming a
//! Non-Differentiable Rasterizer into a Differentiable One with Stochastic Gradient Estimation", 2024) by paired pictures, without
//! derivatives of the rasterizer, as here.
//!
//! After each round test views measure the gain ([`gain`]). A page counts only if it is better in them on the whole and worse at no size. Planes and
//! the morph do not change any more, nor do other channels: color and alpha alone move, and polygons follow the new outlines.
//!
//! Sums have a fixed order: texels collect their credits billboard by billboard, in the order of views and pixels. O(steps · views ·
//! (pixels + fragments)), plus O(texels) a step. Known limit: alpha that is far from the cutoff does not move.

mod credit;
mod gain;
mod leaf_views;
mod of_level;
mod pairs;
mod parts;
mod picture;
mod planes;
mod slabs;
mod switches;
mod texels;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::credit::{Credits, Drawn};
use self::gain::Gain;
use self::leaf_views::{LeafView, LeafViews, drawn, views};
use self::picture::Target;
pub(super) use self::planes::Arrangement;
use self::texels::{Rates, Texels};
use super::billboards::billboards;
use super::cut::CutOut;
use crate::atlas::Atlas;
use crate::error::Result;
use crate::fit::Named;
use crate::foliage::Foliage;
use crate::geometry::Frame;
use crate::metrics::{PICTURE_RADIUS, Reference};
use crate::progress::Progress;
use crate::textures::Page;

pub(super) use of_level::refined;

/// Effort of the refinement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refinement {
    /// Textures stay as they are baked.
    #[default]
    Off,
    /// A few seconds.
    Short,
    /// Some tens of seconds.
    Long,
}

impl Named for Refinement {
    const WHAT: &'static str = "refine";
    const ALL: &'static [Self] = &[Self::Off, Self::Short, Self::Long];

    fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Short => "short",
            Self::Long => "long",
        }
    }
}

impl Refinement {
    /// Returns the share of a level's time that it takes, about.
    pub(super) fn share(self) -> f64 {
        match self {
            Self::Off => 0.0,
            Self::Short => 0.4,
            Self::Long => 0.8,
        }
    }

    /// Returns rounds, steps of each round and views of each step.
    fn plan(self) -> Plan {
        match self {
            Self::Off => Plan { rounds: 0, steps: 0, views: 0 },
            Self::Short => Plan { rounds: 1, steps: 5, views: 4 },
            Self::Long => Plan { rounds: 4, steps: 6, views: 6 },
        }
    }
}

/// Parts of a refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefinedParts {
    /// Planes, and the plane of each leaf.
    pub planes: bool,
    /// Color and alpha of the textures.
    pub texels: bool,
}

impl Default for RefinedParts {
    /// All.
    fn default() -> Self {
        Self { planes: true, texels: true }
    }
}

/// Amount of work.
struct Plan {
    rounds: usize,
    steps: usize,
    views: usize,
}

/// A level that is refined.
pub struct Subject<'a> {
    /// The leaves that it replaces.
    pub leaves: &'a Foliage,
    /// Renderings of the leaves for coverage.
    pub amounts: &'a Reference,
    /// Its layout, in `frame`.
    pub atlas: &'a Atlas,
    /// The layout with tight polygons, which are faster to draw, around all that may become visible.
    pub tight: &'a Atlas,
    /// Its local frame.
    pub frame: &'a Frame,
    /// Whether billboards are seen from both sides.
    pub double_sided: bool,
    /// Up direction.
    pub up: DVec3,
    /// The mip level with texels of about a pixel where the level takes over.
    pub mip: usize,
}

/// A page after refinement.
pub struct RefinedPage {
    /// Unchanged if nothing became better.
    pub page: Page,
    /// Its alpha cutoff.
    pub cutoff: f32,
    /// Errors relative to those before.
    pub refined: Refined,
}

/// The gain of a refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Sides of the test pictures in pixels, with the error relative to that before the refinement.
    pub errors: Vec<(usize, f64)>,
}

/// Sides of the pictures of a step, in pixels.
const SIZES: (usize, usize) = (64, 256);

/// Points along a pixel's side at which the level is looked at.
const POINTS: usize = 2;

/// Number of test views.
const TEST_VIEWS: usize = 8;

/// Turn of the test views. Other views tune (turn ¼) and report (½), and benchmarks use others again (0).
const TEST_TURN: f64 = 0.4;

/// Turns of the steps, spread evenly between these, because a turn of 2.618 golden angles is a whole one: it shares its directions with 0.
const TURNS: (f64, f64) = (0.65, 2.45);

/// Returns the text of the progress: with the best error, once there is one.
fn stage(best: &Gain) -> String {
    match best.mean() {
        1.0 => "refine".to_owned(),
        mean => format!("refine (error {:.1} % of before)", 100.0 * mean),
    }
}

/// Returns the turn of a step's views.
fn turn_of(step: usize) -> f64 {
    let place = step as f64 * 0.618_033_988_75;
    TURNS.0 + (TURNS.1 - TURNS.0) * (place - place.floor())
}

/// Range of alpha about the cutoff in which texels move in one step.
pub const BAND: f32 = 0.2;

impl Subject<'_> {
    /// Returns the page after refinement.
    ///
    /// # Errors
    /// No billboard has an area; [`crate::Error::Cancelled`].
    pub fn refined(&self, page: &Page, cutoff: f32, effort: Refinement, progress: Progress) -> Result<RefinedPage> {
        let Plan { rounds, steps, views: each } = effort.plan();
        progress.tell("refine", 0.0)?;
        let size = self.size();
        let views = |count, turn| views(self.leaves.frame(), self.up, size, (count, turn));
        let tests = LeafViews::of(drawn(self.leaves, views(TEST_VIEWS, TEST_TURN)?)?);
        let first = tests.errors(&self.shown(page, cutoff)?, Vec3::ONE)?;
        let mut best = (page.clone(), cutoff, Gain::none(&first));
        let mut texels = Texels::of(&page.base_color, self.atlas, cutoff);
        for step in 0..rounds * steps {
            progress.tell(&stage(&best.2), step as f64 / (rounds * steps) as f64)?;
            let seen = drawn(self.leaves, views(each, turn_of(step))?)?;
            texels.move_by(&self.credits(page, &texels, cutoff, &seen)?, Rates::of_step(step));
            if (step + 1) % steps == 0 {
                let (page, cutoff) = self.balanced(page, &mut texels)?;
                let gain = Gain::over(&first, &tests.errors(&self.shown(&page, cutoff)?, Vec3::ONE)?);
                if gain.is_better_than(&best.2) {
                    best = (page, cutoff, gain);
                }
            }
        }
        progress.tell(&stage(&best.2), 1.0)?;
        let (page, cutoff, gain) = best;
        Ok(RefinedPage { page, cutoff, refined: Refined { errors: gain.errors } })
    }

    /// Returns a page with the texels and its cutoff, both with the coverage and the mean color of the leaves.
    fn balanced(&self, page: &Page, texels: &mut Texels) -> Result<(Page, f32)> {
        let with = |texels: &Texels| Page { base_color: texels.page(), ..page.clone() };
        let moved = with(texels);
        let cutoff = CutOut::of(&self.shown(&moved, 0.0)?, self.amounts, self.mip)?.cutoff(&moved);
        texels.scale(self.amounts.tone(&self.shown(&moved, cutoff)?)?);
        Ok((with(texels), cutoff))
    }

    /// Returns the side of the pictures: a texel is about a pixel.
    fn size(&self) -> usize {
        let pixels = 2.0 * PICTURE_RADIUS * self.leaves.frame().radius / (self.atlas.texel() * self.frame.radius);
        (pixels as usize).clamp(SIZES.0, SIZES.1) / 8 * 8
    }

    fn shown(&self, page: &Page, cutoff: f32) -> Result<Foliage> {
        billboards(self.atlas, self.frame, page.material(cutoff, self.double_sided))
    }

    /// Returns what the texels contribute to the difference from the leaves, view by view.
    fn credits(&self, page: &Page, texels: &Texels, cutoff: f32, seen: &[LeafView]) -> Result<Credits> {
        let page = Page { base_color: texels.widened(), ..page.clone() };
        let at = |cutoff: f32| {
            let material = page.material(cutoff.clamp(1.0 / 255.0, 1.0), self.double_sided);
            billboards(self.tight, self.frame, material)
        };
        let drawn = Drawn { here: at(cutoff)?, denser: at(cutoff - BAND)?, sparser: at(cutoff + BAND)? };
        let of_view = |(view, image): &LeafView| drawn.credits(texels.grid(), &Target::of(image), view, POINTS);
        let each = seen.par_iter().map(of_view).collect::<Result<Vec<_>>>()?;
        Ok(Credits::joined(each))
    }
}

#[cfg(test)]
mod tests;
