//! Small foliage, and settings of every method.

use glam::DVec3;
use leafcloud::fit::{Effort, FitSettings, Method, Named, fit};
use leafcloud::foliage::Attributes;
use leafcloud::{Cloud, Foliage, Progress, gltf};

use super::in_repository;
use super::random::Random;

/// Returns the shrub in the repository.
pub fn shrub() -> Foliage {
    gltf::read(&in_repository("examples/shrub.glb"), &gltf::DEFAULT_NAMES).unwrap()
}

/// Returns a foliage of separate triangles. Triangles are separate leaves even if corners coincide.
pub fn soup(corners: &[[DVec3; 3]]) -> Foliage {
    let positions: Vec<DVec3> = corners.iter().flatten().copied().collect();
    let triangles = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
}

/// Returns the corners of small, randomly oriented triangles in a ball.
pub fn random_corners(count: usize, seed: u64) -> Vec<[DVec3; 3]> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| {
            let at = random.in_ball();
            [at, at + random.in_ball() * 0.05, at + random.in_ball() * 0.05]
        })
        .collect()
}

/// Returns settings of a quick search.
pub fn quick() -> FitSettings {
    FitSettings { candidates: 100, ..FitSettings::default() }
}

/// Returns settings of every method; the stochastic one with every effort except the longest.
pub fn all_settings() -> Vec<FitSettings> {
    let of = |method, effort| FitSettings {
        method,
        effort,
        max_billboards: (method == Method::KMeans).then_some(12),
        ..quick()
    };
    let mut all: Vec<FitSettings> = Effort::ALL[..3].iter().map(|&effort| of(Method::Stochastic, effort)).collect();
    all.extend([of(Method::Density, Effort::Default), of(Method::KMeans, Effort::Default)]);
    all
}

/// Returns the cloud of a foliage.
pub fn fitted(foliage: &Foliage, settings: &FitSettings) -> Cloud {
    fit(foliage, settings, Progress::silent()).unwrap()
}
