//! Pieces: what a plane captures as one. A whole leaf wherever one plane can hold it, else each triangle by itself.
//!
//! Whether one plane can hold a leaf is the question of its width: the least distance of two parallel planes that enclose it.
//! The optimum's normal is perpendicular to a hull face or to two hull edges, so the normals perpendicular to two differences of
//! vertices contain it: tried in full for leaves of up to [`EXACT_VERTICES`] vertices. Larger leaves try their
//! triangles' normals and a sample of edge pairs: a known limit, which can part a large curved leaf that a plane could just hold.

use glam::DVec3;
use rayon::prelude::*;

use crate::foliage::{Foliage, area_vector};
use crate::geometry::Plane;

const EXACT_VERTICES: usize = 12;

/// Directions of area vectors that are told apart in one piece; a leaf of more (a hedge in one mesh) is summed less, never searched longer.
const MOST_DIRECTIONS: usize = 64;

/// Area vectors closer in direction than this (sine of the angle) are summed: they project alike.
const PARALLEL: f64 = 1e-6;

/// What a plane captures as one.
#[derive(Debug)]
pub struct Piece {
    /// The distinct places of its vertices, local.
    pub vertices: Vec<DVec3>,
    /// Area vectors of its triangles, those of one direction summed; empty for a piece without area.
    pub areas: Vec<DVec3>,
    /// A plane that holds it.
    pub own: Plane,
    triangles: Vec<u32>,
}

/// All pieces of a foliage; every triangle belongs to exactly one.
#[derive(Debug)]
pub struct Pieces(Vec<Piece>);

impl Pieces {
    /// Leaves, where `whole_leaves` and a plane holds all of the leaf within `bound`; else triangles.
    pub fn of(foliage: &Foliage, whole_leaves: bool, bound: f64) -> Self {
        let leaves = foliage.leaves();
        let split = |leaf: usize| -> Vec<Piece> {
            let triangles = leaves.get(leaf);
            if whole_leaves && triangles.len() > 1 {
                let whole = Piece::new(foliage, triangles, bound);
                if whole.held_by(&whole.own, bound) {
                    return vec![whole];
                }
            }
            triangles.iter().map(|&t| Piece::new(foliage, &[t], bound)).collect()
        };
        Self((0..leaves.len()).into_par_iter().flat_map_iter(split).collect())
    }

    pub fn as_slice(&self) -> &[Piece] {
        &self.0
    }

    /// Carries a value per piece to its triangles.
    pub fn spread(&self, values: &[u32], triangle_count: usize) -> Vec<u32> {
        let mut spread = vec![0; triangle_count];
        for (piece, &value) in self.0.iter().zip(values) {
            for &t in &piece.triangles {
                spread[t as usize] = value;
            }
        }
        spread
    }
}

impl Piece {
    fn new(foliage: &Foliage, triangles: &[u32], bound: f64) -> Self {
        let corners: Vec<[DVec3; 3]> = triangles.iter().map(|&t| foliage.corners(t as usize)).collect();
        let vertices = distinct(corners.iter().flatten().copied());
        let areas = merge_parallel(corners.iter().map(|&c| area_vector(c)));
        let own = thin_enough(&vertices, &areas, bound);
        let piece = Self { vertices, areas, own, triangles: triangles.to_vec() };
        debug_assert!(triangles.len() > 1 || piece.held_by(&own, bound), "a triangle has a plane of its own");
        piece
    }

    /// Whether all vertices lie within `bound` of the plane.
    pub fn held_by(&self, plane: &Plane, bound: f64) -> bool {
        self.vertices.iter().all(|&v| plane.height(v).abs() <= bound)
    }

    /// The sum of the triangles' areas.
    pub fn area(&self) -> f64 {
        self.areas.iter().map(|a| a.length()).sum()
    }

    /// The sum of the triangles' areas as projected along `normal`.
    pub fn projected_area(&self, normal: DVec3) -> f64 {
        self.areas.iter().map(|a| a.dot(normal).abs()).sum()
    }
}

fn distinct(points: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = points.collect();
    kept.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    kept.dedup();
    kept
}

/// Sums area vectors of one direction, whichever way they wind, and drops those without length.
fn merge_parallel(areas: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let mut merged: Vec<DVec3> = Vec::new();
    for area in areas.filter(|a| *a != DVec3::ZERO) {
        let parallel = |m: &&mut DVec3| m.cross(area).length() <= PARALLEL * m.length() * area.length();
        let searched = merged.len().min(MOST_DIRECTIONS);
        match merged[..searched].iter_mut().find(parallel) {
            Some(m) => *m += if m.dot(area) < 0.0 { -area } else { area },
            None => merged.push(area),
        }
    }
    merged
}

/// The plane in the middle of a slab around the points: the first look at the area vectors when that holds them within
/// `bound`, else the thinnest that was found.
fn thin_enough(points: &[DVec3], areas: &[DVec3], bound: f64) -> Plane {
    let stride = areas.len().div_ceil(MOST_DIRECTIONS).max(1);
    let from_areas = areas.iter().step_by(stride).filter_map(|a| a.try_normalize());
    let (mut best, mut half) = (Plane { normal: DVec3::Z, distance: 0.0 }, f64::INFINITY);
    let mut consider = |normal: DVec3| {
        let heights = points.iter().map(|p| normal.dot(*p));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        if (high - low) / 2.0 < half {
            (best, half) = (Plane { normal, distance: low / 2.0 + high / 2.0 }, (high - low) / 2.0);
        }
        half
    };
    let mut reached = f64::INFINITY;
    for normal in from_areas {
        reached = consider(normal);
    }
    if reached > bound {
        let directions = differences(points);
        for (i, a) in directions.iter().enumerate() {
            for b in &directions[i + 1..] {
                if let Some(normal) = a.cross(*b).try_normalize() {
                    reached = consider(normal);
                }
            }
            // A sliver's cross products are rounding noise; a plane along its longest edge holds what is as thin as that.
            if let Some(along) = a.try_normalize() {
                reached = consider(along.any_orthonormal_vector());
            }
        }
    }
    if reached == f64::INFINITY {
        consider(DVec3::Z); // one point
    }
    best
}

/// Differences of vertices: all of them for few, a regular sample for many.
fn differences(points: &[DVec3]) -> Vec<DVec3> {
    let stride = points.len().div_ceil(EXACT_VERTICES).max(1);
    let chosen: Vec<DVec3> = points.iter().step_by(stride).copied().collect();
    let pairs = chosen.iter().enumerate().flat_map(|(i, a)| chosen[i + 1..].iter().map(move |b| *b - *a));
    pairs.collect()
}
