//! Convex polygons of few corners: clipped to half-planes, and reduced edge by edge.

use glam::DVec2;

/// The points p with normal · p ≤ offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HalfPlane {
    /// Unit vector.
    pub normal: DVec2,
    pub offset: f64,
}

impl HalfPlane {
    fn height(&self, p: DVec2) -> f64 {
        self.normal.dot(p) - self.offset
    }
}

/// Polygons with corners nearer to each other than this lose one of them, texels.
const SAME: f64 = 1e-7;

/// Tolerance of a corner on a half-plane's edge, texels.
const ON_LINE: f64 = 1e-6;

/// A convex polygon and its measures.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    pub corners: Vec<DVec2>,
    pub area: f64,
    /// Length of all edges of the fan of triangles from the first corner, inner edges twice.
    pub edges: f64,
}

impl Shape {
    pub fn new(corners: Vec<DVec2>) -> Self {
        let first = corners[0];
        let fan = || corners[1..].windows(2).map(|pair| [pair[0], pair[1]]);
        let area = fan().map(|[b, c]| (b - first).perp_dot(c - first)).sum::<f64>() / 2.0;
        let edges = fan().map(|[b, c]| first.distance(b) + b.distance(c) + c.distance(first)).sum();
        Self { corners, area, edges }
    }

    pub fn triangles(&self) -> usize {
        self.corners.len() - 2
    }
}

/// Returns the part of a convex polygon in a half-plane; fewer than three corners if there is none.
pub(super) fn clipped(polygon: &[DVec2], line: HalfPlane) -> Vec<DVec2> {
    let mut inside = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (a, b) = (line.height(p), line.height(q));
        if a <= 0.0 {
            inside.push(p);
        }
        if a * b < 0.0 {
            inside.push(p + (q - p) * (a / (a - b)));
        }
    }
    inside.dedup_by(|a, b| a.distance(*b) < SAME);
    while inside.len() > 1 && inside[0].distance(inside[inside.len() - 1]) < SAME {
        inside.pop();
    }
    inside
}

/// Least slope of an edge against a line, as a sine, along which [`widened`] moves its corner.
const STEEP: f64 = 0.1;

/// Returns a convex polygon with its edge on `line` moved outward by a distance: its neighbors get longer. Corners that would leave the
/// half-planes of `frame` stay, and so do those of neighbors nearly parallel to the line. A polygon that would not be convex stays as it is.
pub(super) fn widened(polygon: Vec<DVec2>, line: HalfPlane, by: f64, frame: &[HalfPlane]) -> Vec<DVec2> {
    let wider = moved_outward(polygon.clone(), line, by, frame);
    if is_convex(&wider) { wider } else { polygon }
}

fn is_convex(polygon: &[DVec2]) -> bool {
    (0..polygon.len()).all(|i| {
        let [a, b, c] = [0, 1, 2].map(|k| polygon[(i + k) % polygon.len()]);
        (b - a).perp_dot(c - b) >= -SAME
    })
}

fn moved_outward(mut polygon: Vec<DVec2>, line: HalfPlane, by: f64, frame: &[HalfPlane]) -> Vec<DVec2> {
    let count = polygon.len();
    let on_line = |p: DVec2| line.height(p).abs() <= ON_LINE;
    let Some(at) = (0..count).find(|&i| on_line(polygon[i]) && on_line(polygon[(i + 1) % count])) else {
        return polygon;
    };
    for (corner, neighbor) in [(at, at + count - 1), ((at + 1) % count, at + 2)] {
        let along = (polygon[corner] - polygon[neighbor % count]).normalize_or_zero();
        let slope = line.normal.dot(along);
        let moved = polygon[corner] + along * (by / slope.max(STEEP));
        if slope >= STEEP && frame.iter().all(|line| line.height(moved) <= 0.0) {
            polygon[corner] = moved;
        }
    }
    polygon
}

/// Returns polygons of 3 to `most` corners around a convex polygon, within the half-planes; none if it has no area.
///
/// Edges leave one by one, the one that adds the least area first; its neighbors are extended until they meet.
pub(super) fn reduced(mut polygon: Vec<DVec2>, lines: &[HalfPlane], most: usize) -> Vec<Shape> {
    let mut shapes = Vec::new();
    if polygon.len() < 3 {
        return shapes;
    }
    let within = |p: DVec2| lines.iter().all(|line| line.height(p) <= ON_LINE);
    let removal = |polygon: &[DVec2], at: usize| beyond(polygon, at).filter(|(corner, _)| within(*corner));
    let mut removals: Vec<Option<(DVec2, f64)>> = (0..polygon.len()).map(|at| removal(&polygon, at)).collect();
    loop {
        if polygon.len() <= most {
            shapes.push(Shape::new(polygon.clone()));
        }
        if polygon.len() == 3 {
            return shapes;
        }
        let costs = removals.iter().enumerate().filter_map(|(at, removal)| Some((at, (*removal)?)));
        let Some((at, (corner, _))) = costs.reduce(|a, b| if b.1.1 < a.1.1 { b } else { a }) else { return shapes };
        let next = (at + 1) % polygon.len();
        polygon[at] = corner;
        polygon.remove(next);
        removals.remove(next);
        // The new corner changes its own edge and the edge before it, and the next edges of both.
        let count = polygon.len();
        let at = if next < at { at - 1 } else { at };
        for near in [at + count - 2, at + count - 1, at, at + 1].map(|i| i % count) {
            removals[near] = removal(&polygon, near);
        }
    }
}

/// Returns the intersection of the neighbors of edge `at` (from corner `at` to the next), extended as if the edge was removed, and the area
/// that this adds. `None` if they do not meet.
fn beyond(polygon: &[DVec2], at: usize) -> Option<(DVec2, f64)> {
    let count = polygon.len();
    let corner = |i: usize| polygon[i % count];
    let (a, b) = (corner(at), corner(at + 1));
    let (before, after) = (a - corner(at + count - 1), b - corner(at + 2));
    let turn = before.perp_dot(after);
    // The neighbors must converge beyond the edge: the outer angles at both ends sum to less than 180°.
    if turn >= -1e-12 * before.length() * after.length() {
        return None;
    }
    let meeting = a + before * ((b - a).perp_dot(after) / turn);
    Some((meeting, (meeting - a).perp_dot(b - a).abs() / 2.0))
}
