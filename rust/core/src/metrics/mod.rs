//! Renderer for metrics: compares a level with the leaves in views without light and, on request, under a sun (`light`). The image error
//! (FLIP) of the pictures is measured in a crate of its own, `leafcloud-flip`. `drawing` counts the cost of drawing.

mod drawing;
mod fragments;
mod layered;
mod light;
mod measure;
mod render;
mod visibility;

pub use drawing::{DrawingCost, counted_views, drawing_cost};
pub(crate) use drawing::{check_scale, check_up};
pub use layered::Layered;
use light::Light;
pub use light::SKY;
pub(crate) use light::brightness;
pub(crate) use measure::coverage;
pub use render::{View, render, render_lit, render_watched, seen_behind};
pub(crate) use render::{shown_points, silhouette, texture_points};
pub use visibility::{LeafSamples, visibility};

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::textures::Samples;

/// Radius of a picture in R of the leaves.
pub const PICTURE_RADIUS: f64 = 1.025;

/// Set of views for metrics: number, orientation and resolution.
#[derive(Clone, Copy, Debug)]
pub struct Views {
    /// Number of directions.
    pub count: usize,
    /// Width and height of each image, in pixels.
    pub size: usize,
    /// Sub-samples along each side of a pixel.
    pub samples: Samples,
    /// Up direction; any length above 0.
    pub up: DVec3,
    /// Rotation of the whole set about `up`, in golden angles. Sets with different turns share no direction.
    pub turn: f64,
}

impl Views {
    /// Returns the directions from the center to the eye: a spiral over the upper three quarters of the sphere, because trees are rarely
    /// seen from straight below.
    fn directions(&self) -> impl Iterator<Item = DVec3> + '_ {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let upright = DQuat::from_rotation_arc(DVec3::Z, self.up.normalize());
        (0..self.count).map(move |i| {
            let z = 1.0 - 1.5 * (i as f64 + 0.5) / self.count as f64;
            let (radius, angle) = ((1.0 - z * z).sqrt(), (i as f64 + self.turn) * golden);
            upright * DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
        })
    }

    /// Returns the direction to the sun of lit pictures, of length 1.
    fn sun(&self) -> DVec3 {
        let (height, turn) = (SUN_HEIGHT.to_radians(), SUN_TURN.to_radians());
        let upright = DQuat::from_rotation_arc(DVec3::Z, self.up.normalize());
        upright
            * DVec3::new(libm::cos(height) * libm::cos(turn), libm::cos(height) * libm::sin(turn), libm::sin(height))
    }

    /// Returns the views, sized to the sphere of `frame`.
    pub fn around(self, frame: &Frame) -> impl Iterator<Item = View> {
        let (centre, radius) = (frame.centre, frame.radius * PICTURE_RADIUS);
        let Self { size, samples, up, .. } = self;
        self.directions().collect::<Vec<_>>().into_iter().map(move |direction| View {
            direction,
            up,
            centre,
            radius,
            size,
            samples,
        })
    }
}

/// Height of the sun of lit pictures, in degrees, and its turn from the first view about `up`.
const SUN_HEIGHT: f64 = 45.0;
const SUN_TURN: f64 = 60.0;

/// Triangles above which views are drawn one after the other. A view takes some 130 bytes for each.
const MANY_TRIANGLES: usize = 1 << 17;

/// Rendered views of a base, for comparison with levels.
#[derive(Debug)]
pub struct Reference {
    views: Vec<View>,
    pictures: Arc<[Image]>,
    sunlit: Option<Sunlit>,
}

/// Lit pictures of a base.
#[derive(Debug)]
struct Sunlit {
    frame: Frame,
    /// Direction to the sun, of length 1.
    sun: DVec3,
    pictures: Arc<[Image]>,
}

impl Reference {
    /// Renders the parts of the base; the sphere of `frame` fills the images.
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn new(base: &[&Foliage], frame: &Frame, views: Views) -> Result<Self> {
        let views: Vec<View> = views.around(frame).collect();
        let pictures = in_each_view(base, &views, |view| render(base, view))?.into();
        Ok(Self { views, pictures, sunlit: None })
    }

    /// Renders the parts of the base as [`Self::new`] does, and also under a sun and a sky.
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn lit(base: &[&Foliage], frame: &Frame, views: Views) -> Result<Self> {
        let (sun, views) = (views.sun(), views.around(frame).collect::<Vec<_>>());
        let (pictures, lit) = flat_and_lit(base, &views, &Light::on(base, frame, sun))?;
        Ok(Self { views, pictures: pictures.into(), sunlit: Some(Sunlit { frame: *frame, sun, pictures: lit.into() }) })
    }

    /// Returns coverage and overlap over all views. Both are exact on any machine, so decisions may depend on them.
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn agreement(&self, level: &Foliage) -> Result<Agreement> {
        let pictures = in_each_view(&[level], &self.views, |view| silhouette(&[level], view))?;
        let pairs = || self.pictures.iter().zip(&pictures);
        Ok(Agreement { coverage: coverage(pairs()), overlap: measure::overlap(pairs()) })
    }

    /// Returns the standard deviation of the base's luminance over the level's; 1 if either hardly varies (10⁻³ or less).
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn contrast(&self, level: &Foliage) -> Result<f64> {
        let (base, other) = (measure::spread(&self.pictures), measure::spread(&self.pictures_of(&[level])?));
        Ok(if base > 1e-3 && other > 1e-3 { base / other } else { 1.0 })
    }

    /// Returns the ratio of mean linear colors, base over level, per channel; 1 if either is black. With lit pictures it is the geometric mean
    /// of the ratios without light and under the sun.
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn tone(&self, level: &Foliage) -> Result<Vec3> {
        let Comparison { flat, lit } = self.compare(&[level])?;
        let of_lit = lit.as_ref().map_or_else(|| flat.tone(), Pictures::tone);
        Ok((flat.tone() * of_lit).map(f32::sqrt))
    }

    /// Renders the parts of a level in all views, beside the base.
    ///
    /// # Errors
    /// Those of [`render()`].
    pub fn compare(&self, level: &[&Foliage]) -> Result<Comparison> {
        let Some(Sunlit { frame, sun, .. }) = &self.sunlit else {
            return Ok(self.beside(self.pictures_of(level)?, None));
        };
        let (flat, lit) = flat_and_lit(level, &self.views, &Light::on(level, frame, *sun))?;
        Ok(self.beside(flat, Some(lit)))
    }

    /// Returns the views.
    pub(crate) fn views(&self) -> &[View] {
        &self.views
    }

    /// Returns the direction to the sun of lit pictures, of length 1; `None` without them.
    pub(crate) fn sun(&self) -> Option<DVec3> {
        self.sunlit.as_ref().map(|sunlit| sunlit.sun)
    }

    /// Returns pictures of a level beside those of the base, for levels that are no triangles; one picture for each view. `lit`: under the sun
    /// of the base's lit pictures, if it has them.
    pub(crate) fn beside(&self, flat: Vec<Image>, lit: Option<Vec<Image>>) -> Comparison {
        let base = self.sunlit.as_ref().map(|sunlit| Arc::clone(&sunlit.pictures));
        let lit = base.zip(lit).map(|(base, lit)| Pictures::new(base, lit));
        Comparison { flat: Pictures::new(Arc::clone(&self.pictures), flat), lit }
    }

    fn pictures_of(&self, level: &[&Foliage]) -> Result<Vec<Image>> {
        in_each_view(level, &self.views, |view| render(level, view))
    }
}

/// Draws parts in all views side by side, or one after the other if their triangles take much memory in each.
///
/// # Errors
/// Those of `draw`.
pub fn in_each_view<T: Send>(
    parts: &[&Foliage],
    views: &[View],
    draw: impl Fn(&View) -> Result<T> + Send + Sync,
) -> Result<Vec<T>> {
    if parts.iter().map(|part| part.triangle_count()).sum::<usize>() > MANY_TRIANGLES {
        views.iter().map(draw).collect()
    } else {
        views.par_iter().map(draw).collect()
    }
}

/// Renders parts in all views, flat-lit and under `light`.
fn flat_and_lit(parts: &[&Foliage], views: &[View], light: &Light) -> Result<(Vec<Image>, Vec<Image>)> {
    let pairs = in_each_view(parts, views, |view| render::flat_and_lit(parts, view, light))?;
    Ok(pairs.into_iter().map(|[flat, lit]| (flat, lit)).unzip())
}

/// Coverage and overlap of a level against a base.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// Sum of alpha over the base's sum, as the mean over the views; 1 if the base is empty.
    pub coverage: f64,
    /// Intersection over union of alpha.
    pub overlap: f64,
}

/// Pictures of a level and of its base in the same views.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Flat-lit pictures.
    pub flat: Pictures,
    /// Pictures under a sun and a sky, if they are wanted and can be made.
    pub lit: Option<Pictures>,
}

/// Pictures of a level and of its base in the same views and light.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// Pictures of the base, one for each view.
    pub base: Arc<[Image]>,
    /// Pictures of the level.
    pub level: Arc<[Image]>,
    /// The errors that have been measured, by the side of the pictures in pixels. Judging takes as long as drawing.
    pub errors: Arc<Mutex<BTreeMap<usize, f64>>>,
}

impl PartialEq for Pictures {
    fn eq(&self, other: &Self) -> bool {
        self.base == other.base && self.level == other.level
    }
}

impl Pictures {
    /// Returns pictures that nobody has judged yet.
    #[must_use]
    pub fn new(base: Arc<[Image]>, level: Vec<Image>) -> Self {
        Self { base, level: level.into(), errors: Arc::default() }
    }

    /// Returns the ratio of mean linear colors, base over level, per channel; 1 if either is black.
    #[must_use]
    pub fn tone(&self) -> Vec3 {
        measure::tone(&self.base, &self.level)
    }
}

impl Comparison {
    /// Returns the sum of alpha over the base's sum, as the mean over the views; 1 if the base is empty. Views with next to no foliage do
    /// not count.
    #[must_use]
    pub fn coverage(&self) -> f64 {
        coverage(self.flat.base.iter().zip(self.flat.level.iter()))
    }
}
