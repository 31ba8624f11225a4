//! Whether a level is worth making: where it takes over it must save a tenth of the cost of drawing the level before it. Otherwise the level
//! before is drawn on, and the next level follows it. A tree of a hundred triangles needs no cloud, however few billboards it has. Level 1 is
//! tried with more triangles before it is left out.

use super::level::Level;
use super::settings::ChainSettings;
use crate::error::Result;
use crate::foliage::Foliage;
use crate::metrics::{DrawingCost, drawing_cost};
use crate::progress::Progress;

/// Least share of the cost of the level before that a level must save. Counts in a few views are off by some percent, and a level that saves
/// no more is not worth its textures.
pub const LEAST_SAVING: f64 = 0.1;

/// Least share that a level after the first must save in a scene: each takes memory of the scene's budget.
pub const LEAST_SAVING_IN_SCENES: f64 = 0.5;

/// A level that was not made, because it saves less than a tenth of the cost of drawing the level before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// The fitter's name, or "cross".
    pub method: &'static str,
    /// ε as a share of the leaves' R; `None` for the cross impostor.
    pub epsilon: Option<f64>,
    /// R of the leaves in pixels, at the distance where the level would take over.
    pub radius_pixels: f64,
    /// Cost of the level there.
    pub cost: DrawingCost,
    /// Cost of the level before it there; for the cross impostor with the trunk.
    pub before: DrawingCost,
}

/// The levels of a chain so far.
#[derive(Default)]
pub(super) struct Made {
    pub levels: Vec<Level>,
    pub left_out: Vec<LeftOut>,
}

impl Made {
    /// Adds the first of the candidates for a level that is worth making, or leaves the level out, with the figures of the cheapest candidate.
    /// `last`: whether no level follows. The last level stays if there is no other: a chain has at least one level. Returns the ε of the level.
    pub fn add(
        &mut self,
        candidates: impl Iterator<Item = Result<Level>>,
        before: &Before,
        last: bool,
        settings: &ChainSettings,
        progress: Progress,
    ) -> Result<Option<f64>> {
        let saving = settings.least_saving(self.levels.len());
        let mut cheapest: Option<LeftOut> = None;
        for level in candidates {
            let level = level?;
            let stays = settings.every_level || (last && self.levels.is_empty());
            let costs = if stays { None } else { Some(LeftOut::of(&level, before, settings, progress)?) };
            match costs.filter(|costs| !costs.saves(saving)) {
                None => {
                    let epsilon = level.epsilon;
                    self.levels.push(level);
                    return Ok(epsilon);
                }
                Some(found) if cheapest.is_none_or(|known| found.cost.total() < known.cost.total()) => {
                    cheapest = Some(found);
                }
                Some(_) => {}
            }
        }
        self.left_out.extend(cheapest);
        Ok(cheapest.and_then(|left_out| left_out.epsilon))
    }

    /// Replaces the last level by a refined one.
    pub fn refine_last(&mut self, refined: impl FnOnce(Level) -> Result<Level>) -> Result<()> {
        if let Some(level) = self.levels.pop() {
            self.levels.push(refined(level)?);
        }
        Ok(())
    }
}

/// The level before another one, or the leaves, with the trunk.
pub(super) struct Before<'a> {
    pub leaves: &'a Foliage,
    /// Counts before the cross impostor only, which shows it. Clouds have simpler trunks of their own, which are not known here.
    pub trunk: Option<&'a Foliage>,
}

impl LeftOut {
    /// Returns the costs of a level and of the level before it, where the level takes over.
    fn of(level: &Level, before: &Before, settings: &ChainSettings, progress: Progress) -> Result<Self> {
        let scale = scale(level, settings);
        let count = |leaves: &Foliage, trunk: Option<&Foliage>| {
            let parts: Vec<&Foliage> = std::iter::once(leaves).chain(trunk).collect();
            drawing_cost(&parts, scale, settings.up, progress)
        };
        Ok(Self {
            method: level.method,
            epsilon: level.epsilon,
            radius_pixels: scale * level.frame.radius,
            cost: count(&level.foliage()?, None)?,
            before: count(before.leaves, before.trunk.filter(|_| level.is_cross()))?,
        })
    }

    fn saves(&self, share: f64) -> bool {
        self.cost.total() <= (1.0 - share) * self.before.total()
    }
}

/// Share of the size where a level takes over at which it is compared in a scene: half of the trees that it draws are smaller still.
const MIDDLE_OF_BAND: f64 = 0.3;

/// Returns the pixels of a length of 1, in the caller's units, where a level takes over: where it was built to, and where its texels are as
/// large as a pixel or smaller. In a scene: in the middle of the distances at which the level is drawn.
fn scale(level: &Level, settings: &ChainSettings) -> f64 {
    let share = if settings.steps.is_empty() { 1.0 } else { MIDDLE_OF_BAND };
    share * level.radius_pixels.min(1.0 / level.atlas.texel()) / level.frame.radius
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::fit::FitSettings;
    use crate::foliage::{Attributes, Material};
    use crate::lod::{Chain, build_chain};
    use crate::textures::Samples;

    /// Parallel square leaves of side 0.2 on a grid in the unit square, `layers` of them one behind another, 0.01 apart.
    fn wall(side: usize, layers: usize) -> Foliage {
        let count = side * side * layers;
        let corner = |i: usize| {
            let (column, row, layer) = (i % side, i / side % side, i / side / side);
            DVec3::new(column as f64, row as f64, 0.0) / side as f64 + DVec3::Z * (0.01 * layer as f64)
        };
        let leaf =
            |i: usize| [(0.0, 0.0), (0.2, 0.0), (0.2, 0.2), (0.0, 0.2)].map(|(x, y)| corner(i) + DVec3::new(x, y, 0.0));
        let positions: Vec<DVec3> = (0..count).flat_map(leaf).collect();
        let triangles = (0..count as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k))).collect();
        Foliage::new(&positions, triangles, Attributes::default(), vec![Material::default()]).unwrap()
    }

    fn chain(foliage: &Foliage, trunk: Option<&Foliage>, settings: &ChainSettings) -> Chain {
        let fit = FitSettings { epsilon: 0.02, ..FitSettings::default() };
        let samples = Samples::new(1).unwrap();
        let settings = ChainSettings { fit, texture_size: 128.into(), samples, ..settings.clone() };
        build_chain(foliage, trunk, &settings, Progress::silent()).unwrap()
    }

    fn cheaper(levels: usize, cross: bool) -> ChainSettings {
        ChainSettings { levels, cross, every_level: false, ..ChainSettings::default() }
    }

    #[test]
    #[ignore = "long: make test-night runs it"]
    fn levels_that_pay_are_made_as_before() {
        let foliage = wall(8, 8);
        let [every, worth] =
            [true, false].map(|every_level| chain(&foliage, None, &ChainSettings { every_level, ..cheaper(2, false) }));
        assert_eq!(worth.left_out, []);
        let same = |(a, b): (&Level, &Level)| a.page == b.page && a.atlas.billboards.len() == b.atlas.billboards.len();
        assert!(every.levels.len() == 2 && every.levels.iter().zip(&worth.levels).all(same));
    }

    #[test]
    fn a_single_leaf_needs_no_cloud_but_a_chain_has_a_level() {
        let leaf = wall(1, 1);
        for (levels, cross) in [(1, false), (2, true), (3, false)] {
            let found = chain(&leaf, None, &cheaper(levels, cross));
            assert_eq!(found.levels.len(), 1);
            assert_eq!(found.levels[0].is_cross(), cross, "the last level stays");
            assert_eq!(found.left_out.len(), levels - usize::from(!cross));
            for each in &found.left_out {
                assert!(each.cost.total() > 0.9 * each.before.total());
                // Its two triangles are the leaf's own.
                assert_eq!((each.cost.triangles, each.before.triangles), (2, 2));
            }
        }
    }

    #[test]
    fn the_level_after_one_left_out_is_made_of_the_leaves() {
        // Two leaves 0.07 R apart: at an ε of 0.02 each has a billboard of its own, at 0.05 they share one.
        let foliage = wall(1, 2);
        let found = chain(&foliage, None, &cheaper(2, false));
        let [left_out] = found.left_out[..] else { panic!("level 1 alone: {:?}", found.left_out) };
        assert_eq!((left_out.cost.triangles, left_out.before.triangles), (4, 4));
        let [level] = &found.levels[..] else { panic!("a level") };
        assert_eq!(left_out.epsilon.map(|epsilon| epsilon * 2.5), level.epsilon);
        let cloud = level.cloud.as_ref().unwrap();
        assert_eq!((cloud.planes.len(), cloud.parents.len()), (1, foliage.triangle_count()));
        assert!((level.max_deviation_leaves - 0.005).abs() < 1e-9, "half of the distance between the leaves");
    }

    #[test]
    fn a_trunk_counts_before_the_cross_alone() {
        let (leaf, trunk) = (wall(1, 1), wall(4, 4));
        let found = chain(&leaf, Some(&trunk), &cheaper(1, true));
        let [cloud] = found.left_out[..] else { panic!("the cloud alone: {:?}", found.left_out) };
        assert_eq!((cloud.cost.triangles, cloud.before.triangles), (2, 2));
        assert!(found.levels[0].is_cross());
    }
}
