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

/// What an impostor shows.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// All parts; the first is the leaves.
    pub parts: &'a [&'a Foliage],
    /// Leaves to render in their place, which deviate by less than a texel.
    pub simpler: Option<&'a Foliage>,
}

impl<'a> Shown<'a> {
    fn rendered(self) -> Vec<&'a Foliage> {
        let leaves = self.simpler.unwrap_or(self.parts[0]);
        std::iter::once(leaves).chain(self.parts[1..].iter().copied()).collect()
    }
}

/// An impostor without the views that nothing needed so far: most impostors are not worth drawing, and judging one takes a third of its views.
pub struct Sketch {
    impostor: Octahedral,
    rendered: pages::Rendered,
    openness: Vec<Vec<f32>>,
    tuning: Tuning,
}

impl Sketch {
    /// Bakes the views that eyes in the directions `seen_from` see. Alpha then covers as much as the tree and colors have its mean, as for all
    /// levels. `references`: the renderings of all parts.
    ///
    /// # Errors
    /// A size or setting outside its range; [`Error::Cancelled`].
    pub fn of(
        shown: Shown,
        size: Size,
        references: &References,
        seen_from: &[DVec3],
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Self> {
        size.check()?;
        let started = Instant::now();
        let layout = Layout::around(shown.parts, settings.up, size);
        let frame = *shown.parts[0].frame();
        let openness = pages::openness(&shown.rendered(), &frame, layout.axes.z_axis);
        let mut rendered = pages::Rendered::none(size);
        let References { tuning: leaves, report } = references;
        let own = leaves.views().iter().chain(report.views()).map(|view| view.direction.normalize());
        let eyes = own.chain(seen_from.iter().copied()).map(|eye| layout.axes.transpose() * eye);
        let views = eyes.flat_map(|eye| draw::projected(eye, &layout)).map(|view| view.tile);
        render(&mut rendered, views, shown, &layout, &openness, settings, progress)?;
        let [color, normal_depth] = rendered.images()?;
        let tell = || progress.tell("tune", 0.8);
        tell()?;
        let depth = draw::depths(&normal_depth);
        let traced = |view: &View| tell().map(|()| Rays::traced(&layout, &depth, view));
        let rays: Vec<Rays> = leaves.views().iter().map(traced).collect::<Result<_>>()?;
        let (tuning, color) = tuned(&layout, &color, &normal_depth, &rays, leaves, tell)?;
        let opening = opening(&layout, &color, &normal_depth, &rays, leaves, tell)?;
        let tuning = Tuning { opening, ..tuning };
        let normal_depth = opened(&normal_depth, opening)?;
        let pages = draw::Pages::new(&layout, &color, &normal_depth);
        let pictures = compared(report, traced, &pages)?;
        let (alpha_cutoff, seconds) = (tuning.cutoff, started.elapsed().as_secs_f64());
        let impostor = Octahedral { layout, frame, color, normal_depth, alpha_cutoff, pictures, seconds };
        Ok(Self { impostor, rendered, openness, tuning })
    }

    /// Returns the impostor as it is seen from the directions of this sketch. Other views are missing.
    #[must_use]
    pub fn impostor(&self) -> &Octahedral {
        &self.impostor
    }

    /// Bakes all views. `shown` and `settings` are those of the sketch.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn finished(&self, shown: Shown, settings: &ChainSettings, progress: Progress) -> Result<Octahedral> {
        let started = Instant::now();
        let Self { impostor, openness, tuning, .. } = self;
        let mut rendered = self.rendered.clone();
        let grid = impostor.layout.size.grid;
        let views = (0..grid * grid).map(|view| (view % grid, view / grid));
        render(&mut rendered, views, shown, &impostor.layout, openness, settings, progress)?;
        let [color, normal_depth] = rendered.images()?;
        let (color, normal_depth) = (tuning.color(color), opened(&normal_depth, tuning.opening)?);
        let seconds = impostor.seconds + started.elapsed().as_secs_f64();
        Ok(Octahedral { color, normal_depth, seconds, ..impostor.clone() })
    }
}

/// Renders the views, by column and row of the grid, that the pages lack.
fn render(
    rendered: &mut pages::Rendered,
    views: impl Iterator<Item = (usize, usize)>,
    shown: Shown,
    layout: &Layout,
    openness: &[Vec<f32>],
    settings: &ChainSettings,
    progress: Progress,
) -> Result<()> {
    let parts = &shown.rendered()[..];
    let triangles = &pages::placed(parts, &layout.axes, layout.centre)[..];
    let bend = settings.channels.normal.unwrap_or(0.0);
    rendered.add(views, &pages::Source { parts, layout, triangles, openness, bend }, progress.part(0.0, 0.8))
}

/// How the pages are changed so that the impostor looks like the tree.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    /// Alpha is that of leaves this much thinner.
    clearness: f64,
    /// Factors on the linear colors.
    tone: Vec3,
    /// Factor on the openness.
    opening: f64,
    /// The cutoff with which the impostor covers as much when it is cut out.
    cutoff: f32,
}

impl Tuning {
    fn color(&self, color: Image) -> Image {
        thickened(color, self.clearness).toned(self.tone).base_color
    }
}

fn thickened(color: Image, clearness: f64) -> Page {
    Page::of_color(color).thickened(1.0 / clearness)
}

impl Octahedral {
    /// Bakes the impostor. `references`: the renderings of all parts.
    ///
    /// # Errors
    /// Those of [`Sketch::of`].
    pub fn build(
        shown: Shown,
        size: Size,
        references: &References,
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Self> {
        let sketch = Sketch::of(shown, size, references, &[], settings, progress.part(0.0, 0.5))?;
        sketch.finished(shown, settings, progress.part(0.5, 1.0))
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

/// Returns alpha, colors and cutoff with which the impostor has the coverage and mean color of the leaves, and the color page with them. Calls `tell`
/// often, and ends with its error.
fn tuned(
    layout: &Layout,
    color: &Image,
    normal_depth: &Image,
    rays: &[Rays],
    leaves: &Reference,
    tell: impl Fn() -> Result<()>,
) -> Result<(Tuning, Image)> {
    let excess = |silhouette: &(dyn Fn(&Rays, usize) -> Result<Image> + Sync)| {
        tell()?;
        let pictures = rays.par_iter().enumerate().map(|(i, rays)| silhouette(rays, i)).collect::<Result<_>>()?;
        Ok(libm::log(leaves.beside(pictures, None).coverage().max(1e-9)))
    };
    let blended = |clearness: f64| {
        let alpha = alphas(&thickened(color.clone(), clearness).base_color);
        excess(&|rays, _| rays.silhouette(rays.alphas(&alpha).into_iter()))
    };
    let clearness = tune::least_excess(1.0, tune::CLEARNESS_RANGE, tune::COVERAGE_ERROR, blended)?;
    let page = thickened(color.clone(), clearness).base_color;
    let alpha = alphas(&page);
    let samples: Vec<Vec<f32>> = rays.iter().map(|rays| rays.alphas(&alpha)).collect();
    let cut = |cutoff: f64| {
        let opaque = |alpha: &f32| draw::opaque_from(*alpha, cutoff as f32);
        excess(&|rays, view| rays.silhouette(samples[view].iter().map(opaque)))
    };
    let cutoff = tune::least_excess(0.5, tune::CUTOFF_RANGE, tune::COVERAGE_ERROR, cut)? as f32;
    let pages = draw::Pages::new(layout, &page, normal_depth);
    let drawn = rays.iter().map(|rays| pages.flat(rays, 0.0)).collect::<Result<_>>()?;
    let tone = leaves.beside(drawn, None).flat.tone();
    let tone = tone.clamp(Vec3::splat(tune::TONES.0), Vec3::splat(tune::TONES.1));
    let tuning = Tuning { clearness, tone, opening: 1.0, cutoff };
    Ok((tuning, tuning.color(color.clone())))
}

/// Range of factors on the share of the light that leaves get.
const OPENINGS: (f64, f64) = (0.25, 4.0);

/// Greatest error of ln brightness under a sun.
const BRIGHTNESS_ERROR: f64 = 0.01;

/// Returns the factor on the openness with which pictures under a sun are as bright as the leaves'; 1 without lit pictures of the leaves. The share of
/// the light stands for shadows, and how much sun a crown lets through depends on its leaves.
fn opening(
    layout: &Layout,
    color: &Image,
    normal_depth: &Image,
    rays: &[Rays],
    leaves: &Reference,
    tell: impl Fn() -> Result<()>,
) -> Result<f64> {
    let Some(sun) = leaves.sun() else { return Ok(1.0) };
    let excess = |factor: f64| {
        tell()?;
        let page = opened(normal_depth, factor)?;
        let pages = draw::Pages::new(layout, color, &page);
        let lit = rays.iter().map(|rays| pages.flat_and_lit(rays, 0.0, sun)).collect::<Result<Vec<_>>>()?;
        let (flat, lit) = lit.into_iter().map(|[flat, lit]| (flat, lit)).unzip();
        let tone = leaves.beside(flat, Some(lit)).lit.map_or(Vec3::ONE, |lit| lit.tone());
        Ok(libm::log(f64::from(tone.element_sum()) / 3.0))
    };
    tune::least_excess(1.0, OPENINGS, BRIGHTNESS_ERROR, excess)
}

/// Returns the page of normals and depth with the openness times a factor.
fn opened(normal_depth: &Image, factor: f64) -> Result<Image> {
    let open = |&[x, y, open, height]: &[u8; 4]| [x, y, (f64::from(open) * factor + 0.5).min(255.0) as u8, height];
    let pixels: Vec<[u8; 4]> = normal_depth.pixels().iter().map(open).collect();
    Image::new(normal_depth.width(), normal_depth.height(), pixels)
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
