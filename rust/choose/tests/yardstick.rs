//! The yardstick, on a small crown with known changes.

#[path = "../../curve/tests/common/mod.rs"]
mod common;

use std::borrow::Cow;

use common::crown;
use glam::DVec3;
use leafcloud::Foliage;
use leafcloud_choose::sway::{motion, swayed};
use leafcloud_choose::yardstick::LARGEST;
use leafcloud_choose::{Judgement, Subject, Yardstick};

/// Side of the pictures that are judged.
const SIDE: usize = 128;

fn yardstick(leaves: &Foliage) -> Yardstick<'_> {
    Yardstick::new(Cow::Borrowed(leaves), None, DVec3::Z, true, SIDE)
}

fn judged(yardstick: &Yardstick, level: &Foliage) -> Judgement {
    yardstick.judge(Subject::Foliage(level), SIDE, 1.0).unwrap().unwrap()
}

#[test]
fn the_leaves_pass_and_the_control_just_passes() {
    let leaves = crown(400);
    let yardstick = yardstick(&leaves);
    let same = judged(&yardstick, &leaves);
    assert_eq!((same.difference, same.places, same.excess(1.0).0), (0.0, 0.0, 0.0));
    let control = judged(&yardstick, &swayed(&leaves, motion(same.crown)).unwrap());
    assert!((control.difference - 1.0).abs() < 1e-9 && (control.places - 1.0).abs() < 1e-9, "{control:?}");
}

#[test]
fn a_stronger_breeze_fails_by_the_difference_or_by_places() {
    let leaves = crown(400);
    let found = judged(&yardstick(&leaves), &swayed(&leaves, 0.1).unwrap());
    let (excess, by) = found.excess(1.0);
    assert!(excess > 1.2 && ["difference", "places", "contrast"].contains(&by), "{found:?}");
    assert!(found.difference > 1.2);
}

#[test]
fn missing_leaves_fail_by_the_coverage() {
    let leaves = crown(400);
    let few: Vec<[DVec3; 3]> = (0..leaves.triangle_count())
        .map(|t| if t % 10 < 2 { [leaves.corners(t)[0]; 3] } else { leaves.corners(t) })
        .collect();
    let found = judged(&yardstick(&leaves), &leaves.with_corners(&few).unwrap());
    assert!(found.looks.coverage < 0.95, "{found:?}");
    assert!(found.excess(1.0).0 > 1.0);
}

#[test]
fn a_level_takes_over_at_most_where_it_may() {
    let leaves = crown(400);
    let yardstick = yardstick(&leaves);
    let whole = yardstick.largest(Subject::Foliage(&leaves), 1.0, 540.0).unwrap();
    assert_eq!((whole.crown, whole.passes), (540.0, true));
    let near = yardstick.largest(Subject::Foliage(&leaves), 1.0, 50.0).unwrap();
    assert_eq!(near.crown, 50.0);
    let moved = swayed(&leaves, 0.2).unwrap();
    let other = yardstick.largest(Subject::Foliage(&moved), 1.0, 540.0).unwrap();
    assert!(!other.passes && other.crown == 12.0, "{other:?}");
    assert_eq!(yardstick.sides().collect::<Vec<_>>(), [128, 64, 32, 16]);
    assert!(yardstick.judge(Subject::Foliage(&leaves), LARGEST, 1.0).unwrap().is_none(), "no pictures of this size");
}

/// The largest side in a row of sides that pass, from 128 up; or, if 128 fails, the largest below that passes. `passes`: largest sides first.
fn side_by_definition(passes: &[(usize, bool)]) -> Option<usize> {
    let larger = passes.iter().rev().skip_while(|(side, _)| *side < 128).take_while(|(_, passes)| *passes);
    let smaller = || passes.iter().find(|(side, passes)| *side < 128 && *passes);
    larger.last().or_else(smaller).map(|(side, _)| *side)
}

#[test]
fn a_level_takes_over_between_the_largest_pictures_in_which_it_passes_and_the_next() {
    let leaves = crown(400);
    let yardstick = Yardstick::new(Cow::Borrowed(&leaves), None, DVec3::Z, false, LARGEST);
    let level = swayed(&leaves, 0.02).unwrap();
    let judge = |side: usize| yardstick.judge(Subject::Foliage(&level), side, 1.0).unwrap().unwrap();
    let judged: Vec<(usize, Judgement)> = yardstick.sides().map(|side| (side, judge(side))).collect();
    let found = [0.3, 0.55, 0.6, 0.865, 0.873, 1.0].map(|q| {
        let passes: Vec<(usize, bool)> =
            judged.iter().map(|(side, judged)| (*side, judged.excess(q).0 <= 1.0)).collect();
        let passed = yardstick.largest(Subject::Foliage(&level), q, 540.0).unwrap();
        let side = side_by_definition(&passes);
        assert_eq!(passed.passes, side.is_some(), "{q}: {passes:?}");
        if let Some(side) = side {
            let (own, next) = (judge(side).crown, 2.0 * judge(side).crown);
            let range = if side == LARGEST { 540.0..=540.0 } else { own..=next };
            assert!(range.contains(&passed.crown) && passed.judged.crown == own, "{q}: {side}, {passed:?}");
        }
        side
    });
    assert_eq!(found, [None, Some(32), Some(64), Some(128), Some(256), Some(512)], "{judged:?}");
}
