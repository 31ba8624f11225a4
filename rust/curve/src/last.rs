//! The form of the last level: the cross impostor, or an octahedral impostor where it is cheaper.
//!
//! The octahedral impostor looks like the leaves at a larger size, so it replaces the level before over more distances. But a pixel of it
//! costs three of another level's. It is chosen if it saves a tenth of the cost of the level before, in the middle of these distances.

use std::sync::Arc;

use leafcloud::error::Result;
use leafcloud::lod::octahedral::{Layout, Octahedral, Size};
use leafcloud::lod::{Chain, ChainSettings, LEAST_SAVING, References};
use leafcloud::metrics::{Comparison, drawing_cost};
use leafcloud::{Error, Foliage, Progress};
use leafcloud_flip::{ImageErrors, SMALLEST, crown_pixels};
use leafcloud_simplify::SimplifiedLeaves;

/// Which form the last level may have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Last {
    /// The octahedral impostor where it is cheaper, else the cross impostor.
    Auto,
    /// The cross impostor.
    #[default]
    Cross,
    /// The octahedral impostor.
    Octahedral,
}

/// Least ratio of the distances at which two levels take over, so that each is drawn.
const LEAST_STEP: f64 = 1.25;

/// What an octahedral impostor would show and replace.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// The leaves, then the trunk if there is one.
    pub parts: &'a [&'a Foliage],
    /// Simplified leaves, if level 1 has them.
    pub simpler: Option<&'a SimplifiedLeaves>,
    /// The level before the cross impostor.
    pub before: &'a Foliage,
    /// Pictures of that level; `None` for the leaves.
    pub before_pictures: Option<&'a Comparison>,
    /// The chain of the tree.
    pub chain: &'a Chain,
}

impl Place<'_> {
    /// Returns the simplified leaves, if they deviate by less than a texel of the impostor.
    fn simpler(&self, up: glam::DVec3, size: Size) -> Option<&Foliage> {
        let simpler = self.simpler?;
        let layout = Layout::around(self.parts, up, size);
        let texel = 2.0 * layout.extent.x.min(layout.extent.y) / layout.size.texels as f64;
        (simpler.deviation * simpler.foliage.frame().radius < texel).then_some(&simpler.foliage)
    }
}

/// Checks that the last level can have a form.
///
/// # Errors
/// [`Last::Octahedral`] with settings without a cross impostor, which plain files show.
pub fn check_last(last: Last, settings: &ChainSettings) -> Result<()> {
    if last == Last::Octahedral && !settings.cross {
        return Err(Error::invalid(
            "`last=octahedral` needs the cross impostor, which files have for readers without the shader; leave out `cross=False`",
        ));
    }
    Ok(())
}

/// Returns the octahedral impostor to draw instead of the chain's cross impostor; `None` if the cross impostor is drawn, or if it is left out.
///
/// `target`: the image error that it may have where it takes over; without it, [`Last::Auto`] keeps the cross impostor.
///
/// # Errors
/// Those of [`check_last`]; [`Error::Cancelled`].
pub fn octahedral(
    last: Last,
    target: Option<f64>,
    place: Place,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Option<Octahedral>> {
    check_last(last, settings)?;
    let cross = place.chain.levels.last().filter(|level| level.is_cross());
    let build = |size: Size| {
        let simpler = place.simpler(settings.up, size);
        let known = place.chain.whole.clone();
        let measured = || References::new(place.parts, place.parts, place.parts[0].frame(), settings).map(Arc::new);
        let references = &*known.map_or_else(measured, Ok)?;
        Octahedral::build(place.parts, simpler, size, references, settings, progress)
    };
    match (last, cross, target) {
        (Last::Octahedral, Some(_), _) => build(Size::default()).map(Some),
        (Last::Auto, Some(cross), Some(target)) => {
            let up = settings.up;
            let range = Range { smallest: crown(&cross.pictures, target), place, up };
            // At best it takes over where its texels are as large as pixels, and some time after the level before.
            let before = place.before_pictures.map_or(f64::INFINITY, |pictures| crown(pictures, target) / LEAST_STEP);
            let largest = before.min(Size::default().texels as f64);
            let size = Size::for_crown(largest);
            let layout = Layout::around(place.parts, up, size);
            if range.saving(largest, &layout)? < LEAST_SAVING {
                return Ok(None);
            }
            let built = build(size)?;
            let is_worth_it = range.saving(crown(&built.pictures, target).min(largest), &layout)? >= LEAST_SAVING;
            Ok(is_worth_it.then_some(built))
        }
        _ => Ok(None),
    }
}

/// Returns the diameter of the crown in pixels up to which a level is within the target.
fn crown(pictures: &Comparison, target: f64) -> f64 {
    crown_pixels(ImageErrors::up_to(pictures, target).largest_size(target).unwrap_or(SMALLEST as f64))
}

/// The sizes of the crown at which the octahedral impostor replaces the level before.
struct Range<'a> {
    /// Diameter in pixels where the cross impostor takes over.
    smallest: f64,
    place: Place<'a>,
    up: glam::DVec3,
}

impl Range<'_> {
    /// Returns the share of the cost that the impostor saves in the middle of the range that ends at `largest` pixels; 0 without a range.
    fn saving(&self, largest: f64, layout: &Layout) -> Result<f64> {
        if largest <= self.smallest {
            return Ok(0.0);
        }
        let frame = self.place.parts[0].frame();
        let scale = 0.5 * (self.smallest * largest).sqrt() / frame.radius;
        let before = drawing_cost(&[self.place.before], scale, self.up, Progress::silent())?.total();
        Ok(1.0 - layout.cost(frame, scale, self.up)?.total() / before)
    }
}
