//! The scene that levels are chosen for: an even plantation, from the distance where one crown fills the picture to the horizon.
//!
//! The number of trees grows with the square of the distance, and the pixels of each fall with it. So every octave of sizes costs the same
//! fragments, and the far octaves most of the triangles.

use leafcloud::error::Result;
use leafcloud::limits::Limits;

/// Diameter of a crown in pixels times its distance in R: 1080 lines, a vertical field of view of 50 degrees.
pub const PIXELS_BY_DISTANCE: f64 = 2313.0;

/// Diameter of the nearest crown in pixels: the picture's height.
pub const NEAREST: f64 = 1080.0;

/// Range of the distance to the horizon in R.
pub const HORIZON: Limits = Limits::between(5.0, 100_000.0);

/// Rings in an octave of sizes.
const RINGS: f64 = 2.0;

/// A part of the plantation.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// Diameters of the crown in pixels, at the near and at the far end.
    near: f64,
    far: f64,
}

impl Ring {
    /// Returns the number of trees between two sizes, on any scale.
    fn trees(self, near: f64, far: f64) -> f64 {
        let beyond = |size: f64| self.far.powi(-2) - size.clamp(self.far, self.near).powi(-2);
        (beyond(near) - beyond(far)).max(0.0)
    }
}

/// An even plantation. Rings of a farther horizon begin with those of a nearer one.
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
        let size = |i: usize| NEAREST * libm::exp2(-(i as f64) / RINGS);
        let rings = (0..).map(|i| Ring { near: size(i), far: size(i + 1).max(farthest) });
        Ok(Self { rings: rings.take_while(|ring| ring.near > farthest).collect() })
    }

    /// Returns the diameters of the crowns in pixels in the middle of each ring.
    pub fn sizes(&self) -> impl Iterator<Item = f64> {
        (0..self.rings.len()).map(|i| NEAREST * libm::exp2(-(i as f64 + 0.5) / RINGS))
    }

    /// Returns the cost of the scene, on any scale. `levels`: the diameter of the crown in pixels where each takes over, descending, and its cost in each
    /// ring.
    #[must_use]
    pub fn cost(&self, levels: &[(f64, &[f64])]) -> f64 {
        let of_level = |number: usize| {
            let (from, costs) = levels[number];
            let until = levels.get(number + 1).map_or(0.0, |next| next.0);
            let cost = move |(ring, cost): (&Ring, &f64)| ring.trees(from, until) * cost;
            self.rings.iter().zip(costs).map(cost).sum::<f64>()
        };
        (0..levels.len()).map(of_level).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_cost_by_the_square_of_the_distance() {
        let scene = Scene::to(50.0).unwrap();
        let (many, none) = (vec![1.0; scene.rings.len()], vec![0.0; scene.rings.len()]);
        let to = |size: f64| scene.cost(&[(f64::INFINITY, &many), (size, &none)]);
        let near = PIXELS_BY_DISTANCE / NEAREST;
        for distance in [near, 5.0, 17.0, 50.0, 90.0] {
            let share = to(PIXELS_BY_DISTANCE / distance) / to(0.0);
            let until = f64::min(distance, 50.0);
            let expected = (until * until - near * near) / (2500.0 - near * near);
            assert!((share - expected).abs() < 1e-9, "{distance} R: {share} {expected}");
        }
    }

    #[test]
    fn rings_of_a_nearer_horizon_come_first() {
        let [near, far] = [50.0, 200.0].map(|horizon| Scene::to(horizon).unwrap());
        let sizes: Vec<f64> = far.sizes().collect();
        assert!(near.sizes().zip(&sizes).all(|(size, same)| size == *same) && sizes.len() > near.rings.len());
        assert!(near.rings.last().unwrap().far == PIXELS_BY_DISTANCE / 50.0);
    }

    #[test]
    fn a_horizon_outside_its_range_is_refused() {
        for horizon in [0.0, 4.0, f64::NAN, 1e6] {
            assert!(Scene::to(horizon).unwrap_err().to_string().starts_with("`scene` is"));
        }
    }
}
