//! Which branches are thin enough to be shown by clouds.
//!
//! A trunk of a few hundred triangles has no twigs, and the mean color of the tree is wrong (a birch: by 0.02). Most triangles of a trunk are in
//! branches that are at most two pixels wide at the size where a cloud takes over. There a cloud shows them as well as it shows leaves.
//!
//! The parts of a trunk are its connected components. The width of a part is that of a tube of its area and length, `area / (π · length)`. Known
//! limit: branches that are one mesh with the stem stay with it. O(triangles).

use std::f64::consts::PI;

use glam::DVec3;
use leafcloud::Foliage;
use leafcloud::error::Result;
use leafcloud::lod::CloudStep;

/// Width of a branch in pixels, where the cloud takes over, up to which the cloud shows it.
const WIDTH: f64 = 2.0;

/// Diameter of the crown in pixels below which no further branches count as thin: a stem is no twig.
pub const LEAST_CROWN: f64 = 40.0;

/// Length of the pieces that branches are cut into, in R: each lies on a plane of its own, as leaves do. Whole branches would need large billboards.
const PIECE: f64 = 0.1;

/// Twigs for clouds.
#[derive(Clone, Debug, Default)]
pub struct Twigs {
    /// For each cloud those that it shows and the cloud before does not.
    pub foliage: Vec<Option<Foliage>>,
    /// Their triangles of the trunk.
    pub triangles: Vec<Vec<u32>>,
}

impl Twigs {
    /// Returns the twigs of a trunk for each cloud: branches within the leaves' frame that are at most [`WIDTH`] pixels wide where it takes over.
    ///
    /// # Errors
    /// Those of [`Foliage::part`].
    pub fn of(trunk: &Foliage, leaves: &Foliage, steps: &[CloudStep]) -> Result<Self> {
        let mut twigs = Self::default();
        let mut before = 0.0;
        for step in steps {
            let widest = 2.0 * WIDTH / step.crown_pixels.max(LEAST_CROWN);
            let found = thin(trunk, leaves, before, widest);
            let foliage = wood(Some(trunk), &found)?.map(|branches| pieces(&branches.double_sided(), leaves));
            twigs.foliage.push(foliage);
            twigs.triangles.push(found);
            before = widest;
        }
        Ok(twigs)
    }
}

/// Returns the triangles of all branches that a cloud may show.
#[must_use]
pub fn thin_branches(trunk: &Foliage, leaves: &Foliage) -> Vec<u32> {
    thin(trunk, leaves, 0.0, 2.0 * WIDTH / LEAST_CROWN)
}

/// Returns some triangles of the trunk, without those that have no area; `None` without any.
///
/// # Errors
/// Those of [`Foliage::part`].
pub fn wood(trunk: Option<&Foliage>, triangles: &[u32]) -> Result<Option<Foliage>> {
    let Some(trunk) = trunk else { return Ok(None) };
    let has_area = |&t: &u32| trunk.area_vector(t as usize).length() > 0.0;
    let triangles: Vec<u32> = triangles.iter().copied().filter(has_area).collect();
    if triangles.is_empty() {
        return Ok(None);
    }
    let corners: Vec<_> = triangles.iter().map(|&t| trunk.corners(t as usize)).collect();
    trunk.part(&triangles, &corners).map(Some)
}

/// Returns the triangles of the branches that are wider than `narrowest` and at most `widest`, in R of the leaves.
fn thin(trunk: &Foliage, leaves: &Foliage, narrowest: f64, widest: f64) -> Vec<u32> {
    let parts = trunk.leaves();
    let is_thin = |part: &&[u32]| {
        let width = width(trunk, leaves, part);
        width > narrowest && width <= widest
    };
    parts.iter().filter(is_thin).flatten().copied().collect()
}

/// Returns the width of a part in R of the leaves; infinite if it reaches out of their frame.
fn width(trunk: &Foliage, leaves: &Foliage, part: &[u32]) -> f64 {
    let (mut low, mut high, mut area) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
    for &triangle in part {
        let [a, b, c] = in_leaves(trunk, leaves, triangle);
        if [a, b, c].iter().any(|p| p.length() > 1.0) {
            return f64::INFINITY;
        }
        (low, high) = (low.min(a).min(b).min(c), high.max(a).max(b).max(c));
        area += 0.5 * (b - a).cross(c - a).length();
    }
    area / (PI * (high - low).length()).max(f64::MIN_POSITIVE)
}

fn in_leaves(trunk: &Foliage, leaves: &Foliage, triangle: u32) -> [DVec3; 3] {
    trunk.corners(triangle as usize).map(|p| leaves.frame().to_local(trunk.frame().to_caller(p)))
}

/// Returns branches that are cut into pieces across their longest sides.
fn pieces(branches: &Foliage, leaves: &Foliage) -> Foliage {
    let mut numbers = vec![0i64; branches.triangle_count()];
    let mut next = 0;
    for branch in branches.leaves().iter() {
        let middle = |t: u32| in_leaves(branches, leaves, t).into_iter().sum::<DVec3>() / 3.0;
        let bounds = |(low, high): (DVec3, DVec3), &t: &u32| (low.min(middle(t)), high.max(middle(t)));
        let (low, high) = branch.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), bounds);
        let axis = (high - low).max_position();
        for &t in branch {
            numbers[t as usize] = next + ((middle(t)[axis] - low[axis]) / PIECE) as i64;
        }
        next += ((high - low)[axis] / PIECE) as i64 + 1;
    }
    branches.with_leaves(&numbers)
}

#[cfg(test)]
mod tests {
    use leafcloud::Attributes;

    use super::*;

    /// Upright strips of these widths and heights on the ground, side by side.
    fn strips(sizes: &[(f64, f64)]) -> Foliage {
        let corner = |i: usize, (width, height): (f64, f64)| {
            let x = 0.07 * i as f64;
            [(x, 0.0), (x + width, 0.0), (x + width, height), (x, height)].map(|(x, z)| DVec3::new(x, 0.0, z))
        };
        let positions: Vec<DVec3> = sizes.iter().enumerate().flat_map(|(i, &size)| corner(i, size)).collect();
        let faces =
            (0..sizes.len() as u32).flat_map(|i| [[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
        Foliage::new(&positions, faces.collect(), Attributes::default(), vec![]).unwrap()
    }

    /// A square around the origin. Its corners are 1 away from it, so local coordinates are those of the caller.
    fn leaves() -> Foliage {
        let half = 0.5f64.sqrt();
        let corners = [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, 0.0));
        Foliage::new(&corners, vec![[0, 1, 2], [0, 2, 3]], Attributes::default(), vec![]).unwrap()
    }

    fn step(crown_pixels: f64) -> CloudStep {
        CloudStep { epsilon: 0.04, crown_pixels, share: 1.0 }
    }

    #[test]
    fn clouds_show_the_branches_that_are_thin_where_they_take_over() {
        // Widths by hand: a strip of width w has the area of a tube of width w / π, a little less by its diagonal.
        let trunk = strips(&[(0.01, 0.5), (0.05, 0.5), (0.3, 0.5), (0.01, 1.5)]);
        let found = Twigs::of(&trunk, &leaves(), &[step(400.0), step(100.0)]).unwrap();
        assert_eq!(found.triangles, [vec![0, 1], vec![2, 3]], "0.3 is wide, and 1.5 leaves the frame");
    }

    #[test]
    fn branches_are_cut_into_pieces() {
        let found = Twigs::of(&strips(&[(0.01, 0.9), (0.01, 0.05)]), &leaves(), &[step(400.0)]).unwrap();
        // The middles of the first strip's two triangles lie at a third and two thirds of its height: three tenths apart.
        let twigs = found.foliage[0].as_ref().unwrap();
        assert_eq!((twigs.triangle_count(), twigs.leaf_ids()), (4, &[0, 1, 2, 2][..]));
    }

    #[test]
    fn a_trunk_without_thin_branches_has_no_twigs() {
        let found = Twigs::of(&strips(&[(0.3, 0.5)]), &leaves(), &[step(400.0)]).unwrap();
        assert!(found.foliage[0].is_none() && found.triangles[0].is_empty());
    }
}
