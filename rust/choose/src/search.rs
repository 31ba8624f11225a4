//! The search for the cheapest clouds of a tree.
//!
//! Clouds are built one after another. Where the first one takes over as late as the second, no others follow it, and the second is built in its place,
//! from the leaves; the best of these chains is completed.

use std::sync::Arc;

use leafcloud::error::Result;
use leafcloud::lod::{ChainSettings, Clouds, Measured, Origin};
use leafcloud::{Error, Foliage, Progress};

use crate::chain::{Chosen, Tree, first_cloud};
use crate::clouds::{CROWNS, TriedEpsilon, given_steps, steps, tried_epsilons};
use crate::leaves::{LeafLevel, leaf_level};
use crate::settle::Settled;
use crate::twigs::Twigs;
use crate::wishes::Wishes;
use crate::yardstick::{Passed, Yardstick};

/// Least gain in the logarithm of the cost for which clouds are built anew.
const LEAST_GAIN: f64 = 0.05;

/// Clouds that are made however small their pages are, and the least side of the pages of further ones.
const ON_ANY_PAGE: usize = 2;
const LEAST_PAGE: usize = 128;

/// The simplified leaves and the ε that a chain's clouds are built with.
pub(crate) struct Plan {
    pub leaf_level: Option<Arc<LeafLevel>>,
    tried: Vec<TriedEpsilon>,
}

impl Plan {
    pub fn new(tree: &Tree, wishes: &Wishes, yardstick: &Yardstick, progress: Progress) -> Result<Self> {
        let Tree { foliage, trunk, settings, .. } = *tree;
        let leaf_level = leaf_level(foliage, wishes, yardstick, settings, progress.part(0.0, 0.4))?.map(Arc::new);
        let mut tried = Vec::new();
        if wishes.free {
            // Billboards show the normals that leaves had before they collapsed.
            let finest = leaf_level.as_deref().map_or(foliage, |level| &level.leaves.foliage).with_normals();
            tried = tried_epsilons(wishes, yardstick, &finest, trunk, settings, progress.part(0.4, 1.0))?;
        }
        Ok(Self { leaf_level, tried })
    }

    /// Returns what clouds are built from.
    pub fn origin<'a>(&'a self, foliage: &'a Foliage) -> Origin<'a> {
        self.leaf_level.as_deref().map_or(Origin::of(foliage), |level| level.origin(foliage))
    }

    /// Begins a chain with clouds from number `first` on, with or without thin branches.
    fn begun<'a>(
        &self,
        measured: &'a Measured<'a>,
        tree: &Tree,
        wishes: &Wishes,
        (first, twigs): (usize, bool),
    ) -> Result<Begun<'a>> {
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
        let Twigs { foliage, triangles } = twigs.unwrap_or_default();
        Ok(Begun { clouds: Clouds::new(measured, settings, foliage)?, twigs: triangles, first: None })
    }

    /// Returns a chain with the clouds so far.
    fn chosen(&self, begun: &Begun, wishes: &Wishes) -> Chosen {
        Chosen {
            twigs: begun.shown(),
            chain: Arc::new(begun.clouds.chain()),
            offer: None,
            leaf_levels: self.leaf_level.iter().map(Arc::clone).collect(),
            octahedral: None,
            takes_over: Vec::new(),
            plain: None,
            tried: self.tried.clone(),
            q: wishes.q(),
        }
    }
}

/// A chain that may lack its last clouds: the search stops where further ones are not worth their time.
struct Begun<'a> {
    clouds: Clouds<'a>,
    /// For each cloud, the triangles of the trunk that it shows and the one before does not.
    twigs: Vec<Vec<u32>>,
    /// Where the first cloud takes over, once it is built.
    first: Option<Passed>,
}

impl Begun<'_> {
    /// Returns, for each cloud so far, the triangles of the trunk that it shows.
    fn shown(&self) -> Vec<Vec<u32>> {
        self.clouds.twigs().iter().map(|&sets| self.twigs[..sets].concat()).collect()
    }
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

/// The search for the cheapest clouds.
pub(crate) struct Search<'a, 't> {
    pub tree: &'a Tree<'t>,
    pub plan: &'a Plan,
    pub measured: &'a Measured<'a>,
    pub wishes: &'a Wishes,
    pub yardstick: &'a Yardstick<'a>,
}

/// A chain that was tried.
struct Try<'a> {
    settled: Settled,
    begun: Begun<'a>,
}

impl Try<'_> {
    fn is_better(&self, than: &Self) -> bool {
        self.settled.walk.is_better(&than.settled.walk)
    }

    /// Adds the cross impostor.
    fn finished(self, progress: Progress) -> Result<Chosen> {
        let chosen = self.settled.chosen;
        let chain = self.begun.clouds.with_cross(Arc::unwrap_or_clone(chosen.chain), progress)?;
        Ok(Chosen { chain: Arc::new(chain), ..chosen })
    }
}

impl<'a> Search<'a, '_> {
    /// Builds the clouds with thin branches; if they take over late then, or one does not look like the leaves, without them, too. Returns the clouds
    /// that all look like the leaves, or with which the tree is cheaper to draw, and the cross impostor.
    pub fn best(&self, progress: Progress) -> Result<Chosen> {
        let [with, without, cross] = [(0.0, 0.5), (0.5, 0.9), (0.9, 1.0)].map(|(from, to)| progress.part(from, to));
        let twigs = !self.tree.thin.is_empty();
        let is_early = |best: &Try| first_cloud(&best.settled.chosen).is_some_and(|crown| crown >= CROWNS[1]);
        let best = match self.cheapest(twigs, with) {
            // Branches may need more billboards than a small page holds.
            Err(Error::Invalid(_)) if twigs => self.cheapest(false, without)?,
            Ok(best) if twigs && !(best.settled.walk.passes && is_early(&best)) => {
                let other = self.cheapest(false, without)?;
                if other.is_better(&best) { other } else { best }
            }
            best => best?,
        };
        best.finished(cross)
    }

    /// Builds the clouds, and finds where they take over. Where the first one would take over only at the size of the second, or a walk without it
    /// would be cheaper, the second is built from the leaves in its place, if the tree is then cheaper to draw.
    fn cheapest(&self, twigs: bool, progress: Progress) -> Result<Try<'a>> {
        let Self { tree, plan, .. } = *self;
        let choices = if plan.tried.is_empty() || tree.settings.every_level { 1 } else { tree.settings.levels };
        let done = |tries: usize| 1.0 - libm::pow(0.5, tries as f64);
        let part = |tries: usize| progress.part(done(tries), done(tries + 1));
        let mut best = self.attempt((0, twigs), choices > 1, part(0))?;
        for (first, crown) in CROWNS.into_iter().enumerate().take(choices).skip(1) {
            let Settled { chosen, walk, without_first } = &best.settled;
            let is_early = first_cloud(chosen).is_some_and(|found| found >= crown);
            if is_early && *without_first > walk.cost - LEAST_GAIN {
                break;
            }
            let next = match self.attempt((first, twigs), first + 1 < choices, part(first)) {
                // A chain that cannot be built is no better.
                Err(Error::Invalid(_)) => break,
                next => next?,
            };
            if !next.is_better(&best) {
                break;
            }
            best = next;
        }
        if best.begun.clouds.is_complete() {
            return Ok(best);
        }
        match self.completed(&mut best.begun, progress.part(done(choices), 1.0)) {
            Err(Error::Invalid(_)) => Ok(best),
            settled => Ok(Try { settled: settled?, ..best }),
        }
    }

    /// Builds the clouds from number `first` on, with or without thin branches; only the first of them if it takes over as late as the second, and
    /// others `may_follow` in its place: the others are not worth their time before.
    fn attempt(&self, (first, twigs): (usize, bool), may_follow: bool, progress: Progress) -> Result<Try<'a>> {
        let mut begun = self.plan.begun(self.measured, self.tree, self.wishes, (first, twigs))?;
        let mut is_late = false;
        if let Some(number) = begun.clouds.add(progress)? {
            let shown = begun.shown()[0].clone();
            let passed = self.tree.passed(&begun.clouds.levels()[0], 0, &shown, self.wishes, self.yardstick)?;
            begun.first = Some(passed);
            is_late = CROWNS.get(first + number + 1).is_some_and(|next| passed.crown < *next);
        }
        let settled =
            if may_follow && is_late { self.settled(&begun, progress) } else { self.completed(&mut begun, progress) };
        Ok(Try { settled: settled?, begun })
    }

    /// Builds the clouds that are missing, and finds where all take over.
    fn completed(&self, begun: &mut Begun, progress: Progress) -> Result<Settled> {
        while begun.clouds.add(progress)?.is_some() {}
        self.settled(begun, progress)
    }

    fn settled(&self, begun: &Begun, progress: Progress) -> Result<Settled> {
        let chosen = self.plan.chosen(begun, self.wishes);
        self.tree.judged(chosen, begun.first, self.wishes, self.yardstick, progress.part(1.0, 1.0))
    }
}
