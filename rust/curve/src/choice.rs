//! The settings that a sweep varies.

use leafcloud::atlas::PageSize;
use leafcloud::error::Result;
use leafcloud::fit::{Effort, FitSettings, Method};
use leafcloud::lod::{ChainSettings, is_published};
use leafcloud::textures::Samples;

/// Least side of an atlas page in texels.
const SMALLEST: usize = 64;

/// The settings that a sweep varies. [`ChainSettings`] and [`FitSettings`] document them and their ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Method of the fit.
    pub method: Method,
    /// Effort of the fit.
    pub effort: Effort,
    /// ε of level 1, a share of R.
    pub epsilon: f64,
    /// N, the number of candidates.
    pub candidates: usize,
    /// Billboard count, the input of the method kmeans.
    pub max_billboards: Option<usize>,
    /// Number of billboard clouds.
    pub levels: usize,
    /// Whether the cross impostor is the last level.
    pub cross: bool,
    /// Width of level 1's atlas page in texels.
    pub texture_size: usize,
    /// Samples along each side of a texel.
    pub samples: usize,
    /// Whether pages are packed tightly, which takes seconds.
    pub tight_pages: bool,
}

impl Choice {
    /// Returns the choice in the given settings.
    #[must_use]
    pub fn of(settings: &ChainSettings) -> Self {
        let FitSettings { method, effort, epsilon, candidates, max_billboards, .. } = settings.fit;
        Self {
            method,
            effort,
            epsilon,
            candidates,
            max_billboards,
            levels: settings.levels,
            cross: settings.cross,
            texture_size: settings.texture_size.width,
            samples: settings.samples.side(),
            tight_pages: settings.tight_pages,
        }
    }

    /// Returns the settings with this choice; the atlas page keeps its proportions.
    ///
    /// # Errors
    /// Samples outside their range. The other settings are checked on use.
    pub fn applied(&self, settings: &ChainSettings) -> Result<ChainSettings> {
        Ok(ChainSettings {
            fit: FitSettings {
                method: self.method,
                effort: self.effort,
                epsilon: self.epsilon,
                candidates: self.candidates,
                max_billboards: self.max_billboards,
                max_size: settings.fit.max_size.filter(|_| !is_published(self.method, self.effort)),
                ..settings.fit.clone()
            },
            levels: self.levels,
            cross: self.cross,
            // The error of level 1 is compared and wished for.
            every_level: true,
            texture_size: self.page(settings),
            samples: Samples::new(self.samples)?,
            tight_pages: self.tight_pages,
            ..settings.clone()
        })
    }

    /// Returns whether this choice is at least as fine as `other` in each of ε, page, samples and effort.
    #[must_use]
    pub fn is_as_fine_as(&self, other: &Self) -> bool {
        self.epsilon <= other.epsilon
            && self.texture_size >= other.texture_size
            && self.samples >= other.samples
            && self.effort >= other.effort
    }

    /// Returns the size of its atlas page, in the proportions of the page of `settings`.
    pub(crate) fn page(&self, settings: &ChainSettings) -> PageSize {
        let PageSize { width, height } = settings.texture_size;
        let scaled = (height * self.texture_size / width.max(1)).max(SMALLEST.min(height));
        PageSize { width: self.texture_size, height: scaled }
    }
}
