//! Drafts of level 1: its planes, and the leaves collapsed onto them, without packing or textures. The picture of the collapsed leaves is
//! close to the picture of the level, for a small part of the time, so settings can be chosen by drafts.

use glam::DVec2;

use super::budget;
use super::settings::ChainSettings;
use super::size::{self, Fitted};
use super::tune;
use crate::cloud::Cloud;
use crate::error::Result;
use crate::fit::{FitSettings, fit_within};
use crate::foliage::Foliage;
use crate::geometry::Outline;
use crate::metrics::Reference;
use crate::outlines::outlines;
use crate::polygons::Scale;
use crate::progress::Progress;
use crate::transition::{HAND_OVER, Projection};

/// View directions for the stretch of drafts.
const VIEWS: usize = 4;

/// Drafts of one foliage, with the size limit of billboards and the stretch of the first one.
pub struct Drafts<'a> {
    foliage: &'a Foliage,
    fit: FitSettings,
    stretch: f64,
    copies: usize,
    /// Most billboards within the level's budget of triangles.
    pub most: usize,
    /// The draft with the ε of the settings.
    pub first: Draft,
}

/// A draft of level 1.
#[derive(Clone, Debug)]
pub struct Draft {
    /// The leaves on their planes, where the level takes over from them.
    pub collapsed: Foliage,
    /// Width and height of the rectangle of each billboard, as shares of R.
    rectangles: Vec<DVec2>,
    /// Triangles drawn for each triangle of a rectangle.
    copies: usize,
}

impl<'a> Drafts<'a> {
    /// Makes the first draft, with the ε of `settings`.
    ///
    /// # Errors
    /// A setting outside its range; the errors of a fit; [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn new(
        settings: &ChainSettings,
        foliage: &'a Foliage,
        trunk: Option<&Foliage>,
        progress: Progress,
    ) -> Result<Self> {
        settings.check()?;
        let (max_size, cloud) = cloud(settings, foliage, trunk, progress)?;
        let views = tune::views_of_amounts(VIEWS, settings.up)?;
        let leaves = Reference::new(&[foliage], foliage.frame(), views)?;
        let laid = tune::projection(foliage, &cloud, &leaves)?;
        let stretch = laid.stretch();
        let copies = copies(settings, foliage);
        let fit = FitSettings { max_size, ..settings.fit.clone() };
        let first = Draft::new(foliage, &cloud, &laid.projection, copies, &fit)?;
        let most = budget::of(settings, None, foliage, trunk)[0] / (2 * copies);
        Ok(Self { foliage, fit, stretch, copies, most, first })
    }

    /// Returns the ε of the first draft.
    #[must_use]
    pub fn epsilon(&self) -> f64 {
        self.fit.epsilon
    }

    /// Makes a draft with another ε.
    ///
    /// # Errors
    /// An ε outside its range; the errors of a fit; [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn with(&self, epsilon: f64, progress: Progress) -> Result<Draft> {
        let fit =
            FitSettings { epsilon, max_size: self.fit.max_size.map(|size| size.max(epsilon)), ..self.fit.clone() };
        fit.check()?;
        let bound = epsilon * self.foliage.frame().radius;
        let cloud = fit_within(self.foliage, &fit.opacity(self.foliage), &fit, bound, progress, None)?;
        let projection = Projection::new(self.foliage, &cloud, self.stretch);
        Draft::new(self.foliage, &cloud, &projection, self.copies, &fit)
    }
}

impl Draft {
    fn new(
        foliage: &Foliage,
        cloud: &Cloud,
        projection: &Projection,
        copies: usize,
        fit: &FitSettings,
    ) -> Result<Self> {
        let collapsed = projection.at(foliage, HAND_OVER)?;
        let opacity = fit.opacity(foliage);
        let outlines = outlines(&cloud.planes, &cloud.parents, |t| foliage.corners(t), &opacity);
        Ok(Self { collapsed, rectangles: outlines.iter().map(Outline::size).collect(), copies })
    }

    /// Returns the number of billboards.
    #[must_use]
    pub fn billboards(&self) -> usize {
        self.rectangles.len()
    }

    /// Returns the cost of drawing all rectangles where R covers `radius_pixels`, in fragments.
    #[must_use]
    pub fn cost(&self, radius_pixels: f64) -> f64 {
        let scale = Scale { pixels_per_unit: radius_pixels, copies: self.copies };
        self.rectangles.iter().map(|size| scale.rectangle(*size)).sum()
    }
}

/// Returns the fit settings with the size limit that level 1 of `foliage` gets. Fits that are compared with one another need the same limit.
///
/// # Errors
/// The errors of a fit.
pub fn settled_fit(
    settings: &ChainSettings,
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    progress: Progress,
) -> Result<FitSettings> {
    let (max_size, _) = cloud(settings, foliage, trunk, progress)?;
    Ok(FitSettings { max_size, ..settings.fit.clone() })
}

/// Returns the planes of level 1 with the size limit of its billboards.
fn cloud(
    settings: &ChainSettings,
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    progress: Progress,
) -> Result<(Option<f64>, Cloud)> {
    let (fit, copies) = (&settings.fit, copies(settings, foliage));
    let fitted = Fitted {
        finer: foliage,
        opacity: &fit.opacity(foliage),
        bound: fit.epsilon * foliage.frame().radius,
        most: size::billboards_within(budget::of(settings, None, foliage, trunk)[0], copies),
        scale: Scale { pixels_per_unit: settings.pixels / fit.epsilon, copies },
    };
    fitted.cloud(fit, progress)
}

/// Returns the number of triangles that are drawn for each triangle of a billboard's polygon.
fn copies(settings: &ChainSettings, foliage: &Foliage) -> usize {
    if settings.back_sides.unwrap_or_else(|| foliage.is_single_sided()) { 2 } else { 1 }
}
