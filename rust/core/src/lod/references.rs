//! The renderings of the leaves that the levels of a chain are compared with.

use std::sync::Arc;

use glam::DVec3;

use super::settings::ChainSettings;
use super::tune::views_of_amounts;
use crate::error::Result;
use crate::foliage::Foliage;
use crate::geometry::Frame;
use crate::metrics::{Reference, Views};
use crate::textures::Samples;

/// The two references of a chain, with different views.
#[derive(Debug)]
pub struct References {
    /// For choosing settings.
    pub tuning: Arc<Reference>,
    /// For the report.
    pub report: Reference,
}

impl References {
    /// Tunes levels to `left`, the leaves that pruning keeps where the first level takes over, and reports them against `whole`.
    ///
    /// # Errors
    /// An `up` without a finite length above 0.
    pub fn new(left: &[&Foliage], whole: &[&Foliage], frame: &Frame, settings: &ChainSettings) -> Result<Self> {
        let amounts = views_of_amounts(settings.views.amounts, settings.up)?;
        Ok(Self {
            tuning: Arc::new(reference(left, frame, amounts, settings)?),
            report: report(whole, frame, settings)?,
        })
    }
}

/// Side of the report's pictures, in pixels. Smaller sizes are means of these.
const REPORT_SIZE: usize = 256;

/// Samples along each side of a pixel of the report's pictures: 4 × 4 samples for a pixel at half of their size.
const REPORT_SAMPLES: usize = 2;

/// Returns the views that the reported metrics use.
pub fn report_views(count: usize, up: DVec3) -> Result<Views> {
    Ok(Views { count, size: REPORT_SIZE, samples: Samples::new(REPORT_SAMPLES)?, up, turn: 0.5 })
}

/// Renders leaves for the reported metrics.
///
/// # Errors
/// A setting of the views outside its range.
pub fn report_of(leaves: &Foliage, settings: &ChainSettings) -> Result<Reference> {
    report(&[leaves], leaves.frame(), settings)
}

fn report(base: &[&Foliage], frame: &Frame, settings: &ChainSettings) -> Result<Reference> {
    reference(base, frame, report_views(settings.views.report, settings.up)?, settings)
}

/// Renders the base in some views, also lit if levels have the normals of their leaves.
fn reference(base: &[&Foliage], frame: &Frame, views: Views, settings: &ChainSettings) -> Result<Reference> {
    if settings.is_lit() { Reference::lit(base, frame, views) } else { Reference::new(base, frame, views) }
}
