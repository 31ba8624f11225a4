//! Leaves that the crown hides from all sides. Of the pine they are an eighth, and nobody misses them on a level.
//!
//! A leaf is hidden if less than a small share of it is seen, in the mean over [`VIEWS`] directions around the crown ([`visibility`]). Leaves
//! with too few samples to tell are not hidden. O(pixels + triangles) for each direction.

use glam::DVec3;

use crate::error::Result;
use crate::foliage::{Foliage, Opacity};
use crate::metrics::{LeafSamples, visibility};
use crate::progress::Progress;
use crate::prune::{Kept, Pruned};

/// Directions from which leaves are looked at.
const VIEWS: usize = 16;

/// Least number of samples that a leaf with just the least visible share has in the mean.
const SAMPLES: f64 = 2.0;

/// Returns the leaves with a visible share of at least `share`, and protected leaves; `None` if these are all leaves.
///
/// # Errors
/// The errors of [`visibility`].
pub fn without_hidden(foliage: &Foliage, share: f64, up: DVec3, progress: Progress) -> Result<Option<Pruned>> {
    if share == 0.0 {
        return Ok(None);
    }
    let leaves = visibility(foliage, &Opacity::of(foliage), up, VIEWS, progress)?;
    let is_hidden = |leaf: &LeafSamples| leaf.share() < share && leaf.facing * share >= SAMPLES;
    let mut stays: Vec<bool> = leaves.iter().map(|leaf| !is_hidden(leaf)).collect();
    for (&leaf, &protected) in foliage.leaf_ids().iter().zip(&foliage.attributes().protected) {
        stays[leaf as usize] |= protected;
    }
    let leaf = |triangle: u32| foliage.leaf_ids()[triangle as usize] as usize;
    let triangles: Vec<u32> = (0..foliage.triangle_count() as u32).filter(|&t| stays[leaf(t)]).collect();
    if triangles.is_empty() || triangles.len() == foliage.triangle_count() {
        return Ok(None);
    }
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(|&t| foliage.corners(t as usize)).collect();
    let growth = vec![1.0; triangles.len()];
    Ok(Some(Pruned { foliage: foliage.part(&triangles, &corners)?, kept: Kept { triangles, growth } }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;

    /// A closed cube of side 2 with a small square in the middle; each side and the square are leaves of two triangles.
    fn boxed(protected: bool) -> Foliage {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let square = |center: DVec3, i: usize, half: f64| {
            let (u, v) = (axes[(i + 1) % 3] * half, axes[(i + 2) % 3] * half);
            [center - u - v, center + u - v, center + u + v, center - u + v]
        };
        let sides = (0..6).map(|i| square(if i < 3 { axes[i] } else { -axes[i - 3] }, i % 3, 1.0));
        let positions: Vec<DVec3> = sides.chain([square(DVec3::ZERO, 2, 0.3)]).flatten().collect();
        let triangles = (0..7u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k))).collect();
        let leaf_ids = (0..14).map(|triangle| triangle / 2).collect();
        let protected = if protected { (0..14).map(|triangle| triangle > 11).collect() } else { Vec::new() };
        let attributes = Attributes { leaf_ids, protected, ..Attributes::default() };
        Foliage::new(&positions, triangles, attributes, vec![]).unwrap()
    }

    fn found(foliage: &Foliage, share: f64) -> Option<Pruned> {
        without_hidden(foliage, share, DVec3::Z, Progress::silent()).unwrap()
    }

    #[test]
    fn what_is_in_a_box_is_left_out_unchanged_in_size() {
        let Pruned { foliage, kept } = found(&boxed(false), 0.02).expect("a hidden leaf");
        assert_eq!(kept.triangles, (0..12).collect::<Vec<_>>());
        assert_eq!(kept.growth, [1.0; 12]);
        assert_eq!((foliage.triangle_count(), foliage.leaf_count()), (12, 6));
    }

    #[test]
    fn protected_leaves_and_a_share_of_nothing_keep_all() {
        assert!(found(&boxed(true), 0.02).is_none());
        assert!(found(&boxed(false), 0.0).is_none());
    }
}
