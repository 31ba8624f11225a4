//! Canonical axes: which way the search looks at the foliage.
//!
//! The search tries fixed directions. So that a foliage turned by a quarter turn or mirrored gets the same planes, turned or mirrored with it,
//! the axes are first put into an order and given signs that follow from the foliage alone: the axis along which corners lie farthest from
//! the centre first, each towards the side where more of them lie. The sums are of whole numbers, exact in any order. Where two sums are
//! equal the caller's order stays: a known limit, which takes a symmetric foliage (whose fits are as good as each other's).

use glam::DVec3;

use crate::foliage::Foliage;
use crate::geometry::Plane;

/// Local coordinates are at most 1; sums of 2³⁴ corners stay within 63 bits.
const UNITS: f64 = (1u64 << 28) as f64;

/// An order of the axes and a sign for each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    order: [usize; 3],
    signs: DVec3,
}

impl Axes {
    /// The axes that follow from the foliage.
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

    /// From local coordinates to canonical ones.
    pub fn to_canonical(self, v: DVec3) -> DVec3 {
        DVec3::from_array(self.order.map(|axis| v[axis])) * self.signs
    }

    /// From canonical coordinates to local ones.
    pub fn to_local(self, v: DVec3) -> DVec3 {
        let signed = v * self.signs;
        let mut local = DVec3::ZERO;
        for (i, axis) in self.order.into_iter().enumerate() {
            local[axis] = signed[i];
        }
        local
    }

    /// A canonical plane in local coordinates.
    pub fn plane_to_local(self, plane: &Plane) -> Plane {
        Plane { normal: self.to_local(plane.normal), distance: plane.distance }
    }
}
