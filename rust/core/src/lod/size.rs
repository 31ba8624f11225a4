//! The default size limit of a level's billboards: the cheapest to draw that the level's budget of triangles allows.
//!
//! A fit without a limit finds the fewest planes, and each is as wide as the crown and mostly empty: level 1 then draws one to nine times
//! the fragments of its leaves. Small billboards are mostly full. At the same number of triangles they draw fewer fragments than tight
//! polygons of larger ones (`docs/decisions/polygons.md`), so rectangles get most of the budget ([`SHARE`]). Where a level takes over at a
//! small size, triangles cost more than fragments, and larger billboards are cheaper. A billboard has room for leaves twice as wide as the
//! mean leaf: smaller ones would tear large leaves. Level 2 is built from the billboards of level 1, and so on, so its billboards are larger
//! in turn.

use crate::cloud::Cloud;
use crate::error::Result;
use crate::fit::{Effort, FitSettings, Method, fit_within};
use crate::foliage::{Foliage, Opacity, area_vector};
use crate::outlines::outlines;
use crate::polygons::Scale;
use crate::progress::Progress;

/// The least limit, and the first that is tried, as shares of R.
const LEAST_SIZE: f64 = 0.1;
const FIRST_SIZE: f64 = 0.2;

/// Least limit, as a multiple of the leaves' mean radius.
const LEAVES: f64 = 2.0;

/// A limit without effect, as a share of R: no two leaves are farther apart.
const WHOLE: f64 = 2.0;

/// Least factor by which the number of billboards grows from one limit to the next smaller one: 1.3 to 1.7 on the measured trees.
const MORE_PER_STEP: f64 = 1.27;

/// Share of the budget of triangles for the rectangles of all billboards; the rest makes polygons tighter.
const SHARE: f64 = 0.8;

/// Greatest share by which a smaller limit may cost more than the cheapest: smaller billboards look better.
const TOLERANCE: f64 = 0.3;

/// Returns the number of billboards of two triangles, times `copies`, for a budget of triangles.
pub fn billboards_within(triangles: usize, copies: usize) -> usize {
    (SHARE * triangles as f64 / (2 * copies) as f64) as usize
}

/// A size limit, with the cloud that it leads to.
type Limited = (Option<f64>, Cloud);

/// What a fit of a level starts from.
pub struct Fitted<'a> {
    /// The level before.
    pub finer: &'a Foliage,
    /// Its opaque parts.
    pub opacity: &'a Opacity,
    /// ε, in the caller's units.
    pub bound: f64,
    /// Most billboards that a default size limit may lead to.
    pub most: usize,
    /// The size at which the level takes over, as pixels along R.
    pub scale: Scale,
}

impl Fitted<'_> {
    /// Returns the cloud with the size limit of `fit`, or with the default limit that is cheapest to draw. Also returns that limit.
    ///
    /// # Errors
    /// The errors of a fit.
    pub fn cloud(&self, fit: &FitSettings, progress: Progress) -> Result<Limited> {
        let mut done = 0.0;
        let mut with = |max_size: Option<f64>| {
            let rest = progress.part(done, 0.5 * (1.0 + done));
            done = 0.5 * (1.0 + done);
            let fit = FitSettings { max_size, ..fit.clone() };
            fit_within(self.finer, self.opacity, &fit, self.bound, rest, None).map(|cloud| (max_size, cloud))
        };
        if fit.max_size.is_some() || fit.max_billboards.is_some() || is_published(fit.method, fit.effort) {
            return with(fit.max_size.map(|size| size.max(fit.epsilon).min(WHOLE)));
        }
        let sizes = sizes(LEAST_SIZE.max(fit.epsilon).max(LEAVES * mean_radius(self.finer)));
        let first = sizes.iter().position(|size| size.is_none_or(|size| size >= FIRST_SIZE)).unwrap_or(0);
        let found = with(sizes[first])?;
        // Smaller billboards are more: one fit that tells how many steps are left saves most of the fits between.
        let left = self.most as f64 / found.1.planes.len().max(1) as f64;
        let steps = (libm::log(left) / libm::log(MORE_PER_STEP)).max(0.0) as usize;
        self.cheapest(&sizes[first.saturating_sub(steps)..], &found, with)
    }

    /// Returns the cloud of the smallest limit that fits and costs at most [`TOLERANCE`] more than the cheapest one; of the last limit if
    /// none fits. `known` is a limit with its cloud.
    fn cheapest(
        &self,
        sizes: &[Option<f64>],
        known: &Limited,
        mut with: impl FnMut(Option<f64>) -> Result<Limited>,
    ) -> Result<Limited> {
        let mut last = known.clone();
        let mut fitting: Vec<(f64, Limited)> = Vec::new();
        for &size in sizes {
            last = if size == known.0 { known.clone() } else { with(size)? };
            if last.1.planes.len() <= self.most {
                let cost = self.cost(&last.1);
                if fitting.last().is_some_and(|(before, _)| *before < cost) {
                    break;
                }
                fitting.push((cost, last.clone()));
            }
        }
        let least = fitting.last().map_or(0.0, |(cost, _)| *cost);
        let chosen = fitting.into_iter().find(|(cost, _)| *cost <= (1.0 + TOLERANCE) * least);
        Ok(chosen.map_or(last, |(_, found)| found))
    }

    /// Returns the cost of drawing the rectangles of all billboards, in fragments.
    fn cost(&self, cloud: &Cloud) -> f64 {
        let outlines = outlines(&cloud.planes, &cloud.parents, |t| self.finer.corners(t), self.opacity);
        outlines.iter().map(|outline| self.scale.rectangle(outline.size())).sum()
    }
}

/// Returns the limits to choose from, ascending by √2 from `least`; the last is none.
fn sizes(least: f64) -> Vec<Option<f64>> {
    let steps = std::iter::successors(Some(least), |size| Some(size * std::f64::consts::SQRT_2));
    steps.take_while(|size| *size < WHOLE).map(Some).chain([None]).collect()
}

/// Returns whether a method runs as published, without a size limit.
#[must_use]
pub fn is_published(method: Method, effort: Effort) -> bool {
    method != Method::Stochastic || effort == Effort::Literal
}

/// Returns the area-weighted mean radius of the leaves, local frame. A leaf's radius is the distance of its farthest corner from the mean
/// of its corners.
fn mean_radius(foliage: &Foliage) -> f64 {
    let leaves = foliage.leaves();
    let (mut radii, mut areas) = (0.0, 0.0);
    for triangles in leaves.iter() {
        let corners = || triangles.iter().flat_map(|&t| foliage.corners(t as usize));
        let middle = corners().sum::<glam::DVec3>() / (3 * triangles.len()) as f64;
        let radius = corners().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let area: f64 = triangles.iter().map(|&t| area_vector(foliage.corners(t as usize)).length()).sum();
        radii += area * radius;
        areas += area;
    }
    radii / areas
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::foliage::Attributes;

    /// Square leaves of the side 0.02 on a grid of n³ places in a cube of side 2.
    fn crown(n: usize) -> Foliage {
        let place = |i: usize| 2.0 * (i as f64 + 0.5) / n as f64 - 1.0;
        let places = (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| [x, y, z].map(place))));
        let square = |[x, y, z]: [f64; 3]| {
            [[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]].map(|[u, v]| DVec3::new(x + u, y + v, z))
        };
        let positions: Vec<DVec3> = places.flat_map(square).collect();
        let triangles =
            (0..positions.len() as u32 / 4).flat_map(|q| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| 4 * q + i)));
        Foliage::new(&positions, triangles.collect(), Attributes::default(), vec![]).unwrap()
    }

    fn found(fit: &FitSettings, most: usize) -> (Option<f64>, usize) {
        found_at(fit, most, 1e4)
    }

    fn found_at(fit: &FitSettings, most: usize, pixels_per_unit: f64) -> (Option<f64>, usize) {
        let finer = crown(6);
        let opacity = fit.opacity(&finer);
        let bound = fit.epsilon * finer.frame().radius;
        let scale = Scale { pixels_per_unit, copies: 1 };
        let fitted = Fitted { finer: &finer, opacity: &opacity, bound, most, scale };
        let (size, cloud) = fitted.cloud(fit, Progress::silent()).unwrap();
        (size, cloud.planes.len())
    }

    #[test]
    fn billboards_are_as_small_as_the_budget_allows() {
        let fit = FitSettings::default();
        let sizes: Vec<Option<f64>> = sizes(LEAST_SIZE);
        let counted: Vec<usize> = [1000, 100, 30, 1]
            .into_iter()
            .map(|most| {
                let (size, count) = found(&fit, most);
                assert!(sizes.contains(&size) && (count <= most || size.is_none()));
                count
            })
            .collect();
        assert!(counted.is_sorted_by(|a, b| a >= b) && counted[0] > 2 * counted[3], "{counted:?}");
    }

    #[test]
    fn billboards_are_larger_where_the_level_takes_over_at_a_smaller_size() {
        let counted: Vec<usize> =
            [1e4, 60.0, 2.0].map(|pixels| found_at(&FitSettings::default(), 1000, pixels).1).to_vec();
        assert!(counted.is_sorted_by(|a, b| a >= b) && counted[0] > 2 * counted[2], "{counted:?}");
    }

    #[test]
    fn a_limit_that_is_set_is_kept_and_at_least_epsilon() {
        let set = |max_size, epsilon| FitSettings { epsilon, max_size: Some(max_size), ..FitSettings::default() };
        assert_eq!(found(&set(0.3, 0.04), 1).0, Some(0.3));
        assert_eq!(found(&set(0.1, 0.25), 1).0, Some(0.25));
    }

    #[test]
    fn a_number_of_billboards_and_the_published_methods_have_no_default() {
        let plain = FitSettings::default();
        let settings = [
            FitSettings { max_billboards: Some(9), ..plain.clone() },
            FitSettings { effort: Effort::Literal, ..plain.clone() },
            FitSettings { method: Method::Density, ..plain },
        ];
        assert!(settings.iter().all(|fit| found(fit, 1000).0.is_none()));
    }

    #[test]
    fn a_billboard_has_two_triangles_and_some_are_left() {
        assert_eq!((billboards_within(1000, 1), billboards_within(1000, 2)), (400, 200));
    }
}
