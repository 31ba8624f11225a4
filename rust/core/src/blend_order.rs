//! Draw order of blended triangles for any viewpoint: a binary space partition.
//!
//! Blended triangles have to be drawn from back to front. Billboards intersect each other, so no order of whole billboards is right. Each
//! node of the tree has the plane of one triangle. Pieces that cross the plane are cut in two; pieces within the plane stay at the node.
//! From any eye, the far side of a node is drawn before the node's own triangles, and these before the near side (Fuchs, Kedem and Naylor,
//! "On visible surface generation by a priori tree structures", SIGGRAPH 1980). The order is exact for the given positions. Billboards that
//! morph to another level keep the order of their original positions.
//!
//! The plane of a node is the best of a few candidates, evenly spread among the node's triangles: few cuts, and both sides about equal.
//! Building takes O(p log p) for p pieces if cuts are few. n triangles may need O(n²) cuts: an exact order has at most [`MOST_CUTS`].
//! If the caller limits the number of pieces, a piece beyond that limit that crosses a plane goes to the side of its middle uncut, and the
//! order is only approximate.

use std::collections::VecDeque;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::progress::Progress;

/// Number of candidate planes for a node.
const TRIED: usize = 12;

/// Cost of one cut, in triangles of imbalance between the two sides.
const CUT_WEIGHT: usize = 6;

/// Maximum number of cuts for an exact order, some 300 MB of pieces: 700 random triangles that cross one another need less.
pub const MOST_CUTS: usize = 1_000_000;

/// Tolerance for a corner within a plane, as a share of the extent of all triangles: a few roundings of single precision.
const THICKNESS: f64 = 2e-6;

/// A corner of a piece, as barycentric coordinates in its source triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Index of the source triangle in the input.
    pub source: u32,
    /// Weights of the triangle's three corners: at least 0, with a sum of 1.
    pub weights: [f64; 3],
}

/// A plane, the triangles within it, and the nodes on its two sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// n of the plane n · x = d; unit length.
    pub normal: DVec3,
    /// d.
    pub offset: f64,
    /// The nodes in front of the plane (n · x > d) and behind it (n · x < d).
    pub children: [Option<u32>; 2],
    /// Range of the triangles that lie in the plane.
    pub triangles: std::ops::Range<u32>,
}

/// Pieces of triangles and the tree that orders them; node 0 is the root.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlendOrder {
    /// The corners of the pieces; pieces share no corners.
    pub corners: Vec<Corner>,
    /// Three corners each, wound like the source triangles, in draw order for a far eye in the direction given to [`Self::new`].
    pub triangles: Vec<[u32; 3]>,
    /// The nodes of the tree.
    pub nodes: Vec<Node>,
}

impl BlendOrder {
    /// Builds the tree of `triangles` and lists their pieces in draw order for a far eye in the direction `toward`. The order
    /// is exact; with `most`, nothing is cut any further from that number of pieces on, and the order is approximate. Triangles without area
    /// are left out.
    ///
    /// # Errors
    /// A corner or the direction is not finite; an exact order needs more than [`MOST_CUTS`]; [`Error::Cancelled`].
    pub fn new(triangles: &[[DVec3; 3]], toward: DVec3, most: Option<usize>, progress: Progress) -> Result<Self> {
        if let Some(at) = triangles.iter().position(|corners| !corners.iter().all(|p| p.is_finite())) {
            return Err(Error::invalid(format!("triangle {at} has a corner that is not finite")));
        }
        if !toward.is_finite() {
            return Err(Error::invalid(format!(
                "the direction toward the eye is {:?}; it must be finite",
                toward.to_array()
            )));
        }
        let thickness = THICKNESS * extent(triangles);
        let pieces: Vec<Polygon> =
            (0u32..).zip(triangles).filter_map(|(i, t)| Polygon::whole(i, t, thickness)).collect();
        Ok(Partition::new(pieces, thickness, most, progress)?.ordered(toward))
    }

    /// Returns the nodes from the farthest to the nearest. `side` returns whether the eye lies in front of a node's plane.
    pub fn walk(&self, side: impl Fn(&Node) -> bool) -> Vec<u32> {
        walk(&self.nodes, |node| side(node))
    }
}

/// Returns half of the diagonal of the bounding box.
fn extent(triangles: &[[DVec3; 3]]) -> f64 {
    let corners = || triangles.iter().flatten().copied();
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    if triangles.is_empty() { 0.0 } else { 0.5 * (high - low).length() }
}

fn walk(nodes: &[Node], in_front: impl Fn(&Node) -> bool) -> Vec<u32> {
    // The stack holds a node twice: first to push its far side above it, then to draw it.
    let mut drawn = Vec::with_capacity(nodes.len());
    let mut stack: Vec<(u32, bool)> = if nodes.is_empty() { Vec::new() } else { vec![(0, false)] };
    while let Some((number, ready)) = stack.pop() {
        if ready {
            drawn.push(number);
            continue;
        }
        let node = &nodes[number as usize];
        let [front, back] = node.children;
        let (near, far) = if in_front(node) { (front, back) } else { (back, front) };
        stack.extend(near.map(|child| (child, false)));
        stack.push((number, true));
        stack.extend(far.map(|child| (child, false)));
    }
    drawn
}

/// A convex polygon cut from a triangle.
#[derive(Clone, Debug)]
struct Polygon {
    source: u32,
    normal: DVec3,
    offset: f64,
    corners: Vec<(DVec3, [f64; 3])>,
}

/// Position of a piece relative to a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Front,
    Back,
    Within,
    Across,
}

impl Polygon {
    /// Makes a piece of the whole triangle; `None` if it is nowhere thicker than `thickness`.
    fn whole(source: u32, corners: &[DVec3; 3], thickness: f64) -> Option<Self> {
        let [a, b, c] = *corners;
        let across = (b - a).cross(c - a);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        if across.length() <= thickness * longest {
            return None;
        }
        let normal = across.normalize();
        let weights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let corners = corners.iter().copied().zip(weights).collect();
        Some(Self { source, normal, offset: normal.dot((a + b + c) / 3.0), corners })
    }

    fn height(&self, corner: usize, of: DVec3, offset: f64) -> f64 {
        of.dot(self.corners[corner].0) - offset
    }

    fn heights(&self, normal: DVec3, offset: f64) -> Vec<f64> {
        (0..self.corners.len()).map(|i| self.height(i, normal, offset)).collect()
    }

    fn side(&self, normal: DVec3, offset: f64, thickness: f64) -> Side {
        let (mut front, mut back) = (false, false);
        for corner in 0..self.corners.len() {
            let height = self.height(corner, normal, offset);
            front |= height > thickness;
            back |= height < -thickness;
        }
        match (front, back) {
            (true, true) => Side::Across,
            (true, false) => Side::Front,
            (false, true) => Side::Back,
            (false, false) => Side::Within,
        }
    }

    /// Returns whether the mean of the corners lies in front of the plane or in it.
    fn middle_in_front(&self, normal: DVec3, offset: f64) -> bool {
        self.heights(normal, offset).iter().sum::<f64>() >= 0.0
    }

    /// Cuts the piece into the part in front of the plane and the part behind it.
    fn cut(&self, normal: DVec3, offset: f64, thickness: f64) -> [Self; 2] {
        let heights = self.heights(normal, offset);
        let mut sides = [Vec::new(), Vec::new()];
        for here in 0..self.corners.len() {
            let next = (here + 1) % self.corners.len();
            let (h, k) = (heights[here], heights[next]);
            if h >= -thickness {
                sides[0].push(self.corners[here]);
            }
            if h <= thickness {
                sides[1].push(self.corners[here]);
            }
            if h.abs() > thickness && k.abs() > thickness && (h > 0.0) != (k > 0.0) {
                let met = between(self.corners[here], self.corners[next], h / (h - k));
                sides[0].push(met);
                sides[1].push(met);
            }
        }
        sides.map(|corners| Self { corners, ..*self })
    }
}

fn between(a: (DVec3, [f64; 3]), b: (DVec3, [f64; 3]), share: f64) -> (DVec3, [f64; 3]) {
    (a.0.lerp(b.0, share), std::array::from_fn(|i| a.1[i] + share * (b.1[i] - a.1[i])))
}

struct Partition {
    nodes: Vec<Node>,
    /// The pieces that lie in the plane of each node.
    within: Vec<Vec<Polygon>>,
}

impl Partition {
    fn new(pieces: Vec<Polygon>, thickness: f64, most: Option<usize>, progress: Progress) -> Result<Self> {
        let mut partition = Self { nodes: Vec::new(), within: Vec::new() };
        let whole = pieces.len();
        let limit = most.unwrap_or(whole + MOST_CUTS);
        let mut count = whole;
        // Pieces still to divide, with their parent node and side. Breadth first: all regions get some of the cuts.
        let mut waiting = VecDeque::from([(pieces, None)]);
        while let Some((pieces, parent)) = waiting.pop_front() {
            // The number of cuts is unknown in advance.
            progress.tell("order", 0.0)?;
            let Some(best) = best_plane(&pieces, thickness) else { continue };
            let Polygon { normal, offset, .. } = pieces[best];
            let number = partition.add((normal, offset), parent);
            let mut sides = [Vec::new(), Vec::new()];
            for (index, piece) in pieces.into_iter().enumerate() {
                match piece.side(normal, offset, thickness) {
                    // The plane's own piece belongs to it in spite of rounding.
                    _ if index == best => partition.within[number].push(piece),
                    Side::Within => partition.within[number].push(piece),
                    Side::Front => sides[0].push(piece),
                    Side::Back => sides[1].push(piece),
                    Side::Across if count < limit => {
                        let [front, back] = piece.cut(normal, offset, thickness);
                        sides[0].push(front);
                        sides[1].push(back);
                        count += 1;
                    }
                    Side::Across if most.is_none() => return Err(too_many_cuts(whole)),
                    Side::Across => sides[usize::from(!piece.middle_in_front(normal, offset))].push(piece),
                }
            }
            waiting.extend(sides.into_iter().enumerate().map(|(side, pieces)| (pieces, Some((number, side)))));
        }
        Ok(partition)
    }

    fn add(&mut self, (normal, offset): (DVec3, f64), parent: Option<(usize, usize)>) -> usize {
        let number = self.nodes.len();
        self.nodes.push(Node { normal, offset, children: [None, None], triangles: 0..0 });
        self.within.push(Vec::new());
        if let Some((parent, side)) = parent {
            self.nodes[parent].children[side] = Some(number as u32);
        }
        number
    }

    /// Triangulates the pieces, in draw order for a far eye in the direction `toward`.
    fn ordered(self, toward: DVec3) -> BlendOrder {
        let Self { mut nodes, within } = self;
        let (mut corners, mut triangles) = (Vec::new(), Vec::new());
        for number in walk(&nodes, |node| node.normal.dot(toward) > 0.0) {
            let first = triangles.len() as u32;
            for piece in &within[number as usize] {
                let start = corners.len() as u32;
                corners.extend(piece.corners.iter().map(|&(_, weights)| Corner { source: piece.source, weights }));
                let fan = 1..piece.corners.len() as u32 - 1;
                triangles.extend(fan.map(|second| [start, start + second, start + second + 1]));
            }
            nodes[number as usize].triangles = first..triangles.len() as u32;
        }
        BlendOrder { corners, triangles, nodes }
    }
}

fn too_many_cuts(triangles: usize) -> Error {
    Error::invalid(format!(
        "the exact order of {triangles} triangles needs more than {MOST_CUTS} cuts, the limit: set `most`, the number of pieces at which \
         cutting stops and the order becomes approximate, or give fewer triangles that cross one another"
    ))
}

/// Returns the piece with the plane of lowest cost (cuts and imbalance); `None` without pieces.
fn best_plane(pieces: &[Polygon], thickness: f64) -> Option<usize> {
    let tried = (0..pieces.len()).step_by(pieces.len().div_ceil(TRIED).max(1));
    let cost = |plane: &Polygon| {
        let mut counts = [0usize; 4];
        for piece in pieces {
            counts[piece.side(plane.normal, plane.offset, thickness) as usize] += 1;
        }
        let [front, back, _, cut] = counts;
        CUT_WEIGHT * cut + front.abs_diff(back)
    };
    tried.min_by_key(|&plane| cost(&pieces[plane]))
}
