//! Tests on the shrub in the repository, and on the measured trees if they are present.

use crate::common::soups::shrub;
use leafcloud::fit::{FitSettings, fit};
use leafcloud::{Progress, gltf};

#[test]
fn the_search_needs_no_more_planes_than_the_literal_one() {
    let trees =
        crate::common::trees().into_iter().filter(|(name, _)| ["maple_13k", "oak_cards_11k"].contains(&name.as_str()));
    let measured = trees.map(|(_, path)| gltf::read(&path, &gltf::DEFAULT_NAMES).unwrap());
    for foliage in measured.chain([shrub()]) {
        let candidates = 200;
        let settings = FitSettings { candidates, whole_leaves: false, ..FitSettings::default() };
        let ours = fit(&foliage, &settings, Progress::silent()).unwrap().planes.len();
        let literal = crate::common::literal::search(&foliage, settings.epsilon, candidates, 1).len();
        assert!(ours <= literal, "{ours} planes against {literal}");
    }
}

#[test]
fn parts_are_read_by_name() {
    let path = crate::common::in_repository("examples/shrub.glb");
    let trunk = gltf::read(&path, &["branch"]).unwrap();
    assert!(trunk.triangle_count() != shrub().triangle_count());
    let error = gltf::read(&path, &["no such part"]).unwrap_err().to_string();
    assert!(error.contains("shrub.glb") && error.contains("no such part"));
    assert!(gltf::read(&path.with_file_name("missing.glb"), &gltf::DEFAULT_NAMES).is_err());
}
