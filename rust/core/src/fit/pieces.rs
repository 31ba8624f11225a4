//! Pieces: the units that a plane captures. A piece is a whole leaf if one plane can hold it, else a single triangle.
//!
//! Pieces are sorted spatially (by Morton codes of their centers). Their points are rows of f32 that the search streams through. Every
//! [`BLOCK`] of them has a bounding box, so a plane tests only the pieces near it. Order and contents follow from the geometry alone, not
//! from the order of the triangles. The bound is tested in f64: [`Pieces::held_in`] tests the f32 points first, and the foliage's own
//! corners if rounding could matter.

use glam::Vec3;
use rayon::prelude::*;

use super::axes::Axes;
use super::bounds::Bounds;
use super::drafts::{Draft, DraftSource, extent, own_plane};
use super::lanes::{Eight, Kernel, LANES, dispatch};
use crate::foliage::{Foliage, Opacity};
use crate::geometry::Plane;
use crate::groups::{Groups, Rows};

/// Pieces per bounding box.
const BLOCK: usize = 32;

/// Leaves per task.
const TASK: usize = 2048;

/// Error bound of a height in f32: three products of numbers of at most 1, each factor rounded to 2⁻²⁵, two sums and a difference of
/// numbers below 2: under 12 · 2⁻²⁴ = 7.2e-7.
pub const HEIGHT_ERROR: f32 = 1e-6;

/// Areas of pieces up to this count as 0: a weight divided by a larger area stays finite in f32.
pub const SMALLEST_AREA: f32 = 1e-30;

/// Error bound of [`Pieces::facing`]: a product with a vector rounded to 2⁻²⁴, three terms per vector and up to 64 vectors, all of one
/// sign, over a sum of as many. Leaves have few vectors, so the error is a few roundings more than their number.
#[cfg(test)]
pub const FACING_ERROR: f32 = 1e-6;

/// Error bound of a plane's cost, times the piece's bound b: for heights h ≤ b, (h ± e)² / b² is off by 2 e / b, with e = [`HEIGHT_ERROR`].
#[cfg(test)]
pub const COST_ERROR: f32 = 2.0 * HEIGHT_ERROR + FACING_ERROR;

/// A plane in canonical coordinates, and the region in which it may hold pieces.
#[derive(Clone, Copy, Debug)]
pub struct Slab {
    /// The plane, in f64: the guaranteed bound refers to it.
    pub plane: Plane,
    /// Center of the region: the place where the plane was found.
    pub centre: Vec3,
    /// Greatest distance of points from the center; infinite without a size limit.
    pub reach: f32,
}

/// Choice of leaves to keep whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WholeLeaves {
    /// All leaves that a plane holds.
    Always,
    /// Only leaves no wider than a slab is thick, which costs next to nothing.
    WhereCheap,
}

/// All pieces of a foliage, or some of them, in canonical coordinates.
#[derive(Clone, Debug)]
pub struct Pieces<'a> {
    foliage: &'a Foliage,
    /// The canonical axes.
    pub axes: Axes,
    triangles: Groups,
    points: Rows<Vec3>,
    areas: Rows<Vec3>,
    totals: Vec<f32>,
    weights: Vec<f32>,
    bounds: Vec<f32>,
    blocks: Vec<Block>,
    /// Points of eight pieces per row, for [`Held`]; a piece with fewer points than its neighbors repeats its last.
    slots: Rows<Slot>,
}

/// A point of each of eight pieces: x, y, z.
type Slot = [[f32; LANES]; 3];

/// Bounding box of the points of [`BLOCK`] pieces, and their greatest bound.
#[derive(Clone, Copy, Debug)]
struct Block {
    centre: Vec3,
    half: Vec3,
    bound: f32,
}

impl<'a> Pieces<'a> {
    /// Makes the pieces: a leaf if `whole` allows it and a plane holds all of it within its bound, else its triangles.
    pub fn of(foliage: &'a Foliage, whole: WholeLeaves, bounds: &Bounds, opacity: &Opacity) -> Self {
        let axes = Axes::of(foliage);
        let leaves = foliage.leaves();
        let source = DraftSource { foliage, axes, bounds, opacity };
        let split = |leaf: usize| -> Vec<Draft> {
            let triangles = leaves.get(leaf);
            let together = triangles.len() == 1 || whole == WholeLeaves::Always || source.is_small(triangles);
            match together.then(|| source.draft(triangles)).flatten() {
                Some(whole) => vec![whole],
                None => {
                    triangles.iter().map(|&t| source.draft(&[t]).expect("a triangle has a plane of its own")).collect()
                }
            }
        };
        let mut drafts: Vec<Draft> =
            (0..leaves.len()).into_par_iter().with_min_len(TASK).flat_map_iter(split).collect();
        drafts.par_sort_unstable_by(|a, b| a.key.cmp(&b.key).then_with(|| a.triangles.cmp(&b.triangles)));
        Self::assemble(foliage, axes, drafts)
    }

    fn assemble(foliage: &'a Foliage, axes: Axes, drafts: Vec<Draft>) -> Self {
        let (mut triangles, mut points, mut areas) = (Rows::default(), Rows::default(), Rows::default());
        let [mut totals, mut weights, mut bounds] = [(); 3].map(|()| Vec::with_capacity(drafts.len()));
        for draft in drafts {
            totals.push(draft.areas.iter().map(|a| a.length()).sum());
            weights.push(draft.weight);
            bounds.push(draft.bound);
            triangles.push(draft.triangles);
            points.push(draft.points);
            areas.push(draft.areas);
        }
        let (blocks, slots) = (blocks(&points, &bounds), slots(&points));
        Self { foliage, axes, triangles, points, areas, totals, weights, bounds, blocks, slots }
    }

    /// Returns the pieces listed in `chosen` (ascending).
    pub fn select(&self, chosen: &[u32]) -> Self {
        let rows = chosen.iter().map(|&i| i as usize);
        let points = self.points.select(rows.clone());
        let bounds: Vec<f32> = rows.clone().map(|i| self.bounds[i]).collect();
        Self {
            foliage: self.foliage,
            axes: self.axes,
            triangles: self.triangles.select(rows.clone()),
            areas: self.areas.select(rows.clone()),
            totals: rows.clone().map(|i| self.totals[i]).collect(),
            weights: rows.map(|i| self.weights[i]).collect(),
            blocks: blocks(&points, &bounds),
            slots: slots(&points),
            points,
            bounds,
        }
    }

    /// Sets the bound of all pieces to `bound`, plus the rounding of f32.
    pub fn with_bound(mut self, bound: f64) -> Self {
        self.bounds.fill((bound as f32).next_up() + HEIGHT_ERROR);
        self.blocks = blocks(&self.points, &self.bounds);
        self
    }

    /// Multiplies the bounds of all pieces by `share`.
    pub fn held_to(mut self, share: f32) -> Self {
        self.bounds.iter_mut().for_each(|bound| *bound *= share);
        self.blocks = blocks(&self.points, &self.bounds);
        self
    }

    pub fn len(&self) -> usize {
        self.totals.len()
    }

    /// Returns the distinct positions of a piece's vertices.
    #[inline]
    pub fn points(&self, piece: usize) -> &[Vec3] {
        self.points.get(piece)
    }

    /// Returns the area vectors of a piece's triangles, summed per direction; empty for a piece without area.
    #[inline]
    pub fn areas(&self, piece: usize) -> &[Vec3] {
        self.areas.get(piece)
    }

    /// Returns the sum of the areas of a piece's triangles.
    #[inline]
    pub fn area(&self, piece: usize) -> f32 {
        self.totals[piece]
    }

    /// Returns the greatest allowed distance of a piece's points from its plane.
    #[inline]
    pub fn bound(&self, piece: usize) -> f32 {
        self.bounds[piece]
    }

    /// Returns the greatest bound of all pieces.
    pub fn greatest_bound(&self) -> f32 {
        self.bounds.iter().copied().fold(0.0, f32::max)
    }

    /// Returns the least bound of all pieces.
    pub fn least_bound(&self) -> f32 {
        self.bounds.iter().copied().fold(f32::INFINITY, f32::min)
    }

    /// Returns the weight of a piece: its visible area.
    #[inline]
    pub fn weight(&self, piece: usize) -> f32 {
        self.weights[piece]
    }

    /// Returns the triangles of a piece.
    pub fn triangles(&self, piece: usize) -> &[u32] {
        self.triangles.get(piece)
    }

    /// Returns the center of a piece's bounding box.
    pub fn centre(&self, piece: usize) -> Vec3 {
        let (low, high) = extent(self.points(piece));
        (low + high) * 0.5
    }

    /// Returns a plane that holds the piece.
    pub fn own_plane(&self, piece: usize) -> Plane {
        own_plane(self.foliage, self.axes, self.triangles(piece), f64::from(self.bounds[piece]))
    }

    /// Returns a slab around the piece's own plane.
    pub fn own_slab(&self, piece: usize, reach: f32) -> Slab {
        let reach = self.reach_around(piece, reach);
        Slab { plane: self.own_plane(piece), centre: self.centre(piece), reach }
    }

    /// Returns `reach`, or the radius of the piece around its center if that is greater: a leaf may be larger than the size limit.
    pub fn reach_around(&self, piece: usize, reach: f32) -> f32 {
        if reach == f32::INFINITY {
            return reach;
        }
        let centre = self.centre(piece);
        let own = self.points(piece).iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        reach.max(own * (1.0 + 1e-6))
    }

    /// Returns the share of its area that a piece keeps when projected along `normal`, to 10⁻⁶ (`FACING_ERROR`); 1 for a piece without
    /// area.
    #[inline]
    pub fn facing(&self, piece: usize, normal: Vec3) -> f32 {
        let total = self.totals[piece];
        if total > SMALLEST_AREA {
            self.areas(piece).iter().map(|a| a.dot(normal).abs()).sum::<f32>() / total
        } else {
            1.0
        }
    }

    /// Returns the greatest distance of a piece's points from the plane, in f32.
    pub fn greatest_height(&self, piece: usize, slab: &Slab) -> f32 {
        let (normal, distance) = (slab.plane.normal.as_vec3(), slab.plane.distance as f32);
        self.points(piece).iter().map(|p| (normal.dot(*p) - distance).abs()).fold(0.0, f32::max)
    }

    /// Returns the bounds of eight pieces from `first`; −∞ beyond the last piece, which is below every height.
    #[inline]
    fn bounds_of_eight(&self, first: usize) -> [f32; LANES] {
        match self.bounds[first..].first_chunk() {
            Some(bounds) => *bounds,
            None => std::array::from_fn(|lane| self.bounds.get(first + lane).copied().unwrap_or(f32::NEG_INFINITY)),
        }
    }

    /// Returns whether all points of a piece lie within `reach` of `centre`.
    #[inline]
    pub fn within_reach(&self, piece: usize, centre: Vec3, reach: f32) -> bool {
        reach == f32::INFINITY || self.points(piece).iter().all(|p| p.distance(centre) <= reach)
    }

    fn holds_exactly(&self, piece: usize, plane: &Plane) -> bool {
        let plane = self.axes.plane_to_local(plane);
        let bound = f64::from(self.bounds[piece]);
        let corners = self.triangles(piece).iter().flat_map(|&t| self.foliage.corners(t as usize));
        corners.into_iter().all(|corner| plane.height(corner).abs() <= bound)
    }

    /// Returns, in ascending order, all pieces with a point within `width` bounds of the plane, and a few more.
    pub fn near(&self, slab: &Slab, width: f32) -> impl Iterator<Item = u32> + '_ {
        let members = |block: usize| (block * BLOCK) as u32..((block + 1) * BLOCK).min(self.len()) as u32;
        self.near_blocks(slab, width, 0..self.len()).flat_map(members)
    }

    /// Returns whether the first of a piece's points lies within `width` bounds of the plane.
    #[inline]
    pub fn touches(&self, piece: usize, slab: &Slab, width: f32) -> bool {
        let height = slab.plane.normal.as_vec3().dot(self.points(piece)[0]) - slab.plane.distance as f32;
        height.abs() <= width * self.bounds[piece]
    }

    /// Returns the pieces in `range` that the slab holds, in ascending order. The ends of `range` are multiples of [`BLOCK`], or the number
    /// of pieces.
    pub fn held_in(&self, slab: &Slab, range: std::ops::Range<usize>) -> Vec<u32> {
        dispatch(Held { pieces: self, slab, range })
    }

    /// Returns the blocks that may have a point within `width` bounds of the plane.
    fn near_blocks(&self, slab: &Slab, width: f32, range: std::ops::Range<usize>) -> impl Iterator<Item = usize> + '_ {
        let slab = *slab;
        let (normal, distance) = (slab.plane.normal.as_vec3(), slab.plane.distance as f32);
        let close = move |block: &Block| {
            let height = (normal.dot(block.centre) - distance).abs() - normal.abs().dot(block.half);
            let away = ((slab.centre - block.centre).abs() - block.half).max(Vec3::ZERO).length();
            height <= width * block.bound + 2.0 * HEIGHT_ERROR && away <= slab.reach + HEIGHT_ERROR
        };
        let first = range.start / BLOCK;
        let blocks = &self.blocks[first..range.end.div_ceil(BLOCK)];
        blocks.iter().enumerate().filter(move |(_, block)| close(block)).map(move |(i, _)| first + i)
    }

    /// Copies a value per piece to its triangles.
    pub fn spread(&self, values: &[u32]) -> Vec<u32> {
        let mut spread = vec![0; self.foliage.triangle_count()];
        for (triangles, &value) in self.triangles.iter().zip(values) {
            for &t in triangles {
                spread[t as usize] = value;
            }
        }
        spread
    }
}

/// Finds the pieces that a slab holds: eight at a time in f32, and in f64 if f32 cannot decide.
pub struct Held<'a> {
    pub pieces: &'a Pieces<'a>,
    pub slab: &'a Slab,
    pub range: std::ops::Range<usize>,
}

#[allow(clippy::inline_always)] // see `lanes`
impl Kernel for Held<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<E: Eight>(self, e: E) -> Vec<u32> {
        let Self { pieces, slab, range } = self;
        let normal = slab.plane.normal.as_vec3().to_array().map(|x| e.splat(x));
        let distance = e.splat(slab.plane.distance as f32);
        let margin = e.splat(HEIGHT_ERROR);
        let mut held = Vec::new();
        for block in pieces.near_blocks(slab, 1.0, range.clone()) {
            let end = ((block + 1) * BLOCK).min(range.end);
            for first in (block * BLOCK..end).step_by(LANES) {
                let mut farthest = e.splat(0.0);
                for slot in pieces.slots.get(first / LANES) {
                    let [x, y, z] = slot.map(|lanes| e.load(lanes));
                    let along = e.add(e.add(e.mul(x, normal[0]), e.mul(y, normal[1])), e.mul(z, normal[2]));
                    farthest = e.max(e.abs(e.sub(along, distance)), farthest);
                }
                let bound = e.load(pieces.bounds_of_eight(first));
                let mut maybe = e.at_most(farthest, e.add(bound, margin));
                if maybe == 0 {
                    continue;
                }
                let surely = e.at_most(farthest, e.sub(bound, margin));
                while maybe != 0 {
                    let lane = maybe.trailing_zeros();
                    maybe &= maybe - 1;
                    let piece = first + lane as usize;
                    let certain = surely >> lane & 1 == 1 || pieces.holds_exactly(piece, &slab.plane);
                    if certain && pieces.within_reach(piece, slab.centre, slab.reach) {
                        held.push(piece as u32);
                    }
                }
            }
        }
        held
    }
}

fn blocks(points: &Rows<Vec3>, bounds: &[f32]) -> Vec<Block> {
    let block = |first: usize| {
        let range = first..(first + BLOCK).min(points.len());
        let each = range.clone().map(|i| extent(points.get(i)));
        let (low, high) = each.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let bound = bounds[range].iter().copied().fold(0.0, f32::max);
        Block { centre: (low + high) * 0.5, half: (high - low) * 0.5, bound }
    };
    (0..points.len()).step_by(BLOCK).map(block).collect()
}

fn slots(points: &Rows<Vec3>) -> Rows<Slot> {
    let mut slots = Rows::default();
    for first in (0..points.len()).step_by(LANES) {
        let row = |lane: usize| points.get((first + lane).min(points.len() - 1));
        let longest = (0..LANES).map(|lane| row(lane).len()).max().unwrap_or(0);
        slots.push((0..longest).map(|slot| {
            let point = |lane: usize| row(lane)[slot.min(row(lane).len() - 1)];
            let points: [Vec3; LANES] = std::array::from_fn(point);
            [points.map(|p| p.x), points.map(|p| p.y), points.map(|p| p.z)]
        }));
    }
    slots
}

#[cfg(test)]
#[path = "pieces_tests.rs"]
mod tests;
