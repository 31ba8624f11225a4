//! Chains, with what decides their settings: the caller, a quality or a wish.

use std::sync::Arc;

use leafcloud::geometry::Frame;
use leafcloud::lod::{self, Chain, ChainSettings, Octahedral, Origin};
use leafcloud::metrics::Comparison;
use leafcloud::{Foliage, Progress};
use leafcloud_curve::quality::{LATER, Scale, TARGET, is_quick, settings_for, with_fewer_views};
use leafcloud_curve::{Last, LeafLevel, Offer, Place, Wish, build_within, check_last, leaf_level, octahedral};

use crate::leaf_level::PyLeafLevel;
use crate::levels::PyChain;
use crate::options::Quality;

/// A chain, with what decided its settings.
#[derive(Clone)]
pub struct Built {
    chain: Arc<Chain>,
    /// Frame of the leaves.
    frame: Frame,
    offer: Option<Offer>,
    leaf_level: Option<Arc<LeafLevel>>,
    octahedral: Option<Arc<Octahedral>>,
}

impl Built {
    pub fn into_python(self) -> PyChain {
        let Self { chain, frame, offer, leaf_level, octahedral } = self;
        let leaf_level = leaf_level.map(|level| PyLeafLevel { level, frame });
        PyChain { chain, radius: frame.radius, offer, leaf_level, octahedral }
    }

    /// Returns the triangles of the level before the last one, and its pictures; those of the leaves are not known.
    fn before_last(&self, foliage: &Foliage) -> leafcloud::Result<(Foliage, Option<&Comparison>)> {
        if let Some(level) = self.chain.levels.iter().rev().nth(1) {
            return Ok((level.foliage()?, Some(&level.pictures)));
        }
        let simplified = self.leaf_level.as_ref();
        let shown = simplified.map_or(foliage, |level| &level.leaves.foliage);
        Ok((shown.clone(), simplified.map(|level| &level.pictures)))
    }
}

/// What decides the settings of a chain.
pub enum Goal {
    /// The caller alone.
    Given,
    Quality(Quality),
    Wish(Wish),
}

impl Goal {
    fn build(
        &self,
        foliage: &Foliage,
        trunk: Option<&Foliage>,
        settings: &ChainSettings,
        progress: Progress,
    ) -> leafcloud::Result<Built> {
        let built = |chain, offer, leaf_level| Built {
            chain: Arc::new(chain),
            frame: *foliage.frame(),
            offer,
            leaf_level,
            octahedral: None,
        };
        match *self {
            Self::Given => Ok(built(lod::build_chain(foliage, trunk, settings, progress)?, None, None)),
            Self::Quality(Quality { target, free, form }) => {
                TARGET.check("target_error", target)?;
                settings.check()?;
                let simplifying = progress.part(0.0, SHARE_OF_LEAVES);
                let quick = is_quick(target);
                let settings = &if quick { with_fewer_views(settings) } else { settings.clone() };
                let scale = Scale::of(foliage, settings, quick)?;
                let leaf_level = leaf_level(target, &scale, settings, form, simplifying)?;
                let origin = leaf_level.as_ref().map_or(Origin::of(foliage), |level| level.origin(foliage));
                let target = if leaf_level.is_some() { LATER * target } else { target };
                let choosing = progress.part(SHARE_OF_LEAVES, SHARE_OF_CHOICE);
                let (target, simplified) = (target.min(MOST_TARGET), leaf_level.as_ref());
                let settings = settings_for(target, &scale, simplified, trunk, settings, free, choosing)?;
                let building = progress.part(SHARE_OF_CHOICE, 1.0);
                let chain = lod::build_chain_of(origin, trunk, &settings, building)?;
                Ok(built(chain, None, leaf_level.map(Arc::new)))
            }
            Self::Wish(wish) => {
                let within = build_within(foliage, trunk, settings, wish, progress)?;
                Ok(built(within.chain, Some(within.offer), None))
            }
        }
    }
}

impl Goal {
    /// Returns the image error that levels after level 1 may have where they take over; `None` if quality does not decide.
    fn later_target(&self) -> Option<f64> {
        match self {
            Self::Quality(Quality { target, .. }) => Some((LATER * target).min(MOST_TARGET)),
            Self::Given | Self::Wish(_) => None,
        }
    }
}

/// A chain that is wanted.
pub struct Wanted {
    pub settings: ChainSettings,
    pub goal: Goal,
    pub last: Last,
}

impl Wanted {
    /// Builds the chain, then the octahedral impostor.
    pub fn build(&self, foliage: &Foliage, trunk: Option<&Foliage>, progress: Progress) -> leafcloud::Result<Built> {
        let Self { settings, goal, last } = self;
        check_last(*last, settings)?;
        if *last == Last::Cross {
            return goal.build(foliage, trunk, settings, progress);
        }
        let built = goal.build(foliage, trunk, settings, progress.part(0.0, SHARE_OF_CHAIN))?;
        let (before, before_pictures) = built.before_last(foliage)?;
        let parts: Vec<&Foliage> = std::iter::once(foliage).chain(trunk).collect();
        let simpler = built.leaf_level.as_ref().map(|level| &level.leaves);
        let place = Place { parts: &parts, simpler, before: &before, before_pictures, chain: &built.chain };
        let impostor = octahedral(*last, goal.later_target(), place, settings, progress.part(SHARE_OF_CHAIN, 1.0))?;
        Ok(Built { octahedral: impostor.map(Arc::new), ..built })
    }
}

/// Share of the progress for the chain, before an octahedral impostor.
const SHARE_OF_CHAIN: f64 = 0.85;

/// Greatest target of a cloud.
const MOST_TARGET: f64 = 0.99;

/// Share of the progress for simplifying leaves.
const SHARE_OF_LEAVES: f64 = 0.1;

/// Share of the progress for choosing settings by quality.
const SHARE_OF_CHOICE: f64 = 0.3;
