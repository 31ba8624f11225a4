//! Exact arithmetic: every f64 is a fraction with a power of two as its denominator, so fractions give sums, products and comparisons
//! without rounding.

use glam::DVec3;
use num_rational::BigRational;
use num_traits::{ToPrimitive, Zero};

/// Returns the exact value of a float.
pub fn exact(x: f64) -> BigRational {
    BigRational::from_float(x).unwrap_or_else(|| panic!("{x} is not finite"))
}

/// Returns the exact dot product.
pub fn dot(a: DVec3, b: DVec3) -> BigRational {
    a.to_array().into_iter().zip(b.to_array()).map(|(a, b)| exact(a) * exact(b)).fold(BigRational::zero(), |s, p| s + p)
}

/// Returns the exact sum, rounded once.
pub fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    terms.fold(BigRational::zero(), |sum, x| sum + exact(x)).to_f64().expect("a number")
}

/// Returns the distance of two numbers in floats.
pub fn ulps(a: f64, b: f64) -> f64 {
    let place = |x: f64| {
        let bits = x.to_bits() as i64;
        if bits < 0 { i64::MIN.wrapping_sub(bits) } else { bits }
    };
    place(a).abs_diff(place(b)) as f64
}
