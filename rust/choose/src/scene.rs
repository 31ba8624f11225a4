//! The scene that levels are chosen for: an even plantation, from the distance where one crown fills the picture to the horizon.
//!
//! The number of trees grows with the square of the distance, and the pixels of each fall with it. So every octave of sizes costs the same
//! fragments, and the far octaves most of the triangles.

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::limits::Limits;
use leafcloud::metrics::drawing_cost;
use leafcloud::{Foliage, Progress};

/// Diameter of a crown in pixels times its distance in R: 1080 lines, a vertical field of view of 50 degrees.
pub const PIXELS_BY_DISTANCE: f64 = 2313.0;

/// Diameter of the nearest crown in pixels: the picture's height.
pub const NEAREST: f64 = 1080.0;

/// Range of the distance to the horizon in R.
pub const HORIZON: Limits = Limits::between(5.0, 100_000.0);

/// Parts of a ring within which trees are taken as equally large.
const PARTS: i32 = 4;

/// A part of the plantation.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// Diameters of the crown in pixels, at the near and at the far end.
    near: f64,
    far: f64,
}

impl Ring {
    /// Returns the diameter in the middle.
    fn middle(self) -> f64 {
        (self.near * self.far).sqrt()
    }

    /// Returns the number of trees between `far` and a size, on any scale.
    fn beyond(self, size: f64) -> f64 {
        let size = size.clamp(self.far, self.near);
        self.far.powi(-2) - size.powi(-2)
    }
}

/// An even plantation.
#[derive(Clone, Debug)]
pub struct Scene {
    rings: Vec<Ring>,
}

impl Scene {
    /// Returns the scene with a horizon at this distance in R.
    ///
    /// # Errors
    /// A distance outside [`HORIZON`].
    pub fn to(horizon: f64) -> Result<Self> {
        HORIZON.check("scene", horizon)?;
        let farthest = PIXELS_BY_DISTANCE / horizon;
        let count = libm::log2(NEAREST / farthest).ceil().max(1.0) as i32;
        let size = |i: i32| NEAREST * libm::pow(farthest / NEAREST, f64::from(i) / f64::from(count));
        Ok(Self { rings: (0..count).map(|i| Ring { near: size(i), far: size(i + 1) }).collect() })
    }

    /// Returns the cost of the scene, on any scale, if a tree of a size costs `cost`. Each ring counts in [`PARTS`] parts.
    ///
    /// # Errors
    /// Those of `cost`.
    pub fn total(&self, cost: impl Fn(f64) -> Result<f64>) -> Result<f64> {
        let parts = |ring: &Ring| {
            let size = |part: i32| ring.near * libm::pow(ring.far / ring.near, f64::from(part) / f64::from(PARTS));
            std::array::from_fn::<_, { PARTS as usize }, _>(|part| Ring {
                near: size(part as i32),
                far: size(part as i32 + 1),
            })
        };
        let of_part = |part: Ring| cost(part.middle()).map(|cost| part.beyond(part.near) * cost);
        self.rings.iter().flat_map(parts).map(of_part).sum()
    }

    /// Returns the diameter of the farthest crown in pixels.
    #[must_use]
    pub fn farthest(&self) -> f64 {
        self.rings.last().map_or(NEAREST, |ring| ring.far)
    }

    /// Returns the cost of drawing a tree in the middle of each ring, in fragments.
    ///
    /// # Errors
    /// Those of [`drawing_cost`].
    pub fn costs(&self, foliage: &Foliage, up: DVec3) -> Result<Vec<f64>> {
        let cost = |ring: &Ring| {
            let scale = 0.5 * ring.middle() / foliage.frame().radius;
            Ok(drawing_cost(&[foliage], scale, up, Progress::silent())?.total())
        };
        self.rings.iter().map(cost).collect()
    }

    /// Returns the cost of the scene if trees are drawn by `before` down to a diameter of `size` pixels, and by `after` where they are smaller.
    #[must_use]
    pub fn cost(&self, size: f64, before: &[f64], after: &[f64]) -> f64 {
        let of_ring = |(ring, (before, after)): (&Ring, (&f64, &f64))| {
            let (all, smaller) = (ring.beyond(ring.near), ring.beyond(size));
            smaller * after + (all - smaller) * before
        };
        self.rings.iter().zip(before.iter().zip(after)).map(of_ring).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_cost_by_the_square_of_the_distance() {
        let scene = Scene::to(50.0).unwrap();
        let (many, none) = (vec![1.0; scene.rings.len()], vec![0.0; scene.rings.len()]);
        let at =
            |distance: f64| scene.cost(PIXELS_BY_DISTANCE / distance, &many, &none) / scene.cost(0.0, &many, &none);
        let near = PIXELS_BY_DISTANCE / NEAREST;
        for distance in [near, 5.0, 17.0, 50.0, 90.0] {
            let to = f64::min(distance, 50.0);
            let expected = (to * to - near * near) / (2500.0 - near * near);
            assert!((at(distance) - expected).abs() < 1e-9, "{distance} R: {} {expected}", at(distance));
        }
        assert!((scene.farthest() - 46.26).abs() < 1e-9);
    }

    #[test]
    fn all_trees_count_once() {
        // The number of trees between two sizes, by hand: on the scale of `total` far⁻² − near⁻².
        let scene = Scene::to(50.0).unwrap();
        let far = |size: f64| Ok(if size < 100.0 { 1.0 } else { 0.0 });
        let (all, few) = (scene.total(|_| Ok(1.0)).unwrap(), scene.total(far).unwrap());
        assert!((all - (scene.farthest().powi(-2) - NEAREST.powi(-2))).abs() < 1e-12, "{all}");
        assert!((few / all - 0.79).abs() < 0.05, "trees beyond 23 R of those to 50 R: {}", few / all);
    }

    #[test]
    fn a_horizon_outside_its_range_is_refused() {
        for horizon in [0.0, 4.0, f64::NAN, 1e6] {
            assert!(Scene::to(horizon).unwrap_err().to_string().starts_with("`scene` is"));
        }
    }
}
