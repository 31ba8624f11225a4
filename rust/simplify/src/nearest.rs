//! The nearest point of a set of triangles.

use glam::DVec3;

/// Triangles in a block. Blocks farther away than the nearest point so far are skipped.
const BLOCK: usize = 16;

/// Triangles in blocks with their bounding boxes, in the given order: triangles that follow one another should be near one another.
pub struct Triangles {
    corners: Vec<[DVec3; 3]>,
    boxes: Vec<(DVec3, DVec3)>,
}

impl Triangles {
    /// Takes at least one triangle.
    pub fn new(corners: Vec<[DVec3; 3]>) -> Self {
        let bounds = |block: &[[DVec3; 3]]| {
            let points = block.as_flattened().iter();
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
        };
        Self { boxes: corners.chunks(BLOCK).map(bounds).collect(), corners }
    }

    /// Returns the point of the triangles that is nearest to `p`; of several, one of the first triangle. O(t) at worst.
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        let (mut best, mut least) = (self.corners[0][0], f64::INFINITY);
        for (block, (low, high)) in self.corners.chunks(BLOCK).zip(&self.boxes) {
            if p.clamp(*low, *high).distance_squared(p) >= least {
                continue;
            }
            for triangle in block {
                let point = in_triangle(p, *triangle);
                let distance = point.distance_squared(p);
                if distance < least {
                    (best, least) = (point, distance);
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
    fn blocks_leave_nothing_out() {
        // A row of separate triangles at x = 0, 10, 20 …, and points beside each of them.
        let triangles = (0..100).map(|i| CORNERS.map(|p| p + DVec3::X * f64::from(10 * i))).collect();
        let triangles = Triangles::new(triangles);
        for i in 0..100 {
            let at = DVec3::X * f64::from(10 * i);
            assert_eq!(triangles.nearest(at + DVec3::new(1.0, 1.0, -2.0)), at + DVec3::new(1.0, 1.0, 0.0));
        }
    }
}
