//! Refinement of the planes: leaves switch between planes, and planes move inside their slabs, until the collapsed leaves look like the
//! leaves.
//!
//! At a = 1 each leaf lies on its plane, so no texture is needed: pictures of the collapsed leaves have nearly the whole error of a level.
//! The fit gives each leaf the nearest plane, and each plane the nearest place. Pictures know more: which leaves are seen from a direction,
//! and which leaves they cover.
//!
//! Each step draws the leaves from new directions, and for each direction a pair of pictures with all parameters changed at random at once:
//! leaves on other planes that hold them ([`switches`](super::switches)), or planes with other offsets and tilts ([`slabs`](super::slabs)).
//! A parameter gets the difference of the error of those pixels alone that show its leaf or plane ([`pairs`](super::pairs)), which
//! takes most of the noise of the other parameters away (Deliot et al., "Transforming a Non-Differentiable Rasterizer into a Differentiable
//! One with Stochastic Gradient Estimation", 2024).
//!
//! After each round, test views decide, as for textures: a cloud counts only if its collapsed leaves are better on the whole and worse at no
//! size. New places keep the bound of every corner, checked in f64, and the greatest deviation. O(steps · views · (pixels + fragments)).
//! Known limit: a leaf has one plane, because a leaf that is drawn on two or on none would appear or vanish where the level takes over.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::gain::{Errors, Gain};
use super::leaf_views::{LeafViews, drawn, views};
use super::pairs::Picture;
use super::parts::{Parts, Places};
use super::slabs::Slabs;
use super::switches::Switches;
use super::{Refined, Refinement, SIZES, TEST_TURN, TEST_VIEWS, stage, turn_of};
use crate::cloud::Cloud;
use crate::error::Result;
use crate::fit::ImageBound;
use crate::foliage::{Foliage, Opacity};
use crate::geometry::Plane;
use crate::lod::tune::{self, TONES};
use crate::metrics::{PICTURE_RADIUS, Reference, View};
use crate::progress::Progress;
use crate::transition::{HAND_OVER, Projection};

/// Input of a refinement of planes.
pub struct Arrangement<'a> {
    /// The foliage that collapses onto the planes.
    pub finer: &'a Foliage,
    /// Opaque parts of `finer`.
    pub opacity: &'a Opacity,
    /// The leaves that the level replaces.
    pub leaves: &'a Foliage,
    /// Renderings of the leaves for the stretch.
    pub amounts: &'a Reference,
    /// Bound on the angle of motions, if given.
    pub image: Option<ImageBound>,
    /// Up direction.
    pub up: DVec3,
    /// R of the leaves in pixels where the level takes over.
    pub radius_pixels: f64,
    pub seed: u64,
}

/// Amount of work: rounds, and steps of switches and of moves in each.
struct Plan {
    rounds: usize,
    switches: usize,
    moves: usize,
}

impl Plan {
    fn of(effort: Refinement) -> Self {
        match effort {
            Refinement::Off => Self { rounds: 0, switches: 0, moves: 0 },
            // Few steps of planes bring nothing.
            Refinement::Short => Self { rounds: 1, switches: 10, moves: 0 },
            Refinement::Long => Self { rounds: 2, switches: 24, moves: 12 },
        }
    }
}

/// Pairs of pictures of a step, each from a direction of its own, and steps between two switches.
const VIEWS: usize = 8;
const BETWEEN: usize = 2;

/// Seeds of random numbers apart from those of the fit.
const SEED: u64 = 0x0070_6C61_6E65_7300;

impl Arrangement<'_> {
    /// Returns the cloud after the refinement, with the errors of the collapsed leaves relative to those before; the same cloud if nothing
    /// became better.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub fn refined(&self, cloud: Cloud, effort: Refinement, progress: Progress) -> Result<(Cloud, Option<Refined>)> {
        let plan = Plan::of(effort);
        if plan.rounds == 0 {
            return Ok((cloud, None));
        }
        progress.tell("refine", 0.0)?;
        let laid = tune::projection(self.finer, &cloud, self.amounts)?;
        let tests = LeafViews::of(drawn(self.leaves, self.views(TEST_VIEWS, TEST_TURN)?)?);
        let (first, tone) = self.errors(&tests, &laid.projection)?;
        let (parts, mut places) = Parts::new(self.finer, &cloud, laid.stretch(), self.image);
        let bound = cloud.bound;
        let mut best = (cloud, Gain::none(&first));
        let steps = plan.rounds * (plan.switches + plan.moves);
        let mut walk = Walk { on: self, parts: &parts, tone, step: 0, steps, progress };
        for _ in 0..plan.rounds {
            walk.switch(&mut places, plan.switches)?;
            walk.shift(&mut places, plan.moves)?;
            let made = parts.cloud(&places, bound);
            let laid = tune::projection(self.finer, &made, self.amounts)?;
            let (errors, tone) = self.errors(&tests, &laid.projection)?;
            walk.tone = tone;
            let gain = Gain::over(&first, &errors);
            if gain.is_better_than(&best.1) {
                best = (made, gain);
            }
        }
        progress.tell(&stage(&best.1), 1.0)?;
        Ok((best.0, Some(Refined { errors: best.1.errors })))
    }

    /// Returns the errors of the collapsed leaves with the mean color of the leaves, which the texture will have, and their factors.
    fn errors(&self, tests: &LeafViews, projection: &Projection) -> Result<(Errors, Vec3)> {
        let collapsed = projection.at(self.finer, HAND_OVER)?;
        let tone = self.amounts.tone(&collapsed)?.clamp(Vec3::splat(TONES.0), Vec3::splat(TONES.1));
        Ok((tests.errors(&collapsed, tone)?, tone))
    }

    /// Returns views of the size at which the level takes over, 256 pixels at most.
    fn views(&self, count: usize, turn: f64) -> Result<Vec<View>> {
        let size = (2.0 * PICTURE_RADIUS * self.radius_pixels) as usize;
        let size = size.clamp(SIZES.0, SIZES.1) / 8 * 8;
        views(self.leaves.frame(), self.up, size, (count, turn))
    }
}

/// The steps so far.
struct Walk<'a> {
    on: &'a Arrangement<'a>,
    parts: &'a Parts<'a>,
    /// Factors on the colors of collapsed leaves.
    tone: Vec3,
    step: usize,
    /// Number of all steps.
    steps: usize,
    progress: Progress<'a>,
}

impl Walk<'_> {
    fn switch(&mut self, places: &mut Places, steps: usize) -> Result<()> {
        if steps == 0 {
            return Ok(());
        }
        let mut switches = Switches::new(self.parts, places, self.on.opacity, self.on.seed ^ SEED);
        for step in 1..=steps {
            let each = self.pairs(|pair, view| {
                let trials = switches.trials(pair);
                let drawn = |in_first: bool| {
                    let parents = switches.parents(places, &trials, in_first);
                    self.picture(&places.planes, &parents, view)
                };
                let (first, second) = (drawn(true)?, drawn(false)?);
                let credits =
                    first.credits(&second, &self.target(view)?, self.parts.len(), |triangle| self.parts.of(triangle));
                Ok((trials, credits))
            })?;
            for (trials, credits) in &each {
                switches.add(trials, credits);
            }
            if step % BETWEEN == 0 {
                switches.switch(places);
            }
            self.step += 1;
        }
        Ok(())
    }

    fn shift(&mut self, places: &mut Places, steps: usize) -> Result<()> {
        if steps == 0 {
            return Ok(());
        }
        let mut slabs = Slabs::new(self.parts, places, !self.on.seed ^ SEED);
        for step in 0..steps {
            let each = self.pairs(|pair, view| {
                let signs = slabs.signs(pair);
                let drawn = |share: f64| self.picture(&slabs.changed(&signs, share), &places.parents, view);
                let (first, second) = (drawn(1.0)?, drawn(-1.0)?);
                let plane = |triangle: u32| places.parents[self.parts.of(triangle)] as usize;
                let credits = first.credits(&second, &self.target(view)?, places.planes.len(), plane);
                Ok(signs.into_iter().zip(credits).map(|(signs, credit)| signs * credit).collect::<Vec<DVec3>>())
            })?;
            let slope = |plane: usize| each.iter().map(|slopes| slopes[plane]).sum::<DVec3>() / VIEWS as f64;
            let slopes: Vec<DVec3> = (0..places.planes.len()).map(slope).collect();
            slabs.step(&slopes, step as f64 / steps as f64);
            self.step += 1;
        }
        places.planes = slabs.planes();
        Ok(())
    }

    /// Returns the results of all pairs of a step, in the order of their views.
    fn pairs<T: Send>(&self, of_view: impl Fn(usize, &View) -> Result<T> + Sync) -> Result<Vec<T>> {
        self.progress.tell("refine", self.step as f64 / self.steps as f64)?;
        let views = self.on.views(VIEWS, turn_of(self.step))?;
        views.par_iter().enumerate().map(|(number, view)| of_view(self.step * VIEWS + number, view)).collect()
    }

    fn picture(&self, planes: &[Plane], parents: &[u32], view: &View) -> Result<Picture> {
        let corners = self.parts.collapsed(planes, parents);
        Picture::new(self.on.finer, |triangle| corners[triangle], self.tone, view)
    }

    fn target(&self, view: &View) -> Result<Picture> {
        Picture::new(self.on.leaves, |triangle| self.on.leaves.corners(triangle), Vec3::ONE, view)
    }
}

#[cfg(test)]
#[path = "planes_tests.rs"]
mod tests;
