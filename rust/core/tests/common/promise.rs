//! The bound ε of every cloud, checked without rounding.

use leafcloud::fit::{FitSettings, Method};
use leafcloud::{Cloud, Foliage};
use num_rational::BigRational;
use num_traits::ToPrimitive;

use super::exact::{dot, exact};

/// Returns the greatest distance of a vertex from its triangle's plane, as a share of ε; the limit is 1. Local frame; the plane's normal is
/// divided by its own exact length. Rounded once, at the end.
///
/// ε is the requested one, except for k-means, which takes no ε: there it is the bound that the cloud reports.
pub fn farthest_share(foliage: &Foliage, cloud: &Cloud, settings: &FitSettings) -> f64 {
    let bound = match settings.method {
        Method::KMeans => exact(cloud.bound) / exact(foliage.frame().radius),
        _ => exact(settings.epsilon),
    };
    let square = |t: usize| -> BigRational {
        let plane = cloud.planes[cloud.parents[t] as usize];
        let heights = foliage.corners(t).map(|p| dot(plane.normal, p) - exact(plane.distance));
        let farthest = heights.into_iter().map(|h| &h * &h).max().expect("three corners");
        farthest / dot(plane.normal, plane.normal)
    };
    let greatest = (0..foliage.triangle_count()).map(square).max().expect("a triangle");
    (greatest / (&bound * &bound)).to_f64().expect("a number").sqrt()
}
