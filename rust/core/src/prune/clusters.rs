//! Clusters of neighboring leaves, with one leaf that stands for each.
//!
//! Cook's random order leaves gaps: where by chance few leaves stay, the crown gets thin. Clusters keep the density of every part of the crown.
//! They are the cells of a k-d tree. Each cut halves the visible area of the leaves, so hidden leaves get few clusters. In each cluster, the leaf
//! nearest to the middle moves to the middle. It grows until its visible area is that of the whole cluster.
//! O(n log² n).

use glam::DVec3;

use crate::foliage::Foliage;
use crate::transition::leaf_pivots;

/// Number of times that the leaves are halved.
pub const HALVINGS: usize = 6;

/// Weight of a leaf that nobody sees, as a share of the mean weight of the seen part.
const UNSEEN: f64 = 0.25;

/// Greatest growth over the growth that keeps the area, if all leaves of a cluster are equal.
const MOST: f64 = 1.5;

/// A leaf that stands for a cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// The leaf.
    pub leaf: usize,
    /// The place of its pivot: the middle of the cluster, local frame.
    pub place: DVec3,
    /// Its linear growth, at least 1.
    pub growth: f64,
}

/// Sets of leaves that stand for clusters. Those of a coarser set are part of those of each finer one.
#[derive(Clone, Debug, Default)]
pub struct Clusters {
    /// Three quarters of the leaves: the clusters of the half, the widest of them divided into single leaves.
    pub three_quarters: Vec<Cluster>,
    /// A half of the leaves, a quarter and so on.
    pub halved: [Vec<Cluster>; HALVINGS],
}

/// Returns the leaves that stand for clusters.
///
/// `seen`: a measure ≥ 0 of the visible part of each leaf. Protected leaves and leaves
/// without neighbors stand for themselves, with a growth of 1.
#[must_use]
pub fn clusters(foliage: &Foliage, seen: &[f64]) -> Clusters {
    let (leaves, marked) = (foliage.leaves(), &foliage.attributes().protected);
    let is_free = |leaf: &usize| marked.is_empty() || !leaves.get(*leaf).iter().any(|&t| marked[t as usize]);
    let (mut free, protected): (Vec<usize>, Vec<usize>) = (0..leaves.len()).partition(is_free);
    let mean = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
    let unseen = if mean > 0.0 { UNSEEN * mean } else { 1.0 };
    let weights = seen.iter().map(|leaf| leaf + unseen).collect();
    let cells = Cells { pivots: leaf_pivots(foliage), weights };
    let alone = |&leaf: &usize| Cluster { leaf, place: cells.pivots[leaf], growth: 1.0 };
    let halved = std::array::from_fn(|_| protected.iter().map(alone).collect());
    let mut found = Found { halved, pairs: Vec::new() };
    let count = free.len() >> HALVINGS;
    cells.split(&mut free, count.max(1), &mut |cell| {
        cells.join(cell, HALVINGS - 1, &mut found);
    });
    let Found { halved, mut pairs } = found;
    let mut three_quarters: Vec<Cluster> = protected.iter().map(alone).collect();
    // Hidden clusters have many leaves, which would need all the room. Stable: of equal ones the first stay apart.
    pairs.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let mut room = (3 * free.len() / 4).saturating_sub(pairs.len());
    for (_, cluster) in &pairs {
        if cluster.len() <= room + 1 {
            room -= cluster.len() - 1;
            three_quarters.extend(cluster.iter().map(alone));
        } else {
            three_quarters.push(cells.joined(cluster, cluster, 0));
        }
    }
    Clusters { three_quarters, halved }
}

/// The sets of halves, and the leaves of each cluster of the half with the gain of their separation.
struct Found {
    halved: [Vec<Cluster>; HALVINGS],
    pairs: Vec<(f64, Vec<usize>)>,
}

struct Cells {
    pivots: Vec<DVec3>,
    weights: Vec<f64>,
}

impl Cells {
    /// Calls `each` with `parts` cells of about the same weight.
    fn split(&self, leaves: &mut [usize], parts: usize, each: &mut impl FnMut(&mut [usize])) {
        if parts < 2 || leaves.len() < 2 {
            if !leaves.is_empty() {
                each(leaves);
            }
            return;
        }
        let left = parts / 2;
        let (a, b) = self.cut(leaves, left as f64 / parts as f64);
        self.split(a, left, each);
        self.split(b, parts - left, each);
    }

    /// Cuts at least two leaves across the longest axis of their box, with a share of the weight in the first part.
    fn cut<'a>(&self, leaves: &'a mut [usize], share: f64) -> (&'a mut [usize], &'a mut [usize]) {
        let pivots = leaves.iter().map(|&leaf| self.pivots[leaf]);
        let (low, high) = pivots.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let size = (high - low).to_array();
        let axis = (0..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest });
        let along = |leaf: usize| self.pivots[leaf].to_array()[axis];
        leaves.sort_unstable_by(|&a, &b| along(a).total_cmp(&along(b)).then(a.cmp(&b)));
        let wanted = share * self.weight(leaves);
        let (mut sum, mut at) = (0.0, 0);
        while at + 1 < leaves.len() && sum + 0.5 * self.weights[leaves[at]] < wanted {
            sum += self.weights[leaves[at]];
            at += 1;
        }
        leaves.split_at_mut(at.max(1))
    }

    /// Adds the clusters of a cell to the sets up to `number`, one to the coarsest, and returns the leaf of that one.
    fn join(&self, cell: &mut [usize], number: usize, found: &mut Found) -> usize {
        let candidates = match number.checked_sub(1) {
            Some(finer) if cell.len() > 1 => {
                let (a, b) = self.cut(cell, 0.5);
                [a, b].map(|half| self.join(half, finer, found)).to_vec()
            }
            Some(finer) => vec![self.join(cell, finer, found)],
            None => {
                found.pairs.push((self.gain(cell), cell.to_vec()));
                cell.to_vec()
            }
        };
        let cluster = self.joined(cell, &candidates, number);
        found.halved[number].push(cluster);
        cluster.leaf
    }

    /// Returns the cluster of a cell, which the nearest of the candidates stands for.
    fn joined(&self, cell: &[usize], candidates: &[usize], number: usize) -> Cluster {
        let (weight, place) = (self.weight(cell), self.middle(cell));
        let far = |leaf: usize| self.pivots[leaf].distance_squared(place);
        let leaf = candidates.iter().copied().reduce(|a, b| if far(b) < far(a) { b } else { a }).unwrap_or(cell[0]);
        let most = MOST * f64::from(2_u32 << number).sqrt();
        Cluster { leaf, place, growth: (weight / self.weights[leaf]).sqrt().min(most) }
    }

    fn middle(&self, cell: &[usize]) -> DVec3 {
        cell.iter().map(|&leaf| self.weights[leaf] * self.pivots[leaf]).sum::<DVec3>() / self.weight(cell)
    }

    /// Returns what each further leaf of a cell is worth: the sum of the squared distances from the middle, by weight, over their number.
    fn gain(&self, cell: &[usize]) -> f64 {
        let middle = self.middle(cell);
        let apart = |&leaf: &usize| self.weights[leaf] * self.pivots[leaf].distance_squared(middle);
        cell.iter().map(apart).sum::<f64>() / cell.len().saturating_sub(1).max(1) as f64
    }

    fn weight(&self, leaves: &[usize]) -> f64 {
        leaves.iter().map(|&leaf| self.weights[leaf]).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;

    /// Equal leaves of one triangle around the points of a grid, `side` to a row.
    fn grid(side: u32, protected: Vec<bool>) -> Foliage {
        let place = |i: u32| DVec3::new(f64::from(i % side), f64::from(i / side % side), f64::from(i / side / side));
        let arms = [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(0.2, -0.1, 0.0), DVec3::new(-0.1, 0.2, 0.0)];
        let positions: Vec<DVec3> = (0..side.pow(3)).flat_map(|i| arms.map(|arm| place(i) + arm)).collect();
        let triangles = (0..side.pow(3)).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Foliage::new(&positions, triangles, Attributes { protected, ..Attributes::default() }, vec![]).unwrap()
    }

    fn equally(foliage: &Foliage) -> Vec<f64> {
        vec![3.0; foliage.leaf_count()]
    }

    #[test]
    fn equal_leaves_on_a_grid_are_halved_into_neighbors() {
        let foliage = grid(8, Vec::new());
        let Clusters { three_quarters, halved: found } = clusters(&foliage, &equally(&foliage));
        let pivots = leaf_pivots(&foliage);
        assert_eq!(three_quarters.len(), 384);
        let half: Vec<usize> = found[0].iter().map(|cluster| cluster.leaf).collect();
        assert!(half.iter().all(|&leaf| three_quarters.iter().any(|cluster| cluster.leaf == leaf)));
        assert_eq!(three_quarters.iter().filter(|cluster| found[0].contains(cluster)).count(), 128);
        let step = pivots[0].distance(pivots[1]);
        for (number, set) in found.iter().enumerate() {
            let halved = 2_u32 << number;
            assert_eq!(set.len(), 512 >> (number + 1));
            for cluster in set {
                assert!((cluster.growth - f64::from(halved).sqrt()).abs() < 1e-9, "{number}: {}", cluster.growth);
                let moved = pivots[cluster.leaf].distance(cluster.place) / step;
                assert!(moved < 0.6 * f64::from(halved).cbrt(), "{number}: {moved}");
            }
            // What all clusters show lies in the middle, as what the leaves show.
            let middle = set.iter().map(|cluster| cluster.place).sum::<DVec3>() / set.len() as f64;
            let expected = pivots.iter().sum::<DVec3>() / 512.0;
            assert!(middle.distance(expected) < 1e-9, "{number}: {middle}");
        }
        for pair in found.windows(2) {
            let finer: Vec<usize> = pair[0].iter().map(|cluster| cluster.leaf).collect();
            assert!(pair[1].iter().all(|cluster| finer.contains(&cluster.leaf)), "{}", pair[1].len());
        }
    }

    #[test]
    fn pairs_that_are_close_are_joined_first() {
        // Two rows of pairs: in one, the leaves of a pair are half as far apart.
        let pair = |i: usize| DVec3::new(4.0 * (i / 2) as f64, if i < 512 { 0.0 } else { 900.0 }, 0.0);
        let apart = |i: usize| DVec3::X * (i % 2) as f64 * if i < 512 { 0.5 } else { 1.0 };
        let arms = [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(0.2, -0.1, 0.0), DVec3::new(-0.1, 0.2, 0.0)];
        let positions: Vec<DVec3> = (0..1024).flat_map(|i| arms.map(|arm| pair(i) + apart(i) + arm)).collect();
        let triangles = (0..1024).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let foliage = Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap();
        let joined = clusters(&foliage, &equally(&foliage)).three_quarters;
        assert_eq!(joined.iter().filter(|cluster| cluster.leaf < 512).count(), 256);
        assert!(joined.iter().all(|cluster| (cluster.growth > 1.0) == (cluster.leaf < 512)));
    }

    #[test]
    fn hidden_leaves_take_few_clusters() {
        let foliage = grid(8, Vec::new());
        let seen = |leaf| if leaf < 256 { 8.0 } else { 0.0 };
        let Clusters { three_quarters, halved: [half, ..] } =
            clusters(&foliage, &(0..512).map(seen).collect::<Vec<_>>());
        let shown = half.iter().filter(|cluster| cluster.leaf < 256).count();
        assert!(half.len() > 240 && shown > 2 * half.len() / 3, "{shown} of {}", half.len());
        let shown = three_quarters.iter().filter(|cluster| cluster.leaf < 256).count();
        assert!(three_quarters.len() <= 384 && shown > 240, "{shown} of {}", three_quarters.len());
    }

    #[test]
    fn few_protected_and_unseen_leaves_are_no_special_case() {
        let foliage = grid(2, (0..8).map(|leaf| leaf < 3).collect());
        for seen in [equally(&foliage), vec![0.0; 8]] {
            let Clusters { three_quarters, halved: found } = clusters(&foliage, &seen);
            for set in found.iter().chain([&three_quarters]) {
                let grows = |leaf| set.iter().find(|cluster| cluster.leaf == leaf).map(|cluster| cluster.growth > 1.0);
                assert!((0..3).all(|leaf| grows(leaf) == Some(false)), "{set:?}");
                assert!(set.iter().all(|cluster| cluster.growth.is_finite()), "{set:?}");
            }
            assert_eq!(found[HALVINGS - 1].len(), 4);
        }
    }
}
