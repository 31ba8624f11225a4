//! Leaves with fewer triangles, one by one, within a bound.
//!
//! A leaf bends and has lobes, which nobody sees when it is a few pixels long. Its edges collapse as long as it stays within the bound
//! ([`Collapse`]). A leaf without its lobes is smaller, so it grows about its pivot until it has the area that it had. Each corner of the input
//! moves to the nearest point of its simplified leaf, as far as that has grown: the target of a morph.
//!
//! O(t log t) for a leaf of t triangles. A known limit: only corners of the input and middles of new edges are checked.

use glam::DVec3;
use leafcloud::foliage::area_vector;
use leafcloud::{Foliage, Progress, Result};
use rayon::prelude::*;

use crate::collapse::Collapse;
use crate::nearest::Triangles;
use crate::part::Part;

/// Leaves with fewer triangles. Corner c of the input is corner c mod 3 of triangle c / 3.
#[derive(Clone, Debug)]
pub struct SimplifiedLeaves {
    /// The simplified leaves, with the numbers of the input's leaves (`Foliage::leaf_ids`).
    pub foliage: Foliage,
    /// (s) triangles, each as three corners of the input. Triangles of a leaf are contiguous; leaves are in the order of the input.
    pub corners: Vec<[u32; 3]>,
    /// (s) positions of these corners, local frame of the input.
    pub places: Vec<[DVec3; 3]>,
    /// (t) for each triangle of the input, the points of the simplified leaf to which its corners move; local frame of the input.
    pub targets: Vec<[DVec3; 3]>,
    /// Greatest distance of a corner from its target, local units of the input.
    pub deviation: f64,
}

/// Returns the leaves with the fewest triangles found within `bound` of `foliage`, in R, before they grow. No leaf is left out. `None` if no
/// leaf gets simpler.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// [`Error::Cancelled`](leafcloud::Error::Cancelled), checked before every leaf.
pub fn simplified_leaves(foliage: &Foliage, bound: f64, progress: Progress) -> Result<Option<SimplifiedLeaves>> {
    let leaves = foliage.leaves();
    let numbers: Vec<usize> = (0..leaves.len()).collect();
    let simplified = |&number: &usize| {
        progress.tell("simplify", 0.0)?;
        Ok(Leaf::within(foliage, leaves.get(number), bound))
    };
    let simplified: Vec<Leaf> = numbers.par_iter().map(simplified).collect::<Result<_>>()?;
    let corners: Vec<[u32; 3]> = simplified.iter().flat_map(|leaf| &leaf.corners).copied().collect();
    if corners.len() == foliage.triangle_count() {
        return Ok(None);
    }
    let places: Vec<[DVec3; 3]> = simplified.iter().flat_map(|leaf| &leaf.places).copied().collect();
    let mut targets = vec![[DVec3::ZERO; 3]; foliage.triangle_count()];
    for (number, leaf) in simplified.iter().enumerate() {
        for (&triangle, target) in leaves.get(number).iter().zip(&leaf.targets) {
            targets[triangle as usize] = *target;
        }
    }
    Ok(Some(SimplifiedLeaves {
        foliage: foliage.gathered(&corners, &places)?,
        corners,
        places,
        targets,
        deviation: simplified.iter().map(|leaf| leaf.deviation).fold(0.0, f64::max),
    }))
}

/// Greatest growth of a leaf.
const MOST_GROWTH: f64 = 1.5;

struct Leaf {
    corners: Part,
    places: Vec<[DVec3; 3]>,
    /// Targets of each triangle's corners.
    targets: Vec<[DVec3; 3]>,
    deviation: f64,
}

impl Leaf {
    fn within(foliage: &Foliage, triangles: &[u32], bound: f64) -> Self {
        let whole = || triangles.iter().map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let corners: Part = Collapse::new(foliage, triangles, bound).run();
        let is_seen = |t: &[u32; 3]| area_vector(t.map(|corner| foliage.corner(corner))) != DVec3::ZERO;
        let corners = if corners.iter().any(is_seen) { corners } else { whole() };
        let before: Vec<[DVec3; 3]> = triangles.iter().map(|&t| foliage.corners(t as usize)).collect();
        let after: Vec<[DVec3; 3]> = corners.iter().map(|t| t.map(|corner| foliage.corner(corner))).collect();
        let [(_, had), (pivot, has)] = [&before, &after].map(|leaf| centroid(leaf));
        let growth = (had / has).sqrt().clamp(1.0, MOST_GROWTH);
        let grown = |p: DVec3| pivot + (p - pivot) * growth;
        let targets: Vec<[DVec3; 3]> = if after.len() == before.len() {
            before.clone()
        } else {
            let left = Triangles::new(after.clone());
            before.iter().map(|places| places.map(|p| grown(left.nearest(p)))).collect()
        };
        let moves = before.as_flattened().iter().zip(targets.as_flattened());
        Self {
            corners,
            places: after.iter().map(|places| places.map(grown)).collect(),
            deviation: moves.map(|(p, q)| p.distance(*q)).fold(0.0, f64::max),
            targets,
        }
    }
}

/// Returns the area centroid of triangles, or a corner if they have no area, and their area.
fn centroid(triangles: &[[DVec3; 3]]) -> (DVec3, f64) {
    let weighted = |&[a, b, c]: &[DVec3; 3]| ((a + b + c) / 3.0, area_vector([a, b, c]).length());
    let (sum, area) =
        triangles.iter().map(weighted).fold((DVec3::ZERO, 0.0), |(sum, all), (p, area)| (sum + p * area, all + area));
    if area > 0.0 { (sum / area, area) } else { (triangles[0][0], 1.0) }
}
