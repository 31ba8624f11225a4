//! Transition of a level to the next: the position of every corner at a = 1, and the law of a.
//!
//! Orthogonal projection keeps only the share cos = `|n·n_t|` of a tilted leaf's area: 0.70 over a whole maple. So the leaf is *laid* into
//! the plane instead, as if turned about its projected pivot. Its projection is stretched along the direction of steepest tilt, up to a
//! limit, to keep the leaf's area. The distance along the normal, bounded by ε, does not change. The motion within the plane is reported
//! separately.
//!
//! Collapsed leaves hide one another: the needles of a fir keep their areas, but their pictures lose 12 % of the covered pixels. So leaves may
//! [grow](Projection::grown) about their pivots as they collapse.

use glam::DVec3;
use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::error::Result;
use crate::foliage::{Foliage, area_vector};
use crate::geometry::Plane;
use crate::groups::{Groups, number_by_appearance};

/// The transition a at which the next level takes over: just below 1, because leaves in exactly one plane have no depth order.
pub const HAND_OVER: f64 = 0.998;

/// Share of its height over the plane that a point keeps at a = 1. Leaves that overlap in exactly one plane have no depth order. They
/// flicker in a depth buffer, and a ray that passes a transparent texel of one leaf passes all of them (a pine loses 6 % of its coverage in
/// Cycles). This small height is enough for an order, and less than 1e-5 R at ε = 0.04.
pub const DEPTH_ORDER: f64 = 1.0 / 4096.0;

/// Positions of a level at a = 1, in the foliage's local frame; one entry per triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    /// Positions of each triangle's corners at a = 1.
    pub targets: Vec<[DVec3; 3]>,
    /// The pivot of each triangle's leaf at a = 0: the area centroid of the leaf.
    pub pivots: Vec<DVec3>,
    /// Position of that pivot at a = 1.
    pub pivot_targets: Vec<DVec3>,
}

impl Projection {
    /// Lays every leaf into its plane. `stretch` ≥ 1 limits the stretch; 1 is orthogonal projection.
    ///
    /// The triangles of a leaf in one plane share one affine map; a leaf in several planes has one map per plane.
    #[must_use]
    pub fn new(foliage: &Foliage, cloud: &Cloud, stretch: f64) -> Self {
        let leaf_pivots = leaf_pivots(foliage);
        let pivots: Vec<DVec3> = foliage.leaf_ids().iter().map(|&leaf| leaf_pivots[leaf as usize]).collect();
        let parts = foliage.leaf_ids().iter().zip(&cloud.parents);
        let (part_of, part_count) = number_by_appearance(parts);
        let parts = Groups::by_key(&part_of, part_count);
        let lay = |part: usize| {
            let triangles = parts.get(part);
            let first = triangles[0] as usize;
            Lay::new(foliage, triangles, cloud.planes[cloud.parents[first] as usize], pivots[first], stretch)
        };
        let lays: Vec<Lay> = (0..part_count).into_par_iter().map(lay).collect();
        let of = |triangle: usize| &lays[part_of[triangle] as usize];
        let count = foliage.triangle_count();
        Self {
            targets: (0..count).into_par_iter().map(|t| foliage.corners(t).map(|p| of(t).target(p))).collect(),
            pivot_targets: (0..count).into_par_iter().map(|t| of(t).pivot).collect(),
            pivots,
        }
    }

    /// Returns the projection with all lengths of leaves within their planes times `factor`, about the leaves' pivots. No corner moves farther
    /// than the bound of the cloud: a leaf as large as a crown would swell.
    #[must_use]
    pub fn grown(&self, foliage: &Foliage, cloud: &Cloud, factor: f64) -> Self {
        let farthest = cloud.bound / foliage.frame().radius;
        let grown = |(triangle, corners): (usize, &[DVec3; 3])| {
            let (plane, pivot) = (cloud.planes[cloud.parents[triangle] as usize], self.pivot_targets[triangle]);
            let moved = |corner: DVec3| ((factor - 1.0) * (plane.project(corner) - pivot)).clamp_length_max(farthest);
            corners.map(|corner| corner + moved(corner))
        };
        Self { targets: self.targets.par_iter().enumerate().map(grown).collect(), ..self.clone() }
    }

    /// Returns the foliage during the transition, at `a` in [0, 1].
    ///
    /// # Errors
    /// No leaf has an area at `a`.
    pub fn at(&self, foliage: &Foliage, a: f64) -> Result<Foliage> {
        let corners = self.targets.iter().enumerate().map(|(triangle, targets)| {
            let from = foliage.corners(triangle);
            std::array::from_fn(|i| from[i].lerp(targets[i], a))
        });
        foliage.with_corners(&corners.collect::<Vec<_>>())
    }

    /// Returns the greatest distance that a corner moves within its plane, in local units.
    #[must_use]
    pub fn in_plane_motion(&self, foliage: &Foliage, cloud: &Cloud) -> f64 {
        let motion = |t: usize| {
            let plane = cloud.planes[cloud.parents[t] as usize];
            let moved = foliage
                .corners(t)
                .into_iter()
                .zip(self.targets[t])
                .map(|(p, q)| plane.project(p).distance(plane.project(q)));
            moved.fold(0.0, f64::max)
        };
        (0..foliage.triangle_count()).map(motion).fold(0.0, f64::max)
    }
}

/// Returns the area centroid of each leaf, in local units.
#[must_use]
pub fn leaf_pivots(foliage: &Foliage) -> Vec<DVec3> {
    foliage.leaves().iter().map(|triangles| centroid(foliage, triangles)).collect()
}

/// Returns the area centroid of the triangles, or the mean of their corners if they have no area.
fn centroid(foliage: &Foliage, triangles: &[u32]) -> DVec3 {
    let mut weighted = (DVec3::ZERO, 0.0);
    let mut plain = DVec3::ZERO;
    for &t in triangles {
        let corners = foliage.corners(t as usize);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let area = area_vector(corners).length();
        weighted = (weighted.0 + middle * area, weighted.1 + area);
        plain += middle;
    }
    if weighted.1 > 0.0 { weighted.0 / weighted.1 } else { plain / triangles.len() as f64 }
}

/// The affine map that lays one leaf into its plane.
pub(crate) struct Lay {
    plane: Plane,
    /// The projected pivot, a fixed point of the map.
    pivot: DVec3,
    /// Unit vector of the stretch within the plane, along the leaf's steepest tilt; zero without a stretch.
    steepest: DVec3,
    /// Stretch − 1.
    excess: f64,
}

impl Lay {
    pub fn new(foliage: &Foliage, triangles: &[u32], plane: Plane, pivot: DVec3, limit: f64) -> Self {
        let (mut sum, mut area, mut projected) = (DVec3::ZERO, 0.0, 0.0);
        for &t in triangles {
            let vector = foliage.area_vector(t as usize);
            sum += if vector.dot(sum) < 0.0 { -vector } else { vector };
            area += vector.length();
            projected += vector.dot(plane.normal).abs();
        }
        let steepest = (sum - plane.normal * sum.dot(plane.normal)).try_normalize();
        let stretch = if projected > 0.0 { (area / projected).clamp(1.0, limit) } else { limit };
        Self {
            plane,
            pivot: plane.project(pivot),
            excess: if steepest.is_some() { stretch - 1.0 } else { 0.0 },
            steepest: steepest.unwrap_or(DVec3::ZERO),
        }
    }

    pub fn target(&self, point: DVec3) -> DVec3 {
        let projected = self.plane.project(point);
        let order = self.plane.normal * (self.plane.height(point) * DEPTH_ORDER);
        projected + order + self.steepest * (self.excess * self.steepest.dot(projected - self.pivot))
    }
}

/// Returns a: 0 up to `start`, 1 from `end`, linear between; a step at `end` if `end ≤ start`. A NaN distance
/// (no camera) gives 0. Limits that are NaN, or both infinite, give a step at `end`.
#[must_use]
pub fn transition(distance: f64, start: f64, end: f64) -> f64 {
    if end <= start || distance.is_nan() {
        return f64::from(distance >= end);
    }
    // Halve first: the difference of two numbers may overflow f64.
    let share = (distance * 0.5 - start * 0.5) / (end * 0.5 - start * 0.5);
    if share.is_nan() { f64::from(distance >= end) } else { share.clamp(0.0, 1.0) }
}

/// Returns the distance from which a length of `deviation` appears smaller than `pixels`, for a perspective camera of `resolution` pixels
/// over the angle `field_of_view` (radians): d = δ · res / (2 · px · tan(fov/2)).
#[must_use]
pub fn switch_distance(deviation: f64, pixels: f64, resolution: f64, field_of_view: f64) -> f64 {
    deviation * resolution / (2.0 * pixels * libm::tan(field_of_view / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;

    /// A unit square leaf, tilted about the x axis to a normal at `cosine` to z, centered on the z axis at `height`.
    fn tilted(cosine: f64, height: f64) -> (Foliage, Cloud) {
        let sine = (1.0 - cosine * cosine).sqrt();
        let along = DVec3::new(0.0, cosine, sine) * 0.5;
        let x = DVec3::X * 0.5;
        let centre = DVec3::Z * height;
        let corners = [centre - x - along, centre + x - along, centre + x + along, centre - x + along];
        let foliage = Foliage::new(&corners, vec![[0, 1, 2], [0, 2, 3]], Attributes::default(), vec![]).unwrap();
        let local = foliage.frame().to_local(DVec3::ZERO);
        let plane = Plane::through(local, DVec3::Z);
        let cloud = Cloud::new(&foliage, vec![plane], vec![0, 0], 10.0);
        (foliage, cloud)
    }

    fn area(targets: &[[DVec3; 3]], foliage: &Foliage) -> f64 {
        targets.iter().map(|&t| area_vector(t).length()).sum::<f64>() * foliage.frame().radius.powi(2)
    }

    #[test]
    fn orthogonal_projection_keeps_the_cosine() {
        let (foliage, cloud) = tilted(0.8, 0.3);
        let projection = Projection::new(&foliage, &cloud, 1.0);
        assert!((area(&projection.targets, &foliage) - 0.8).abs() < 1e-6, "up to the depth order");
        assert!(projection.in_plane_motion(&foliage, &cloud) < 1e-12);
    }

    #[test]
    fn laying_keeps_the_area_up_to_the_limit() {
        for (cosine, limit, expected) in [(0.8, 2.0, 1.0), (0.5, 2.0, 1.0), (0.4, 1.5, 0.6)] {
            let (foliage, cloud) = tilted(cosine, 0.3);
            let projection = Projection::new(&foliage, &cloud, limit);
            assert!((area(&projection.targets, &foliage) - expected).abs() < 1e-6, "cos {cosine}");
            let height = |p: &DVec3| cloud.planes[0].height(*p);
            for (t, targets) in projection.targets.iter().enumerate() {
                for (from, to) in foliage.corners(t).iter().zip(targets) {
                    assert!((height(to) - height(from) * DEPTH_ORDER).abs() < 1e-15);
                }
                assert!(height(&projection.pivot_targets[t]).abs() < 1e-15);
            }
            // The square keeps its side along x and its center.
            let caller = |p: DVec3| foliage.frame().to_caller(p);
            let [a, b, _] = projection.targets[0].map(caller);
            assert!((a.distance(b) - 1.0).abs() < 1e-12);
            assert!(caller(projection.pivot_targets[0]).length() < 1e-12);
        }
    }

    #[test]
    fn growth_scales_about_the_pivot_and_keeps_heights() {
        let (foliage, cloud) = tilted(0.8, 0.3);
        let laid = Projection::new(&foliage, &cloud, 2.0);
        let grown = laid.grown(&foliage, &cloud, 1.1);
        assert!((area(&grown.targets, &foliage) - 1.21).abs() < 1e-6);
        for (triangle, (before, after)) in laid.targets.iter().zip(&grown.targets).enumerate() {
            let from_pivot = |p: &DVec3| cloud.planes[0].project(*p) - laid.pivot_targets[triangle];
            for (p, q) in before.iter().zip(after) {
                assert!(from_pivot(q).distance(1.1 * from_pivot(p)) < 1e-12);
                assert!((cloud.planes[0].height(*p) - cloud.planes[0].height(*q)).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn growth_moves_no_corner_farther_than_the_bound() {
        let (foliage, cloud) = tilted(0.8, 0.3);
        let laid = Projection::new(&foliage, &cloud, 2.0);
        let bound = 0.05; // Less than a fifth of a corner's distance from the pivot.
        let grown = laid.grown(&foliage, &Cloud { bound, ..cloud }, 1.2);
        for (p, q) in laid.targets.iter().flatten().zip(grown.targets.iter().flatten()) {
            assert!((p.distance(*q) * foliage.frame().radius - bound).abs() < 1e-12);
        }
    }

    #[test]
    fn on_the_way_corners_lie_between() {
        let (foliage, cloud) = tilted(0.8, 0.3);
        let projection = Projection::new(&foliage, &cloud, 1.5);
        let half = projection.at(&foliage, 0.5).unwrap();
        for t in 0..2 {
            let corners = half.corners(t).map(|p| foliage.frame().to_local(half.frame().to_caller(p)));
            for ((p, q), r) in foliage.corners(t).into_iter().zip(projection.targets[t]).zip(corners) {
                assert!(r.distance((p + q) / 2.0) < 1e-12);
            }
        }
        assert_eq!(half.leaf_ids(), foliage.leaf_ids());
    }

    #[test]
    fn the_law_of_a() {
        let at = |d: f64| transition(d, 2.0, 4.0);
        assert_eq!([at(0.0), at(2.0), at(3.0), at(4.0), at(9.0)], [0.0, 0.0, 0.5, 1.0, 1.0]);
        assert_eq!([at(f64::NAN), at(f64::INFINITY)], [0.0, 1.0]);
        assert_eq!([transition(1.0, 2.0, 2.0), transition(2.0, 2.0, 2.0)], [0.0, 1.0]);
    }

    #[test]
    fn a_unit_at_the_switch_distance_covers_the_pixels() {
        // At 90° the image is 2d high at distance d.
        let d = switch_distance(1.0, 8.0, 1000.0, std::f64::consts::FRAC_PI_2);
        assert!((1000.0 / (2.0 * d) - 8.0).abs() < 1e-12);
    }
}
