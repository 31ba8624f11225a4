use std::sync::LazyLock;

use glam::{DVec3, Vec2, Vec4};

use super::credit::Credit;
use super::*;
use crate::Error;
use crate::atlas::Region;
use crate::fit::FitSettings;
use crate::foliage::{Attributes, Image, Material};
use crate::lod::{ChainSettings, Level, build_chain};
use crate::metrics::{Comparison, Views};
use crate::textures::Samples;

/// Cards in a ball, each with a round leaf of another green on a transparent ground.
pub fn bush(count: u32) -> Foliage {
    let disc = |i: usize| {
        let (x, y) = ((i % 32) as f64 - 15.5, (i / 32) as f64 - 15.5);
        [60, 140, 30, if x.hypot(y) < 13.0 { 255 } else { 0 }]
    };
    let leaf = Image::new(32, 32, (0..32 * 32).map(disc).collect::<Vec<_>>()).unwrap();
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let (mut positions, mut triangles, mut attributes) = (Vec::new(), Vec::new(), Attributes::default());
    for i in 0..count {
        let share = (f64::from(i) + 0.5) / f64::from(count);
        let (z, angle) = (1.0 - 2.0 * share, f64::from(i) * golden);
        let place = DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z);
        let normal = (place + DVec3::new((5.0 * angle).sin(), (3.0 * angle).cos(), 0.4)).normalize();
        let (x, y) = normal.any_orthonormal_pair();
        let at = |a: f64, b: f64| place * (0.4 + 0.6 * share) + x * (0.15 * a) + y * (0.15 * b);
        let first = 4 * i;
        positions.extend([at(-1., -1.), at(1., -1.), at(1., 1.), at(-1., 1.)]);
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        attributes.uvs.extend([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]);
        let shade = Vec4::new(1.0, 0.4 + 0.6 * share as f32, 1.0, 1.0);
        attributes.colors.extend([[shade; 3]; 2]);
    }
    let material = Material {
        image: Some(leaf),
        alpha_mode: crate::AlphaMode::Mask(0.5),
        double_sided: true,
        ..Material::default()
    };
    Foliage::new(&positions, triangles, attributes, vec![material]).unwrap()
}

pub fn settings(refine: Refinement) -> ChainSettings {
    let fit = FitSettings { epsilon: 0.15, candidates: 60, ..FitSettings::default() };
    let samples = Samples::new(2).unwrap();
    ChainSettings {
        fit,
        levels: 1,
        cross: false,
        texture_size: 256.into(),
        samples,
        refine,
        ..ChainSettings::default()
    }
}

fn level(foliage: &Foliage, refine: Refinement) -> Level {
    build_chain(foliage, None, &settings(refine), Progress::silent()).unwrap().levels.remove(0)
}

/// Bushes and their first levels, for several tests.
static UNREFINED_400: LazyLock<(Foliage, Level)> = LazyLock::new(|| bush_and_level(400, Refinement::Off));
static REFINED_400: LazyLock<(Foliage, Level)> = LazyLock::new(|| bush_and_level(400, Refinement::Short));

fn bush_and_level(count: u32, refine: Refinement) -> (Foliage, Level) {
    let foliage = bush(count);
    let level = level(&foliage, refine);
    (foliage, level)
}

/// Mean absolute difference of codes over the pixels of all pictures, in f64; a definition of its own.
fn error(Comparison { flat, .. }: &Comparison) -> f64 {
    let shown = |pixel: &[u8; 4]| {
        let alpha = f64::from(pixel[3]) / 255.0;
        [0, 1, 2].map(|i| f64::from(pixel[i]) * alpha + 127.5 * (1.0 - alpha))
    };
    let pixels = flat.base.iter().zip(flat.level.iter()).flat_map(|(a, b)| a.pixels().iter().zip(b.pixels()));
    let off = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|i| (shown(a)[i] - shown(b)[i]).abs()).sum::<f64>();
    let errors: Vec<f64> = pixels.map(off).collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn pictures_from_other_sides_become_more_like_the_leaves() {
    let (foliage, before) = &*UNREFINED_400;
    let (_, after) = &*REFINED_400;
    assert_eq!(before.refined, None);
    let tested = &after.refined.as_ref().unwrap().errors;
    assert!(tested.iter().all(|(_, ratio)| *ratio < 1.0), "{tested:?}");
    let views = Views { count: 5, size: 96, samples: Samples::new(4).unwrap(), up: DVec3::Z, turn: 0.13 };
    let leaves = Reference::new(&[foliage], foliage.frame(), views).unwrap();
    let pictures = |page: &Page, level: &Level| {
        let material = page.material(level.alpha_cutoff, !level.two_sided);
        leaves.compare(&[&billboards(&level.atlas, &level.frame, material).unwrap()]).unwrap()
    };
    let [old, new] = [before, after].map(|level| pictures(&level.page, level));
    assert!(error(&new) < 0.97 * error(&old), "{} after {}", error(&new), error(&old));
    assert!((new.coverage() - 1.0).abs() < 0.03, "{}", new.coverage());
}

#[test]
fn textures_leave_planes_and_the_morph_as_they_are() {
    let foliage = bush(200);
    let refined_parts = RefinedParts { planes: false, texels: true };
    let [before, after] = [Refinement::Off, Refinement::Short].map(|effort| {
        let settings = ChainSettings { refined_parts, ..settings(effort) };
        build_chain(&foliage, None, &settings, Progress::silent()).unwrap().levels.remove(0)
    });
    let targets = |level: &Level| level.projection.as_ref().unwrap().targets.clone();
    assert_eq!(targets(&before), targets(&after));
    let planes = |level: &Level| level.cloud.as_ref().unwrap().planes.clone();
    let numbers = |level: &Level| planes(level).iter().map(|p| (p.normal, p.distance)).collect::<Vec<_>>();
    assert_eq!(numbers(&before), numbers(&after));
    assert_ne!(before.page.base_color, after.page.base_color);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn any_number_of_threads_gives_the_same_bytes() {
    let foliage = bush(150);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| level(&foliage, Refinement::Short))
    };
    let [one, three] = [on(1), on(3)];
    assert_eq!(one.page, three.page);
    assert_eq!(one.alpha_cutoff, three.alpha_cutoff);
    assert_eq!(one.refined, three.refined);
}

#[test]
fn a_refinement_can_be_cancelled() {
    let foliage = bush(150);
    let report = |stage: &str, _: f64| stage != "refine";
    let result = build_chain(&foliage, None, &settings(Refinement::Long), Progress::new(&report));
    assert!(matches!(result, Err(Error::Cancelled)));
}

#[test]
fn blended_billboards_stay_as_they_are_baked() {
    let foliage = bush(100);
    let of = |refine: Refinement| {
        let settings = ChainSettings { blended: true, ..settings(refine) };
        build_chain(&foliage, None, &settings, Progress::silent()).unwrap().levels.remove(0)
    };
    let [off, short] = [of(Refinement::Off), of(Refinement::Short)];
    assert_eq!(off.page, short.page);
    assert_eq!(short.refined, None);
}

#[test]
fn steps_use_other_views_than_tests_and_reports() {
    let whole = 2.0 * std::f64::consts::PI / (std::f64::consts::PI * (3.0 - 5f64.sqrt()));
    for step in 0..32 {
        for other in [0.0, 0.25, TEST_TURN, 0.5] {
            let apart = (turn_of(step) - other).rem_euclid(whole);
            assert!(apart.min(whole - apart) > 0.1, "step {step} has the turn {}", turn_of(step));
        }
    }
}

#[test]
#[ignore = "long: make test-night runs it"]
fn pages_of_any_shape_are_refined() {
    let foliage = bush(120);
    for (width, height, back_sides) in [(256, 64, None), (64, 128, Some(true)), (64, 64, None)] {
        let size = crate::atlas::PageSize { width, height };
        let settings = ChainSettings { texture_size: size, back_sides, levels: 2, ..settings(Refinement::Short) };
        let chain = build_chain(&foliage, None, &settings, Progress::silent()).unwrap();
        for level in &chain.levels {
            let errors = &level.refined.as_ref().unwrap().errors;
            assert!(errors.iter().all(|(_, ratio)| *ratio <= 1.0), "{errors:?}");
            assert!((0.8..1.2).contains(&level.coverage), "{}", level.coverage);
        }
    }
}

#[test]
fn unmoved_texels_stay_as_they_are_baked() {
    let foliage = bush(150);
    let level = level(&foliage, Refinement::Off);
    let texels = Texels::of(&level.page.base_color, &level.atlas, level.alpha_cutoff);
    let pairs = || texels.page().pixels().to_vec().into_iter().zip(level.page.base_color.pixels().to_vec());
    assert!(pairs().all(|(new, old)| (0..4).all(|i| new[i].abs_diff(old[i]) <= 1)), "within a code");
    assert_ne!(texels.widened(), level.page.base_color);
}

#[test]
fn a_step_moves_few_texels_over_the_cutoff() {
    let foliage = bush(150);
    let level = level(&foliage, Refinement::Off);
    let cutoff = level.alpha_cutoff;
    let mut texels = Texels::of(&level.page.base_color, &level.atlas, cutoff);
    let drawn = |texels: &Texels| texels.page().pixels().iter().filter(|p| f32::from(p[3]) / 255.0 >= cutoff).count();
    // All texels would better vanish.
    let side = level.page.base_color.width();
    let of_region =
        |r: Region| (r.y..r.y + r.height).flat_map(move |y| (r.x..r.x + r.width).map(move |x| y * side + x));
    let credit = |texel: usize| Credit { texel: texel as u32, value: Vec2::new(-1.0, 1.0) };
    let alpha = level.atlas.regions().flat_map(of_region).map(credit).collect();
    let credits = Credits { alpha, ..Credits::default() };
    let mut before = drawn(&texels);
    for step in 0..8 {
        texels.move_by(&credits, Rates::of_step(step));
        let after = drawn(&texels);
        assert!(after < before, "step {step}");
        assert!((before - after) as f64 <= 0.07 * before as f64, "step {step}: {before} to {after}");
        before = after;
    }
}

#[test]
fn sums_along_both_axes_are_those_of_the_definition() {
    let (width, height, reach) = (7usize, 4usize, 2usize);
    let values: Vec<Vec4> = (0..width * height).map(|i| Vec4::splat((i * i % 11) as f32)).collect();
    let found = picture::box_sums(&values, width, reach);
    for (index, sum) in found.iter().enumerate() {
        let near = |other: &usize| {
            (other % width).abs_diff(index % width) <= reach && (other / width).abs_diff(index / width) <= reach
        };
        let wanted: Vec4 = (0..values.len()).filter(near).map(|other| values[other]).sum();
        assert_eq!(*sum, wanted, "at {index}");
    }
}

#[test]
fn a_perfect_level_has_nothing_to_gain() {
    let first = vec![(64, 0.0)];
    assert_eq!(Gain::over(&first, &vec![(64, 0.0)]).errors, [(64, 1.0)]);
}

#[test]
fn a_gain_counts_only_if_no_size_loses() {
    let first = vec![(64, 0.2), (32, 0.1)];
    let gain = |errors: [f64; 2]| Gain::over(&first, &vec![(64, errors[0]), (32, errors[1])]);
    let none = Gain::none(&first);
    assert!(gain([0.1, 0.1]).is_better_than(&none));
    assert!(!gain([0.02, 0.101]).is_better_than(&none), "the small pictures became worse");
    assert!(gain([0.1, 0.05]).is_better_than(&gain([0.1, 0.1])));
    assert!(!none.is_better_than(&none));
}
