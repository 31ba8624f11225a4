//! The pruning order of leaves.

use glam::DVec3;

use crate::foliage::Foliage;
use crate::random::Stream;

/// The rank of leaves that are never pruned.
pub const PROTECTED: f32 = -1.0;

/// Returns each leaf's rank in the pruning order, in [0, 1): a weighted random order (Efraimidis and Spirakis 2006: keys u^(1/w), greatest
/// first) with w = ½ + (r + v)/2. r is the leaf's distance from the crown's center, in crown radii: leaves at the rim stay longer than
/// leaves in the middle, which others hide. v is half the leaf's `visibility` over the mean visibility, at most 1; visibility is any
/// measure ≥ 0 of its visible part. v = r if nothing was measured (an empty slice). Protected leaves have the rank [`PROTECTED`] and take
/// no place among the others.
#[must_use]
pub fn order(foliage: &Foliage, visibility: &[f64], seed: u64) -> Vec<f32> {
    let leaves = foliage.leaves();
    let twice_mean = 2.0 * visibility.iter().sum::<f64>() / visibility.len() as f64;
    let seen = |leaf: usize| visibility.get(leaf).filter(|_| twice_mean > 0.0).map(|seen| (seen / twice_mean).min(1.0));
    let key = |leaf: usize| {
        let triangles = leaves.get(leaf);
        let sum: DVec3 = triangles.iter().flat_map(|&t| foliage.corners(t as usize)).sum();
        let from_centre = (sum / (3.0 * triangles.len() as f64)).length();
        let weight = 0.5 + 0.5 * (from_centre + seen(leaf).unwrap_or(from_centre));
        let uniform = Stream::new(seed, 0, leaf).signed() * 0.5 + 0.5;
        libm::log(uniform.max(f64::MIN_POSITIVE)) / weight
    };
    let protected = &foliage.attributes().protected;
    let is_free = |leaf: &usize| protected.is_empty() || !leaves.get(*leaf).iter().any(|&t| protected[t as usize]);
    let mut keyed: Vec<(f64, usize)> = (0..leaves.len()).filter(is_free).map(|leaf| (key(leaf), leaf)).collect();
    keyed.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut ranks = vec![PROTECTED; leaves.len()];
    for (place, (_, leaf)) in keyed.iter().enumerate() {
        ranks[*leaf] = rank(place, keyed.len());
    }
    ranks
}

/// Returns place / count as f32, kept below 1 if rounding would reach it.
fn rank(place: usize, count: usize) -> f32 {
    const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
    ((place as f64 / count as f64) as f32).min(BELOW_ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;

    #[test]
    fn the_order_is_a_permutation_that_keeps_the_rim() {
        let place = |i: u32| DVec3::new(f64::from(i % 20), f64::from(i / 20 % 20), f64::from(i / 400));
        let positions: Vec<DVec3> =
            (0..4000).flat_map(|i| [DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1].map(|o| place(i) + o)).collect();
        let triangles = (0..4000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let foliage = Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap();
        let ranks = order(&foliage, &[], 7);
        let mut sorted = ranks.clone();
        sorted.sort_by(f32::total_cmp);
        assert!(sorted.iter().enumerate().all(|(i, &r)| r == (i as f64 / 4000.0) as f32));
        let mean = |inner: bool| {
            let chosen: Vec<f64> = (0..4000)
                .filter(|&t| (foliage.corners(t)[0].length() < 0.5) == inner)
                .map(|t| f64::from(ranks[t]))
                .collect();
            chosen.iter().sum::<f64>() / chosen.len() as f64
        };
        assert!(mean(false) < mean(true) - 0.02);
        assert_eq!(rank(9_999_999, 10_000_000).max(0.99), rank(9_999_999, 10_000_000));
        assert!(rank(199_999_999, 200_000_000) < 1.0);
    }
    #[test]
    fn at_equal_distance_visible_leaves_stay_longer() {
        let place = |i: u32| DVec3::new(libm::cos(f64::from(i)), libm::sin(f64::from(i)), 0.0);
        let positions: Vec<DVec3> =
            (0..4000).flat_map(|i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|o| place(i) + 1e-4 * o)).collect();
        let triangles = (0..4000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let foliage = Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap();
        let visibility: Vec<f64> = (0..4000).map(|leaf| if leaf < 2000 { 0.3 } else { 0.0 }).collect();
        let ranks = order(&foliage, &visibility, 7);
        let mean = |leaves: std::ops::Range<usize>| ranks[leaves].iter().sum::<f32>() / 2000.0;
        // With weights 3/2 and 1, the first leaf precedes the second in three of five cases: the means are (½ + ⅖)/2 and (½ + ⅗)/2.
        assert!((mean(0..2000) - 0.45).abs() < 0.02);
        assert!((mean(2000..4000) - 0.55).abs() < 0.02);
        assert_eq!(
            order(&foliage, &vec![0.0; 4000], 7),
            order(&foliage, &[], 7),
            "visibility of 0 everywhere has no effect"
        );
    }
}
