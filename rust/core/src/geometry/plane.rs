//! Planes as unit normal and signed distance: a point `p` has the height `n·p − d`.

use glam::{DMat3, DVec3};

use super::Frame;

/// A plane, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: DVec3,
    /// Signed distance from the origin along the normal.
    pub distance: f64,
}

impl Plane {
    /// Returns the plane through a point.
    #[must_use]
    pub fn through(point: DVec3, normal: DVec3) -> Self {
        Self { normal, distance: normal.dot(point) }
    }

    /// Returns the plane through three points; `None` if they are collinear to f64's precision (an area vector
    /// shorter than 1e-12 of the squared longest edge).
    #[must_use]
    pub fn through_points([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let cross = (b - a).cross(c - a);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        (cross.length() > 1e-12 * longest).then(|| Self::through(a, cross.normalize()))
    }

    /// Returns the signed distance of a point from the plane.
    #[must_use]
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }

    /// Returns the orthogonal projection of a point.
    #[must_use]
    pub fn project(&self, point: DVec3) -> DVec3 {
        point - self.normal * self.height(point)
    }

    /// Converts the plane from local to the caller's coordinates.
    #[must_use]
    pub fn to_caller(&self, frame: &Frame) -> Self {
        Self { normal: self.normal, distance: self.normal.dot(frame.centre) + self.distance * frame.radius }
    }

    /// Converts the plane from local to the tree's own coordinates.
    #[must_use]
    pub fn to_tree(&self, frame: &Frame) -> Self {
        frame.placement.plane_to_tree(self.to_caller(frame))
    }

    /// Returns two unit vectors in the plane with `x × y = normal`; equal normals give equal axes.
    #[must_use]
    pub fn axes(&self) -> (DVec3, DVec3) {
        axes(self.normal)
    }
}

/// Returns two unit vectors perpendicular to the unit vector `normal`, with `x × y = normal`
/// (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017: branch-free, no pole).
#[must_use]
pub fn axes(normal: DVec3) -> (DVec3, DVec3) {
    normal.any_orthonormal_pair()
}

/// Returns the eigenvector of the least eigenvalue of a symmetric positive semi-definite matrix, by inverse iteration from `start`.
#[must_use]
#[inline(never)] // Inlined into the refits, rustc 1.95 with link-time optimisation gives other last bits than without (tools/same_bytes.sh).
pub fn least_direction(matrix: DMat3, start: DVec3) -> DVec3 {
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    let shifted = matrix + DMat3::from_diagonal(DVec3::splat(1e-9 * trace.max(f64::MIN_POSITIVE)));
    let inverse = shifted.inverse();
    let turned = (0..32).try_fold(start, |direction, _| (inverse * direction).try_normalize());
    turned.filter(|direction| direction.is_finite()).unwrap_or(start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn through_three_points() {
        let plane = Plane::through_points([DVec3::Z, DVec3::Z + DVec3::X, DVec3::Z + DVec3::Y]).unwrap();
        assert_eq!(plane, Plane { normal: DVec3::Z, distance: 1.0 });
        assert_eq!(plane.height(DVec3::new(7.0, 8.0, 3.5)), 2.5);
        assert_eq!(plane.project(DVec3::new(7.0, 8.0, 3.5)), DVec3::new(7.0, 8.0, 1.0));
    }

    #[test]
    fn collinear_points_have_none() {
        assert_eq!(Plane::through_points([DVec3::ZERO, DVec3::ONE, DVec3::ONE * 3.0]), None);
        assert_eq!(Plane::through_points([DVec3::ONE; 3]), None);
    }

    proptest! {
        #[test]
        fn axes_are_right_handed(x in -1.0..1.0, y in -1.0..1.0, z in -1.0..1.0) {
            let n: DVec3 = DVec3::new(x, y, z);
            prop_assume!(n.length() > 1e-3);
            let n = n.normalize();
            let (u, v) = axes(n);
            prop_assert!(u.cross(v).distance(n) < 1e-12);
            prop_assert!(u.dot(v).abs() < 1e-12);
        }
    }
}
