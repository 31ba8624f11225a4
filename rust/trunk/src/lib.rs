//! Simplification of trunks and branches within a measured distance.
//!
//! The crate `meshopt` collapses edges in the order of quadric errors (Garland and Heckbert 1997), which include texture coordinates and
//! normals (Hoppe 1999). Its error is a mean over area: a branch that has become thin weighs nothing, and whole branches vanish under a
//! bound that their error exceeds forty times. So every connected part is simplified separately, and the result is measured against the
//! input in both directions ([`distance`]). While the bound is exceeded, the part is simplified again with the missed vertices locked
//! ([`part`]).
//!
//! Corners of the result are corners of the input: positions, texture coordinates, normals, colors and materials are not recomputed.
//!
//! Known limit: distances ignore thickness. A branch thinner than the bound may become a flat strip.

mod distance;
mod part;
mod vertices;

use leafcloud::{Error, Foliage, Progress, Result, error::number};
use rayon::prelude::*;

/// A simplified trunk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simplified {
    /// (n) triangles, each as three corners of the input: corner c is corner c mod 3 of triangle c / 3. The triangles of a part (connected
    /// component) are contiguous; parts are in the order of the input.
    pub corners: Vec<[u32; 3]>,
    /// Greatest distance of a sample of the input from the result or the reverse, caller's units. A removed part counts with the radius of
    /// its bounding sphere.
    pub error: f64,
}

/// Returns `trunk` with the fewest triangles found within `error`, a length in the caller's units. Its parts are the leaves of the foliage
/// (`Foliage::leaf_ids`).
///
/// Parts that fit into a sphere of the radius `error` are removed. The result does not depend on the number of threads; `meshopt`, which is
/// C++, may round differently on another kind of processor.
///
/// # Errors
/// An `error` that is not above 0 and finite; [`Error::Cancelled`], checked before every part.
pub fn simplify(trunk: &Foliage, error: f64, progress: Progress) -> Result<Simplified> {
    if !(error > 0.0 && error.is_finite()) {
        return Err(Error::invalid(format!(
            "error is {}; it must be a length above 0, in the units of the positions",
            number(error)
        )));
    }
    let radius = trunk.frame().radius;
    let parts = trunk.leaves();
    let numbers: Vec<usize> = (0..parts.len()).collect();
    let simplify = |&number: &usize| {
        progress.tell("simplify", 0.0)?;
        Ok(part::simplify(trunk, parts.get(number), error / radius))
    };
    let simplified = numbers.par_iter().map(simplify).collect::<Result<Vec<Simplified>>>()?;
    Ok(Simplified {
        error: simplified.iter().map(|part| part.error).fold(0.0, f64::max) * radius,
        corners: simplified.into_iter().flat_map(|part| part.corners).collect(),
    })
}
