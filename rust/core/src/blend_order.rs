//! In which order blended triangles are drawn, from wherever they are looked at: a binary space partition.
//!
//! What is blended has to be drawn from back to front, and billboards cross one another, so no order of whole ones is right. Each node
//! of the tree has the plane of one triangle; what crosses it is cut in two, and what lies in it stays there. Then from any eye the far side of
//! a node is drawn before its own triangles, and these before the near side (Fuchs, Kedem and Naylor, "On visible surface generation by a
//! priori tree structures", SIGGRAPH 1980). The order is exact for the places that the triangles have here; where billboards move, as
//! they do while they morph to another level, it is that of where they came from.
//!
//! The plane of a node is the best of some that are evenly spread among its triangles: few cuts, and both sides alike. Building takes
//! O(p log p) for p pieces where cuts are few; there may be O(n²) of them for n triangles, so behind a number of pieces that is given nothing is cut
//! any more, but goes where its middle lies, and is drawn in about the right order only.

use std::collections::VecDeque;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::progress::Progress;

/// How many planes are tried for a node.
const TRIED: usize = 12;

/// What a cut weighs beside a triangle that one side has more than the other.
const CUT_WEIGHT: usize = 6;

/// How near to a plane, as a share of the extent of all, a corner counts as lying in it: some roundings of single precision.
const THICKNESS: f64 = 2e-6;

/// A corner of a piece: it lies in the triangle that it was cut from, at these barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// The triangle, as it was given.
    pub source: u32,
    /// Of the triangle's three corners; not negative, and 1 together.
    pub weights: [f64; 3],
}

/// A plane with what lies in it and on its two sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// n · x = d, with n of length 1.
    pub normal: DVec3,
    /// d.
    pub offset: f64,
    /// The node of what lies where n · x > d, and of what lies where n · x < d.
    pub children: [Option<u32>; 2],
    /// The triangles that lie in it.
    pub triangles: std::ops::Range<u32>,
}

/// Pieces of triangles, and the tree by which they are ordered; node 0 is its root.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlendOrder {
    /// The corners of the pieces; no two pieces share one.
    pub corners: Vec<Corner>,
    /// Three corners each, wound as the triangles that they were cut from; in the order for an eye far away where it was asked for.
    pub triangles: Vec<[u32; 3]>,
    /// All planes.
    pub nodes: Vec<Node>,
}

impl BlendOrder {
    /// The tree of `triangles`, which are in order in the list for an eye far away in the direction `toward`. Behind `most` pieces, nothing is cut
    /// any more. Triangles without area show nothing and are left out.
    ///
    /// # Errors
    /// A corner or the direction that is not finite; [`Error::Cancelled`].
    pub fn new(triangles: &[[DVec3; 3]], toward: DVec3, most: usize, progress: Progress) -> Result<Self> {
        if let Some(at) = triangles.iter().position(|corners| !corners.iter().all(|p| p.is_finite())) {
            return Err(Error::invalid(format!("triangle {at} has a corner that is not finite")));
        }
        if !toward.is_finite() {
            return Err(Error::invalid(format!("the eye is toward {:?}; it must be finite", toward.to_array())));
        }
        let thickness = THICKNESS * extent(triangles);
        let pieces: Vec<Piece> = (0u32..).zip(triangles).filter_map(|(i, t)| Piece::whole(i, t, thickness)).collect();
        Ok(Partition::new(pieces, thickness, most, progress)?.ordered(toward))
    }

    /// The nodes from the farthest to the nearest, as an eye sees them that lies where `side` of a node's normal and offset is positive.
    pub fn walk(&self, side: impl Fn(&Node) -> bool) -> Vec<u32> {
        walk(&self.nodes, |node| side(node))
    }
}

/// The half of the diagonal of the box around all corners.
fn extent(triangles: &[[DVec3; 3]]) -> f64 {
    let corners = || triangles.iter().flatten().copied();
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    if triangles.is_empty() { 0.0 } else { 0.5 * (high - low).length() }
}

fn walk(nodes: &[Node], in_front: impl Fn(&Node) -> bool) -> Vec<u32> {
    // A node is met twice: first its far side is put before it, then it is drawn.
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

/// A convex polygon that was cut from a triangle.
#[derive(Clone, Debug)]
struct Piece {
    source: u32,
    normal: DVec3,
    offset: f64,
    corners: Vec<(DVec3, [f64; 3])>,
}

/// Where a piece lies to a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Front,
    Back,
    Within,
    Across,
}

impl Piece {
    /// The triangle; `None` when it is nowhere thicker than `thickness`.
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

    /// On which side the middle of its corners lies.
    fn middle_in_front(&self, normal: DVec3, offset: f64) -> bool {
        self.heights(normal, offset).iter().sum::<f64>() >= 0.0
    }

    /// What lies in front of the plane and behind it.
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
    /// What lies in each.
    within: Vec<Vec<Piece>>,
}

impl Partition {
    fn new(pieces: Vec<Piece>, thickness: f64, most: usize, progress: Progress) -> Result<Self> {
        let mut partition = Self { nodes: Vec::new(), within: Vec::new() };
        let mut count = pieces.len();
        // What still has to be divided, and whose child it becomes. Planes through much of it come first: all get some of the cuts.
        let mut waiting = VecDeque::from([(pieces, None)]);
        while let Some((pieces, parent)) = waiting.pop_front() {
            // How many cuts are to come is unknown.
            progress.tell("order", 0.0)?;
            let Some(best) = best_plane(&pieces, thickness) else { continue };
            let Piece { normal, offset, .. } = pieces[best];
            let number = partition.add((normal, offset), parent);
            let mut sides = [Vec::new(), Vec::new()];
            for (index, piece) in pieces.into_iter().enumerate() {
                match piece.side(normal, offset, thickness) {
                    // Its own plane holds it, however it is rounded.
                    _ if index == best => partition.within[number].push(piece),
                    Side::Within => partition.within[number].push(piece),
                    Side::Front => sides[0].push(piece),
                    Side::Back => sides[1].push(piece),
                    Side::Across if count < most => {
                        let [front, back] = piece.cut(normal, offset, thickness);
                        sides[0].push(front);
                        sides[1].push(back);
                        count += 1;
                    }
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

    /// The pieces as triangles, in the order for an eye far away in this direction.
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

/// The piece whose plane cuts few others, and leaves about as many on one side as on the other. `None` when there are none.
fn best_plane(pieces: &[Piece], thickness: f64) -> Option<usize> {
    let tried = (0..pieces.len()).step_by(pieces.len().div_ceil(TRIED).max(1));
    let cost = |plane: &Piece| {
        let mut counts = [0usize; 4];
        for piece in pieces {
            counts[piece.side(plane.normal, plane.offset, thickness) as usize] += 1;
        }
        let [front, back, _, cut] = counts;
        CUT_WEIGHT * cut + front.abs_diff(back)
    };
    tried.min_by_key(|&plane| cost(&pieces[plane]))
}
