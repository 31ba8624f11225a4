//! The refinement of a level's textures, and with them of its polygons and its figures.

use std::time::Instant;

use super::{BAND, RefinedPage, Refinement, Subject};
use crate::error::Result;
use crate::lod::billboards::billboards;
use crate::lod::cut::mip_of;
use crate::lod::level::{Level, Step, tightened};
use crate::lod::settings::ChainSettings;
use crate::lod::tight::{OF_SHARES, Shown};
use crate::lod::tune;
use crate::progress::Progress;

/// Returns the level after refinement. It is unchanged without one, or if alpha is coverage.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub fn refined(level: Level, step: &Step, settings: &ChainSettings, progress: Progress) -> Result<Level> {
    if settings.refine == Refinement::Off || !settings.refined_parts.texels || level.alpha_cutoff == 0.0 {
        return Ok(level);
    }
    let started = Instant::now();
    let whole = level.atlas.with_rectangles();
    let tight = |least: f32, level: &Level| {
        let shown = Shown::new(&level.page.base_color, least);
        tightened(whole.clone(), &shown, level.radius_pixels, step.triangles, settings)
    };
    let subject = Subject {
        leaves: step.leaves,
        amounts: &step.references.tuning,
        atlas: &whole,
        tight: &tight(level.alpha_cutoff - BAND, &level),
        frame: &level.frame,
        double_sided: !level.two_sided,
        up: settings.up,
        mip: mip_of(level.radius_pixels * whole.texel()),
    };
    let made = subject.refined(&level.page, level.alpha_cutoff, settings.refine, progress)?;
    let RefinedPage { page, cutoff: alpha_cutoff, refined } = made;
    let mut level = Level { page, alpha_cutoff, refined: Some(refined), ..level };
    level.atlas = tight(alpha_cutoff.min(OF_SHARES), &level);
    let shown = billboards(&level.atlas, &level.frame, level.page.material(alpha_cutoff, !level.two_sided))?;
    level.pictures = step.references.report.compare(&[&shown])?;
    level.coverage = level.pictures.coverage();
    tune::check_shown(level.coverage, &level.page, alpha_cutoff)?;
    level.seconds.refine += started.elapsed().as_secs_f64();
    Ok(level)
}
