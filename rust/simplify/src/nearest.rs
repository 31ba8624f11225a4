//! The nearest point of a set of triangles, by a tree of bounding boxes.

use glam::DVec3;

/// Most triangles of a box that is not divided.
const FEW: usize = 8;

/// Triangles in a tree of boxes, each divided at the median of the triangles' middles along its longest side.
pub struct Triangles {
    /// In the order of the tree.
    corners: Vec<[DVec3; 3]>,
    /// A box is followed by its first half.
    boxes: Vec<Bounds>,
}

struct Bounds {
    low: DVec3,
    high: DVec3,
    content: Content,
}

enum Content {
    /// The number of the box of the second half.
    Halves(usize),
    /// Triangles.
    Few(std::ops::Range<usize>),
}

impl Bounds {
    fn distance_squared(&self, p: DVec3) -> f64 {
        p.clamp(self.low, self.high).distance_squared(p)
    }
}

impl Triangles {
    /// Takes at least one triangle. O(t log² t).
    pub fn new(corners: Vec<[DVec3; 3]>) -> Self {
        let count = corners.len();
        let mut triangles = Self { corners, boxes: Vec::new() };
        triangles.divide(0..count);
        triangles
    }

    fn divide(&mut self, range: std::ops::Range<usize>) {
        let points = self.corners[range.clone()].as_flattened().iter();
        let (low, high) =
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
        let number = self.boxes.len();
        self.boxes.push(Bounds { low, high, content: Content::Few(range.clone()) });
        if range.len() <= FEW {
            return;
        }
        let longest = (high - low).max_position();
        let middle = |[a, b, c]: &[DVec3; 3]| (*a + *b + *c)[longest];
        // Stable, so that equal middles keep their order.
        self.corners[range.clone()].sort_by(|a, b| middle(a).total_cmp(&middle(b)));
        let half = range.start + range.len() / 2;
        self.divide(range.start..half);
        self.boxes[number].content = Content::Halves(self.boxes.len());
        self.divide(half..range.end);
    }

    /// Returns the point of the triangles that is nearest to `p`; of several, always the same. O(log t) for triangles of even sizes.
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        self.nearest_within(p, f64::INFINITY, |_| false).unwrap_or(self.corners[0][0])
    }

    /// Returns whether a point of the triangles is no farther than `distance` from `p`.
    pub fn reach(&self, p: DVec3, distance: f64) -> bool {
        let most = distance * distance;
        self.nearest_within(p, most * (1.0 + 4.0 * f64::EPSILON), |found| found <= most)
            .is_some_and(|q| q.distance(p) <= distance)
    }

    /// Returns the nearest point at a squared distance below `least`, or the first one that is near `enough`.
    fn nearest_within(&self, p: DVec3, mut least: f64, enough: impl Fn(f64) -> bool) -> Option<DVec3> {
        let mut best = None;
        let mut waiting = vec![0];
        while let Some(number) = waiting.pop() {
            let bounds = &self.boxes[number];
            if bounds.distance_squared(p) >= least {
                continue;
            }
            match &bounds.content {
                Content::Halves(second) => {
                    let halves = [number + 1, *second];
                    let [first, other] = halves.map(|half| self.boxes[half].distance_squared(p));
                    // The nearer one is taken from the end.
                    waiting.extend(if first <= other { [halves[1], halves[0]] } else { halves });
                }
                Content::Few(range) => {
                    for triangle in &self.corners[range.clone()] {
                        let point = in_triangle(p, *triangle);
                        let distance = point.distance_squared(p);
                        if distance < least {
                            (best, least) = (Some(point), distance);
                            if enough(distance) {
                                return best;
                            }
                        }
                    }
                }
            }
        }
        best
    }
}

/// Returns the point of a triangle that is nearest to `p` (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
pub fn in_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let [d1, d2] = [ab, ac].map(|side| side.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let [d3, d4] = [ab, ac].map(|side| side.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let of_c = d1 * d4 - d3 * d2;
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * share(d1, d1 - d3);
    }
    let [d5, d6] = [ab, ac].map(|side| side.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let of_b = d5 * d2 - d1 * d6;
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * share(d2, d2 - d6);
    }
    let of_a = d3 * d6 - d5 * d4;
    if of_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * share(d4 - d3, (d4 - d3) + (d5 - d6));
    }
    let sum = of_a + of_b + of_c;
    a + ab * share(of_b, sum) + ac * share(of_c, sum)
}

/// Returns `part / whole`; 0 if the whole is 0, as in a triangle without area.
fn share(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 0.0 } else { part / whole }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 3.0, 0.0)];

    #[test]
    fn each_region_of_a_right_triangle() {
        let near = |x: f64, y: f64| in_triangle(DVec3::new(x, y, 7.0), CORNERS);
        assert_eq!(near(1.0, 1.0), DVec3::new(1.0, 1.0, 0.0), "above the face");
        assert_eq!(near(-1.0, -2.0), CORNERS[0]);
        assert_eq!(near(9.0, -1.0), CORNERS[1]);
        assert_eq!(near(-1.0, 9.0), CORNERS[2]);
        assert_eq!(near(1.0, -5.0), DVec3::new(1.0, 0.0, 0.0));
        assert_eq!(near(-5.0, 1.0), DVec3::new(0.0, 1.0, 0.0));
        // The foot of (4, 3) on the hypotenuse 3x + 4y = 12.
        assert!(near(4.0, 3.0).distance(DVec3::new(2.56, 1.08, 0.0)) < 1e-12);
    }

    #[test]
    fn a_triangle_without_area_is_a_line() {
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert_eq!(in_triangle(DVec3::new(0.5, 1.0, 0.0), line), DVec3::X * 0.5);
        assert_eq!(in_triangle(DVec3::ONE, [DVec3::X; 3]), DVec3::X);
    }

    #[test]
    fn boxes_leave_nothing_out() {
        // A row of separate triangles at x = 0, 10, 20 …, and points beside each of them.
        let triangles = (0..100).map(|i| CORNERS.map(|p| p + DVec3::X * f64::from(10 * i))).collect();
        let triangles = Triangles::new(triangles);
        for i in 0..100 {
            let at = DVec3::X * f64::from(10 * i);
            let beside = at + DVec3::new(1.0, 1.0, -2.0);
            assert_eq!(triangles.nearest(beside), at + DVec3::new(1.0, 1.0, 0.0));
            assert!(triangles.reach(beside, 2.0) && !triangles.reach(beside, 1.999));
        }
    }
}
