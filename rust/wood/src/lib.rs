//! Trunks and branches with fewer triangles, within a distance that is measured.
//!
//! The crate `meshopt` collapses edges in the order of quadric errors (Garland and Heckbert 1997), with texture coordinates and normals
//! among them (Hoppe 1999). Its error is a mean over area: a branch that has grown thin weighs nothing, and whole ones vanish under a
//! bound that they exceed forty times. So every connected part is simplified by itself, what came out is measured against what went
//! in, both ways ([`distance`]), and the part is done again, with the places kept that were missed, until the bound holds ([`part`]).
//!
//! Corners of the result are corners of the input: positions, texture coordinates, normals, colours and materials are not computed anew.
//!
//! Known limitation: distances know nothing of thickness. A branch thinner than the bound may become a flat strip.

mod distance;
mod part;
mod vertices;

use leafcloud::{Error, Foliage, Progress, Result, error::number};
use rayon::prelude::*;

/// What is left of the wood.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simplified {
    /// (n) triangles, each by three corners of the input: corner c is corner c mod 3 of triangle c / 3. Those of one part (connected
    /// component) stand together, parts in the order of the input.
    pub corners: Vec<[u32; 3]>,
    /// No sample of the input lies farther from the result, nor the other way round, caller's units. A part of which nothing is left
    /// counts with the radius of its bounding sphere.
    pub error: f64,
}

/// `wood` with as few triangles as were found within `error`, a length in the caller's units; its parts are its leaves (`Foliage::leaf_ids`).
///
/// Parts that fit into a sphere of the radius `error` are left out. The same on any number of threads; on another kind of processor
/// `meshopt`, which is C++, may round otherwise.
///
/// # Errors
/// An `error` that is not above 0 and finite; [`Error::Cancelled`], asked before every part.
pub fn simplify(wood: &Foliage, error: f64, progress: Progress) -> Result<Simplified> {
    if !(error > 0.0 && error.is_finite()) {
        return Err(Error::invalid(format!(
            "error is {}; it must be a length above 0, in the units of the positions",
            number(error)
        )));
    }
    let radius = wood.frame().radius;
    let parts = wood.leaves();
    let numbers: Vec<usize> = (0..parts.len()).collect();
    let simplify = |&number: &usize| {
        progress.tell("simplify", 0.0)?;
        Ok(part::simplify(wood, parts.get(number), error / radius))
    };
    let simplified = numbers.par_iter().map(simplify).collect::<Result<Vec<Simplified>>>()?;
    Ok(Simplified {
        error: simplified.iter().map(|part| part.error).fold(0.0, f64::max) * radius,
        corners: simplified.into_iter().flat_map(|part| part.corners).collect(),
    })
}
