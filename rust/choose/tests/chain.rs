//! Settings chosen for the image error at the hand-over, on a small crown.

mod common;

use common::crown;
use leafcloud::fit::FitSettings;
use leafcloud::lod::{ChainSettings, build_chain};
use leafcloud::{Foliage, Progress, Result};
use leafcloud_curve::quality::{Scale, is_quick, settings_for, with_fewer_views};
use leafcloud_flip::{ImageErrors, crown_pixels};

fn tried_on(
    quick: bool,
    target: f64,
    foliage: &Foliage,
    settings: &ChainSettings,
    free: bool,
) -> Result<ChainSettings> {
    let scale = Scale::of(foliage, settings, quick)?;
    settings_for(target, &scale, None, None, settings, free, Progress::silent())
}

fn tried(target: f64, foliage: &Foliage, settings: &ChainSettings, free: bool) -> Result<ChainSettings> {
    tried_on(false, target, foliage, settings, free)
}

fn chosen(target: f64, foliage: &Foliage, settings: &ChainSettings, free: bool) -> ChainSettings {
    tried(target, foliage, settings, free).unwrap()
}

/// Diameter of the crown in pixels where level 1 takes over by these settings.
fn predicted_size(settings: &ChainSettings) -> f64 {
    2.0 * settings.pixels / settings.fit.epsilon
}

#[test]
fn level_1_takes_over_about_where_it_was_predicted() {
    let foliage = crown(600);
    let settings = ChainSettings { levels: 1, cross: false, ..ChainSettings::default() };
    let settings = chosen(0.06, &foliage, &settings, true);
    let chain = build_chain(&foliage, None, &settings, Progress::silent()).unwrap();
    let measured = ImageErrors::of(&chain.levels[0].pictures).largest_size(0.06).map(crown_pixels).unwrap();
    let ratio = measured / predicted_size(&settings);
    assert!((0.6..1.5).contains(&ratio), "measured {measured}, predicted {}", predicted_size(&settings));
}

#[test]
fn more_error_takes_over_nearer() {
    let foliage = crown(300);
    let fixed = ChainSettings::default();
    let sizes = [0.03, 0.06, 0.12].map(|target| predicted_size(&chosen(target, &foliage, &fixed, false)));
    assert!(sizes.is_sorted() && sizes[0] < 0.7 * sizes[2], "{sizes:?}");
}

#[test]
fn a_quick_choice_is_near_the_one_of_a_search() {
    // Bounds are tried by √2: the guess may be off by two steps.
    for leaves in [100, 300, 900] {
        let foliage = crown(leaves);
        let found = |quick| tried_on(quick, 0.18, &foliage, &ChainSettings::default(), true).unwrap().fit.epsilon;
        let ratio = found(true) / found(false);
        assert!((0.49..2.05).contains(&ratio), "{leaves} leaves: {} in place of {}", found(true), found(false));
    }
    let fewer = with_fewer_views(&ChainSettings::default()).views;
    assert!(fewer.amounts < ChainSettings::default().views.amounts && is_quick(0.18) && !is_quick(0.08));
}

#[test]
fn a_given_epsilon_stays() {
    let foliage = crown(300);
    let fit = FitSettings { epsilon: 0.05, ..FitSettings::default() };
    let given = ChainSettings { fit, ..ChainSettings::default() };
    assert_eq!(chosen(0.06, &foliage, &given, false).fit.epsilon, 0.05);
    let limited = FitSettings { max_billboards: Some(20), ..given.fit.clone() };
    let limited = ChainSettings { fit: limited, ..given };
    assert_eq!(chosen(0.06, &foliage, &limited, true).fit.epsilon, 0.05, "a number of billboards leaves no choice");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let foliage = crown(300);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| chosen(0.06, &foliage, &ChainSettings::default(), true));
        (found.fit.epsilon, found.pixels)
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn a_target_outside_its_range_is_refused() {
    let foliage = crown(20);
    for target in [0.0, 1.0, -0.1, f64::NAN] {
        let found = tried(target, &foliage, &ChainSettings::default(), true);
        let message = found.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.starts_with("`target_error` is"), "{target}: {message}");
    }
}
