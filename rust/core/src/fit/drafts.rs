//! Drafts of pieces: what one leaf or triangle is, found out from the foliage's own corners in f64, before pieces are put in order.
//!
//! Nothing depends on the order of triangles: corners are sorted by where they lie before anything is summed.

use glam::{DVec3, Vec3};

use super::axes::Axes;
use super::bounds::Bounds;
use super::thinnest::thin_enough;
use crate::foliage::{Foliage, Opacity, area_vector};
use crate::geometry::Plane;

/// Area vectors closer in direction than this (sine of the angle) are summed: they project alike.
const PARALLEL: f64 = 1e-6;

/// Directions of area vectors that are told apart in one piece; a leaf of more (a hedge in one mesh) is summed less, never searched longer.
const MOST_DIRECTIONS: usize = 64;

/// What is found out about one leaf or triangle before pieces are put in order.
pub struct Draft {
    pub key: (u64, [u32; 3]),
    pub triangles: Vec<u32>,
    pub points: Vec<Vec3>,
    pub areas: Vec<Vec3>,
    pub weight: f32,
    pub bound: f32,
}

/// What drafts are made from.
pub struct Source<'a> {
    pub foliage: &'a Foliage,
    pub axes: Axes,
    pub bounds: &'a Bounds,
    pub opacity: &'a Opacity,
}

impl Source<'_> {
    /// Whether a slab is as thick as the leaf is wide: then to keep it whole costs next to nothing.
    pub fn is_small(&self, triangles: &[u32]) -> bool {
        let corners = triangles.iter().flat_map(|&t| self.foliage.corners(t as usize));
        let (low, high) =
            corners.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        high.distance(low) <= 2.0 * f64::from(self.bounds.of(corners))
    }

    /// `None` when no plane holds all triangles.
    pub fn draft(&self, triangles: &[u32]) -> Option<Draft> {
        let corners = corners(self.foliage, self.axes, triangles);
        let vertices = distinct(&corners);
        let areas = merge_parallel(&corners);
        let bound = self.bounds.of(vertices.iter().map(|&v| self.axes.to_local(v)));
        if triangles.len() > 1 {
            let plane = thin_enough(&vertices, &areas, f64::from(bound));
            // A hair less, so that another order of the same sums cannot find it too far.
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

/// A plane that holds the triangles, canonical, if one within `bound` is found.
pub fn own_plane(foliage: &Foliage, axes: Axes, triangles: &[u32], bound: f64) -> Plane {
    let corners = corners(foliage, axes, triangles);
    thin_enough(&distinct(&corners), &merge_parallel(&corners), bound)
}

/// The corners of triangles, canonical; triangles in an order that follows from where they lie.
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
    // Adding 0 turns −0 into +0: the same place.
    let mut kept: Vec<DVec3> = corners.iter().flatten().map(|&p| p + DVec3::ZERO).collect();
    kept.sort_by(by_coordinates);
    kept.dedup();
    kept
}

/// Sums area vectors of one direction, whichever way they wind, and drops those without length.
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

/// The box around points: least and greatest coordinates.
pub fn extent(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

/// The Morton code of a point: 21 bits an axis, interleaved.
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
