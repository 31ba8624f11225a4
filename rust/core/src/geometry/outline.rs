//! Outlines: the rectangle of least area around points of a plane.
//!
//! One side of the least rectangle lies on an edge of the convex hull (Freeman and Shapira, 1975). Testing each edge of the hull (Andrew's
//! monotone chain, O(n log n); then O(h²) for a small h) finds it exactly.

use glam::DVec2;

/// A rectangle in a plane. The axes are `x` and its left normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Unit vector of the first axis. The second axis is the first turned by +90°.
    pub x: DVec2,
    /// Least coordinates along the axes.
    pub low: DVec2,
    /// Greatest coordinates along the axes.
    pub high: DVec2,
}

impl Outline {
    /// Returns width and height of the rectangle; either may be 0 (points on a line, a single point).
    #[must_use]
    pub fn size(&self) -> DVec2 {
        self.high - self.low
    }

    /// Returns the area of the rectangle.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.size().x * self.size().y
    }

    /// Returns the same outline with axes turned by 90°, which swaps width and height.
    #[must_use]
    pub fn turned(&self) -> Self {
        Self { x: self.x.perp(), low: DVec2::new(self.low.y, -self.high.x), high: DVec2::new(self.high.y, -self.low.x) }
    }

    /// Returns the rectangle around `points` with the unit vector `x` as first axis.
    #[must_use]
    pub fn along(points: &[DVec2], x: DVec2) -> Self {
        let (low, high) = bounds(points, x);
        Self { x, low, high }
    }
}

fn bounds(points: &[DVec2], x: DVec2) -> (DVec2, DVec2) {
    let local = |p: &DVec2| DVec2::new(x.dot(*p), x.perp().dot(*p));
    let grow = |(low, high): (DVec2, DVec2), p: DVec2| (low.min(p), high.max(p));
    points.iter().map(local).fold((DVec2::INFINITY, DVec2::NEG_INFINITY), grow)
}

/// Returns the rectangle of least area around `points` (at least one, all finite). Among equals, the first along the hull wins.
///
/// # Panics
/// Without points: a billboard always has triangles.
#[must_use]
pub fn minimum_rectangle(points: &[DVec2]) -> Outline {
    assert!(!points.is_empty(), "an outline needs a point");
    let hull = convex_hull(points);
    let edges = (0..hull.len()).filter_map(|i| (hull[(i + 1) % hull.len()] - hull[i]).try_normalize());
    edges
        .map(|x| Outline::along(&hull, x))
        .reduce(|best, next| if next.area() < best.area() { next } else { best })
        .unwrap_or_else(|| Outline::along(&hull, DVec2::X))
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
