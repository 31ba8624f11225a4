//! The settings that a sweep varies.

use leafcloud::error::Result;
use leafcloud::fit::{Effort, FitSettings, Method};
use leafcloud::lod::{ChainSettings, is_published};
use leafcloud::sheet::PageSize;
use leafcloud::textures::Samples;

/// Texels that a page has along a side, at least.
const SMALLEST: usize = 64;

/// The settings that a sweep varies; what they mean and their ranges stand in [`ChainSettings`] and [`FitSettings`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// How planes are found.
    pub method: Method,
    /// How long.
    pub effort: Effort,
    /// Of level 1, a share of R.
    pub epsilon: f64,
    /// N.
    pub candidates: usize,
    /// The input of the method kmeans.
    pub max_billboards: Option<usize>,
    /// Clouds behind the leaves.
    pub levels: usize,
    /// Whether the cross stands behind them.
    pub cross: bool,
    /// Columns of level 1's page, in texels.
    pub texture_size: usize,
    /// Along each side of a texel.
    pub samples: usize,
    /// Whether pages are packed as tightly as seconds allow.
    pub tight_pages: bool,
}

impl Choice {
    /// What the settings have chosen.
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

    /// The settings with this choice; a page keeps its proportions.
    ///
    /// # Errors
    /// Samples outside their range; the other settings are checked where they are used.
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
            texture_size: self.page(settings),
            samples: Samples::new(self.samples)?,
            tight_pages: self.tight_pages,
            ..settings.clone()
        })
    }

    /// Whether this choice is in no setting coarser than `other`: bound, page, samples and effort.
    #[must_use]
    pub fn is_as_fine_as(&self, other: &Self) -> bool {
        self.epsilon <= other.epsilon
            && self.texture_size >= other.texture_size
            && self.samples >= other.samples
            && self.effort >= other.effort
    }

    /// Its page, in the proportions of that of `settings`.
    pub(crate) fn page(&self, settings: &ChainSettings) -> PageSize {
        let PageSize { width, height } = settings.texture_size;
        let scaled = (height * self.texture_size / width.max(1)).max(SMALLEST.min(height));
        PageSize { width: self.texture_size, height: scaled }
    }
}
