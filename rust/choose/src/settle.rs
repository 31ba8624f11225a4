//! Settles where the levels of a built chain take over.

use std::borrow::Cow;
use std::collections::HashSet;
use std::rc::Rc;
use std::sync::Arc;

use leafcloud::error::Result;
use leafcloud::lod::{Chain, Level};
use leafcloud::{Foliage, Progress};

use crate::chain::{Chosen, Tree};
use crate::costs::{FEWEST_OF_TRUNKS, Prices, some};
use crate::fewer::{Whole, one_after_another};
use crate::leaves::LeafLevel;
use crate::scene::Scene;
use crate::twigs::wood;
use crate::walk::{Candidate, Levels, Scenes, Walk};
use crate::wishes::{LATER_CROWN, Wishes};
use crate::yardstick::{LARGEST, Passed, Subject, Yardstick};

/// Greatest excess with which a cloud takes over that passes nowhere, where it is closest to passing. The bake says so.
const NEARLY: f64 = 2.0;

/// Side of the largest pictures of a quick choice.
pub const LARGEST_OF_QUICK: usize = 128;

/// Most levels after the leaves: each is a mesh and a hand-over more in the file.
const MOST_LEVELS: usize = 5;

/// A chain, with the size at which each level takes over.
pub struct Settled {
    /// The chain.
    pub chosen: Chosen,
    /// The walk through its levels.
    pub walk: Walk,
    /// The logarithm of the cost without its first cloud; infinite if it has one or none.
    pub without_first: f64,
}

impl<'a> Tree<'a> {
    /// Finds where cloud number `number` takes over. `twigs`: the triangles of the trunk that it shows.
    pub fn passed(
        &self,
        cloud: &Level,
        number: usize,
        twigs: &[u32],
        wishes: &Wishes,
        yardstick: &Yardstick,
    ) -> Result<Passed> {
        let usual = if number == 0 { wishes.largest_crown() } else { LATER_CROWN };
        let most = wishes.crown(number).unwrap_or(usual);
        let with_twigs = if twigs.is_empty() { None } else { self.yardstick_with(twigs, wishes)? };
        let yardstick = with_twigs.as_deref().unwrap_or(yardstick);
        let passed = yardstick.largest(Subject::Foliage(&drawn(cloud, wishes)?), wishes.q(), most)?;
        let nearly = !passed.passes && passed.judged.excess(wishes.q()).0 <= NEARLY;
        let crown = if nearly { passed.judged.crown.min(most) } else { passed.crown };
        Ok(Passed { crown, ..passed })
    }

    /// Finds where leaves and clouds take over. `first`: where the first cloud takes over, if that is known. Fewer leaves come before the clouds,
    /// where the tree is then cheaper to draw.
    pub fn judged(
        &self,
        chosen: Chosen,
        first: Option<Passed>,
        wishes: &Wishes,
        yardstick: &Yardstick,
        progress: Progress,
    ) -> Result<Settled> {
        let mut takes_over: Vec<Passed> = chosen.leaf_levels.iter().map(|level| level.passed).collect();
        for (number, level) in clouds(&chosen.chain).enumerate() {
            let twigs = chosen.twigs.get(number).map_or(&[][..], Vec::as_slice);
            let known = first.filter(|_| number == 0);
            takes_over.push(known.map_or_else(|| self.passed(level, number, twigs, wishes, yardstick), Ok)?);
        }
        let chosen = without_failing(Chosen { takes_over, q: wishes.q(), ..chosen }, self);
        self.settled(chosen, wishes, yardstick, progress)
    }

    /// Chooses among levels that may take over at `chosen.takes_over` at most.
    fn settled(&self, chosen: Chosen, wishes: &Wishes, yardstick: &Yardstick, progress: Progress) -> Result<Settled> {
        let scenes = Scenes::to(wishes.scene)?;
        let costs = self.costs(&chosen, wishes, &scenes.priced)?;
        let fewer = if may_have_fewer(&chosen, &costs, wishes) {
            self.fewer(&chosen, &costs, wishes, yardstick, &scenes.priced, progress)?
        } else {
            &[]
        };
        let impostor = self.has_cross(&chosen.chain);
        let mut levels = Levels { impostor, ..costs.levels(&chosen, fewer, wishes) };
        let (leaf_levels, count) = (usize::from(levels.simplified.is_some()), levels.clouds.len());
        let room = MOST_LEVELS.saturating_sub(leaf_levels + usize::from(self.settings.cross));
        let may_go = !fewer.is_empty() && impostor;
        let is_wished = self.settings.every_level || !wishes.sizes.is_empty();
        let walk = scenes.best(&levels, room, if is_wished { count } else { usize::from(!may_go) });
        let mut without_first = f64::INFINITY;
        if count > 1 {
            levels.clouds.remove(0);
            without_first = scenes.best(&levels, room, 1).cost;
        }
        let fewer = fewer.iter().map(|(level, _)| level.clone()).collect();
        Ok(Settled { chosen: along(chosen, &walk, fewer), walk, without_first })
    }

    /// Returns whether a chain has a cross impostor, or gets one once its clouds are settled.
    fn has_cross(&self, chain: &Chain) -> bool {
        self.settings.cross && !chain.left_out.iter().any(|level| level.epsilon.is_none())
    }

    /// Returns what the levels of a chain cost to draw.
    fn costs(&self, chosen: &Chosen, wishes: &Wishes, scene: &Scene) -> Result<Costs> {
        let trunk = wood(self.trunk, &some(&self.thin, self.thin.len().div_ceil(2)))?;
        let beside = |leaves: &Foliage| self.priced(leaves, trunk.as_ref(), scene);
        let of_cloud = |(number, level): (usize, &Level)| {
            let shown = chosen.twigs.get(number).map_or(&[][..], Vec::as_slice);
            self.priced(&drawn(level, wishes)?, self.left_of(shown, level.atlas.triangles())?.as_ref(), scene)
        };
        let leaves = self.price.get().cloned().map_or_else(|| beside(self.foliage), Ok)?;
        Ok(Costs {
            leaves: self.price.get_or_init(|| leaves).clone(),
            simplified: chosen.leaf_levels.first().map(|level| beside(&level.leaves.foliage)).transpose()?,
            clouds: clouds(&chosen.chain).enumerate().map(of_cloud).collect::<Result<_>>()?,
            trunk,
        })
    }

    /// Returns levels of fewer leaves with their prices. They are the same for all clouds that are tried, so they are made once.
    fn fewer(
        &self,
        chosen: &Chosen,
        costs: &Costs,
        wishes: &Wishes,
        yardstick: &Yardstick,
        scene: &Scene,
        progress: Progress,
    ) -> Result<&[(LeafLevel, Prices)]> {
        if let Some(known) = self.fewer.get() {
            return Ok(known);
        }
        let whole = Whole { leaves: self.foliage, simplified: chosen.leaf_levels.first().map(Arc::as_ref) };
        let priced = |level: LeafLevel| {
            self.priced(&level.leaves.foliage, costs.trunk.as_ref(), scene).map(|prices| (level, prices))
        };
        let found = whole.fewer(wishes, yardstick, self.settings, progress)?.into_iter().map(priced);
        let found = found.collect::<Result<Vec<_>>>()?;
        Ok(self.fewer.get_or_init(|| found))
    }

    /// Returns the thin branches that are left to the trunk of a cloud with this number of triangles. `shown`: those that the cloud shows.
    fn left_of(&self, shown: &[u32], triangles: usize) -> Result<Option<Foliage>> {
        let shown: HashSet<u32> = shown.iter().copied().collect();
        let left: Vec<u32> = self.thin.iter().copied().filter(|triangle| !shown.contains(triangle)).collect();
        wood(self.trunk, &some(&left, triangles.max(FEWEST_OF_TRUNKS)))
    }

    fn priced(&self, level: &Foliage, trunk: Option<&Foliage>, scene: &Scene) -> Result<Prices> {
        let parts: Vec<&Foliage> = std::iter::once(level).chain(trunk).collect();
        Prices::of(&parts, self.foliage.frame().radius, self.settings.up, scene)
    }

    /// Returns the yardstick for a cloud that shows these triangles of the trunk, too; `None` without any. All chains that are tried share it.
    fn yardstick_with(&self, twigs: &[u32], wishes: &Wishes) -> Result<Option<Rc<Yardstick<'a>>>> {
        let mut yardsticks = self.yardsticks.borrow_mut();
        let mut twigs = twigs.to_vec();
        twigs.sort_unstable();
        if let Some((_, known)) = yardsticks.iter().find(|(known, _)| *known == twigs) {
            return Ok(Some(Rc::clone(known)));
        }
        let Some(wood) = wood(self.trunk, &twigs)? else { return Ok(None) };
        let Self { foliage, settings, .. } = self;
        let largest = if wishes.is_quick() { LARGEST_OF_QUICK } else { LARGEST };
        let (leaves, wood) = (Cow::Borrowed(*foliage), Some(Cow::Owned(wood)));
        let made = Rc::new(Yardstick::new(leaves, wood, settings.up, settings.is_lit(), largest));
        yardsticks.push((twigs, Rc::clone(&made)));
        Ok(Some(made))
    }
}

/// What the levels of a tree cost to draw.
struct Costs {
    /// The part of the trunk that is drawn beside leaves.
    trunk: Option<Foliage>,
    leaves: Prices,
    simplified: Option<Prices>,
    clouds: Vec<Prices>,
}

impl Costs {
    /// Returns the levels that may be drawn.
    fn levels<'a>(&'a self, chosen: &Chosen, fewer: &'a [(LeafLevel, Prices)], wishes: &Wishes) -> Levels<'a> {
        let largest =
            |passed: &Passed, prices| Candidate { largest: passed.crown, passes: passed.passes, wished: None, prices };
        let cloud = |(number, (passed, prices))| Candidate { wished: wishes.crown(number), ..largest(passed, prices) };
        let simplified = chosen.leaf_levels.first().zip(self.simplified.as_ref());
        let of_clouds = chosen.takes_over[chosen.leaf_levels.len()..].iter().zip(&self.clouds);
        Levels {
            leaves: &self.leaves,
            simplified: simplified.map(|(level, prices)| largest(&level.passed, prices)),
            fewer: fewer.iter().map(|(level, prices)| largest(&level.passed, prices)).collect(),
            clouds: of_clouds.enumerate().map(cloud).collect(),
            impostor: false,
        }
    }
}

/// Returns whether levels of fewer leaves may be cheaper than the clouds. A time or an error is a wish for clouds.
fn may_have_fewer(chosen: &Chosen, costs: &Costs, wishes: &Wishes) -> bool {
    let first = chosen.takes_over.get(chosen.leaf_levels.len()).zip(costs.clouds.first());
    // Half of the leaves cost no less than this.
    let is_cheap = |(first, cloud): (&Passed, &Prices)| {
        first.crown >= wishes.largest_crown() && cloud.is_half_of(&costs.leaves, first.crown)
    };
    chosen.offer.is_none() && !first.is_some_and(is_cheap)
}

fn clouds(chain: &Chain) -> impl Iterator<Item = &Level> {
    chain.levels.iter().filter(|level| !level.is_cross())
}

/// Returns the chain with the levels of a walk.
fn along(chosen: Chosen, walk: &Walk, fewer: Vec<LeafLevel>) -> Chosen {
    let Chosen { mut chain, mut takes_over, mut leaf_levels, mut twigs, .. } = chosen;
    let drawn = fewer.into_iter().enumerate().filter(|(number, _)| walk.fewer.contains(number));
    for level in one_after_another(drawn.map(|(_, level)| level).collect()) {
        takes_over.insert(leaf_levels.len(), level.passed);
        leaf_levels.push(Arc::new(level));
    }
    if takes_over.len() > walk.crowns.len() {
        let mut levels = Arc::unwrap_or_clone(chain);
        keep_clouds(&mut levels, walk.clouds);
        takes_over.truncate(walk.crowns.len());
        twigs.truncate(walk.clouds);
        chain = Arc::new(levels);
    }
    for (passed, &crown) in takes_over.iter_mut().zip(&walk.crowns) {
        passed.crown = crown;
    }
    Chosen { chain, leaf_levels, takes_over, twigs, ..chosen }
}

/// Keeps the first clouds, and the cross impostor.
fn keep_clouds(chain: &mut Chain, count: usize) {
    let mut number = 0;
    chain.levels.retain(|level| {
        number += 1;
        level.is_cross() || number <= count
    });
}

/// Returns the chain without its last clouds, if they look like the leaves at no size. No level is built from them. A chain has one level at least.
fn without_failing(chosen: Chosen, tree: &Tree) -> Chosen {
    let Chosen { chain, mut takes_over, mut twigs, .. } = chosen;
    let mut chain = Arc::unwrap_or_clone(chain);
    while !tree.settings.every_level && takes_over.len() > 1 && takes_over.last().is_some_and(|last| !last.passes) {
        let clouds = clouds(&chain).count();
        if clouds == 0 || clouds == 1 && !tree.has_cross(&chain) {
            break;
        }
        takes_over.pop();
        twigs.pop();
        keep_clouds(&mut chain, clouds - 1);
    }
    Chosen { chain: Arc::new(chain), takes_over, twigs, ..chosen }
}

/// Returns a level as the renderer draws it.
pub fn drawn(level: &Level, wishes: &Wishes) -> Result<Foliage> {
    if wishes.shares { level.shares() } else { level.foliage() }
}
