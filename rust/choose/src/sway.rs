//! The control: the same tree as a light breeze has moved it. An equally good tree, so a level may differ from the leaves as much as it does.
//!
//! Every corner of a leaf moves by a smooth random field, so neighbors stay neighbors: coverage and texture of the crown are kept, and only the
//! places of the leaves differ. The field is the sum of [`WAVES`] plane waves of random direction, direction of motion and phase, [`LENGTH`]
//! R long. O(corners · waves).

use std::f64::consts::TAU;

use glam::DVec3;
use leafcloud::Foliage;
use leafcloud::error::Result;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;
use rayon::prelude::*;

/// Number of waves.
const WAVES: usize = 16;

/// Length of the waves in R.
const LENGTH: f64 = 0.4;

/// Root mean square of the motion: in R, at least in pixels, and at most in R.
pub const MOVE: f64 = 0.025;
const LEAST_PIXELS: f64 = 1.5;
const MOST: f64 = 0.06;

/// Seed of the waves: the same breeze for all trees.
const SEED: u64 = 7;

/// Returns the root mean square of the motion in R, for a crown with a diameter of so many pixels.
#[must_use]
pub fn motion(crown_pixels: f64) -> f64 {
    (2.0 * LEAST_PIXELS / crown_pixels).clamp(MOVE, MOST)
}

struct Wave {
    along: DVec3,
    motion: DVec3,
    phase: f64,
}

/// Returns a direction, uniform on the sphere.
fn direction(unit: &mut impl FnMut() -> f64) -> DVec3 {
    let (z, turn) = (2.0 * unit() - 1.0, TAU * unit());
    let radius = (1.0 - z * z).sqrt();
    DVec3::new(radius * libm::cos(turn), radius * libm::sin(turn), z)
}

fn waves() -> Vec<Wave> {
    let mut random = Pcg32::new(SEED, 0);
    let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let wave = |_| Wave { along: direction(&mut unit), motion: direction(&mut unit), phase: TAU * unit() };
    (0..WAVES).map(wave).collect()
}

/// Returns the leaves moved by a field with the root mean square `motion` over their corners, in R.
///
/// # Errors
/// Those of [`Foliage::with_corners`].
pub fn swayed(leaves: &Foliage, motion: f64) -> Result<Foliage> {
    let waves = waves();
    let push = |place: DVec3| -> DVec3 {
        let of_wave = |wave: &Wave| wave.motion * libm::sin(TAU / LENGTH * place.dot(wave.along) + wave.phase);
        waves.iter().map(of_wave).sum()
    };
    let pushes: Vec<[DVec3; 3]> =
        (0..leaves.triangle_count()).into_par_iter().map(|t| leaves.corners(t).map(push)).collect();
    let squares: f64 = pushes.as_flattened().iter().map(|push| push.length_squared()).sum();
    let strength = motion / (squares / (3 * pushes.len()).max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let moved = |(t, pushes): (usize, &[DVec3; 3])| {
        let corners = leaves.corners(t);
        std::array::from_fn(|i| corners[i] + strength * pushes[i])
    };
    let corners: Vec<[DVec3; 3]> = pushes.par_iter().enumerate().map(moved).collect();
    leaves.with_corners(&corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use leafcloud::foliage::Attributes;

    #[test]
    fn the_motion_is_a_share_of_the_crown_or_some_pixels() {
        let found = [512.0, 120.0, 100.0, 50.0, 8.0].map(motion);
        assert_eq!(found, [0.025, 0.025, 0.03, 0.06, 0.06]);
    }

    #[test]
    fn leaves_move_by_the_root_mean_square_and_neighbors_stay_together() {
        let at = |i: usize| DVec3::new((i % 40) as f64, (i / 40 % 40) as f64, (i / 1600) as f64) / 20.0;
        let leaf = |i: usize| [DVec3::ZERO, 1e-3 * DVec3::X, 1e-3 * DVec3::Y].map(|p| p + at(i));
        let positions: Vec<DVec3> = (0..64_000).flat_map(leaf).collect();
        let triangles = (0..64_000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let leaves = Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap();
        let moved = swayed(&leaves, 0.05).unwrap();
        let place = |foliage: &Foliage, t: usize, k: usize| foliage.frame().to_caller(foliage.corners(t)[k]);
        let radius = leaves.frame().radius;
        let distance = |t: usize, k: usize| (place(&moved, t, k) - place(&leaves, t, k)) / radius;
        let mean = (0..64_000).map(|t| distance(t, 0).length_squared()).sum::<f64>() / 64_000.0;
        assert!((mean.sqrt() / 0.05 - 1.0).abs() < 1e-3, "{}", mean.sqrt());
        let apart = (0..64_000).map(|t| distance(t, 0).distance(distance(t, 1))).fold(0.0, f64::max);
        assert!(apart < 0.01, "{apart}");
        let still = swayed(&leaves, 0.0).unwrap();
        assert!(place(&still, 9, 1).distance(place(&leaves, 9, 1)) < 1e-12);
    }
}
