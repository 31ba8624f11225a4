//! The local frame: centered on the bounding box in f64 and scaled to R = 1. All later stages work at
//! one scale, with f32 in hot loops, without loss.

use glam::DVec3;

use super::Placement;

/// Position and scale of the foliage: a point `p` of the caller, in the world, is `(p − centre) / radius` in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The center of the axis-aligned bounding box, in the caller's coordinates.
    pub centre: DVec3,
    /// The distance of the farthest vertex from the center, in the caller's units; above 0.
    pub radius: f64,
    /// The transform from the tree's own coordinates, in which results leave the core, to the caller's.
    pub placement: Placement,
}

impl Frame {
    /// Returns the frame of `points`; `None` without points, if all points coincide, or if the radius is not finite.
    pub fn of(points: impl Iterator<Item = DVec3> + Clone) -> Option<Self> {
        let bounds = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
        let (low, high) = points.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), bounds);
        // Halve both first: the sum of two coordinates near the largest float must not overflow.
        let centre = low * 0.5 + high * 0.5;
        let radius = points.map(|p| p.distance(centre)).fold(0.0, f64::max);
        (radius > 0.0 && radius.is_finite()).then_some(Self { centre, radius, placement: Placement::default() })
    }

    /// Converts a point from the caller's coordinates to local ones.
    #[must_use]
    pub fn to_local(&self, p: DVec3) -> DVec3 {
        (p - self.centre) / self.radius
    }

    /// Converts a point from local coordinates to the caller's.
    #[must_use]
    pub fn to_caller(&self, p: DVec3) -> DVec3 {
        self.centre + p * self.radius
    }

    /// Converts a point from local coordinates to the tree's own.
    #[must_use]
    pub fn to_tree(&self, p: DVec3) -> DVec3 {
        self.placement.to_tree(self.to_caller(p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centre_of_the_box_and_farthest_vertex() {
        let points = [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        let frame = Frame::of(points.into_iter()).unwrap();
        assert_eq!(frame.centre, DVec3::new(1.0, 2.0, 0.0));
        assert_eq!(frame.radius, 5f64.sqrt());
    }

    #[test]
    fn no_scale_from_one_place() {
        assert_eq!(Frame::of([DVec3::ONE; 3].into_iter()), None);
        assert_eq!(Frame::of([].into_iter()), None);
    }

    #[test]
    fn there_and_back_far_from_the_origin() {
        let far = DVec3::new(1e8, -1e8, 1e8);
        let points = [far, far + DVec3::X, far + DVec3::Y];
        let frame = Frame::of(points.into_iter()).unwrap();
        for p in points {
            assert!(frame.to_caller(frame.to_local(p)).distance(p) <= 4e-8, "within two roundings at 1e8");
        }
    }
}
