//! A lower bound on the number of billboards, for any search.
//!
//! Every triangle must be held by a plane. So the number of triangles, divided by the most that any plane can hold, is a lower bound. For
//! all directions within an angle of n, a vertex v moves along the normal by at most 2 |v| sin(angle / 2). So a triangle can be held only
//! at offsets in `[max(n·v − that) − ε, min(n·v + that) + ε]`. Cells of directions are subdivided until their bound is close to the number
//! that their center direction holds. The bound is sound but not tight: it ignores that slabs overlap.

use glam::DVec3;
use leafcloud::Foliage;
use rayon::prelude::*;

/// Cells are subdivided until their bound is at most this many times the most that a plane was found to hold.
const CLOSE: f64 = 1.25;

/// Most subdivisions of a cell.
const DEEPEST: usize = 5;

/// A square on the cube around the unit sphere: its center and half its sides.
#[derive(Clone, Copy)]
struct Cell {
    middle: DVec3,
    right: DVec3,
    up: DVec3,
}

impl Cell {
    fn normal(&self) -> DVec3 {
        self.middle.normalize()
    }

    /// Returns the greatest distance of its unit normals from the center one.
    fn radius(&self) -> f64 {
        let corners = [(1., 1.), (1., -1.), (-1., 1.), (-1., -1.)];
        let away =
            |(x, y): (f64, f64)| (self.middle + self.right * x + self.up * y).normalize().distance(self.normal());
        corners.into_iter().map(away).fold(0.0, f64::max)
    }

    fn quarters(&self) -> [Self; 4] {
        [(1., 1.), (1., -1.), (-1., 1.), (-1., -1.)].map(|(x, y)| Self {
            middle: self.middle + self.right * (x / 2.0) + self.up * (y / 2.0),
            right: self.right / 2.0,
            up: self.up / 2.0,
        })
    }
}

/// Returns the most triangles held at one offset, if every height may be off by `slack` · |v|.
fn most_held(triangles: &[[DVec3; 3]], normal: DVec3, slack: f64, epsilon: f64) -> usize {
    let mut ends: Vec<(f64, i32)> = Vec::with_capacity(2 * triangles.len());
    for corners in triangles {
        let low =
            corners.iter().map(|v| normal.dot(*v) - slack * v.length()).fold(f64::NEG_INFINITY, f64::max) - epsilon;
        let high = corners.iter().map(|v| normal.dot(*v) + slack * v.length()).fold(f64::INFINITY, f64::min) + epsilon;
        if low <= high {
            ends.extend([(low, -1), (high, 1)]); // starts before ends at the same offset
        }
    }
    ends.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (mut held, mut most) = (0i32, 0i32);
    for (_, end) in ends {
        held -= end;
        most = most.max(held);
    }
    most as usize
}

/// Returns a lower bound on the number of billboards for this ε (share of R).
pub fn billboards(foliage: &Foliage, epsilon: f64) -> usize {
    let triangles: Vec<[DVec3; 3]> = (0..foliage.triangle_count()).map(|t| foliage.corners(t)).collect();
    let face = |middle: DVec3, right: DVec3, up: DVec3| Cell { middle, right, up };
    // Three faces of the cube: the other three hold the opposite normals of the same planes.
    let mut cells = vec![
        face(DVec3::X, DVec3::Y, DVec3::Z),
        face(DVec3::Y, DVec3::Z, DVec3::X),
        face(DVec3::Z, DVec3::X, DVec3::Y),
    ];
    let (mut found, mut settled) = (1usize, 0usize);
    for depth in 0..=DEEPEST {
        let looked: Vec<(Cell, usize, usize)> = cells
            .par_iter()
            .map(|cell| {
                let bound = most_held(&triangles, cell.normal(), cell.radius(), epsilon);
                (*cell, bound, most_held(&triangles, cell.normal(), 0.0, epsilon))
            })
            .collect();
        found = looked.iter().map(|l| l.2).fold(found, usize::max);
        let enough = |bound: usize| depth == DEEPEST || bound as f64 <= found as f64 * CLOSE;
        settled = looked.iter().map(|l| l.1).filter(|&bound| enough(bound)).fold(settled, usize::max);
        cells = looked.iter().filter(|l| !enough(l.1)).flat_map(|l| l.0.quarters()).collect();
    }
    triangles.len().div_ceil(settled.max(1))
}
