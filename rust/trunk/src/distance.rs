//! The one-sided Hausdorff distance between two surfaces, at samples.
//!
//! Aspert, Santa-Cruz and Ebrahimi, "MESH: Measuring errors between surfaces using the Hausdorff distance", 2002: samples on a grid
//! over every triangle; an R*-tree finds the nearest point of each on the other surface. The distance to a surface changes no faster than
//! the position, so between samples it exceeds the measured distance by at most their spacing.

use glam::DVec3;
use rayon::prelude::*;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

/// Most steps between samples along an edge, so that a few large triangles among many small ones do not take all the time.
const MOST_STEPS: usize = 16;

/// A triangle in space; degenerate triangles have distances, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle(pub [DVec3; 3]);

/// Distance of a triangle from a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Far {
    /// Distance of its farthest sample.
    pub distance: f64,
    /// The corner nearest to that sample.
    pub corner: DVec3,
}

/// Returns the distance of each triangle of `from` from `to`. Samples are at most `spacing` apart if [`MOST_STEPS`] allows it. The distance
/// from an empty surface is infinite.
pub fn farthest(from: &[Triangle], to: &[Triangle], spacing: f64) -> Vec<Far> {
    let tree = RTree::bulk_load(to.to_vec());
    let distance = |p: DVec3| tree.nearest_neighbor(&p.to_array()).map_or(f64::INFINITY, |t| p.distance(t.nearest(p)));
    let of_triangle = |t: &Triangle| {
        let samples = t.samples(spacing).map(|p| (distance(p), p));
        let (distance, sample) = samples.fold((0.0, t.0[0]), |most, far| if far.0 > most.0 { far } else { most });
        Far { distance, corner: t.nearest_corner(sample) }
    };
    from.par_iter().map(of_triangle).collect()
}

impl Triangle {
    /// Returns whether the triangle is not degenerate.
    pub fn has_area(&self) -> bool {
        let [a, b, c] = self.0;
        (b - a).cross(c - a) != DVec3::ZERO
    }

    /// Returns the point of the triangle nearest to `p` (Ericson, "Real-Time Collision Detection", 5.1.5).
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        let [a, b, c] = self.0;
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        let inside = |from: DVec3, to: DVec3| normal.dot((to - from).cross(p - from)) >= 0.0;
        if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
            return p - normal * (normal.dot(p - a) / normal.length_squared());
        }
        let on_edges = [nearest_on_edge(a, b, p), nearest_on_edge(b, c, p), nearest_on_edge(c, a, p)];
        Self(on_edges).nearest_corner(p)
    }

    fn nearest_corner(&self, p: DVec3) -> DVec3 {
        let [a, b, c] = self.0;
        let nearer = |x: DVec3, y: DVec3| if y.distance_squared(p) < x.distance_squared(p) { y } else { x };
        nearer(nearer(a, b), c)
    }

    /// Returns a grid of points over the triangle, including its corners.
    fn samples(&self, spacing: f64) -> impl Iterator<Item = DVec3> {
        let [a, b, c] = self.0;
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let steps = ((longest / spacing).ceil() as usize).clamp(1, MOST_STEPS);
        let share = move |i: usize| i as f64 / steps as f64;
        (0..=steps).flat_map(move |i| (0..=steps - i).map(move |j| a + (b - a) * share(i) + (c - a) * share(j)))
    }
}

fn nearest_on_edge(a: DVec3, b: DVec3, p: DVec3) -> DVec3 {
    let along = b - a;
    let length = along.length_squared();
    if length > 0.0 { a + along * ((p - a).dot(along) / length).clamp(0.0, 1.0) } else { a }
}

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        AABB::from_points(self.0.map(|p| p.to_array()).iter())
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, point: &[f64; 3]) -> f64 {
        let p = DVec3::from_array(*point);
        p.distance_squared(self.nearest(p))
    }
}
