//! Drafts of pieces: the properties of one leaf or triangle, computed in f64 before pieces are sorted.
//!
//! Nothing depends on the order of the triangles: corners are sorted by position before anything is summed.

use glam::{DVec3, Vec3};

use super::axes::Axes;
use super::bounds::Bounds;
use super::thinnest::thin_enough;
use crate::foliage::{Foliage, Opacity, area_vector};
use crate::geometry::Plane;

/// Area vectors closer in direction than this (sine of the angle) are summed: their projections are alike.
const PARALLEL: f64 = 1e-6;

/// Distinct directions to compare with in one piece. Beyond it, area vectors are merged less, which bounds the time for a hedge in one
/// mesh.
const MOST_DIRECTIONS: usize = 64;

/// Properties of one leaf or triangle, before pieces are sorted.
pub struct Draft {
    pub key: (u64, [u32; 3]),
    pub triangles: Vec<u32>,
    pub points: Vec<Vec3>,
    pub areas: Vec<Vec3>,
    pub weight: f32,
    pub bound: f32,
}

/// Input of the drafts.
pub struct DraftSource<'a> {
    pub foliage: &'a Foliage,
    pub axes: Axes,
    pub bounds: &'a Bounds,
    pub opacity: &'a Opacity,
}

impl DraftSource<'_> {
    /// Returns whether the leaf is no wider than a slab is thick: keeping it whole then costs next to nothing.
    pub fn is_small(&self, triangles: &[u32]) -> bool {
        let corners = triangles.iter().flat_map(|&t| self.foliage.corners(t as usize));
        let (low, high) =
            corners.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        high.distance(low) <= 2.0 * f64::from(self.bounds.of(corners))
    }

    /// Returns the draft of a piece; `None` if no plane holds all its triangles.
    pub fn draft(&self, triangles: &[u32]) -> Option<Draft> {
        let corners = corners(self.foliage, self.axes, triangles);
        let vertices = distinct(&corners);
        let areas = merge_parallel(&corners);
        let bound = self.bounds.of(vertices.iter().map(|&v| self.axes.to_local(v)));
        if triangles.len() > 1 {
            let plane = thin_enough(&vertices, &areas, f64::from(bound));
            // Slightly tighter: summing in another order must not exceed the bound.
            let held = f64::from(bound) * (1.0 - 1e-7);
            if vertices.iter().any(|&v| plane.height(v).abs() > held) {
                return None;
            }
        }
        let points: Vec<Vec3> = vertices.iter().map(|v| v.as_vec3()).collect();
        let areas = areas.iter().map(|a| a.as_vec3()).filter(|a| *a != Vec3::ZERO).collect();
        let visible =
            |&t: &u32| self.foliage.area_vector(t as usize).length() as f32 * self.opacity.get(t as usize).share;
        let (low, high) = extent(&points);
        let key = (morton((low + high) * 0.5), points[0].to_array().map(f32::to_bits));
        let weight = triangles.iter().map(visible).sum();
        Some(Draft { key, triangles: triangles.to_vec(), points, areas, weight, bound })
    }
}

/// Returns a plane for the triangles, in canonical coordinates; it holds them if a plane within `bound` was found.
pub fn own_plane(foliage: &Foliage, axes: Axes, triangles: &[u32], bound: f64) -> Plane {
    let corners = corners(foliage, axes, triangles);
    thin_enough(&distinct(&corners), &merge_parallel(&corners), bound)
}

/// Returns the canonical corners of triangles, sorted by position.
fn corners(foliage: &Foliage, axes: Axes, triangles: &[u32]) -> Vec<[DVec3; 3]> {
    let mut corners: Vec<[DVec3; 3]> =
        triangles.iter().map(|&t| foliage.corners(t as usize).map(|p| axes.to_canonical(p))).collect();
    corners.sort_by(|a, b| {
        a.iter().zip(b).map(|(a, b)| by_coordinates(a, b)).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    });
    corners
}

fn by_coordinates(a: &DVec3, b: &DVec3) -> std::cmp::Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

fn distinct(corners: &[[DVec3; 3]]) -> Vec<DVec3> {
    // Adding 0 turns −0 into +0: the same position.
    let mut kept: Vec<DVec3> = corners.iter().flatten().map(|&p| p + DVec3::ZERO).collect();
    kept.sort_by(by_coordinates);
    kept.dedup();
    kept
}

/// Sums area vectors of the same direction, regardless of winding, and drops vectors without length.
fn merge_parallel(corners: &[[DVec3; 3]]) -> Vec<DVec3> {
    let mut merged: Vec<DVec3> = Vec::new();
    for area in corners.iter().map(|&c| area_vector(c)).filter(|a| *a != DVec3::ZERO) {
        let parallel = |m: &&mut DVec3| m.cross(area).length() <= PARALLEL * m.length() * area.length();
        let searched = merged.len().min(MOST_DIRECTIONS);
        match merged[..searched].iter_mut().find(parallel) {
            Some(m) => *m += if m.dot(area) < 0.0 { -area } else { area },
            None => merged.push(area),
        }
    }
    merged
}

/// Returns the bounding box of points: least and greatest coordinates.
pub fn extent(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

/// Returns the Morton code of a point: 21 bits per axis, interleaved.
fn morton(p: Vec3) -> u64 {
    let spread = |x: f32| {
        let mut bits = ((x * 0.5 + 0.5).clamp(0.0, 1.0) * 2_097_151.0) as u64;
        bits = (bits | (bits << 32)) & 0x001F_0000_0000_FFFF;
        bits = (bits | (bits << 16)) & 0x001F_0000_FF00_00FF;
        bits = (bits | (bits << 8)) & 0x100F_00F0_0F00_F00F;
        bits = (bits | (bits << 4)) & 0x10C3_0C30_C30C_30C3;
        (bits | (bits << 2)) & 0x1249_2492_4924_9249
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}
