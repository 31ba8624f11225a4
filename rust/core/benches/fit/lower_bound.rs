//! How few billboards there can be, whatever the search.
//!
//! No plane can hold more triangles than the largest number held for some direction near by, and every triangle must be held: so many
//! billboards at least as that number goes into all. For all directions within an angle of n, a vertex v moves along the normal by at most
//! 2 |v| sin(angle / 2), so a triangle can be held only at offsets in `[max(n·v − that) − ε, min(n·v + that) + ε]`. Cells of directions are cut until their
//! bound is close to what their own middle holds. Sound, but far from tight: it ignores that slabs overlap.

use glam::DVec3;
use leafcloud::Foliage;
use rayon::prelude::*;

/// Cells are cut until the best bound is this close to what a plane was found to hold.
const CLOSE: f64 = 1.25;

/// Cuts of a cell's side, at most.
const DEEPEST: usize = 5;

/// A square on the cube around the unit sphere: its middle and half its side.
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

    /// The greatest distance between its unit normals and the middle one.
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

/// The most triangles held at one offset, where every height may be off by `slack` · |v|.
fn most_held(triangles: &[[DVec3; 3]], normal: DVec3, slack: f64, epsilon: f64) -> usize {
    let mut ends: Vec<(f64, i32)> = Vec::with_capacity(2 * triangles.len());
    for corners in triangles {
        let low =
            corners.iter().map(|v| normal.dot(*v) - slack * v.length()).fold(f64::NEG_INFINITY, f64::max) - epsilon;
        let high = corners.iter().map(|v| normal.dot(*v) + slack * v.length()).fold(f64::INFINITY, f64::min) + epsilon;
        if low <= high {
            ends.extend([(low, -1), (high, 1)]); // beginnings before ends where they meet
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

/// A number of billboards that no cloud of this ε (share of R) can do without.
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
