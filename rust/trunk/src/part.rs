//! One connected part: simplified and measured until the bound holds.
//!
//! The simplifier's own bound begins at the requested error and is halved from try to try. Each bound gets a few rounds: if the result is
//! too far from the part, the vertices missed most are locked for all later rounds.

use glam::DVec3;
use leafcloud::{Foliage, geometry::Frame};
use meshopt::{SimplifyOptions, SimplifyVertex, simplify_scale_decoder, simplify_with_attributes_and_locks_decoder};

use crate::Simplified;
use crate::distance::{Far, Triangle, farthest};
use crate::vertices::{ATTRIBUTES, Vertices};

/// Number of bounds tried; each is half of the one before.
const BOUNDS: usize = 10;
/// Rounds at one bound.
const ROUNDS: usize = 4;
/// Most positions that one round locks.
const MOST_KEPT: usize = 256;
/// Distance between samples, as a share of the error.
const SPACING: f64 = 0.5;
/// Weight of normals: a normal that changes by 1 counts like a move by this share of the part's extent. It keeps branches round, so that
/// they do not collapse. Of weights from 0.1 to 4, measured on the trees of `ez-tree`, this one gives the fewest triangles.
const NORMAL_WEIGHT: f32 = 0.3;

/// Simplifies the part of `trunk` with these triangles within `error`. Both the given and the returned error are in the local frame.
pub fn simplify(trunk: &Foliage, triangles: &[u32], error: f64) -> Simplified {
    let places: Vec<DVec3> = triangles.iter().flat_map(|&t| trunk.corners(t as usize)).collect();
    match Frame::of(places.iter().copied()) {
        Some(sphere) if sphere.radius > error => {}
        sphere => return Simplified { corners: Vec::new(), error: sphere.map_or(0.0, |s| s.radius) },
    }
    let part = Part::new(trunk, triangles, places, error);
    part.search().unwrap_or_else(|| Simplified { corners: part.in_trunk(&part.vertices.of_corner), error: 0.0 })
}

struct Part<'a> {
    /// Indices of its triangles in the whole trunk.
    triangles: &'a [u32],
    vertices: Vertices,
    /// Positions of the corners, local frame.
    places: Vec<DVec3>,
    /// Triangles of the input that have an area.
    whole: Vec<Triangle>,
    error: f64,
    /// `error` as a share of the extent that the simplifier uses as its unit.
    bound: f32,
}

impl<'a> Part<'a> {
    fn new(trunk: &Foliage, triangles: &'a [u32], places: Vec<DVec3>, error: f64) -> Self {
        let vertices = Vertices::new(trunk, triangles, &places);
        let bound = (error / f64::from(simplify_scale_decoder(&vertices.places))) as f32;
        let mut part = Self { triangles, vertices, places, whole: Vec::new(), error, bound };
        part.whole = part.surface(&part.vertices.of_corner);
        part.whole.retain(Triangle::has_area);
        part
    }

    /// Returns the first result within the bound; `None` if no triangle can be saved.
    fn search(&self) -> Option<Simplified> {
        let mut locks = self.locks();
        let mut bound = self.bound;
        for _ in 0..BOUNDS {
            for _ in 0..ROUNDS {
                let indices = self.collapsed(bound, &locks);
                if indices.len() >= self.vertices.of_corner.len() {
                    break;
                }
                let missed = match self.measured(&indices) {
                    Ok(error) => return Some(Simplified { corners: self.in_trunk(&indices), error }),
                    Err(missed) => missed,
                };
                if !self.keep(missed, &mut locks) {
                    break;
                }
            }
            bound *= 0.5;
        }
        None
    }

    /// Returns the initial locks: vertices on seams between texture coordinates, colors or materials are protected; normals may merge.
    fn locks(&self) -> Vec<SimplifyVertex> {
        let lock = |&on_seam: &bool| if on_seam { SimplifyVertex::Protect } else { SimplifyVertex::None };
        self.vertices.on_seam.iter().map(lock).collect()
    }

    fn collapsed(&self, bound: f32, locks: &[SimplifyVertex]) -> Vec<u32> {
        let (uv, normal, color) = (self.bound, NORMAL_WEIGHT, self.bound);
        let indices = simplify_with_attributes_and_locks_decoder(
            &self.vertices.of_corner,
            &self.vertices.places,
            self.vertices.attributes.as_flattened(),
            &[uv, uv, normal, normal, normal, color, color, color, color],
            ATTRIBUTES * size_of::<f32>(),
            locks,
            0,
            bound,
            SimplifyOptions::Permissive,
            None,
        );
        let seen = |t: &&[u32; 3]| self.triangle(**t).has_area();
        indices.as_chunks::<3>().0.iter().filter(seen).copied().flatten().collect()
    }

    /// Returns the distance between the part and its simplification or, as the error, the distance of each triangle if that exceeds the
    /// limit.
    fn measured(&self, indices: &[u32]) -> Result<f64, Vec<Far>> {
        let (left, spacing) = (self.surface(indices), SPACING * self.error);
        let greatest = |far: &[Far]| far.iter().map(|f| f.distance).fold(0.0, f64::max);
        let missed = farthest(&self.whole, &left, spacing);
        let there = greatest(&missed);
        if there > self.error {
            return Err(missed);
        }
        let back = greatest(&farthest(&left, &self.whole, spacing));
        if back > self.error { Err(missed) } else { Ok(there.max(back)) }
    }

    /// Locks vertices that the simplified surface misses, so that the next try keeps them: first the farthest from the surface, then the
    /// farthest outside a ball of that distance around it, and so on. Returns whether any vertex is missed.
    fn keep(&self, mut missed: Vec<Far>, locks: &mut [SimplifyVertex]) -> bool {
        missed.retain(|far| far.distance > self.error);
        missed.sort_by(|a, b| b.distance.total_cmp(&a.distance));
        let mut kept: Vec<Far> = Vec::new();
        for far in missed {
            if kept.len() < MOST_KEPT && kept.iter().all(|k| k.corner.distance(far.corner) > k.distance) {
                kept.push(far);
            }
        }
        for (lock, &corner) in locks.iter_mut().zip(&self.vertices.corners) {
            if kept.iter().any(|far| far.corner == self.places[corner as usize]) {
                *lock = SimplifyVertex::Lock;
            }
        }
        !kept.is_empty()
    }

    fn surface(&self, indices: &[u32]) -> Vec<Triangle> {
        indices.as_chunks::<3>().0.iter().map(|&t| self.triangle(t)).collect()
    }

    fn triangle(&self, vertices: [u32; 3]) -> Triangle {
        Triangle(vertices.map(|v| self.places[self.vertices.corners[v as usize] as usize]))
    }

    /// Returns triangles of the part's vertices as corners of the whole trunk.
    fn in_trunk(&self, indices: &[u32]) -> Vec<[u32; 3]> {
        let corner = |v: u32| {
            let corner = self.vertices.corners[v as usize];
            3 * self.triangles[corner as usize / 3] + corner % 3
        };
        indices.as_chunks::<3>().0.iter().map(|t| t.map(corner)).collect()
    }
}
