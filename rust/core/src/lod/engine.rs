//! The pages of a level for engines: one image for engines that make mip levels, and mip levels for files that bring their own. Both are refined
//! by pictures. Trilinear filters mix two mip levels, and the mean of two patterns shows less than each of them at a high cutoff, and more at
//! a low one: so mip levels of files get their coverage from the coarsest to the finest, half of it alone and half of it mixed with the next.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use glam::Vec3;
use rayon::prelude::*;

use super::billboards::billboards;
use super::cross;
use super::level::Level;
use super::refine::{LeafPictures, OnMips};
use super::tune::{self, MIP_COVERAGE, MIP_COVERAGE_ERROR, TONES};
use crate::atlas::{Atlas, Region};
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image, Material};
use crate::geometry::Frame;
use crate::metrics::Reference;
use crate::textures::{EnginePage, LightGrid, PagePart, Pictured, Sight, bent, cut_outs, mips, recut, tone};

/// Pages for engines and their mip levels for files, by the number of halvings, each made when it is first wanted.
#[derive(Debug, Default)]
pub(super) struct EnginePages {
    pages: [OnceLock<EnginePage>; MOST_HALVINGS + 1],
    mips: [OnceLock<Vec<Mip>>; MOST_HALVINGS + 1],
}

/// A mip level.
#[derive(Clone, Debug)]
pub struct Mip {
    /// The level.
    pub image: Image,
    /// Regions in which alpha is cut out, each with its least drawn alpha code.
    pub cut_outs: Vec<(Region, u8)>,
}

/// Most halvings of a page for engines.
const MOST_HALVINGS: usize = 3;

/// Number of steps that refine a page by pictures. Refined levels take twice as many.
const STEPS: usize = 4;

/// A tree on an atlas page.
#[derive(Clone, Debug)]
pub(super) struct Sharer {
    atlas: Atlas,
    alpha_cutoff: f32,
    /// The first mip level that is seen.
    first_seen: usize,
    frame: Frame,
    material: Material,
    leaves: Arc<Reference>,
    refine_by: Option<Arc<LeafPictures>>,
    steps: usize,
}

impl Sharer {
    /// Returns the tree of a level, on a page with this layout.
    pub fn of(level: &Level, atlas: &Atlas) -> Self {
        Self {
            atlas: atlas.clone(),
            alpha_cutoff: level.alpha_cutoff,
            first_seen: if level.is_cross() { cross::FIRST_SEEN } else { 0 },
            frame: level.frame,
            material: Material { image: None, ..level.page.material(level.alpha_cutoff, !level.two_sided) },
            leaves: Arc::clone(&level.amounts),
            refine_by: level.refine_by.clone(),
            steps: if level.refined.is_some() { 2 * STEPS } else { STEPS },
        }
    }

    /// Returns its part of the page. Made on each call, because it takes four bytes for each texel of the whole page.
    fn part(&self) -> PagePart {
        PagePart::of(&self.atlas, self.alpha_cutoff, self.first_seen)
    }

    /// Returns the number of texels of its regions.
    pub fn texels(&self) -> usize {
        self.atlas.texels()
    }

    /// Returns the refinement of an image and so many mip levels, if there are pictures.
    fn on_mips(&self, cutoff: f32, mips: usize) -> Option<OnMips<'_>> {
        let Self { atlas, frame, material, refine_by, steps, .. } = self;
        refine_by.as_ref().map(|pictures| OnMips { atlas, frame, material, cutoff, pictures, steps: *steps, mips })
    }

    /// Returns mip levels of a file with the coverage and the mean color of the leaves, refined where pictures show them; unchanged without
    /// pictures.
    fn settled(&self, mips: mips::Levels, cutoff: f32) -> Result<mips::Levels> {
        let Some(alone) = self.on_mips(cutoff, 1) else { return Ok(mips) };
        // All at once: pictures of a coarse mip level are too few and too small for many cores.
        let refined = |mip: Image| Ok(alone.refined(&mip)?.unwrap_or(mip));
        let refined = mips.into_par_iter().map(refined).collect::<Result<mips::Levels>>()?;
        let mut settled = mips::Levels::new();
        for mip in refined.into_iter().rev() {
            settled.push(self.covering(&mip, settled.last(), cutoff)?);
        }
        settled.reverse();
        Ok(settled)
    }

    /// Returns a mip level with the coverage and the mean color of the leaves. `coarser`: the next level; trilinear filters mix both.
    fn covering(&self, mip: &Image, coarser: Option<&Image>, cutoff: f32) -> Result<Image> {
        let coarser = coarser.map(LightGrid::of);
        let recut = |pivot: f64| bent(mip, pivot as f32, cutoff);
        let excess = |pivot: f64| {
            let image = recut(pivot);
            let between = coarser.as_ref().map(|coarser| LightGrid::of(&image).halfway(coarser));
            let seen = between.into_iter().chain([image]).map(|image| self.coverage(image, cutoff));
            let seen = seen.collect::<Result<Vec<f64>>>()?;
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            Ok(libm::log(mean.max(1e-9) / MIP_COVERAGE))
        };
        let pivot = tune::least_excess(f64::from(cutoff), tune::CUTOFF_RANGE, MIP_COVERAGE_ERROR, excess)?;
        let image = recut(pivot);
        let tone = self.sight(image.clone(), cutoff)?.tone;
        Ok(tone::scaled(&image, tone))
    }

    /// Returns how the billboards look with another page.
    fn sight(&self, image: Image, alpha_cutoff: f32) -> Result<Sight> {
        let pictures = self.leaves.compare(&self.billboards(image, alpha_cutoff)?)?;
        let tone = pictures.tone().clamp(Vec3::splat(TONES.0), Vec3::splat(TONES.1));
        Ok(Sight { coverage: pictures.coverage(), tone })
    }

    /// Returns the coverage of [`Self::sight`] without its colors, which take most of the time.
    fn coverage(&self, image: Image, alpha_cutoff: f32) -> Result<f64> {
        Ok(self.leaves.agreement(&self.billboards(image, alpha_cutoff)?)?.coverage)
    }

    fn billboards(&self, image: Image, alpha_cutoff: f32) -> Result<Foliage> {
        let alpha_mode = AlphaMode::Mask(alpha_cutoff);
        let material = Material { image: Some(image), alpha_mode, ..self.material.clone() };
        billboards(&self.atlas, &self.frame, material)
    }
}

impl Pictured for [Sharer] {
    fn sight(&self, part: usize, image: Image, cutoff: f32) -> Result<Sight> {
        self[part].sight(image, cutoff)
    }

    fn error(&self, part: usize, image: &Image, cutoff: f32) -> Result<Option<f64>> {
        self[part].on_mips(cutoff, usize::MAX).map_or(Ok(None), |on_mips| on_mips.error(image))
    }

    fn refined(&self, part: usize, image: &Image, cutoff: f32) -> Result<Option<Image>> {
        self[part].on_mips(cutoff, usize::MAX).map_or(Ok(None), |on_mips| on_mips.refined(image))
    }
}

impl Level {
    /// Returns base color and cutoff for engines that make mip levels themselves, with sides halved so many times, three at most and as often as
    /// both are even; whole for alpha-blended levels. Computed on the first call; a thread that waits for the result does no other work, so
    /// a job of a rayon pool may call it only if no other job of the pool does.
    #[must_use]
    pub fn for_engines(&self, halvings: usize) -> (&Image, f32) {
        if self.alpha_cutoff == 0.0 {
            return (&self.page.base_color, 0.0); // Box filtering keeps coverage.
        }
        let page = self.engine_page(halvings);
        (&page.image, page.cutoffs[self.part])
    }

    /// Returns a channel other than base color with its sides halved as often as [`Self::for_engines`] halves those of base color. `None` for a
    /// missing channel and for label textures.
    #[must_use]
    pub fn halved(&self, channel: &str, halvings: usize) -> Option<Image> {
        let most = if self.alpha_cutoff == 0.0 { 0 } else { EnginePage::most_halvings(&self.page.base_color) };
        self.page.levels(channel)?.into_iter().nth(halvings.min(MOST_HALVINGS).min(most))
    }

    fn engine_page(&self, halvings: usize) -> &EnginePage {
        let halvings = halvings.min(MOST_HALVINGS);
        let make = || {
            let sharers = self.sharers();
            let parts: Vec<PagePart> = sharers.iter().map(Sharer::part).collect();
            EnginePage::new(&self.page.base_color, &parts, halvings, &*sharers).expect("the level was drawn before")
        };
        self.engine.pages[halvings].get_or_init(make)
    }

    /// Returns the mip levels of a channel; base color at the cutoff of [`Self::for_engines`], computed on the first call. `None` for a missing
    /// channel and for label textures. As for [`Self::for_engines`], only
    /// one job of a rayon pool may call it.
    #[must_use]
    pub fn mips(&self, channel: &str, halvings: usize) -> Option<Cow<'_, [Mip]>> {
        let whole = |image| Mip { image, cut_outs: Vec::new() };
        if channel != "base_color" {
            return Some(self.page.levels(channel)?.into_iter().map(whole).collect());
        }
        if self.alpha_cutoff == 0.0 {
            return Some(mips::means(&self.page.base_color).into_iter().map(whole).collect());
        }
        let make = || self.color_mips(&self.engine_page(halvings).cutoffs);
        Some(Cow::Borrowed(self.engine.mips[halvings.min(MOST_HALVINGS)].get_or_init(make)))
    }

    /// Returns the mip levels of base color with these cutoffs, one for each tree on the page.
    fn color_mips(&self, cutoffs: &[f32]) -> Vec<Mip> {
        let sharers = self.sharers();
        let mut parts: Vec<PagePart> = sharers.iter().map(Sharer::part).collect();
        let image = recut(&self.page.base_color, &parts, cutoffs);
        parts.iter_mut().zip(cutoffs).for_each(|(part, cutoff)| part.alpha_cutoff = *cutoff);
        let settled = |part: usize, mips| sharers[part].settled(mips, cutoffs[part]);
        let levels = mips::of_parts(&image, &parts, settled).expect("the level was drawn before").into_iter();
        let mip = |(number, image)| Mip { cut_outs: cut_outs(&parts, number, &image), image };
        levels.enumerate().map(mip).collect()
    }

    /// Returns all trees on the page, this one among them.
    fn sharers(&self) -> Cow<'_, [Sharer]> {
        if self.sharers.is_empty() {
            Cow::Owned(vec![Sharer::of(self, &self.atlas)])
        } else {
            Cow::Borrowed(&self.sharers)
        }
    }
}
