//! The form of the last level, on trees with a known cheapest form.

mod common;

use common::crown;
use leafcloud::lod::{Chain, ChainSettings, Octahedral, build_chain};
use leafcloud::{Error, Foliage, Progress};
use leafcloud_curve::{Last, Place, octahedral};
use leafcloud_flip::ImageErrors;

fn settings(cross: bool) -> ChainSettings {
    ChainSettings { levels: usize::from(!cross), cross, texture_size: 512.into(), ..ChainSettings::default() }
}

/// Returns the impostor that replaces the level `before` of a crown.
fn chosen(
    last: Last,
    target: Option<f64>,
    chain: &Chain,
    leaves: &Foliage,
    before: &Foliage,
) -> Result<Option<Octahedral>, Error> {
    let place = Place { parts: &[leaves], simpler: None, before, before_pictures: None, chain };
    octahedral(last, target, place, &settings(true), Progress::silent())
}

#[test]
fn it_replaces_many_triangles_and_not_two() {
    let leaves = crown(600);
    let chain = build_chain(&leaves, None, &settings(true), Progress::silent()).unwrap();
    let few = chain.levels[0].foliage().unwrap();
    let auto = |before: &Foliage, target| chosen(Last::Auto, target, &chain, &leaves, before).unwrap();
    let found = auto(&leaves, Some(0.08)).expect("an impostor in place of 1,200 triangles");
    assert!(auto(&few, Some(0.08)).is_none(), "six triangles are cheaper");
    assert!(auto(&leaves, None).is_none(), "nothing to judge it by");
    assert!(chosen(Last::Cross, Some(0.08), &chain, &leaves, &leaves).unwrap().is_none());
    assert!(chosen(Last::Octahedral, None, &chain, &leaves, &few).unwrap().is_some());
    let error = |pictures| ImageErrors::of(pictures).0.iter().find(|(size, _)| *size == 64).unwrap().1;
    assert!(error(&found.pictures) <= 0.5 * error(&chain.levels[0].pictures), "half of the cross impostor's error");
    assert!(found.color.width() <= 1024 && found.color.height() <= 1024);
}

#[test]
fn files_need_a_cross_impostor_beside_it() {
    let leaves = crown(100);
    let without = settings(false);
    let chain = build_chain(&leaves, None, &without, Progress::silent()).unwrap();
    let place = Place { parts: &[&leaves], simpler: None, before: &leaves, before_pictures: None, chain: &chain };
    let with = |last, settings: &ChainSettings| octahedral(last, Some(0.08), place, settings, Progress::silent());
    let error = with(Last::Octahedral, &without).unwrap_err().to_string();
    assert!(error.contains("cross"), "{error}");
    assert!(with(Last::Auto, &without).unwrap().is_none());
    assert!(with(Last::Octahedral, &settings(true)).unwrap().is_none(), "left out because it saves nothing");
}
