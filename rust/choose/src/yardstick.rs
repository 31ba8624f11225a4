//! The yardstick: whether a level looks like its leaves, by what an equally good tree passes.
//!
//! FLIP asks whether each leaf is in its own place. A viewer of a tree does not ask that. So a level is compared with the leaves, and its
//! figures with those of a *control*: the same leaves as a light breeze has moved them ([`crate::sway`]). Without light and under a sun, it may
//! have FLIP of q times the control's; contrast of the three finest octaves, coverage and mean color must be those of the leaves; and from
//! [`CELLS_FROM`] pixels on the cells of the crown must be covered as in the control.
//!
//! Pictures have the diameters of the crown that halve from [`LARGEST`]. They are means of pictures twice as large, up to that size: the two
//! largest are of the same ones. O(views · pixels) for each; 25 bytes for each pixel of the leaves' pictures are kept, 70 MB with a sun.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::Octahedral;
use leafcloud::metrics::{Comparison, Pictures, Reference, Views};
use leafcloud::textures::{Samples, mips};
use leafcloud::{Foliage, Image};
use leafcloud_flip::crown_pixels;
use rayon::prelude::*;

use crate::looks::{Leaves, Looks};
use crate::sway::{motion, swayed};

/// Side of the largest pictures in pixels, half of a usual screen's height, and of the smallest.
pub const LARGEST: usize = 512;
const SMALLEST: usize = 16;

/// Side of the pictures in which a level is judged first. Most levels that pass there pass in the largest, and most others in the next smaller ones;
/// a picture of the largest takes sixteen times as long.
const FIRST: usize = 128;

/// Side of the pictures in which drafts are judged. How much a level differs over the control hardly follows the size.
pub const OF_DRAFTS: usize = 128;

/// Diameter of a crown in pixels that is too small to tell a tree from a dot.
pub const UNJUDGED: f64 = 12.0;

/// Largest diameter of a crown in pixels at which a level is reported, and may take over, that passes nowhere.
const SMALLISH: f64 = 64.0;

/// Number of views.
pub const VIEWS: usize = 4;

/// Contrast over the leaves'.
const CONTRAST: (f64, f64) = (0.75, 1.15);

/// Difference of coverage from the leaves', for crowns of at least [`SMALL`] pixels and for smaller ones.
const COVERAGE: (f64, f64) = (0.03, 0.05);
const SMALL: f64 = 40.0;

/// Difference of the mean color.
const COLOR: f64 = 0.01;

/// Least side of a picture in pixels for the comparison of cells.
const CELLS_FROM: usize = 64;

/// Figures of a level in pictures of one size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Diameter of the crown in pixels.
    pub crown: f64,
    /// The figures without light or under a sun, of the light with the larger [`Self::excess`].
    pub looks: Looks,
    /// FLIP over the control's.
    pub difference: f64,
    /// Cells over the control's; 0 where they are not compared.
    pub places: f64,
}

impl Judgement {
    /// Returns the greatest share of an allowance that is used, at most 1 if the level passes, and the name of the figure. `q`: allowed FLIP over
    /// the control's.
    #[must_use]
    pub fn excess(&self, q: f64) -> (f64, &'static str) {
        let Looks { contrast, coverage, color, .. } = self.looks;
        let (least, most) = CONTRAST;
        let used = |ratio: f64| if ratio < 1.0 { (1.0 - ratio) / (1.0 - least) } else { (ratio - 1.0) / (most - 1.0) };
        let cover = if self.crown < SMALL { COVERAGE.1 } else { COVERAGE.0 };
        let all = [
            (self.difference / q, "difference"),
            (contrast.into_iter().map(used).fold(0.0, f64::max), "contrast"),
            ((coverage - 1.0).abs() / cover, "coverage"),
            (self.places, "places"),
            (color / COLOR, "color"),
        ];
        all.into_iter().fold((0.0, "difference"), |most, each| if each.0 > most.0 { each } else { most })
    }
}

/// A level for the yardstick.
#[derive(Clone, Copy)]
pub enum Subject<'a> {
    /// Triangles.
    Foliage(&'a Foliage),
    /// An octahedral impostor.
    Octahedral(&'a Octahedral),
}

impl Subject<'_> {
    fn beside(self, base: &Reference) -> Result<Comparison> {
        match self {
            Self::Foliage(foliage) => base.compare(&[foliage]),
            Self::Octahedral(impostor) => impostor.compare(base),
        }
    }
}

/// Pictures of the leaves and of the control. They are rendered when a level is first judged by them.
pub struct Yardstick<'a> {
    leaves: Cow<'a, Foliage>,
    /// Parts that no breeze moves.
    still: Option<Cow<'a, Foliage>>,
    up: DVec3,
    lit: bool,
    /// Groups of sizes, the largest first. All sizes of a group are judged in the same renderings, which are made when they are needed.
    pictures: Vec<(Vec<Size>, OnceLock<Rendered>)>,
}

/// Renderings of the leaves of one size.
struct Rendered {
    reference: Reference,
    /// The control by the motion of its leaves: crowns of different sizes may sway by as much.
    swaying: Mutex<Option<(f64, Arc<Comparison>)>>,
}

/// Pictures of one size, as means of renderings.
struct Size {
    side: usize,
    /// The leaves, for each light and view, once they are needed.
    leaves: OnceLock<Vec<Vec<Option<Leaves>>>>,
    /// The control, for each light.
    control: OnceLock<Vec<Looks>>,
}

impl<'a> Yardstick<'a> {
    /// Judges by pictures of at most `largest` pixels. `still`: parts that no breeze moves, which levels show, too. `up` has a finite length above 0.
    /// `lit`: also under a sun.
    #[must_use]
    pub fn new(
        leaves: Cow<'a, Foliage>,
        still: Option<Cow<'a, Foliage>>,
        up: DVec3,
        lit: bool,
        largest: usize,
    ) -> Self {
        let sides = std::iter::successors(Some(largest), |side| Some(side / 2)).take_while(|side| *side >= SMALLEST);
        let sides: Vec<usize> = sides.collect();
        let groups = sides.chunk_by(|a, b| rendered_side(*a) == rendered_side(*b));
        let size = |&side: &usize| Size { side, leaves: OnceLock::new(), control: OnceLock::new() };
        let pictures = groups.map(|sides| (sides.iter().map(size).collect(), OnceLock::new())).collect();
        Self { leaves, still, up, lit, pictures }
    }

    fn rendered<'b>(&self, side: usize, known: &'b OnceLock<Rendered>) -> Result<&'b Rendered> {
        if let Some(known) = known.get() {
            return Ok(known);
        }
        let Self { leaves, still, lit, .. } = self;
        let render = if *lit { Reference::lit } else { Reference::new };
        let views = self.views(rendered_side(side))?;
        let reference = render(&parts(leaves, still.as_deref()), leaves.frame(), views)?;
        Ok(known.get_or_init(|| Rendered { reference, swaying: Mutex::default() }))
    }

    fn views(&self, size: usize) -> Result<Views> {
        Ok(Views { count: VIEWS, size, samples: Samples::new(2)?, up: self.up, turn: 0.5 })
    }

    /// Returns the directions to the eyes of all pictures, of length 1.
    ///
    /// # Errors
    /// Never: the number of samples is allowed.
    pub fn directions(&self) -> Result<impl Iterator<Item = DVec3>> {
        Ok(self.views(LARGEST)?.around(self.leaves.frame()).map(|view| view.direction.normalize()))
    }

    /// Returns the figures of the control, for each light.
    fn control<'b>(&self, size: &'b Size, rendered: &Rendered) -> Result<&'b [Looks]> {
        if let Some(known) = size.control.get() {
            return Ok(known);
        }
        let motion = motion(crown_pixels(size.side as f64));
        let swaying = || rendered.swaying.lock().unwrap_or_else(PoisonError::into_inner);
        let compared = || -> Result<Arc<Comparison>> {
            let swayed = swayed(&self.leaves, motion)?;
            rendered.reference.compare(&parts(&swayed, self.still.as_deref())).map(Arc::new)
        };
        let known = swaying().clone().filter(|(known, _)| *known == motion);
        let pictures = known.map_or_else(compared, |(_, pictures)| Ok(pictures))?;
        *swaying() = Some((motion, Arc::clone(&pictures)));
        let looks = size.looks(&pictures).into_iter().flatten().collect();
        Ok(size.control.get_or_init(|| looks))
    }

    /// Returns the sides of the pictures, from the largest.
    pub fn sides(&self) -> impl Iterator<Item = usize> + '_ {
        self.pictures.iter().flat_map(|(sizes, _)| sizes).map(|size| size.side)
    }

    fn size(&self, side: usize) -> Option<(&Size, &OnceLock<Rendered>)> {
        let sizes = self.pictures.iter().flat_map(|(sizes, known)| sizes.iter().map(move |size| (size, known)));
        sizes.into_iter().find(|(size, _)| size.side == side)
    }

    /// Judges a level where its pictures are `side` pixels wide. `None` for an unknown size, or without leaves in the pictures.
    ///
    /// # Errors
    /// Those of a render.
    pub fn judge(&self, level: Subject, side: usize, q: f64) -> Result<Option<Judgement>> {
        let Some((size, known)) = self.size(side) else { return Ok(None) };
        let rendered = self.rendered(side, known)?;
        Ok(size.judged(&level.beside(&rendered.reference)?, self.control(size, rendered)?, q))
    }

    /// Returns the diameter of the crown in pixels up to which a level passes, at most `most`, with its judgement in the pictures nearest to it.
    /// Between two sizes the excess is taken as linear in the logarithm of the size. If it passes nowhere, or no leaf is
    /// seen in the pictures: [`UNJUDGED`].
    ///
    /// Pictures of [`FIRST`] pixels come first, then larger ones as long as it passes, or else smaller ones until it does. So a level that fails there
    /// and would pass in larger pictures takes over below them: it is drawn there, too.
    ///
    /// # Errors
    /// Those of a render.
    pub fn largest(&self, level: Subject, q: f64, most: f64) -> Result<Passed> {
        let is_judged = |side: usize| crown_pixels(side as f64) <= 1.5 * most || side / 2 < SMALLEST;
        let mut compared: Option<(usize, Comparison)> = None;
        let mut judged = |side: usize| -> Result<Option<Judgement>> {
            let Some((size, known)) = self.size(side) else { return Ok(None) };
            let rendered = self.rendered(side, known)?;
            let pictures = match compared.take() {
                Some((of_side, pictures)) if of_side == rendered_side(side) => pictures,
                _ => level.beside(&rendered.reference)?,
            };
            let (_, pictures) = compared.insert((rendered_side(side), pictures));
            Ok(size.judged(pictures, self.control(size, rendered)?, q))
        };
        let (larger, smaller): (Vec<usize>, Vec<usize>) =
            self.sides().filter(|side| is_judged(*side)).partition(|side| *side > FIRST);
        let passes = |judged: &Judgement| judged.excess(q).0 <= 1.0;
        let (mut passed, mut above, mut nearly) = (None, None, None::<Judgement>);
        for side in smaller {
            let Some(found) = judged(side)? else { continue };
            if passes(&found) {
                passed = Some(found);
                break;
            }
            above = Some(found);
            if found.crown <= SMALLISH && nearly.is_none_or(|known| found.excess(q).0 < known.excess(q).0) {
                nearly = above;
            }
        }
        if above.is_none() {
            for side in larger.into_iter().rev() {
                let Some(found) = judged(side)? else { continue };
                if !passes(&found) {
                    above = Some(found);
                    break;
                }
                passed = Some(found);
            }
        }
        let Some(judged) = passed else {
            return Ok(Passed { crown: UNJUDGED, judged: nearly.unwrap_or_default(), passes: false });
        };
        let between = |above: Judgement| {
            let [excess, larger] = [judged, above].map(|each| each.excess(q).0);
            judged.crown * libm::pow(above.crown / judged.crown, (1.0 - excess) / (larger - excess))
        };
        Ok(Passed { crown: above.map_or(most, between).min(most), judged, passes: true })
    }
}

/// Returns the side of the pictures that are rendered for a size.
fn rendered_side(side: usize) -> usize {
    (2 * side).min(LARGEST)
}

impl Size {
    /// Returns the mean figures over all views, for each light. Those of the leaves are kept.
    fn looks(&self, pictures: &Comparison) -> Vec<Option<Looks>> {
        let halved = |image: &Image| mips::means(image).into_iter().find(|level| level.width() <= self.side);
        let own = |pictures: &Pictures| pictures.base.par_iter().map(|base| Leaves::of(&halved(base)?)).collect();
        // Not within the lock: threads that wait for it may be those that this needs.
        let known = self.leaves.get().is_none().then(|| lights(pictures).map(own).collect());
        let leaves = self.leaves.get_or_init(|| known.unwrap_or_default());
        let mean = |(leaves, pictures): (&Vec<Option<Leaves>>, &Pictures)| {
            let look = |(leaves, level): (&Option<Leaves>, &Image)| Some(Looks::of(leaves.as_ref()?, &halved(level)?));
            let views: Vec<Looks> = leaves.par_iter().zip(pictures.level.par_iter()).filter_map(look).collect();
            Looks::mean(&views)
        };
        leaves.iter().zip(lights(pictures)).map(mean).collect()
    }

    /// Judges pictures of a level beside the leaves, by the figures of the control. `None` without leaves in them.
    fn judged(&self, pictures: &Comparison, control: &[Looks], q: f64) -> Option<Judgement> {
        let crown = crown_pixels(self.side as f64);
        let of_light = |(looks, control): (Option<Looks>, &Looks)| {
            let looks = looks?;
            let places = if self.side < CELLS_FROM { 0.0 } else { looks.cells / control.cells.max(1e-6) };
            Some(Judgement { crown, looks, difference: looks.flip / control.flip.max(1e-6), places })
        };
        let judged = self.looks(pictures).into_iter().zip(control).filter_map(of_light);
        judged.max_by(|a, b| a.excess(q).0.total_cmp(&b.excess(q).0))
    }
}

/// Where a level may take over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// Diameter of the crown in pixels.
    pub crown: f64,
    /// The judgement at the nearest judged size. For a level that does not pass: the judgement with the least excess at up to 64 pixels.
    pub judged: Judgement,
    /// Whether it passes there.
    pub passes: bool,
}

fn parts<'a>(leaves: &'a Foliage, still: Option<&'a Foliage>) -> Vec<&'a Foliage> {
    std::iter::once(leaves).chain(still).collect()
}

/// Returns the pictures without light, and under a sun if there are any.
fn lights(pictures: &Comparison) -> impl Iterator<Item = &Pictures> {
    std::iter::once(&pictures.flat).chain(&pictures.lit)
}
