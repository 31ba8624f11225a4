//! The renderings of the leaves that the levels of a chain are compared with.

use glam::DVec3;

use super::settings::ChainSettings;
use super::tune::views_of_amounts;
use crate::error::Result;
use crate::foliage::Foliage;
use crate::geometry::Frame;
use crate::judge::{Judge, Views};
use crate::textures::Samples;

/// The two metrics renderers of a chain: one for choosing settings, one for the report. Their views differ.
pub struct Judges {
    /// For choosing settings.
    pub tuning: Judge,
    /// For the report.
    pub report: Judge,
}

impl Judges {
    /// Tunes levels to `left`, the leaves that pruning keeps where the first level takes over, and reports them against `whole`.
    ///
    /// # Errors
    /// An `up` without a finite length above 0.
    pub fn new(left: &[&Foliage], whole: &[&Foliage], frame: &Frame, settings: &ChainSettings) -> Result<Self> {
        let ChainSettings { looks, up, .. } = *settings;
        Ok(Self {
            tuning: Judge::new(left, frame, views_of_amounts(looks.amounts, up)?)?,
            report: Judge::new(whole, frame, report_views(looks.report, up))?,
        })
    }
}

/// Returns the views that the reported metrics use.
pub fn report_views(count: usize, up: DVec3) -> Views {
    Views { count, size: 128, samples: Samples::default(), up, turn: 0.5 }
}
