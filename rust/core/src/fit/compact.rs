//! Compact subsets: billboards without wide gaps.
//!
//! Décoret et al. 2003, §3: the pieces of a plane are projected onto four directions 45° apart. A gap in a projection splits them into
//! two billboards in the same plane. This repeats until no part has a gap in any of the four directions.
//! O(n log n) for each split.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::geometry::Plane;

/// Four directions, 45° apart.
const ALONG: [DVec2; 4] = [
    DVec2::X,
    DVec2::Y,
    DVec2::new(std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2),
    DVec2::new(std::f64::consts::FRAC_1_SQRT_2, -std::f64::consts::FRAC_1_SQRT_2),
];

/// Splits every plane at gaps of at least `gap` between its triangles; `corners` are the triangles' own. Returns the planes, repeated for
/// their parts, and each triangle's parent as an index into them.
pub fn parted(
    planes: &[Plane],
    parents: &[u32],
    corners: impl Fn(usize) -> [DVec3; 3] + Sync,
    gap: f64,
) -> (Vec<Plane>, Vec<u32>) {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); planes.len()];
    for (triangle, &parent) in parents.iter().enumerate() {
        members[parent as usize].push(triangle);
    }
    let parts_of = |(plane, members): (&Plane, Vec<usize>)| {
        let (x, y) = plane.axes();
        let flat = |&t: &usize| corners(t).map(|p| DVec2::new(x.dot(p), y.dot(p)));
        let flat: Vec<[DVec2; 3]> = members.iter().map(flat).collect();
        let all = (0..members.len()).collect();
        let parts = without_gaps(&flat, all, gap);
        parts.into_iter().map(|part| part.into_iter().map(|i| members[i]).collect()).collect::<Vec<Vec<usize>>>()
    };
    let parts: Vec<Vec<Vec<usize>>> = planes.par_iter().zip(members).map(parts_of).collect();
    let (mut repeated, mut numbers) = (Vec::new(), vec![0; parents.len()]);
    for (plane, parts) in planes.iter().zip(parts) {
        for part in parts {
            for triangle in part {
                numbers[triangle] = repeated.len() as u32;
            }
            repeated.push(*plane);
        }
    }
    (repeated, numbers)
}

fn without_gaps(triangles: &[[DVec2; 3]], members: Vec<usize>, gap: f64) -> Vec<Vec<usize>> {
    for along in ALONG {
        let mut extents: Vec<(f64, f64, usize)> = members
            .iter()
            .map(|&i| {
                let at = triangles[i].map(|p| along.dot(p));
                (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]), i)
            })
            .collect();
        extents.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let mut parts: Vec<Vec<usize>> = Vec::new();
        let mut reached = f64::NEG_INFINITY;
        for (from, to, i) in extents {
            if from - reached >= gap || parts.is_empty() {
                parts.push(Vec::new());
            }
            parts.last_mut().expect("one was just pushed").push(i);
            reached = reached.max(to);
        }
        if parts.len() > 1 {
            return parts.into_iter().flat_map(|part| without_gaps(triangles, part, gap)).collect();
        }
    }
    vec![members]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRONT: Plane = Plane { normal: DVec3::Z, distance: 0.0 };

    fn parts(places: &[(f64, f64)], gap: f64) -> Vec<u32> {
        let corner = |t: usize| DVec3::new(places[t].0, places[t].1, 0.0);
        let corners = |t: usize| [corner(t), corner(t) + DVec3::X * 0.1, corner(t) + DVec3::Y * 0.1];
        let (planes, parents) = parted(&[FRONT], &vec![0; places.len()], corners, gap);
        assert!(planes.iter().all(|&p| p == FRONT));
        parents
    }

    #[test]
    fn a_gap_parts_and_a_small_one_does_not() {
        assert_eq!(parts(&[(0.0, 0.0), (0.2, 0.0), (1.0, 0.0)], 0.5), [0, 0, 1]);
        assert_eq!(parts(&[(0.0, 0.0), (0.2, 0.0), (1.0, 0.0)], 0.8), [0, 0, 0]);
    }

    #[test]
    fn four_corners_fall_apart_whatever_the_axes_of_the_plane() {
        let mut found = parts(&[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)], 0.3);
        found.sort_unstable();
        assert_eq!(found, [0, 1, 2, 3]);
    }
}
