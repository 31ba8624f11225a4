//! Builds the chain for a scene from the wishes and the tree, and tells the reason for each level.
//!
//! 1. Simplified leaves are level 1 where leaves have several triangles and the scene gets cheaper ([`crate::leaves`]).
//! 2. Drafts find the ε that the quality allows ([`crate::clouds`]). Pages get the texels that the memory allows.
//! 3. The clouds are built, each for a size. One that does not save half of the cost of the level before is left out. Where the first one takes over
//!    as late as the second, no others follow it, and the second is built in its place; the best of these chains is completed.
//! 4. The yardstick tells the largest size at which each level passes, with the page that files hold ([`crate::settle`]).
//! 5. Of these and of levels of fewer leaves ([`crate::fewer`]), the cheapest walk through the scene is drawn ([`crate::walk`]).
//! 6. The octahedral impostor follows where it passes ([`crate::last`]).
//!
//! The choice depends on FLIP, whose last digits differ between machines. Figures are rounded where ε follows from them.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell, RefCell};
use std::rc::Rc;
use std::sync::Arc;

use leafcloud::error::Result;
use leafcloud::lod::{self, Chain, ChainSettings, Level, Octahedral, Origin, References, ViewCounts};
use leafcloud::{Error, Foliage, Progress};
use leafcloud_curve::{Offer, Wish, build_within};

use crate::clouds::{CROWNS, TriedEpsilon, given_steps, leave_a_choice, steps, tried_epsilons};
use crate::costs::Prices;
use crate::last::{Built, Judge, LEAST_STEP, Last, Place, check_last, octahedral};
use crate::leaves::{LeafLevel, leaf_level};
use crate::settle::{LARGEST_OF_QUICK, Settled, drawn};
use crate::twigs::{Twigs, thin_branches};
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

/// Clouds that are made however small their pages are, and the least side of the pages of further ones.
const ON_ANY_PAGE: usize = 2;
const LEAST_PAGE: usize = 128;

/// Least gain in the logarithm of the cost for which clouds are built anew.
const LEAST_GAIN: f64 = 0.05;

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
                tree.cheapest(&plan, wishes, &yardstick, clouds)?
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

/// The simplified leaves and the ε that a chain's clouds are built with.
struct Plan {
    leaf_level: Option<Arc<LeafLevel>>,
    tried: Vec<TriedEpsilon>,
}

impl Plan {
    fn new(tree: &Tree, wishes: &Wishes, yardstick: &Yardstick, progress: Progress) -> Result<Self> {
        let Tree { foliage, trunk, settings, .. } = *tree;
        let leaf_level = leaf_level(foliage, wishes, yardstick, settings, progress.part(0.0, 0.4))?.map(Arc::new);
        let mut tried = Vec::new();
        if wishes.free {
            // Billboards show the normals that leaves had before they collapsed.
            let finest = origin(leaf_level.as_deref(), foliage).finest.with_normals();
            tried = tried_epsilons(wishes, yardstick, &finest, trunk, settings, progress.part(0.4, 1.0))?;
        }
        Ok(Self { leaf_level, tried })
    }

    /// Builds the clouds from number `first` on, with or without thin branches. `goes_on` tells from the first cloud that is made, its number and
    /// the triangles of the trunk that it shows whether others are wanted.
    fn built(
        &self,
        tree: &Tree,
        wishes: &Wishes,
        (first, twigs): (usize, bool),
        goes_on: impl Fn(&Level, usize, &[u32]) -> Result<bool>,
        progress: Progress,
    ) -> Result<Chosen> {
        let Tree { foliage, trunk, settings, .. } = *tree;
        let settings = within_memory(settings, wishes);
        let mut steps = match self.tried.last() {
            Some(chosen) => steps(wishes, chosen.epsilon, settings.levels, first),
            None => given_steps(wishes, settings.fit.epsilon, settings.levels),
        };
        if wishes.sizes.is_empty() {
            // Pages halve from cloud to cloud, and far clouds have a hundred billboards still.
            let side = settings.texture_size.width.min(settings.texture_size.height);
            let has_room = |number: &usize| *number < ON_ANY_PAGE || side >> number >= LEAST_PAGE;
            steps.truncate((0..steps.len()).take_while(has_room).count());
        }
        let settings = ChainSettings { levels: steps.len(), steps, ..settings };
        let twigs = trunk.filter(|_| twigs).map(|trunk| Twigs::of(trunk, foliage, &settings.steps)).transpose()?;
        let twigs = twigs.unwrap_or_default();
        let origin = origin(self.leaf_level.as_deref(), foliage);
        let shown = |sets: usize| twigs.triangles[..sets].concat();
        let goes_on = |level: &Level, number: usize, sets: usize| goes_on(level, number, &shown(sets));
        let origin = Origin { twigs: &twigs.foliage, whole: tree.whole.get(), goes_on: Some(&goes_on), ..origin };
        let chain = lod::build_chain_of(origin, trunk, &settings, progress)?;
        if let Some(whole) = &chain.whole {
            tree.whole.get_or_init(|| Arc::clone(whole));
        }
        Ok(Chosen {
            twigs: chain.twigs.iter().map(|&sets| shown(sets)).collect(),
            chain: Arc::new(chain),
            offer: None,
            leaf_levels: self.leaf_level.iter().map(Arc::clone).collect(),
            octahedral: None,
            takes_over: Vec::new(),
            plain: None,
            tried: self.tried.clone(),
            q: wishes.q(),
        })
    }
}

/// Returns the diameter of the crown in pixels where the first cloud takes over.
pub(crate) fn first_cloud(chosen: &Chosen) -> Option<f64> {
    chosen.takes_over.get(chosen.leaf_levels.len()).map(|passed| passed.crown)
}

/// Returns what clouds are built from.
fn origin<'a>(leaf_level: Option<&'a LeafLevel>, foliage: &'a Foliage) -> Origin<'a> {
    leaf_level.map_or(Origin::of(foliage), |level| level.origin(foliage))
}

/// Returns the settings with pages within the budget of memory, unless they are given.
fn within_memory(settings: &ChainSettings, wishes: &Wishes) -> ChainSettings {
    let channels = settings.channels.completed();
    let images =
        1 + [channels.normal.is_some(), channels.orm, channels.translucency].into_iter().filter(|on| *on).count();
    let side = wishes.page_side(images).min(settings.texture_size.width);
    let texture_size = if settings.fitting_pages { side.into() } else { settings.texture_size };
    ChainSettings { texture_size, ..settings.clone() }
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
    /// Yardsticks for clouds that show these triangles of the trunk.
    pub yardsticks: RefCell<Vec<(Vec<u32>, Rc<Yardstick<'a>>)>>,
    /// The yardstick for impostors, which show the trunk, too.
    of_impostors: Yardstick<'a>,
    /// The renderings of leaves and trunk that impostors are compared with, once they are known.
    whole: OnceCell<Arc<References>>,
    /// The octahedral impostors that were built.
    octahedral: Built,
}

impl<'a> Tree<'a> {
    fn new(foliage: &'a Foliage, trunk: Option<&'a Foliage>, settings: &'a ChainSettings, thin: Vec<u32>) -> Self {
        let (up, lit) = (settings.up, settings.is_lit());
        let of_impostors =
            Yardstick::new(Cow::Borrowed(foliage), trunk.map(Cow::Borrowed), up, lit, LARGEST_OF_IMPOSTORS);
        let (fewer, whole, yardsticks, octahedral) = Default::default();
        Self { foliage, trunk, settings, thin, fewer, yardsticks, of_impostors, whole, octahedral }
    }
}

impl Tree<'_> {
    /// Builds the clouds for the plan with thin branches; if they take over late then, or one does not look like the leaves, without them, too.
    /// Returns the clouds that all look like the leaves, or with which the tree is cheaper to draw.
    fn cheapest(&self, plan: &Plan, wishes: &Wishes, yardstick: &Yardstick, progress: Progress) -> Result<Chosen> {
        let [with, without] = [(0.0, 0.5), (0.5, 1.0)].map(|(from, to)| progress.part(from, to));
        let twigs = !self.thin.is_empty();
        let best = match self.cheapest_of(plan, twigs, wishes, yardstick, with) {
            // Branches may need more billboards than a small page holds.
            Err(Error::Invalid(_)) if twigs => {
                return self.cheapest_of(plan, false, wishes, yardstick, without).map(|built| built.chosen);
            }
            best => best?,
        };
        let is_early = |crown: f64| crown >= CROWNS[1];
        if !twigs || best.walk.passes && first_cloud(&best.chosen).is_some_and(is_early) {
            return Ok(best.chosen);
        }
        let other = self.cheapest_of(plan, false, wishes, yardstick, without)?;
        Ok(if other.walk.is_better(&best.walk) { other.chosen } else { best.chosen })
    }

    /// Builds the clouds, and finds where they take over. Where the first one would take over only at the size of the second, or a walk without it
    /// would be cheaper, the second is built from the leaves in its place, if the tree is then cheaper to draw.
    fn cheapest_of(
        &self,
        plan: &Plan,
        twigs: bool,
        wishes: &Wishes,
        yardstick: &Yardstick,
        progress: Progress,
    ) -> Result<Settled> {
        let choices = if plan.tried.is_empty() || self.settings.every_level { 1 } else { self.settings.levels };
        let done = |tries: usize| 1.0 - libm::pow(0.5, tries as f64);
        let judged = |first: usize, may_stop: bool, part: Progress| {
            let (found, stopped) = (Cell::new(None), Cell::new(false));
            // Where the first cloud takes over as late as the second, the second is tried in its place: others are not worth their time before.
            let goes_on = |cloud: &Level, number: usize, shown: &[u32]| {
                let passed = self.passed(cloud, 0, shown, wishes, yardstick)?;
                found.set(Some(passed));
                let is_late = CROWNS.get(first + number + 1).is_some_and(|next| passed.crown < *next);
                stopped.set(may_stop && is_late);
                Ok(!stopped.get())
            };
            let built = plan.built(self, wishes, (first, twigs), goes_on, part)?;
            let settled = self.judged(built, found.get(), wishes, yardstick, part.part(1.0, 1.0))?;
            Ok(Settled { stopped: stopped.get(), ..settled })
        };
        let part = |tries: usize| progress.part(done(tries), done(tries + 1));
        let (mut best, mut best_first) = (judged(0, choices > 1, part(0))?, 0);
        for (first, crown) in CROWNS.into_iter().enumerate().take(choices).skip(1) {
            let is_early = first_cloud(&best.chosen).is_some_and(|found| found >= crown);
            if is_early && best.without_first > best.walk.cost - LEAST_GAIN {
                break;
            }
            let next = match judged(first, first + 1 < choices, part(first)) {
                // A chain that cannot be built is no better.
                Err(Error::Invalid(_)) => break,
                next => next?,
            };
            if !next.walk.is_better(&best.walk) {
                break;
            }
            (best, best_first) = (next, first);
        }
        if !best.stopped {
            return Ok(best);
        }
        match judged(best_first, false, progress.part(done(choices), 1.0)) {
            Err(Error::Invalid(_)) => Ok(best),
            whole => whole,
        }
    }

    /// Adds the last level. Where an octahedral impostor takes over nearly as early as the first cloud, it is drawn in place of all clouds.
    fn finished(&self, chosen: Chosen, wishes: Option<&Wishes>, last: Last, progress: Progress) -> Result<Chosen> {
        self.yardsticks.borrow_mut().clear();
        let crown = first_cloud(&chosen).unwrap_or(f64::INFINITY);
        let may_replace = last == Last::Auto && !self.settings.every_level && chosen.offer.is_none();
        if may_replace && AS_EARLY * crown <= LARGEST_OF_IMPOSTORS as f64 {
            let without = self.with_last(without_clouds(chosen.clone()), wishes, last, progress)?;
            let takes_over = without.takes_over.last().map_or(0.0, |passed| passed.crown);
            if without.octahedral.is_some() && takes_over >= AS_EARLY * crown {
                return Ok(without);
            }
        }
        self.with_last(chosen, wishes, last, progress)
    }

    /// Adds the octahedral impostor, and finds where the last level takes over.
    fn with_last(&self, chosen: Chosen, wishes: Option<&Wishes>, last: Last, progress: Progress) -> Result<Chosen> {
        let Some(cross) = chosen.chain.levels.last().filter(|level| level.is_cross()) else { return Ok(chosen) };
        if wishes.is_none() && last != Last::Octahedral {
            return Ok(chosen);
        }
        let before = chosen.chain.levels.iter().rev().nth(1).map(Level::foliage).transpose()?;
        let simpler = chosen.leaf_levels.first().filter(|level| level.kept.is_none()).map(|level| &level.leaves);
        let parts: Vec<&Foliage> = std::iter::once(self.foliage).chain(self.trunk).collect();
        let before_crown = chosen.takes_over.last().map_or(f64::INFINITY, |passed| passed.crown);
        let of_leaves = chosen.leaf_levels.last().map_or(self.foliage, |level| &level.leaves.foliage);
        let before = before.as_ref().unwrap_or(of_leaves);
        let built = &self.octahedral;
        let place = Place { parts: &parts, simpler, before, before_crown, chain: &chosen.chain, built };
        let progress = progress.part(SHARE_OF_CLOUDS, 1.0);
        let Some(wishes) = wishes else {
            let made = octahedral(last, None, place, self.settings, progress)?;
            return Ok(Chosen { octahedral: made.map(|(impostor, _)| impostor), ..chosen });
        };
        let settings = self.settings;
        let yardstick = &self.of_impostors;
        let judge = Judge { yardstick, q: wishes.q(), memory_budget: wishes.memory_budget };
        let made = octahedral(last, Some(&judge), place, settings, progress)?;
        let most = (before_crown / LEAST_STEP).min(LARGEST_CROWN);
        let of_cross = yardstick.largest(Subject::Foliage(&drawn(cross, wishes)?), wishes.q(), most)?;
        let mut takes_over = chosen.takes_over.clone();
        let Some((impostor, passed)) = made else {
            takes_over.push(of_cross);
            return Ok(Chosen { takes_over, ..chosen });
        };
        takes_over.extend(passed);
        Ok(Chosen { takes_over, plain: Some(of_cross), octahedral: Some(impostor), ..chosen })
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
