//! Leaves that the crown hides from all sides. In dense crowns they are a third of what a level would draw, and nobody misses them.
//!
//! A leaf is hidden if less than a small share of it is seen from [`VIEWS`] directions around the crown ([`visibility`]). Between the
//! directions a little more may be seen of it, so the share is that of the mean. O(pixels + triangles) for each direction.

use glam::DVec3;

use crate::error::Result;
use crate::foliage::{Foliage, Opacity};
use crate::metrics::visibility;
use crate::progress::Progress;
use crate::prune::{Kept, Pruned};

/// Directions from which leaves are looked at.
const VIEWS: usize = 16;

/// Returns the leaves of which at least a `share` is seen from outside, and protected leaves; `None` if these are all leaves.
///
/// # Errors
/// The errors of [`visibility`].
pub fn without_hidden(foliage: &Foliage, share: f64, up: DVec3, progress: Progress) -> Result<Option<Pruned>> {
    if share == 0.0 {
        return Ok(None);
    }
    let seen = visibility(foliage, &Opacity::of(foliage), up, VIEWS, progress)?;
    let mut stays: Vec<bool> = seen.iter().map(|seen| *seen >= share).collect();
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
