//! Exact arithmetic: every f64 is a fraction with a power of two below it, so sums, products and comparisons of fractions have no rounding.

use glam::DVec3;
use leafcloud::{Cloud, Foliage};
use num_rational::BigRational;
use num_traits::{ToPrimitive, Zero};

/// The number that the float stands for.
pub fn exact(x: f64) -> BigRational {
    BigRational::from_float(x).unwrap_or_else(|| panic!("{x} is not finite"))
}

fn dot(a: DVec3, b: DVec3) -> BigRational {
    a.to_array().into_iter().zip(b.to_array()).map(|(a, b)| exact(a) * exact(b)).fold(BigRational::zero(), |s, p| s + p)
}

/// The greatest distance of a vertex from its triangle's plane, as a share of the cloud's bound: at most 1 is promised. Local frame; the
/// plane's normal is divided by its own exact length. Rounded once, at the end.
pub fn farthest_share(foliage: &Foliage, cloud: &Cloud) -> f64 {
    let bound = exact(cloud.bound) / exact(foliage.frame().radius);
    let square = |t: usize| -> BigRational {
        let plane = cloud.planes[cloud.parents[t] as usize];
        let heights = foliage.corners(t).map(|p| dot(plane.normal, p) - exact(plane.distance));
        let farthest = heights.into_iter().map(|h| &h * &h).max().expect("three corners");
        farthest / dot(plane.normal, plane.normal)
    };
    let greatest = (0..foliage.triangle_count()).map(square).max().expect("a triangle");
    (greatest / (&bound * &bound)).to_f64().expect("a number").sqrt()
}

/// The exact sum, rounded once.
pub fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    terms.fold(BigRational::zero(), |sum, x| sum + exact(x)).to_f64().expect("a number")
}

/// How many floats lie between two numbers.
pub fn ulps(a: f64, b: f64) -> f64 {
    let place = |x: f64| {
        let bits = x.to_bits() as i64;
        if bits < 0 { i64::MIN.wrapping_sub(bits) } else { bits }
    };
    place(a).abs_diff(place(b)) as f64
}
