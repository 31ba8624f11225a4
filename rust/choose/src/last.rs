//! The form of the last level: the cross impostor, or an octahedral impostor where it is cheaper.
//!
//! The octahedral impostor looks like the leaves at a larger size, so it replaces the level before over more distances. But a pixel of it
//! costs three of another level's. It is chosen if it passes the yardstick and saves a tenth of the cost of the level before, in the middle of
//! these distances. Either one takes over where it saves a tenth: a plant of few triangles is cheaper to draw as it is until it is small.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::octahedral::{Layout, Shown, Size, Sketch};
use leafcloud::lod::{Chain, ChainSettings, LEAST_SAVING, References};
use leafcloud::metrics::{DrawingCost, drawing_cost};
use leafcloud::{Error, Foliage, Progress};
use leafcloud_simplify::SimplifiedLeaves;

use crate::costs::{FEWEST_OF_TRUNKS, LEAST_CROWN, some};
use crate::twigs::wood;
use crate::wishes::compressed;
use crate::yardstick::{Passed, Subject, Yardstick};

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
pub const LEAST_STEP: f64 = 1.25;

/// Largest diameters of the crown in pixels at which an octahedral impostor takes over: where the clouds leave room in the budget of memory, and
/// elsewhere. Its pages have a texel for each of these pixels, so the smaller one takes a quarter of the memory.
const LARGEST: f64 = 62.0;
const LARGEST_OF_SMALL: f64 = 30.0;

/// Ratio of the sizes at which costs are compared.
const STEP: f64 = 0.9;

/// Images of an octahedral impostor.
const IMAGES: usize = 2;

/// What an octahedral impostor would show and replace.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// The leaves, then the trunk if there is one.
    pub parts: &'a [&'a Foliage],
    /// Simplified leaves, if level 1 has them.
    pub simpler: Option<&'a SimplifiedLeaves>,
    /// The level before the cross impostor.
    pub before: &'a Foliage,
    /// Diameter of the crown in pixels where that level takes over; infinite for the leaves.
    pub before_crown: f64,
    /// The chain of the tree.
    pub chain: &'a Chain,
    /// Impostors of the tree.
    pub sketches: &'a Sketches,
}

/// The octahedral impostors of a tree that were sketched: they are the same beside all chains.
pub type Sketches = RefCell<Vec<Rc<Sketch>>>;

impl Place<'_> {
    /// Returns the largest diameter of the crown in pixels, up to `crown`, at which the last level saves a tenth of the cost of the level before; at
    /// least [`LEAST_CROWN`]. `price`: what the last level costs at a scale in pixels.
    ///
    /// # Errors
    /// Those of [`drawing_cost`].
    pub fn cheaper_from(&self, crown: f64, price: &dyn Fn(f64) -> Result<DrawingCost>, up: DVec3) -> Result<f64> {
        let trunk = self.parts.get(1).map_or(Ok(None), |trunk| {
            let all: Vec<u32> = (0..trunk.triangle_count() as u32).collect();
            wood(Some(trunk), &some(&all, self.before.triangle_count().max(FEWEST_OF_TRUNKS)))
        })?;
        let before: Vec<&Foliage> = std::iter::once(self.before).chain(trunk.as_ref()).collect();
        let mut size = crown;
        while size > LEAST_CROWN {
            let scale = 0.5 * size / self.parts[0].frame().radius;
            let dear = drawing_cost(&before, scale, up, Progress::silent())?.total();
            if price(scale)?.total() <= (1.0 - LEAST_SAVING) * dear {
                return Ok(size);
            }
            size *= STEP;
        }
        Ok(size.max(LEAST_CROWN.min(crown)))
    }

    /// Returns the sketch of an impostor, for eyes in the directions `seen_from`.
    fn sketch(
        &self,
        size: Size,
        seen_from: &[DVec3],
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Rc<Sketch>> {
        let is_known = |sketch: &&Rc<Sketch>| sketch.impostor().layout.size == size;
        if let Some(known) = self.sketches.borrow().iter().find(is_known) {
            return Ok(Rc::clone(known));
        }
        let frame = self.parts[0].frame();
        let measured = || References::new(self.parts, self.parts, frame, settings).map(Arc::new);
        let references = self.chain.whole.clone().map_or_else(measured, Ok)?;
        let shown = shown(self.parts, self.simpler, settings.up, size);
        let sketch = Rc::new(Sketch::of(shown, size, &references, seen_from, settings, progress)?);
        self.sketches.borrow_mut().push(Rc::clone(&sketch));
        Ok(sketch)
    }
}

/// Returns what an impostor of all parts shows: the simplified leaves, if they deviate by less than a texel of it.
pub fn shown<'a>(parts: &'a [&'a Foliage], simpler: Option<&'a SimplifiedLeaves>, up: DVec3, size: Size) -> Shown<'a> {
    let layout = Layout::around(parts, up, size);
    let texel = 2.0 * layout.extent.x.min(layout.extent.y) / layout.size.texels as f64;
    let is_fine = |simpler: &&SimplifiedLeaves| simpler.deviation * simpler.foliage.frame().radius < texel;
    Shown { parts, simpler: simpler.filter(is_fine).map(|simpler| &simpler.foliage) }
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

/// Returns the sketch of the octahedral impostor to draw instead of the chain's cross impostor, and where it takes over; `None` if the cross impostor is drawn, or
/// if it is left out.
///
/// `judge`: the yardstick and its limit. Without it, [`Last::Auto`] keeps the cross impostor.
///
/// # Errors
/// Those of [`check_last`]; [`Error::Cancelled`].
pub fn octahedral(
    last: Last,
    judge: Option<&Judge>,
    place: Place,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Option<(Rc<Sketch>, Option<Passed>)>> {
    check_last(last, settings)?;
    let Some(cross) = place.chain.levels.last().filter(|level| level.is_cross()) else { return Ok(None) };
    let sketched = |size: Size, eyes: &[DVec3]| place.sketch(size, eyes, settings, progress);
    let Some(judge) = judge else {
        return if last == Last::Octahedral {
            sketched(Size::default(), &[]).map(|sketch| Some((sketch, None)))
        } else {
            Ok(None)
        };
    };
    if last == Last::Cross {
        return Ok(None);
    }
    let is_wished = last == Last::Octahedral;
    let has_room = is_wished || judge.memory_budget >= megabytes(Size::for_crown(LARGEST), place);
    let eyes: Vec<DVec3> = judge.yardstick.directions()?.collect();
    let judged = |most: f64| -> Result<(Rc<Sketch>, Passed)> {
        let largest = most.min(place.before_crown / LEAST_STEP);
        let sketch = sketched(if is_wished { Size::default() } else { Size::for_crown(largest) }, &eyes)?;
        let passed = judge.yardstick.largest(Subject::Octahedral(sketch.impostor()), judge.q, largest)?;
        Ok((sketch, passed))
    };
    let (mut sketch, mut passed) = judged(if has_room { LARGEST } else { LARGEST_OF_SMALL })?;
    let is_large = LARGEST.min(place.before_crown / LEAST_STEP) > LARGEST_OF_SMALL;
    if has_room && is_large && !is_wished && passed.passes && passed.crown <= LARGEST_OF_SMALL {
        // Pages that serve no larger crown than small ones are not worth their memory. Where large ones pass nowhere, small ones are not tried: they
        // show less.
        (sketch, passed) = judged(LARGEST_OF_SMALL)?;
    }
    let cross = judge.yardstick.largest(Subject::Foliage(&cross.foliage()?), judge.q, passed.crown)?;
    let layout = &sketch.impostor().layout;
    let frame = place.parts[0].frame();
    let price = |scale: f64| layout.cost(frame, scale, settings.up);
    let crown = if is_wished { passed.crown } else { place.cheaper_from(passed.crown, &price, settings.up)? };
    let is_worth_it = passed.passes && saving(place, crown, cross, layout, settings.up)? >= LEAST_SAVING;
    Ok((is_wished || is_worth_it).then_some((sketch, Some(Passed { crown, ..passed }))))
}

/// The yardstick for an octahedral impostor, and its limits.
pub struct Judge<'a> {
    /// Pictures of leaves and trunk.
    pub yardstick: &'a Yardstick<'a>,
    /// Allowed FLIP over the control's.
    pub q: f64,
    /// Budget of the compressed textures of all levels in MB.
    pub memory_budget: f64,
}

/// Returns the compressed textures of the clouds and of an impostor in MB.
fn megabytes(size: Size, place: Place) -> f64 {
    let images = place.chain.levels.iter().flat_map(|level| level.page.images());
    let clouds: usize = images.map(|(_, image)| image.pixels().len()).sum();
    compressed(clouds + IMAGES * (size.grid * size.texels).pow(2))
}

/// Returns the share of the cost of the level before that the impostor saves where the cross impostor may not yet take over.
fn saving(place: Place, crown: f64, cross: Passed, layout: &Layout, up: DVec3) -> Result<f64> {
    let farther = if cross.passes { cross.crown } else { 0.25 * crown };
    if crown <= farther {
        return Ok(0.0);
    }
    let frame = place.parts[0].frame();
    let scale = 0.5 * (farther * crown).sqrt() / frame.radius;
    let before = drawing_cost(&[place.before], scale, up, Progress::silent())?.total();
    Ok(1.0 - layout.cost(frame, scale, up)?.total() / before)
}
