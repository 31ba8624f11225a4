//! A crown for the tests of this crate.

use glam::DVec3;
use leafcloud::{Attributes, Foliage, Material};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// Square leaves at random places in a ball, at random slopes.
pub fn crown(leaves: usize) -> Foliage {
    crown_of(leaves, 0.08)
}

/// As [`crown`], with leaves of this half side.
pub fn crown_of(leaves: usize, half: f64) -> Foliage {
    let mut random = Pcg32::new(5, 3);
    let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
    let mut positions = Vec::new();
    while positions.len() < 4 * leaves {
        let (place, normal) = (DVec3::new(unit(), unit(), unit()), DVec3::new(unit(), unit(), unit()));
        if place.length() > 1.0 || normal.length() < 0.1 {
            continue;
        }
        let side = normal.any_orthogonal_vector().normalize() * half;
        let other = normal.cross(side).normalize() * half;
        positions.extend([place - side - other, place + side - other, place + side + other, place - side + other]);
    }
    let quads = (0..leaves as u32).map(|leaf| 4 * leaf);
    let triangles = quads.flat_map(|i| [[i, i + 1, i + 2], [i, i + 2, i + 3]]).collect();
    Foliage::new(&positions, triangles, Attributes::default(), vec![Material::default()]).unwrap()
}
