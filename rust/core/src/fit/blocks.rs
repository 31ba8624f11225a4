//! Scoring a plane: the projected area of the pieces that it holds, eight pieces at a time.
//!
//! Pieces lie in structure-of-arrays blocks of eight lanes; a lane with fewer vertices than its block repeats one, a lane without a piece
//! has no area. Sorted by their number of vertices, pieces waste few slots. One scan costs 9 flops per vertex slot, 6 per
//! area slot.
//!
//! Error bound: heights are sums of three products of numbers ≤ 1 in f32, so within 4 · 2⁻²⁴ of their value in f64: a piece that close
//! to the bound may be scored wrongly, never assigned wrongly (capture is decided in f64). The area sum is flushed to f64
//! every 64 blocks: relative error below 64 · 2⁻²⁴ < 4e-6.

use glam::{DVec3, Vec3};
use wide::f32x8;

use super::pieces::Piece;
use crate::geometry::Plane;

const LANES: usize = 8;
const FLUSH: usize = 64;

#[derive(Clone, Copy)]
struct Lanes3 {
    x: f32x8,
    y: f32x8,
    z: f32x8,
}

impl Lanes3 {
    fn gather(slot: impl Fn(usize) -> Vec3) -> Self {
        let lanes: [Vec3; LANES] = std::array::from_fn(slot);
        Self {
            x: f32x8::from(lanes.map(|v| v.x)),
            y: f32x8::from(lanes.map(|v| v.y)),
            z: f32x8::from(lanes.map(|v| v.z)),
        }
    }

    #[inline]
    fn dot(&self, n: &Self) -> f32x8 {
        self.x * n.x + self.y * n.y + self.z * n.z
    }

    fn splat(v: Vec3) -> Self {
        Self { x: f32x8::splat(v.x), y: f32x8::splat(v.y), z: f32x8::splat(v.z) }
    }
}

struct Block {
    vertices: std::ops::Range<usize>,
    areas: std::ops::Range<usize>,
}

/// Pieces in blocks, ready to be scored.
pub struct Blocks {
    list: Vec<Block>,
    vertices: Vec<Lanes3>,
    areas: Vec<Lanes3>,
}

impl Blocks {
    /// Blocks of these pieces.
    pub fn of<'a>(pieces: impl Iterator<Item = &'a Piece>) -> Self {
        let mut sorted: Vec<&Piece> = pieces.collect();
        sorted.sort_by_key(|p| (p.vertices.len(), p.areas.len()));
        let mut built = Self { list: Vec::new(), vertices: Vec::new(), areas: Vec::new() };
        for lanes in sorted.chunks(LANES) {
            let longest = |length: fn(&Piece) -> usize| lanes.iter().map(|p| length(p)).max().unwrap_or(0);
            let (first_vertex, first_area) = (built.vertices.len(), built.areas.len());
            for slot in 0..longest(|p| p.vertices.len()) {
                built.vertices.push(Lanes3::gather(|lane| match lanes.get(lane) {
                    Some(p) => p.vertices[slot.min(p.vertices.len() - 1)].as_vec3(),
                    None => Vec3::ZERO,
                }));
            }
            for slot in 0..longest(|p| p.areas.len()) {
                let area = |lane: usize| lanes.get(lane).and_then(|p| p.areas.get(slot)).copied();
                built.areas.push(Lanes3::gather(|lane| area(lane).unwrap_or(DVec3::ZERO).as_vec3()));
            }
            built
                .list
                .push(Block { vertices: first_vertex..built.vertices.len(), areas: first_area..built.areas.len() });
        }
        built
    }

    /// The projected area of the pieces whose vertices all lie within `bound` of the plane.
    pub fn score(&self, plane: &Plane, bound: f64) -> f64 {
        let normal = Lanes3::splat(plane.normal.as_vec3());
        let distance = f32x8::splat(plane.distance as f32);
        let bound = f32x8::splat(bound as f32);
        let mut total = 0.0;
        for blocks in self.list.chunks(FLUSH) {
            let mut sum = f32x8::ZERO;
            for block in blocks {
                let mut farthest = f32x8::ZERO;
                for vertex in &self.vertices[block.vertices.clone()] {
                    farthest = farthest.fast_max((vertex.dot(&normal) - distance).abs());
                }
                let held = farthest.simd_le(bound);
                if held.any() {
                    let mut area = f32x8::ZERO;
                    for vector in &self.areas[block.areas.clone()] {
                        area += vector.dot(&normal).abs();
                    }
                    sum += area & held;
                }
            }
            // In this order, not by a horizontal instruction, whose order differs between processors.
            total += sum.to_array().iter().map(|&x| f64::from(x)).sum::<f64>();
        }
        total
    }
}
