//! The default size limit of a level's billboards.
//!
//! A fit without a limit finds the fewest planes, and each is as wide as the crown and mostly empty: level 1 then draws two to eight times
//! the fragments of its leaves. Billboards a fifth of R across draw a third to a quarter of that, for a few hundred triangles more
//! (`docs/bench/size.md`). That size would tear large leaves, so billboards have room for leaves twice as wide as the mean leaf. Level 2 is
//! built from the billboards of level 1, and so on, so its billboards are larger in turn. If leaves are few and far apart, a billboard of
//! that size holds a single leaf and the level saves no triangles: then the limit grows.

use crate::error::Result;
use crate::fit::{Effort, FitSettings, Method, fit_within};
use crate::foliage::{Foliage, area_vector};
use crate::progress::Progress;

/// The least limit, as a share of R.
const LEAST_SIZE: f64 = 0.2;

/// Least limit, as a multiple of the leaves' mean radius.
const LEAVES: f64 = 2.0;

/// A limit without effect, as a share of R: no two leaves are farther apart.
const WHOLE: f64 = 2.0;

/// Returns the size limit for a fit of `finer`, as a share of R: the limit of `fit`, at least its ε, or the default.
///
/// Returns `None`, no limit, if a billboard count is given, because a default limit would conflict with it. The published methods have no
/// size limit either.
pub fn limit(fit: &FitSettings, finer: &Foliage) -> Option<f64> {
    let default = || LEAST_SIZE.max(LEAVES * mean_radius(finer));
    let size =
        fit.max_size.or_else(|| (fit.max_billboards.is_none() && !is_published(fit.method, fit.effort)).then(default));
    size.map(|size| size.max(fit.epsilon).min(WHOLE))
}

/// Returns whether a method runs as published, without a size limit.
#[must_use]
pub fn is_published(method: Method, effort: Effort) -> bool {
    method != Method::Stochastic || effort == Effort::Literal
}

/// Returns the settings with the final size limit of level 1 of `foliage`, found by fits at their ε. Fits that are compared with one
/// another need the same limit.
///
/// # Errors
/// The errors of a fit.
pub fn settled(fit: &FitSettings, foliage: &Foliage, progress: Progress) -> Result<FitSettings> {
    let with = |max_size| FitSettings { max_size, ..fit.clone() };
    let mut size = limit(fit, foliage);
    if fit.max_size.is_some() || size.is_none() {
        return Ok(with(size));
    }
    let (opacity, bound) = (fit.opacity(foliage), fit.epsilon * foliage.frame().radius);
    while size.is_some() {
        let cloud = fit_within(foliage, &opacity, &with(size), bound, progress, None)?;
        if is_worth(cloud.planes.len() * (fit.max_corners - 2), foliage.triangle_count()) {
            return Ok(with(size));
        }
        size = larger(size);
    }
    Ok(with(Some(WHOLE)))
}

/// Returns the limit to try after `size`; `None`, no limit, once it spans the whole crown.
pub fn larger(size: Option<f64>) -> Option<f64> {
    size.map(|size| 2.0 * size).filter(|size| *size < WHOLE)
}

/// Returns whether a level of `triangles` is worth drawing in place of `finer` triangles: it must have at most half.
pub fn is_worth(triangles: usize, finer: usize) -> bool {
    2 * triangles <= finer
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
    use crate::foliage::{Attributes, Foliage};

    /// Two square leaves with this side at the ends of a line from −1 to 1. R is half the diagonal of their box.
    fn two_leaves(side: f64) -> Foliage {
        let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y * side, z * side);
        let leaf = |x: f64| [corner(x, -0.5, -0.5), corner(x, 0.5, -0.5), corner(x, 0.5, 0.5), corner(x, -0.5, 0.5)];
        let positions = [leaf(-1.0), leaf(1.0)].concat();
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
    }

    #[test]
    fn billboards_have_room_for_large_leaves() {
        for side in [0.01, 0.1, 0.5] {
            let foliage = two_leaves(side);
            let radius = side * 0.5f64.sqrt() / foliage.frame().radius;
            let expected = (2.0 * radius).max(0.2);
            let found = limit(&FitSettings::default(), &foliage).unwrap();
            assert!((found - expected).abs() < 1e-12, "side {side}: {found}, {expected} expected");
        }
    }

    #[test]
    fn limits_grow_to_the_whole_crown() {
        let limits: Vec<f64> = std::iter::successors(Some(0.2), |size| larger(Some(*size))).collect();
        assert_eq!(limits, [0.2, 0.4, 0.8, 1.6]);
        assert!(is_worth(300, 600) && !is_worth(301, 600));
    }

    #[test]
    fn a_limit_that_is_set_is_kept_and_at_least_epsilon() {
        let foliage = two_leaves(0.1);
        let set = |max_size, epsilon| limit(&FitSettings { epsilon, max_size, ..FitSettings::default() }, &foliage);
        assert_eq!(set(Some(0.1), 0.04), Some(0.1));
        assert_eq!(set(Some(0.1), 0.25), Some(0.25));
        assert_eq!(set(None, 0.25), Some(0.25));
    }

    #[test]
    fn a_number_of_billboards_and_the_published_methods_have_no_default() {
        let foliage = two_leaves(0.1);
        let plain = FitSettings::default();
        let settings = [
            FitSettings { max_billboards: Some(9), ..plain.clone() },
            FitSettings { effort: Effort::Literal, ..plain.clone() },
            FitSettings { method: Method::Density, ..plain },
        ];
        assert!(settings.iter().all(|settings| limit(settings, &foliage).is_none()));
    }
}
