//! Chains that quality chooses, on a small crown.

#[path = "../../curve/tests/common/mod.rs"]
mod common;

use common::{crown, crown_of};
use leafcloud::fit::FitSettings;
use leafcloud::lod::ChainSettings;
use leafcloud::textures::Samples;
use leafcloud::{Foliage, Progress, Result};
use leafcloud_choose::{Chosen, Last, Wanted, Wishes};

fn built(foliage: &Foliage, settings: ChainSettings, wishes: Option<Wishes>, last: Last) -> Result<Chosen> {
    let settings = ChainSettings { samples: Samples::new(1)?, every_level: false, tight_pages: false, ..settings };
    Wanted { settings, wish: None, wishes, last }.build(foliage, None, Progress::silent())
}

/// Small pages and a low quality are quick.
fn small() -> Wishes {
    Wishes { memory_budget: 0.25, quality: 0.2, ..Wishes::default() }
}

fn chosen(foliage: &Foliage, wishes: Wishes) -> Chosen {
    built(foliage, ChainSettings { levels: 2, ..ChainSettings::default() }, Some(wishes), Last::Auto).unwrap()
}

fn sizes(chosen: &Chosen) -> Vec<f64> {
    chosen.takes_over.iter().map(|passed| passed.crown).collect()
}

#[test]
fn levels_take_over_where_they_look_like_the_leaves_one_after_another() {
    let wishes = Wishes { quality: 0.3, ..small() };
    let settings = ChainSettings { levels: 2, ..ChainSettings::default() };
    let found = built(&crown_of(1500, 0.04), settings, Some(wishes), Last::Cross).unwrap();
    let clouds = found.chain.levels.iter().filter(|level| !level.is_cross()).count();
    let leaves = found.leaf_levels.len();
    assert!(clouds + leaves > 0 && found.takes_over.len() == found.chain.levels.len() + leaves);
    for passed in &found.takes_over[..clouds + leaves] {
        assert!(passed.passes && passed.judged.excess(found.q).0 <= 1.0, "{passed:?}");
    }
    let sizes = sizes(&found);
    assert!(sizes.windows(2).all(|pair| pair[0] >= 1.25 * pair[1]), "{sizes:?}");
    assert!((16.0..=540.0).contains(&sizes[0]), "{sizes:?}");
}

#[test]
fn more_quality_allows_less_deviation() {
    let foliage = crown(300);
    let epsilon = |quality| chosen(&foliage, Wishes { quality, ..small() }).tried.last().unwrap().epsilon;
    let found = [1.0, 0.5].map(epsilon);
    assert!(found[0] < 0.8 * found[1], "{found:?}");
}

#[test]
fn wished_sizes_and_a_given_epsilon_are_kept() {
    let foliage = crown(200);
    let found = chosen(&foliage, Wishes { sizes: vec![0.4, 0.1], ..small() });
    assert_eq!(sizes(&found)[..2], [432.0, 108.0]);
    let settings = ChainSettings {
        fit: FitSettings { epsilon: 0.05, ..FitSettings::default() },
        levels: 1,
        ..ChainSettings::default()
    };
    let given =
        built(&foliage, settings, Some(Wishes { free: false, sizes: vec![0.3], ..small() }), Last::Cross).unwrap();
    assert!(given.tried.is_empty() && given.chain.levels[0].epsilon == Some(0.05));
}

#[test]
fn pages_keep_to_the_memory() {
    let foliage = crown(200);
    let side = |memory| {
        let found = chosen(&foliage, Wishes { memory_budget: memory, sizes: vec![0.4], ..small() });
        found.chain.levels.iter().map(|level| level.page.base_color.width()).max().unwrap()
    };
    assert!(side(0.25) <= 256 && side(4.0) > 256);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let foliage = crown(200);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| chosen(&foliage, small()));
        (sizes(&found), found.tried)
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn the_last_level_has_the_form_that_is_asked_for() {
    let foliage = crown(300);
    let settings = ChainSettings { levels: 1, ..ChainSettings::default() };
    let last = |form| built(&foliage, settings.clone(), Some(small()), form).unwrap();
    assert!(last(Last::Cross).octahedral.is_none());
    let impostor = last(Last::Octahedral);
    assert!(impostor.octahedral.is_some() && impostor.plain.is_some(), "plain files show the cross impostor");
    let unjudged = built(&foliage, settings.clone(), None, Last::Octahedral).unwrap();
    assert!(unjudged.octahedral.is_some() && unjudged.takes_over.is_empty());
    let without = ChainSettings { cross: false, ..settings };
    let refused = built(&foliage, without, None, Last::Octahedral).err().map(|error| error.to_string());
    assert!(refused.unwrap().contains("cross impostor"));
}

#[test]
fn wishes_out_of_range_are_refused() {
    let wishes = Wishes { quality: f64::NAN, ..Wishes::default() };
    let refused = built(&crown(20), ChainSettings::default(), Some(wishes), Last::Cross).err().unwrap().to_string();
    assert!(refused.starts_with("`quality` is NaN"), "{refused}");
}

#[test]
fn fewer_leaves_fill_the_gap_before_a_late_cloud() {
    let foliage = crown_of(3000, 0.012);
    let found = chosen(&foliage, Wishes { quality: 0.26, ..small() });
    let levels: Vec<_> = found.leaf_levels.iter().filter(|level| level.kept.is_some()).collect();
    let sizes = sizes(&found);
    assert!(!levels.is_empty() && sizes.windows(2).all(|pair| pair[0] >= 1.25 * pair[1]), "{sizes:?}");
    let mut before: Vec<u32> = (0..foliage.triangle_count() as u32).collect();
    for level in levels {
        let kept = &level.kept.as_ref().unwrap().triangles;
        assert!(level.passed.passes && kept.len() * 5 <= before.len() * 4 && kept.iter().all(|t| before.contains(t)));
        assert_eq!(level.leaves.targets.len(), before.len());
        let mut places = level.leaves.places.iter();
        for (triangle, target) in before.iter().zip(&level.leaves.targets) {
            if kept.contains(triangle) {
                assert_eq!(target, places.next().unwrap(), "a kept leaf grows");
            } else {
                assert!(target.iter().all(|p| *p == target[0]), "others shrink into a point");
            }
        }
        before.clone_from(kept);
    }
}
