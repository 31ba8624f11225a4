//! Builds the chain for a scene from the wishes and the tree, and tells the reason for each level.
//!
//! 1. Simplified leaves are level 1 where leaves have several triangles and the scene gets cheaper ([`crate::leaves`]).
//! 2. Drafts find the ε that the quality allows ([`crate::clouds`]). Pages get the texels that the memory allows.
//! 3. The clouds are built, each for a size ([`crate::search`]). One that does not save half of the cost of the level before is left out.
//! 4. The yardstick tells up to which size each level passes, with the page that files hold ([`crate::settle`]).
//! 5. Of these and of levels of fewer leaves ([`crate::fewer`]), the cheapest walk through the scene is drawn ([`crate::walk`]).
//! 6. The octahedral impostor follows where it passes ([`crate::last`]).

use std::borrow::Cow;
use std::cell::{OnceCell, RefCell};
use std::rc::Rc;
use std::sync::Arc;

use leafcloud::error::Result;
use leafcloud::lod::octahedral::Sketch;
use leafcloud::lod::{self, Chain, ChainSettings, Level, Measured, Octahedral, ViewCounts};
use leafcloud::metrics::drawing_cost;
use leafcloud::{Foliage, Progress};
use leafcloud_curve::{Offer, Wish, build_within};
use leafcloud_simplify::SimplifiedLeaves;

use crate::clouds::{TriedEpsilon, leave_a_choice};
use crate::costs::Prices;
use crate::last::{Judge, LEAST_STEP, Last, Place, Sketches, check_last, octahedral, shown};
use crate::leaves::LeafLevel;
use crate::search::{Plan, Search};
use crate::settle::{LARGEST_OF_QUICK, drawn};
use crate::twigs::thin_branches;
use crate::wishes::{LARGEST_CROWN, Wishes};
use crate::yardstick::{LARGEST, Passed, Subject, Yardstick};

/// Side of the largest pictures of leaves with their trunk: impostors take over where the crown is small.
const LARGEST_OF_IMPOSTORS: usize = 64;

/// Least size at which an octahedral impostor replaces all clouds, as a share of that of the first cloud.
const AS_EARLY: f64 = 0.8;

/// Most views of a quick choice.
const FEWER: ViewCounts = ViewCounts { order: 8, amounts: 8, report: 4 };

/// Shares of the progress: for simplified leaves and drafts, and for the clouds.
const SHARE_OF_CHOICE: f64 = 0.3;
const SHARE_OF_CLOUDS: f64 = 0.85;

/// A chain that is wanted.
pub struct Wanted {
    /// Settings of the chain.
    pub settings: ChainSettings,
    /// A time, an error or a preset that decides the settings.
    pub wish: Option<Wish>,
    /// Settings for the choice by quality; `None` without it.
    pub wishes: Option<Wishes>,
    /// The form of the last level.
    pub last: Last,
}

/// A chain with the reasons for its levels.
#[derive(Clone)]
pub struct Chosen {
    /// The clouds and the cross impostor.
    pub chain: Arc<Chain>,
    /// The settings chosen for a time, an error or a preset.
    pub offer: Option<Offer>,
    /// Simplified leaves and fewer leaves before the clouds.
    pub leaf_levels: Vec<Arc<LeafLevel>>,
    /// The octahedral impostor, drawn in place of the cross impostor.
    pub octahedral: Option<Arc<Octahedral>>,
    /// Where each level takes over, in the order of distances; empty if quality does not decide.
    pub takes_over: Vec<Passed>,
    /// Where the cross impostor takes over in files in place of the octahedral one.
    pub plain: Option<Passed>,
    /// The ε that were tried; the last one was chosen.
    pub tried: Vec<TriedEpsilon>,
    /// Allowed FLIP over the control's.
    pub q: f64,
    /// For each cloud, the triangles of the trunk that it shows.
    pub twigs: Vec<Vec<u32>>,
}

impl Wanted {
    /// Builds the chain.
    ///
    /// # Errors
    /// A setting or wish outside its range; the errors of [`lod::build_chain`]; [`Error::Cancelled`](leafcloud::Error::Cancelled).
    pub fn build(&self, foliage: &Foliage, trunk: Option<&Foliage>, progress: Progress) -> Result<Chosen> {
        let Self { settings, wish, wishes, last } = self;
        check_last(*last, settings)?;
        settings.check()?;
        let Some(wishes) = wishes else {
            let clouds = progress.part(0.0, if *last == Last::Cross { 1.0 } else { SHARE_OF_CLOUDS });
            let built = built(foliage, trunk, settings, *wish, clouds)?;
            return Tree::new(foliage, trunk, settings, Vec::new()).finished(built, None, *last, progress);
        };
        wishes.check()?;
        let settings = if wishes.is_quick() { with_fewer_views(settings) } else { settings.clone() };
        // Levels at wished sizes are made, whatever they save and however they look.
        let settings = &ChainSettings { every_level: settings.every_level || !wishes.sizes.is_empty(), ..settings };
        progress.tell("measure", 0.0)?;
        let largest = if wishes.is_quick() { LARGEST_OF_QUICK } else { LARGEST };
        let yardstick = Yardstick::new(Cow::Borrowed(foliage), None, settings.up, settings.is_lit(), largest);
        let thin = trunk.filter(|_| wishes.twigs).map(|trunk| thin_branches(trunk, foliage));
        let tree = Tree::new(foliage, trunk, settings, thin.unwrap_or_default());
        let clouds = progress.part(SHARE_OF_CHOICE, SHARE_OF_CLOUDS);
        let judged = match wish {
            None if settings.levels > 0 && leave_a_choice(&settings.fit) => {
                let plan = Plan::new(&tree, wishes, &yardstick, progress.part(0.0, SHARE_OF_CHOICE))?;
                let measured = Measured::of(plan.origin(foliage), trunk, settings, clouds.part(0.0, 0.0))?;
                Search { tree: &tree, plan: &plan, measured: &measured, wishes, yardstick: &yardstick }.best(clouds)?
            }
            _ => {
                let built = built(foliage, trunk, settings, *wish, clouds)?;
                tree.judged(built, None, wishes, &yardstick, clouds.part(1.0, 1.0))?.chosen
            }
        };
        tree.finished(judged, Some(wishes), *last, progress)
    }
}

/// Builds the chain of given settings, or for a wish.
fn built(
    foliage: &Foliage,
    trunk: Option<&Foliage>,
    settings: &ChainSettings,
    wish: Option<Wish>,
    progress: Progress,
) -> Result<Chosen> {
    let (chain, offer) = match wish {
        None => (lod::build_chain(foliage, trunk, settings, progress)?, None),
        Some(wish) => {
            let within = build_within(foliage, trunk, settings, wish, progress)?;
            (within.chain, Some(within.offer))
        }
    };
    Ok(Chosen {
        chain: Arc::new(chain),
        offer,
        leaf_levels: Vec::new(),
        octahedral: None,
        takes_over: Vec::new(),
        plain: None,
        tried: Vec::new(),
        q: 1.0,
        twigs: Vec::new(),
    })
}

/// Returns the diameter of the crown in pixels where the first cloud takes over.
pub(crate) fn first_cloud(chosen: &Chosen) -> Option<f64> {
    chosen.takes_over.get(chosen.leaf_levels.len()).map(|passed| passed.crown)
}

fn with_fewer_views(settings: &ChainSettings) -> ChainSettings {
    let ViewCounts { order, amounts, report } = settings.views;
    let views = ViewCounts {
        order: order.min(FEWER.order),
        amounts: amounts.min(FEWER.amounts),
        report: report.min(FEWER.report),
    };
    ChainSettings { views, ..settings.clone() }
}

/// A tree with the settings of its chain.
pub(crate) struct Tree<'a> {
    pub foliage: &'a Foliage,
    pub trunk: Option<&'a Foliage>,
    pub settings: &'a ChainSettings,
    /// The triangles of the thin branches that clouds may show.
    pub thin: Vec<u32>,
    /// Levels of fewer leaves, once they are known: they are the same for all clouds that are tried.
    pub fewer: OnceCell<Vec<(LeafLevel, Prices)>>,
    /// What the tree's own leaves cost to draw, once it is known.
    pub price: OnceCell<Prices>,
    /// Yardsticks for clouds that show these triangles of the trunk.
    pub yardsticks: RefCell<Vec<(Vec<u32>, Rc<Yardstick<'a>>)>>,
    /// The yardstick for impostors, which show the trunk, too.
    of_impostors: Yardstick<'a>,
    /// The octahedral impostors that were sketched.
    sketches: Sketches,
}

impl<'a> Tree<'a> {
    fn new(foliage: &'a Foliage, trunk: Option<&'a Foliage>, settings: &'a ChainSettings, thin: Vec<u32>) -> Self {
        let (up, lit) = (settings.up, settings.is_lit());
        let of_impostors =
            Yardstick::new(Cow::Borrowed(foliage), trunk.map(Cow::Borrowed), up, lit, LARGEST_OF_IMPOSTORS);
        let (fewer, price, yardsticks, sketches) = Default::default();
        Self { foliage, trunk, settings, thin, fewer, price, yardsticks, of_impostors, sketches }
    }
}

impl Tree<'_> {
    /// Adds the last level. Where an octahedral impostor takes over nearly as early as the first cloud, it is drawn in place of all clouds.
    fn finished(&self, chosen: Chosen, wishes: Option<&Wishes>, last: Last, progress: Progress) -> Result<Chosen> {
        self.yardsticks.borrow_mut().clear();
        let crown = first_cloud(&chosen).unwrap_or(f64::INFINITY);
        let may_replace = last == Last::Auto && !self.settings.every_level && chosen.offer.is_none();
        let (judging, baking) = (progress.part(SHARE_OF_CLOUDS, 0.95), progress.part(0.95, 1.0));
        if may_replace && AS_EARLY * crown <= LARGEST_OF_IMPOSTORS as f64 {
            let (without, sketch) = self.with_last(without_clouds(chosen.clone()), wishes, last, judging)?;
            let takes_over = without.takes_over.last().map_or(0.0, |passed| passed.crown);
            if sketch.is_some() && takes_over >= AS_EARLY * crown {
                return self.baked(without, sketch, baking);
            }
        }
        let (chosen, sketch) = self.with_last(chosen, wishes, last, judging)?;
        self.baked(chosen, sketch, baking)
    }

    /// Adds the octahedral impostor of a sketch.
    fn baked(&self, chosen: Chosen, sketch: Option<Rc<Sketch>>, progress: Progress) -> Result<Chosen> {
        let Some(sketch) = sketch else { return Ok(chosen) };
        let (parts, size) = (self.parts(), sketch.impostor().layout.size);
        let shown = shown(&parts, chosen.simplified(), self.settings.up, size);
        let impostor = sketch.finished(shown, self.settings, progress)?;
        Ok(Chosen { octahedral: Some(Arc::new(impostor)), ..chosen })
    }

    /// Returns the leaves, and the trunk.
    fn parts(&self) -> Vec<&Foliage> {
        std::iter::once(self.foliage).chain(self.trunk).collect()
    }

    /// Finds where the last level takes over, and whether an octahedral impostor is drawn for it.
    fn with_last(
        &self,
        chosen: Chosen,
        wishes: Option<&Wishes>,
        last: Last,
        progress: Progress,
    ) -> Result<(Chosen, Option<Rc<Sketch>>)> {
        let cross = chosen.chain.levels.last().filter(|level| level.is_cross());
        let Some(cross) = cross.filter(|_| wishes.is_some() || last == Last::Octahedral) else {
            return Ok((chosen, None));
        };
        let before = chosen.chain.levels.iter().rev().nth(1).map(Level::foliage).transpose()?;
        let (simpler, parts) = (chosen.simplified(), self.parts());
        let before_crown = chosen.takes_over.last().map_or(f64::INFINITY, |passed| passed.crown);
        let of_leaves = chosen.leaf_levels.last().map_or(self.foliage, |level| &level.leaves.foliage);
        let before = before.as_ref().unwrap_or(of_leaves);
        let sketches = &self.sketches;
        let place = Place { parts: &parts, simpler, before, before_crown, chain: &chosen.chain, sketches };
        let Some(wishes) = wishes else {
            let made = octahedral(last, None, place, self.settings, progress)?;
            return Ok((chosen, made.map(|(sketch, _)| sketch)));
        };
        let settings = self.settings;
        let yardstick = &self.of_impostors;
        let judge = Judge { yardstick, q: wishes.q(), memory_budget: wishes.memory_budget };
        let made = octahedral(last, Some(&judge), place, settings, progress)?;
        let most = (before_crown / LEAST_STEP).min(LARGEST_CROWN);
        let cross = drawn(cross, wishes)?;
        let of_cross = yardstick.largest(Subject::Foliage(&cross), wishes.q(), most)?;
        let price = |scale: f64| drawing_cost(&[&cross], scale, settings.up, Progress::silent());
        let of_cross = Passed { crown: place.cheaper_from(of_cross.crown, &price, settings.up)?, ..of_cross };
        let mut takes_over = chosen.takes_over.clone();
        let Some((sketch, passed)) = made else {
            takes_over.push(of_cross);
            return Ok((Chosen { takes_over, ..chosen }, None));
        };
        takes_over.extend(passed);
        Ok((Chosen { takes_over, plain: Some(of_cross), ..chosen }, Some(sketch)))
    }
}

impl Chosen {
    /// Returns the simplified leaves, if there are any.
    fn simplified(&self) -> Option<&SimplifiedLeaves> {
        self.leaf_levels.first().filter(|level| level.kept.is_none()).map(|level| &level.leaves)
    }
}

/// Returns the chain with leaves and impostor only.
fn without_clouds(chosen: Chosen) -> Chosen {
    let Chosen { chain, mut takes_over, .. } = chosen;
    let mut chain = Arc::unwrap_or_clone(chain);
    chain.levels.retain(Level::is_cross);
    takes_over.truncate(chosen.leaf_levels.len());
    Chosen { chain: Arc::new(chain), takes_over, twigs: Vec::new(), ..chosen }
}
