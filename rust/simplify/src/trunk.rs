//! Simplification of trunks and branches by their pictures.
//!
//! A level's trunk is seen from afar and through its leaves. So its error is measured in pictures: all round the tree, at the distance
//! where the level appears, with the level's leaves in front ([`picture`]). Every connected part is simplified to fewer and fewer triangles
//! ([`part`]), each step is measured, and the steps that change the least of the pictures for each saved triangle are taken ([`choice`]).
//!
//! Corners of the result are corners of the input: positions, texture coordinates, normals, colors and materials are not recomputed.

use glam::DVec3;
use leafcloud::{Error, Foliage, Progress, Result, error::number};
use rayon::prelude::*;

use crate::choice::{Ladder, choose};
use crate::part::{self, Part};
use crate::picture;

/// How a trunk is seen.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// The leaves that hide parts of the trunk; `None` without leaves.
    pub leaves: Option<&'a Foliage>,
    /// Side of a pixel on the tree, caller's units.
    pub pixel: f64,
    /// Up direction; any length above 0.
    pub up: DVec3,
}

/// A simplified trunk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simplified {
    /// (n) triangles, each as three corners of the input: corner c is corner c mod 3 of triangle c / 3. The triangles of a part (connected
    /// component) are contiguous; parts are in the order of the input.
    pub corners: Vec<[u32; 3]>,
    /// Area of the pictures that changes, as a share of the area that shows leaves or trunk; the sum over the parts, each measured while all
    /// parts have about the same share of their triangles.
    pub change: f64,
}

/// Returns `trunk` with the fewest triangles found that change its pictures by at most `change`, a share in [0, 1]; with at most `most`
/// triangles even if the pictures change more. Its parts are the leaves of the foliage (`Foliage::leaf_ids`).
///
/// The result does not depend on the number of threads; `meshopt`, which is C++, may round differently on another kind of processor.
///
/// # Errors
/// A `pixel` that is not above 0 and finite; a `change` outside [0, 1]; leaves 10⁶ times as large as the trunk;
/// [`Error::Cancelled`], checked before every part and every view.
pub fn simplify(trunk: &Foliage, sight: Sight, change: f64, most: usize, progress: Progress) -> Result<Simplified> {
    check(sight.pixel, change)?;
    let parts = trunk.leaves();
    let numbers: Vec<usize> = (0..parts.len()).collect();
    let steps = |&number: &usize| {
        progress.tell("simplify", 0.0)?;
        Ok(part::steps(trunk, parts.get(number), most))
    };
    let steps: Vec<Vec<Part>> = numbers.par_iter().map(steps).collect::<Result<_>>()?;
    let most_steps = steps.iter().map(Vec::len).max().unwrap_or(0);
    let at =
        |step: usize| -> Vec<&[[u32; 3]]> { steps.iter().map(|of| of[step.min(of.len() - 1)].as_slice()).collect() };
    let trunks: Vec<_> = (1..most_steps).map(at).collect();
    let changes = picture::changes(trunk, &trunks, sight, progress)?;
    let ladder = |part: usize| {
        let changed = [0].into_iter().chain(changes.of_parts.iter().map(|of_part| of_part[part]));
        let points = steps[part].iter().map(Vec::len).zip(changed);
        Ladder::new(points.chain([(0, changes.seen[part])]))
    };
    let ladders: Vec<Ladder> = (0..parts.len()).map(ladder).collect();
    let choice = choose(&ladders, (change * changes.area as f64) as u64, most);
    let chosen = |(steps, &step): (&Vec<Part>, &usize)| steps.get(step).cloned().unwrap_or_default();
    Ok(Simplified {
        corners: steps.iter().zip(&choice.steps).flat_map(chosen).collect(),
        change: choice.change as f64 / (changes.area as f64).max(1.0),
    })
}

fn check(pixel: f64, change: f64) -> Result<()> {
    if !(pixel > 0.0 && pixel.is_finite()) {
        let pixel = number(pixel);
        return Err(Error::invalid(format!(
            "pixel is {pixel}; it must be a length above 0, in the units of the positions"
        )));
    }
    if !(0.0..=1.0).contains(&change) {
        return Err(Error::invalid(format!("change is {}; it must be a share between 0 and 1", number(change))));
    }
    Ok(())
}
