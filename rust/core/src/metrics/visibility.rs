//! Visible part of each leaf from outside: the crown hides its inner leaves.

use glam::DVec3;

use super::{Views, render};
use crate::error::Result;
use crate::foliage::{Foliage, Opacity};
use crate::progress::Progress;
use crate::textures::Samples;

/// Width and height of the images, in pixels: from 16 directions, some hundred samples of a leaf among ten thousand.
const SIZE: usize = 128;

/// Samples of a leaf, summed over all directions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LeafSamples {
    /// Samples that see the leaf.
    pub seen: f64,
    /// Samples of its opaque area as it faces the eye.
    pub facing: f64,
}

impl LeafSamples {
    /// Returns the visible share of the leaf, in [0, 1].
    #[must_use]
    pub fn share(&self) -> f64 {
        if self.facing > 0.0 { (self.seen / self.facing).min(1.0) } else { 0.0 }
    }
}

/// Counts the samples of each leaf from `count` directions all around; an empty list for a count of 0. Counts are the same on any machine.
///
/// # Errors
/// An `up` without a finite length above 0; [`crate::Error::Cancelled`].
pub fn visibility(
    foliage: &Foliage,
    opacity: &Opacity,
    up: DVec3,
    count: usize,
    progress: Progress,
) -> Result<Vec<LeafSamples>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let views = Views { count, size: SIZE, samples: Samples::default(), up, turn: 0.25 };
    let mut leaves = vec![LeafSamples::default(); foliage.leaf_count()];
    for (number, view) in views.around(foliage.frame()).enumerate() {
        progress.tell("measure", number as f64 / count as f64)?;
        let samples = render::seen_samples(foliage, &view)?;
        let side = (view.size * view.samples.side()) as f64;
        let per_area = (side * foliage.frame().radius / (2.0 * view.radius)).powi(2);
        for (triangle, (&leaf, &count)) in foliage.leaf_ids().iter().zip(&samples).enumerate() {
            let leaf = &mut leaves[leaf as usize];
            leaf.seen += f64::from(count);
            leaf.facing += foliage.area_vector(triangle).dot(view.direction).abs()
                * per_area
                * f64::from(opacity.get(triangle).share);
        }
    }
    Ok(leaves)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;

    /// Squares given as center, perpendicular axis and side; each is a leaf.
    fn squares(places: &[(DVec3, usize, f64)]) -> Foliage {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let corners = |&(place, across, side): &(DVec3, usize, f64)| {
            let (u, v) = (axes[(across + 1) % 3] * side / 2.0, axes[(across + 2) % 3] * side / 2.0);
            [place - u - v, place + u - v, place + u + v, place - u + v]
        };
        let positions: Vec<DVec3> = places.iter().flat_map(corners).collect();
        let triangles = (0..places.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k)));
        let leaf_ids = (0..2 * places.len() as i64).map(|triangle| triangle / 2).collect();
        Foliage::new(&positions, triangles.collect(), Attributes { leaf_ids, ..Attributes::default() }, vec![]).unwrap()
    }

    fn shares(places: &[(DVec3, usize, f64)]) -> Vec<f64> {
        let leaves = visibility(&squares(places), &Opacity::ignored(), DVec3::Z, 16, Progress::silent()).unwrap();
        leaves.iter().map(LeafSamples::share).collect()
    }

    #[test]
    fn a_leaf_alone_is_seen_whole_from_everywhere() {
        for across in 0..3 {
            let seen = shares(&[(DVec3::new(3.0, -5.0, 1.0), across, 0.7)]);
            assert!((seen[0] - 1.0).abs() < 0.01, "{seen:?}");
        }
    }

    #[test]
    fn what_is_in_a_box_is_not_seen_and_hides_nothing() {
        let sides = (0..6).map(|i| {
            let axis = [DVec3::X, DVec3::Y, DVec3::Z][i % 3];
            (if i < 3 { axis } else { -axis }, i % 3, 2.0)
        });
        let mut places: Vec<_> = sides.collect();
        let outside = shares(&places);
        places.push((DVec3::ZERO, 0, 0.5));
        let seen = shares(&places);
        assert_eq!(seen[6], 0.0);
        assert_eq!(seen[..6], outside);
        // One of two opposite sides is visible from anywhere.
        for (front, back) in [(0, 3), (1, 4), (2, 5)] {
            assert!((seen[front] + seen[back] - 1.0).abs() < 0.03, "{seen:?}");
        }
    }
}
