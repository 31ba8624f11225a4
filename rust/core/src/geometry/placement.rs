//! The transform from the tree's own coordinates to the world.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::Plane;
use crate::error::{Error, Result};

/// Greatest product of the norms of matrix and inverse (Frobenius; 3 for a rotation). Beyond it, positions in single precision lose the
/// short axis beside the long one.
const WORST_CONDITION: f64 = 1e8;

/// An invertible affine transform from the tree's coordinates to the world; the identity by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    to_world: DAffine3,
    to_tree: DAffine3,
}

impl Placement {
    /// Returns the placement with these rows of a 4 × 4 matrix, which transforms column vectors.
    ///
    /// # Errors
    /// A value that is not finite; a last row other than 0, 0, 0, 1; a matrix that is singular or nearly so.
    pub fn new(rows: [[f64; 4]; 4]) -> Result<Self> {
        if let Some(value) = rows.iter().flatten().find(|value| !value.is_finite()) {
            return Err(Error::invalid(format!("matrix has the value {value}; all its values must be finite")));
        }
        let [x, y, z, last] = rows;
        if last != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::invalid(format!("matrix has the last row {last:?}; it must be 0, 0, 0, 1")));
        }
        let row = |r: [f64; 4]| DVec3::new(r[0], r[1], r[2]);
        let linear = DMat3::from_cols(row(x), row(y), row(z)).transpose();
        let condition = norm(linear) * norm(linear.inverse());
        let condition = if condition.is_nan() { f64::INFINITY } else { condition }; // A determinant of 0 gives 0 × ∞.
        if condition > WORST_CONDITION {
            return Err(Error::invalid(format!(
                "matrix has the condition number {condition:.1e}; the limit is {WORST_CONDITION:e}: it must not be singular, so give the \
                 object a scale other than 0 on each axis"
            )));
        }
        let to_world = DAffine3::from_mat3_translation(linear, DVec3::new(x[3], y[3], z[3]));
        Ok(Self { to_world, to_tree: to_world.inverse() })
    }

    /// Converts a point from the tree's coordinates to the world.
    #[must_use]
    pub fn to_world(&self, p: DVec3) -> DVec3 {
        self.to_world.transform_point3(p)
    }

    /// Converts a point from the world to the tree's coordinates.
    #[must_use]
    pub fn to_tree(&self, p: DVec3) -> DVec3 {
        self.to_tree.transform_point3(p)
    }

    /// Converts a normal from the tree's coordinates to a unit normal in the world. A zero normal stays zero.
    #[must_use]
    pub fn normal_to_world(&self, normal: Vec3) -> Vec3 {
        let turned = self.to_tree.matrix3.transpose() * normal.as_dvec3();
        let length = turned.length();
        if length == 0.0 { Vec3::ZERO } else { (turned / length).as_vec3() }
    }

    /// Converts a plane from the world to the tree's coordinates, with a unit normal there.
    #[must_use]
    pub fn plane_to_tree(&self, plane: Plane) -> Plane {
        let normal = self.to_world.matrix3.transpose() * plane.normal;
        let length = normal.length();
        Plane {
            normal: normal / length,
            distance: (plane.distance - plane.normal.dot(self.to_world.translation)) / length,
        }
    }

    /// Returns whether a counter-clockwise triangle of the tree is clockwise in the world.
    #[must_use]
    pub fn mirrors(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// Reorders values at a triangle's corners so that its front stays the front in the other coordinates. The first corner stays first. A
    /// second call restores the order.
    #[must_use]
    pub fn wound<T>(&self, [a, b, c]: [T; 3]) -> [T; 3] {
        if self.mirrors() { [a, c, b] } else { [a, b, c] }
    }
}

fn norm(matrix: DMat3) -> f64 {
    matrix.to_cols_array().iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNED: [[f64; 4]; 4] =
        [[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 6.0], [0.0, 0.0, 4.0, 7.0], [0.0, 0.0, 0.0, 1.0]];
    const MIRRORED: [[f64; 4]; 4] =
        [[0.0, 2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 6.0], [0.0, 0.0, 4.0, 7.0], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn there_and_back() {
        let placement = Placement::new(MIRRORED).unwrap();
        let p = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(placement.to_world(p), DVec3::new(9.0, 8.0, 19.0));
        assert_eq!(placement.to_tree(placement.to_world(p)), p);
        assert_eq!(Placement::default().to_world(p), p);
    }

    #[test]
    fn a_mirror_winds_the_other_way() {
        assert!(Placement::new(MIRRORED).unwrap().mirrors());
        assert_eq!(Placement::new(MIRRORED).unwrap().wound([0, 1, 2]), [0, 2, 1]);
        assert_eq!(Placement::new(TURNED).unwrap().wound([0, 1, 2]), [0, 1, 2]);
    }

    #[test]
    fn normals_and_planes_stay_perpendicular() {
        let placement = Placement::new(MIRRORED).unwrap();
        let (a, b) = (DVec3::new(1.0, 0.0, 1.0), DVec3::new(0.0, 1.0, 1.0));
        let normal = placement.normal_to_world(a.cross(b).as_vec3()).as_dvec3();
        let turned = |p: DVec3| placement.to_world(p) - placement.to_world(DVec3::ZERO);
        assert!(normal.dot(turned(a)).abs() < 1e-6 && normal.dot(turned(b)).abs() < 1e-6);
        assert_eq!(placement.normal_to_world(Vec3::ZERO), Vec3::ZERO);
        let world = Plane::through(placement.to_world(a), turned(a).cross(turned(b)).normalize());
        let plane = placement.plane_to_tree(world);
        for p in [DVec3::ZERO, a, b] {
            assert!(plane.height(p).abs() < 1e-12);
        }
    }

    #[test]
    fn refusals_name_the_value() {
        let with = |row: usize, column: usize, value: f64| {
            let mut rows = MIRRORED;
            rows[row][column] = value;
            Placement::new(rows).map(|_| ()).map_err(|error| error.to_string())
        };
        assert!(with(0, 3, f64::NAN).unwrap_err().contains("value NaN"));
        assert!(with(3, 0, 0.5).unwrap_err().contains("[0.5, 0.0, 0.0, 1.0]"));
        assert!(with(2, 2, 0.0).unwrap_err().contains("singular"));
        assert!(with(2, 2, 1e-9).unwrap_err().contains("condition number"));
        assert!(with(2, 2, 1e-6).is_ok());
    }
}
