//! Leaves as connected components of the triangles.
//!
//! Two triangles belong together if they share a vertex, as in an artist's mesh, or an edge with exactly coinciding
//! ends, as after an exporter splits vertices along a texture seam. One common position is not enough:
//! leaves that touch at their stems stay separate. Union-find with path halving, O(t α(t)); edges go through a hash map.

use std::collections::HashMap;

use glam::DVec3;

use crate::groups::number_by_appearance;

/// Returns the component of each triangle, numbered by first appearance, and the number of components.
pub fn components(positions: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<u32>, usize) {
    let mut sets = DisjointSets::new(positions.len());
    for &[a, b, c] in triangles {
        sets.join(a, b);
        sets.join(a, c);
    }
    let places = number_places(positions);
    let mut edges = HashMap::with_capacity(triangles.len() * 3);
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let ends = (places[a as usize], places[b as usize]);
            if ends.0 == ends.1 {
                continue; // an edge without length is a point: sharing it does not join
            }
            let other = *edges.entry((ends.0.min(ends.1), ends.0.max(ends.1))).or_insert(a);
            sets.join(a, other);
        }
    }
    number_by_appearance(triangles.iter().map(|t| sets.find(t[0])))
}

/// Numbers the vertices; exactly equal positions share a number.
fn number_places(positions: &[DVec3]) -> Vec<u32> {
    // Adding 0 turns −0 into +0: the two are equal but differ in their bits.
    number_by_appearance(positions.iter().map(|p| (*p + DVec3::ZERO).to_array().map(f64::to_bits))).0
}

struct DisjointSets(Vec<u32>);

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn find(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            let parent = self.0[item as usize];
            self.0[item as usize] = self.0[parent as usize];
            item = parent;
        }
        item
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        // The lower index stays the root: the result does not depend on the order of the joins.
        self.0[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];

    #[test]
    fn a_shared_vertex_joins() {
        assert_eq!(components(&SQUARE, &[[0, 1, 2], [0, 2, 3]]), (vec![0, 0], 1));
    }

    #[test]
    fn a_split_edge_joins_and_a_common_place_does_not() {
        let [a, b, c, d] = SQUARE;
        // Two triangles share the diagonal through separate vertices; a third only touches the corner c.
        let positions = [a, b, c, a, c, d, c, c + DVec3::X, c + DVec3::Z];
        assert_eq!(components(&positions, &[[0, 1, 2], [3, 4, 5], [6, 7, 8]]), (vec![0, 0, 1], 2));
    }

    #[test]
    fn negative_zero_is_the_same_place() {
        let minus = DVec3::new(-0.0, 0.0, 0.0);
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, minus, DVec3::X, DVec3::Z];
        assert_eq!(components(&positions, &[[0, 1, 2], [3, 4, 5]]).1, 1);
    }
}
