//! Outlines: the rectangle of least area around points of a plane, or a convex polygon of few corners.
//!
//! One side of the least rectangle lies on an edge of the convex hull (Freeman and Shapira, 1975). Testing each edge of the hull (Andrew's
//! monotone chain, O(n log n); then O(h²) for a small h) finds it exactly. A polygon starts as the hull and loses edges until few enough
//! are left (O(h²)): removing an edge extends its two neighbors until they meet, and the edge that adds the least area goes first. This is
//! greedy: the least polygon can be smaller.

use glam::DVec2;

/// A convex polygon in a plane and the rectangle that its texture fills. The axes are `x` and its left normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Unit vector of the first axis. The second axis is the first turned by +90°.
    pub x: DVec2,
    /// Least coordinates along the axes.
    pub low: DVec2,
    /// Greatest coordinates along the axes.
    pub high: DVec2,
    /// The corners along the axes, counter-clockwise.
    pub corners: Vec<DVec2>,
}

impl Outline {
    /// Returns width and height of the rectangle; either may be 0 (points on a line, a single point).
    #[must_use]
    pub fn size(&self) -> DVec2 {
        self.high - self.low
    }

    /// Returns the area of the polygon.
    #[must_use]
    pub fn area(&self) -> f64 {
        polygon_area(&self.corners)
    }

    /// Returns the same outline with axes turned by 90°, which swaps width and height.
    #[must_use]
    pub fn turned(&self) -> Self {
        Self {
            x: self.x.perp(),
            low: DVec2::new(self.low.y, -self.high.x),
            high: DVec2::new(self.high.y, -self.low.x),
            corners: self.corners.iter().map(|p| DVec2::new(p.y, -p.x)).collect(),
        }
    }

    /// Returns the rectangle around `points` with the unit vector `x` as first axis.
    #[must_use]
    pub fn along(points: &[DVec2], x: DVec2) -> Self {
        let (low, high) = bounds(points, x);
        let corners = vec![low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        Self { x, low, high, corners }
    }

    /// Returns the outline of the polygon `corners`, with the least rectangle around it.
    fn around(corners: &[DVec2]) -> Self {
        let mut outline = minimum_rectangle(corners);
        let x = outline.x;
        outline.corners = corners.iter().map(|p| DVec2::new(x.dot(*p), x.perp().dot(*p))).collect();
        outline
    }
}

fn bounds(points: &[DVec2], x: DVec2) -> (DVec2, DVec2) {
    let local = |p: &DVec2| DVec2::new(x.dot(*p), x.perp().dot(*p));
    let grow = |(low, high): (DVec2, DVec2), p: DVec2| (low.min(p), high.max(p));
    points.iter().map(local).fold((DVec2::INFINITY, DVec2::NEG_INFINITY), grow)
}

fn polygon_area(corners: &[DVec2]) -> f64 {
    let Some(&first) = corners.first() else { return 0.0 };
    corners.windows(2).map(|pair| (pair[0] - first).perp_dot(pair[1] - first)).sum::<f64>() / 2.0
}

/// Returns the rectangle of least area around `points` (at least one, all finite). Among equals, the first along the hull wins.
///
/// # Panics
/// Without points: a billboard always has triangles.
#[must_use]
pub fn minimum_rectangle(points: &[DVec2]) -> Outline {
    assert!(!points.is_empty(), "an outline needs a point");
    let hull = convex_hull(points);
    let area = |o: &Outline| o.size().x * o.size().y;
    let edges = (0..hull.len()).filter_map(|i| (hull[(i + 1) % hull.len()] - hull[i]).try_normalize());
    edges
        .map(|x| Outline::along(&hull, x))
        .reduce(|best, next| if area(&next) < area(&best) { next } else { best })
        .unwrap_or_else(|| Outline::along(&hull, DVec2::X))
}

/// Returns a convex outline around `points` with exactly `corners` corners (at least 3); with 4, the rectangle of least area. If the points
/// need fewer corners, edges are split.
///
/// # Panics
/// Without points.
#[must_use]
pub fn convex_outline(points: &[DVec2], corners: usize) -> Outline {
    let rectangle = minimum_rectangle(points);
    if corners == 4 {
        return rectangle;
    }
    let mut polygon = convex_hull(points);
    if polygon.len() < 3 || rectangle.size().min_element() <= 0.0 {
        return simple(rectangle, corners); // a point or a segment
    }
    while polygon.len() > corners {
        let Some(at) = cheapest_edge(&polygon) else { break };
        let (corner, next) = (beyond(&polygon, at).expect("its neighbors meet").0, (at + 1) % polygon.len());
        polygon[at] = corner;
        polygon.remove(next);
    }
    let outline = Outline::around(&polygon);
    let simple = simple(rectangle, corners);
    let better = polygon.len() <= corners && outline.area() < simple.area();
    if better { with_corners(outline, corners) } else { simple }
}

/// Returns the rectangle with extra corners, or for 3 corners a right triangle around it.
fn simple(rectangle: Outline, corners: usize) -> Outline {
    if corners >= 4 {
        return with_corners(rectangle, corners);
    }
    let (low, size) = (rectangle.low, rectangle.size());
    let triangle = vec![low, low + DVec2::new(2.0 * size.x, 0.0), low + DVec2::new(0.0, 2.0 * size.y)];
    Outline { high: low + 2.0 * size, corners: triangle, ..rectangle }
}

/// Splits the longest edge that does not touch the first corner until the polygon has enough corners. A fan from the first corner then has
/// no triangle without area.
fn with_corners(mut outline: Outline, corners: usize) -> Outline {
    let polygon = &mut outline.corners;
    while polygon.len() < corners {
        let length = |i: usize| polygon[i].distance(polygon[i + 1]);
        let longest = (1..polygon.len() - 1).reduce(|a, b| if length(b) > length(a) { b } else { a });
        let at = longest.expect("a polygon has three corners");
        polygon.insert(at + 1, (polygon[at] + polygon[at + 1]) / 2.0);
    }
    outline
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

fn cheapest_edge(polygon: &[DVec2]) -> Option<usize> {
    let costs = (0..polygon.len()).filter_map(|at| Some((beyond(polygon, at)?.1, at)));
    costs.reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, at)| at)
}

/// Returns the convex hull, counter-clockwise, without collinear points.
#[must_use]
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let chain = |points: &mut dyn Iterator<Item = &DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for &p in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp_dot(p - b) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter());
    hull.extend(chain(&mut sorted.iter().rev()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn v(x: f64, y: f64) -> DVec2 {
        DVec2::new(x, y)
    }

    #[test]
    fn a_turned_rectangle_is_found() {
        // 4 × 2 along (3, 4)/5, with points inside and on the edges.
        let x = v(0.6, 0.8);
        let at = |a: f64, b: f64| x * a + x.perp() * b;
        let points = [at(0., 0.), at(4., 0.), at(4., 2.), at(0., 2.), at(1., 1.), at(2., 0.)];
        let size = minimum_rectangle(&points).size();
        assert!((size.max_element() - 4.0).abs() < 1e-12 && (size.min_element() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn points_and_segments_have_no_area() {
        assert_eq!(minimum_rectangle(&[v(3.0, 4.0); 5]).size(), v(0.0, 0.0));
        let segment = minimum_rectangle(&[v(0.0, 0.0), v(3.0, 4.0), v(1.5, 2.0)]).size();
        assert!((segment.x - 5.0).abs() < 1e-12 && segment.y.abs() < 1e-12);
    }

    #[test]
    fn corners_of_a_hexagon_and_fewer() {
        let hexagon: Vec<DVec2> =
            (0..6).map(|i| DVec2::from_angle(std::f64::consts::FRAC_PI_3 * f64::from(i))).collect();
        let area = |corners| convex_outline(&hexagon, corners).area();
        let whole = 1.5 * 3f64.sqrt();
        assert!((area(6) - whole).abs() < 1e-12);
        // Removing an edge adds a triangle: a sixth of the hexagon.
        assert!((area(5) - whole * 7.0 / 6.0).abs() < 1e-12);
        assert!((area(4) - 2.0 * 3f64.sqrt()).abs() < 1e-12, "the rectangle");
        assert!((area(8) - whole).abs() < 1e-12, "edges are split");
    }

    #[test]
    fn turning_keeps_the_rectangle() {
        let outline = minimum_rectangle(&[v(0., 0.), v(4., 0.), v(4., 2.), v(0., 2.)]);
        let turned = outline.turned();
        assert_eq!(turned.size(), v(outline.size().y, outline.size().x));
        let corner = |o: &Outline| o.x * o.low.x + o.x.perp() * o.low.y;
        let far = |o: &Outline| o.x * o.high.x + o.x.perp() * o.low.y;
        assert!(far(&turned).distance(corner(&outline)) < 1e-12 || corner(&turned).distance(far(&outline)) < 1e-12);
    }

    proptest! {
        #[test]
        fn polygons_hold_all_and_have_their_corners(points in prop::collection::vec((-1.0..1.0, -1.0..1.0), 1..40), corners in 3usize..12) {
            let points: Vec<DVec2> = points.into_iter().map(|(x, y): (f64, f64)| v(x, y)).collect();
            let o = convex_outline(&points, corners);
            prop_assert_eq!(o.corners.len(), corners);
            for p in &points {
                let q = v(o.x.dot(*p), o.x.perp().dot(*p));
                for i in 0..corners {
                    let (a, b) = (o.corners[i], o.corners[(i + 1) % corners]);
                    prop_assert!((b - a).perp_dot(q - a) >= -1e-9, "{} is outside", q);
                }
            }
            prop_assert!(o.area() >= -1e-12);
            let (low, high) = bounds(&o.corners, DVec2::X);
            prop_assert!(low.distance(o.low) < 1e-9 && high.distance(o.high) < 1e-9);
            prop_assert!(corners < 4 || o.area() <= minimum_rectangle(&points).area() + 1e-12);
        }

        #[test]
        fn holds_all_and_is_no_larger_than_the_box(points in prop::collection::vec((-1.0..1.0, -1.0..1.0), 1..40)) {
            let points: Vec<DVec2> = points.into_iter().map(|(x, y): (f64, f64)| v(x, y)).collect();
            let o = minimum_rectangle(&points);
            for p in &points {
                let q = v(o.x.dot(*p), o.x.perp().dot(*p));
                prop_assert!(q.cmpge(o.low - 1e-12).all() && q.cmple(o.high + 1e-12).all());
            }
            let aligned = Outline::along(&points, DVec2::X).size();
            prop_assert!(o.size().x * o.size().y <= aligned.x * aligned.y + 1e-12);
        }
    }
}
