//! The octahedral impostor: one quad that faces the eye and shows the three nearest of many views of the whole tree, trunk included, from
//! above and from a little below (Brucks, "Octahedral Impostors", 2018).
//!
//! The views are on a hemi-octahedral grid ([`mapping`]). `pages` renders them: base color and alpha, normals, openness and depth. [`draw`] has the
//! law by which they are blended, shifted by the stored depth.
//!
//! `cost` has the cost of drawing it. Eyes below the lowest views see the tree as from these. Roughness and translucency are not
//! stored. The share of the light from above that a leaf gets stands for the shadows of the other leaves. Error bound: none; the pictures are compared with the leaves. Depth has 8 bits of the tree's size; a leaf that lies behind others
//! in all three views is missing.
//! Baking is O(views · triangles), the pages have `grid²·texels²` texels, whatever the tree. Deterministic on any number of threads.

mod cost;
pub mod draw;
pub mod mapping;
mod pages;
mod sharpen;

use std::time::Instant;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

use self::draw::Rays;
use super::references::References;
use super::settings::ChainSettings;
use super::tune;
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Image};
use crate::geometry::{Frame, Placement};
use crate::metrics::{Comparison, Reference, View};
use crate::progress::Progress;
use crate::textures::Page;

/// Least number of texels along each side of a view.
const LEAST_TEXELS: usize = 16;

/// Number and size of the views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Views along each side of the grid; 2 to 32.
    pub grid: usize,
    /// Texels along each side of a view; 16 to 512.
    pub texels: usize,
}

impl Default for Size {
    /// A page of 1024 × 1024 texels, for trees of up to 64 pixels.
    fn default() -> Self {
        Self { grid: 16, texels: 64 }
    }
}

impl Size {
    /// Returns the size for a tree that is at most so many pixels large: a texel a pixel at least, within the margin.
    #[must_use]
    pub fn for_crown(pixels: f64) -> Self {
        let Self { grid, texels } = Self::default();
        Self { grid, texels: (pixels.ceil() as usize + 2).next_power_of_two().clamp(LEAST_TEXELS, texels) }
    }

    fn check(self) -> Result<()> {
        let Self { grid, texels } = self;
        if (4..=32).contains(&grid) && (LEAST_TEXELS..=512).contains(&texels) {
            return Ok(());
        }
        Err(Error::invalid(format!(
            "an octahedral impostor of {grid} × {grid} views of {texels} texels; ask for 4 to 32 views and 16 to 512 texels"
        )))
    }
}

/// The place of an impostor. Its axes have the length 1; z is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Number and size of the views.
    pub size: Size,
    /// The point that all views look at, in the caller's coordinates.
    pub centre: DVec3,
    /// The axes as columns, in the caller's coordinates.
    pub axes: DMat3,
    /// Half of the width and of the height of each view's picture, and the depth that is stored as 1, in the caller's units.
    pub extent: DVec3,
    /// Half of the tree's box around the center, along the axes, in the caller's units.
    pub half: DVec3,
}

impl Layout {
    /// Returns the layout around all corners of the parts. The views' pictures have a margin of a texel, so that their borders are empty.
    #[must_use]
    pub fn around(parts: &[&Foliage], up: DVec3, size: Size) -> Self {
        let axes = upright(up);
        let inverse = axes.transpose();
        let corners = || {
            parts.iter().flat_map(|part| {
                let corners = (0..part.triangle_count()).flat_map(|triangle| part.corners(triangle));
                corners.map(|p| inverse * part.frame().to_caller(p))
            })
        };
        let (low, high) =
            corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let centre = low * 0.5 + high * 0.5;
        let wide = corners().map(|p| (p - centre).truncate().length()).fold(0.0, f64::max);
        let far = corners().map(|p| (p - centre).length()).fold(f64::MIN_POSITIVE, f64::max);
        let margin = size.texels as f64 / (size.texels - 2) as f64;
        // A pole would have no width at all.
        let extent = DVec3::new(wide.max(0.01 * far) * margin, far * margin, far);
        Self { size, centre: axes * centre, axes, extent, half: (high - low) * 0.5 }
    }

    /// Returns the transform from the tree's own coordinates to the layout's axes, with lengths as shares of the stored depth.
    #[must_use]
    pub fn of_tree(&self, placement: &Placement) -> DAffine3 {
        let place = |p: DVec3| self.axes.transpose() * (placement.to_world(p) - self.centre) / self.extent.z;
        let [origin, x, y, z] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(place);
        DAffine3::from_cols(x - origin, y - origin, z - origin, origin)
    }

    /// Returns the side of a texel, in the caller's units.
    #[must_use]
    pub fn texel(&self) -> f64 {
        2.0 * self.extent.y / self.size.texels as f64
    }
}

/// Returns axes with z = up. For up = z they are those of the world; for up = y they are x, −z and y.
fn upright(up: DVec3) -> DMat3 {
    let up = up.normalize();
    let level = |axis: DVec3| axis - up * axis.dot(up);
    let first = if up.x.abs() < 0.9 { level(DVec3::X) } else { level(DVec3::Y) }.normalize();
    DMat3::from_cols(first, up.cross(first), up)
}

/// An octahedral impostor: its pages, and how well it shows the tree.
#[derive(Clone, Debug)]
pub struct Octahedral {
    /// The place.
    pub layout: Layout,
    /// The frame of the leaves.
    pub frame: Frame,
    /// Base color of all views: sRGB with straight alpha. Alpha is coverage.
    pub color: Image,
    /// x and y of the normals in the axes of each view, in [−1, 1] as codes; z ≥ 0 follows. Then two thirds of the share of the light from above that the leaf gets, and
    /// in alpha the depth toward the viewer, in [−1, 1] as codes.
    pub normal_depth: Image,
    /// Least alpha to draw, for engines that cut out instead of blending.
    pub alpha_cutoff: f32,
    /// Pictures of the tree and of the impostor in the report's views, blended.
    pub pictures: Comparison,
    /// Seconds for all of it.
    pub seconds: f64,
}

impl Octahedral {
    /// Bakes the impostor of all parts; `parts[0]` is the leaves. Alpha then covers as much as the tree and colors have its mean, as for all
    /// levels. `simpler`: leaves to render in place of `parts[0]`, which deviate by less than a texel. `references`: the renderings of all parts.
    ///
    /// # Errors
    /// A size or setting outside its range; [`Error::Cancelled`].
    pub fn build(
        parts: &[&Foliage],
        simpler: Option<&Foliage>,
        size: Size,
        references: &References,
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Self> {
        size.check()?;
        let started = Instant::now();
        let layout = Layout::around(parts, settings.up, size);
        let rendered: Vec<&Foliage> = std::iter::once(simpler.unwrap_or(parts[0])).chain(parts[1..].to_vec()).collect();
        let triangles = pages::placed(&rendered, &layout.axes, layout.centre);
        let bend = settings.channels.normal.unwrap_or(0.0);
        let openness = pages::Openness::of(&rendered, parts[0].frame(), layout.axes.z_axis);
        let (color, normal_depth) = pages::render(&triangles, &layout, bend, &openness, progress.part(0.0, 0.8))?;
        let tuning = || progress.tell("tune", 0.8);
        tuning()?;
        let depth = draw::depths(&normal_depth);
        let leaves = &references.tuning;
        let traced = |view: &View| tuning().map(|()| Rays::traced(&layout, &depth, view));
        let rays: Vec<Rays> = leaves.views().iter().map(traced).collect::<Result<_>>()?;
        let (color, alpha_cutoff) = tuned(&layout, color, &normal_depth, &rays, leaves, tuning)?;
        let normal_depth = opened(&layout, &color, normal_depth, &rays, leaves, tuning)?;
        let pages = draw::Pages::new(&layout, &color, &normal_depth);
        let traced = |view: &View| progress.tell("tune", 0.95).map(|()| Rays::traced(&layout, &depth, view));
        let pictures = compared(&references.report, traced, &pages)?;
        let (frame, seconds) = (*parts[0].frame(), started.elapsed().as_secs_f64());
        Ok(Self { layout, frame, color, normal_depth, alpha_cutoff, pictures, seconds })
    }

    /// Draws the impostor in all views of `base`, beside it.
    ///
    /// # Errors
    /// A view of no pixels.
    pub fn compare(&self, base: &Reference) -> Result<Comparison> {
        let depth = draw::depths(&self.normal_depth);
        let pages = draw::Pages::new(&self.layout, &self.color, &self.normal_depth);
        compared(base, |view| Ok(Rays::traced(&self.layout, &depth, view)), &pages)
    }

    /// Draws the impostor as seen in `view`, blended, or cut out at a `cutoff` above 0; lit if there is a `sun`, in this direction of length 1.
    ///
    /// # Errors
    /// A part of the view outside its range; more than [`MOST_SAMPLES`] samples along a side.
    pub fn draw(&self, view: &View, cutoff: f32, sun: Option<DVec3>) -> Result<Image> {
        view.checked()?;
        let samples = view.size.saturating_mul(view.samples.side());
        if samples > MOST_SAMPLES {
            return Err(Error::invalid(format!(
                "a picture of {} pixels with {} samples each along a side has {samples} samples there; an octahedral impostor is drawn with at \
                 most {MOST_SAMPLES}: lower `size` or `samples`",
                view.size,
                view.samples.side()
            )));
        }
        let rays = Rays::traced(&self.layout, &draw::depths(&self.normal_depth), view);
        let pages = draw::Pages::new(&self.layout, &self.color, &self.normal_depth);
        match sun {
            None => pages.flat(&rays, cutoff),
            Some(sun) => pages.flat_and_lit(&rays, cutoff, sun).map(|[_, lit]| lit),
        }
    }
}

/// Most samples along the side of a picture: all rays of a picture are traced at once, and take some 40 bytes each.
pub const MOST_SAMPLES: usize = 4096;

/// Returns the color page with coverage and mean color of the leaves, and the cutoff with which it covers as much when it is cut out. Calls `tell`
/// often, and ends with its error.
fn tuned(
    layout: &Layout,
    color: Image,
    normal_depth: &Image,
    rays: &[Rays],
    leaves: &Reference,
    tell: impl Fn() -> Result<()>,
) -> Result<(Image, f32)> {
    let excess = |silhouette: &(dyn Fn(&Rays, usize) -> Result<Image> + Sync)| {
        tell()?;
        let pictures = rays.par_iter().enumerate().map(|(i, rays)| silhouette(rays, i)).collect::<Result<_>>()?;
        Ok(libm::log(leaves.beside(pictures, None).coverage().max(1e-9)))
    };
    let page = Page::of_color(color);
    let thicker = |clearness: f64| page.clone().thickened(1.0 / clearness);
    let blended = |clearness: f64| {
        let alpha = alphas(&thicker(clearness).base_color);
        excess(&|rays, _| rays.silhouette(rays.alphas(&alpha).into_iter()))
    };
    let page = thicker(tune::least_excess(1.0, tune::CLEARNESS_RANGE, tune::COVERAGE_ERROR, blended)?);
    let alpha = alphas(&page.base_color);
    let samples: Vec<Vec<f32>> = rays.iter().map(|rays| rays.alphas(&alpha)).collect();
    let cut = |cutoff: f64| {
        let opaque = |alpha: &f32| draw::opaque_from(*alpha, cutoff as f32);
        excess(&|rays, view| rays.silhouette(samples[view].iter().map(opaque)))
    };
    let cutoff = tune::least_excess(0.5, tune::CUTOFF_RANGE, tune::COVERAGE_ERROR, cut)? as f32;
    let pages = draw::Pages::new(layout, &page.base_color, normal_depth);
    let drawn = rays.iter().map(|rays| pages.flat(rays, 0.0)).collect::<Result<_>>()?;
    let tone = leaves.beside(drawn, None).flat.tone();
    let toned = page.toned(tone.clamp(Vec3::splat(tune::TONES.0), Vec3::splat(tune::TONES.1)));
    Ok((toned.base_color, cutoff))
}

/// Range of factors on the share of the light that leaves get.
const OPENINGS: (f64, f64) = (0.25, 4.0);

/// Greatest error of ln brightness under a sun.
const BRIGHTNESS_ERROR: f64 = 0.01;

/// Returns the page of normals and depth with the openness scaled until pictures under a sun are as bright as the leaves'. Without lit pictures of
/// the leaves it stays. The share of the light stands for shadows, and how much sun a crown lets through depends on its leaves.
fn opened(
    layout: &Layout,
    color: &Image,
    normal_depth: Image,
    rays: &[Rays],
    leaves: &Reference,
    tell: impl Fn() -> Result<()>,
) -> Result<Image> {
    let Some(sun) = leaves.sun() else { return Ok(normal_depth) };
    let scaled = |factor: f64| {
        let open = |&[x, y, open, height]: &[u8; 4]| [x, y, (f64::from(open) * factor + 0.5).min(255.0) as u8, height];
        let pixels: Vec<[u8; 4]> = normal_depth.pixels().iter().map(open).collect();
        Image::new(normal_depth.width(), normal_depth.height(), pixels)
    };
    let excess = |factor: f64| {
        tell()?;
        let page = scaled(factor)?;
        let pages = draw::Pages::new(layout, color, &page);
        let lit = rays.iter().map(|rays| pages.flat_and_lit(rays, 0.0, sun)).collect::<Result<Vec<_>>>()?;
        let (flat, lit) = lit.into_iter().map(|[flat, lit]| (flat, lit)).unzip();
        let tone = leaves.beside(flat, Some(lit)).lit.map_or(Vec3::ONE, |lit| lit.tone());
        Ok(libm::log(f64::from(tone.element_sum()) / 3.0))
    };
    scaled(tune::least_excess(1.0, OPENINGS, BRIGHTNESS_ERROR, excess)?)
}

/// Returns the alpha of each texel.
fn alphas(color: &Image) -> Vec<f32> {
    color.pixels().iter().map(|pixel| f32::from(pixel[3]) / 255.0).collect()
}

/// Draws the impostor beside the base, flat-lit, and lit if the base is.
fn compared<'a>(
    base: &Reference,
    traced: impl Fn(&View) -> Result<Rays<'a>>,
    pages: &draw::Pages,
) -> Result<Comparison> {
    let rays = base.views().iter().map(traced);
    match base.sun() {
        None => Ok(base.beside(rays.map(|rays| pages.flat(&rays?, 0.0)).collect::<Result<_>>()?, None)),
        Some(sun) => {
            let pairs = rays.map(|rays| pages.flat_and_lit(&rays?, 0.0, sun)).collect::<Result<Vec<_>>>()?;
            let (flat, lit) = pairs.into_iter().map(|[flat, lit]| (flat, lit)).unzip();
            Ok(base.beside(flat, Some(lit)))
        }
    }
}

#[cfg(test)]
mod tests;
