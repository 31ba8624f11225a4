//! Canonical axes: the coordinates of the search.
//!
//! The search tries fixed directions. Canonical axes follow from the foliage alone, so a foliage that is mirrored or turned by a quarter
//! turn gets the same planes, mirrored or turned with it. The axes are sorted by the sum of the corners' distances from the center,
//! greatest first, and each points toward the side with the larger sum of coordinates. Sums are of integers, so they are exact in any
//! order. Known limit: equal sums keep the caller's order. That happens only for symmetric foliage, for which either fit is equally good.

use glam::DVec3;

use crate::foliage::Foliage;
use crate::geometry::Plane;

/// Integer units per local unit: local coordinates are at most 1, so sums of 2³⁴ corners stay within 63 bits.
const UNITS: f64 = (1u64 << 28) as f64;

/// An order and a sign for each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    order: [usize; 3],
    signs: DVec3,
}

impl Axes {
    /// Returns the canonical axes of the foliage.
    pub fn of(foliage: &Foliage) -> Self {
        let (mut spread, mut lean) = ([0i64; 3], [0i64; 3]);
        for corner in (0..foliage.triangle_count()).flat_map(|t| foliage.corners(t)) {
            for (axis, x) in corner.to_array().into_iter().enumerate() {
                let units = (x * UNITS).round() as i64;
                spread[axis] += units.abs();
                lean[axis] += units;
            }
        }
        let mut order = [0, 1, 2];
        order.sort_by_key(|&axis| std::cmp::Reverse(spread[axis]));
        let signs = DVec3::from_array(order.map(|axis| if lean[axis] < 0 { -1.0 } else { 1.0 }));
        Self { order, signs }
    }

    /// Converts a vector from local to canonical coordinates.
    pub fn to_canonical(self, v: DVec3) -> DVec3 {
        DVec3::from_array(self.order.map(|axis| v[axis])) * self.signs
    }

    /// Converts a vector from canonical to local coordinates.
    pub fn to_local(self, v: DVec3) -> DVec3 {
        let signed = v * self.signs;
        let mut local = DVec3::ZERO;
        for (i, axis) in self.order.into_iter().enumerate() {
            local[axis] = signed[i];
        }
        local
    }

    /// Converts a plane from canonical to local coordinates.
    pub fn plane_to_local(self, plane: &Plane) -> Plane {
        Plane { normal: self.to_local(plane.normal), distance: plane.distance }
    }
}
