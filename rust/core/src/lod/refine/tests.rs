use std::sync::LazyLock;

use glam::{DVec3, Vec2, Vec4};

use super::credit::Credit;
use super::leaf_views::of_size;
use super::*;
use crate::Error;
use crate::atlas::Region;
use crate::fit::FitSettings;
use crate::foliage::{Attributes, Image, Material};
use crate::lod::{ChainSettings, Level, ViewCounts, build_chain};
use crate::metrics::{Comparison, Views};
use crate::textures::{LightGrid, Samples};

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
static REFINED_200: LazyLock<(Foliage, Level)> = LazyLock::new(|| bush_and_level(200, Refinement::Short));

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
        leaves.compare(&billboards(&level.atlas, &level.frame, material).unwrap()).unwrap()
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
    assert!(one.for_engines(1) == three.for_engines(1));
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

/// A mip level in views that no refinement uses.
struct MipSeen {
    error: f64,
    coverage: f64,
    tone: f32,
}

/// Looks at mip levels, the first of them in views of 96 pixels.
fn mips_seen(foliage: &Foliage, level: &Level, mips: impl Iterator<Item = Image>, cutoff: f32) -> Vec<MipSeen> {
    let look = |(number, mip): (usize, Image)| {
        let views = Views { count: 6, size: 96 >> number, samples: Samples::new(4).unwrap(), up: DVec3::Z, turn: 0.13 };
        let leaves = Reference::new(&[foliage], foliage.frame(), views).unwrap();
        let alpha_mode = crate::AlphaMode::Mask(cutoff);
        let material = Material { image: Some(mip), alpha_mode, ..level.page.material(cutoff, !level.two_sided) };
        let pictures = leaves.compare(&billboards(&level.atlas, &level.frame, material).unwrap()).unwrap();
        MipSeen { error: error(&pictures), coverage: pictures.coverage(), tone: pictures.tone().y }
    };
    mips.enumerate().map(look).collect()
}

/// Looks at a page for engines on its first mip levels.
fn page_seen(foliage: &Foliage, level: &Level, page: &Image, cutoff: f32) -> Vec<MipSeen> {
    mips_seen(foliage, level, LightGrid::of(page).levels(3).map(|mip| mip.to_image()), cutoff)
}

fn without_pictures(level: &Level) -> Level {
    Level { refine_by: None, engine: std::sync::Arc::default(), ..level.clone() }
}

#[test]
fn pages_for_engines_become_more_like_the_leaves_on_all_mip_levels() {
    for ((foliage, refined), most) in [(&*UNREFINED_400, 0.99), (&*REFINED_400, 0.98)] {
        let [old, new] = [&without_pictures(refined), refined].map(|level| {
            let (page, cutoff) = level.for_engines(1);
            page_seen(foliage, level, page, cutoff)
        });
        for (number, (new, old)) in new.iter().zip(&old).enumerate() {
            assert!(new.error < most * old.error, "level {number}: {} after {}", new.error, old.error);
        }
    }
}

#[test]
fn mip_levels_of_files_become_more_like_the_leaves_and_cover_a_little_more() {
    let (foliage, refined) = &*UNREFINED_400;
    let [old, new] = [&without_pictures(refined), refined].map(|level| {
        let cutoff = level.for_engines(1).1;
        let mips = level.mips("base_color", 1).unwrap().into_owned().into_iter().skip(1).take(3).map(|mip| mip.image);
        mips_seen(foliage, level, mips, cutoff)
    });
    for (number, (new, old)) in new.iter().zip(&old).enumerate() {
        assert!(new.error < 0.99 * old.error, "level {number}: {} after {}", new.error, old.error);
        assert!((0.99..1.05).contains(&new.coverage), "level {number}: {} after {}", new.coverage, old.coverage);
        assert!((new.tone - 1.0).abs() < 0.02, "level {number}: {} after {}", new.tone, old.tone);
    }
}

#[test]
fn levels_have_pictures_for_engines_unless_few_views_are_wanted_or_alpha_is_coverage() {
    let foliage = bush(50);
    let has_pictures = |more: &dyn Fn(&mut ChainSettings)| {
        let mut settings = ChainSettings { cross: true, ..settings(Refinement::Off) };
        more(&mut settings);
        let chain = build_chain(&foliage, None, &settings, Progress::silent()).unwrap();
        chain.levels.iter().map(|level| level.refine_by.is_some()).collect::<Vec<_>>()
    };
    assert_eq!(has_pictures(&|_| ()), [true, true]);
    assert_eq!(has_pictures(&|settings| settings.views = ViewCounts::QUICK), [false, false]);
    let quick_but_refined = |settings: &mut ChainSettings| {
        (settings.views, settings.refine) = (ViewCounts::QUICK, Refinement::Short);
    };
    assert_eq!(has_pictures(&quick_but_refined), [true, true]);
    assert_eq!(has_pictures(&|settings| settings.blended = true), [false, false]);
}

fn page_material(level: &Level, cutoff: f32) -> Material {
    Material { image: None, ..level.page.material(cutoff, !level.two_sided) }
}

/// Returns a refinement of a level's page for engines, in four steps.
fn on_all_mips<'a>(level: &'a Level, material: &'a Material, cutoff: f32, pictures: &'a LeafPictures) -> OnMips<'a> {
    OnMips { atlas: &level.atlas, frame: &level.frame, material, cutoff, pictures, steps: 4, mips: usize::MAX }
}

#[test]
fn a_page_for_engines_that_shows_nothing_is_no_choice() {
    let foliage = bush(200);
    let level = level(&foliage, Refinement::Off);
    let (page, cutoff) = level.for_engines(1);
    let material = page_material(&level, cutoff);
    let on_mips = on_all_mips(&level, &material, cutoff, level.refine_by.as_ref().unwrap());
    let error = |image: &Image| on_mips.error(image).unwrap().unwrap();
    let blank = page.mapped(|[r, g, b, _]| [r, g, b, 0]);
    assert!(error(&blank) > error(page) + 3.0, "{} and {}", error(&blank), error(page));
}

#[test]
fn a_page_for_engines_that_is_too_dark_gets_its_light_back() {
    let (foliage, level) = &*REFINED_200;
    let kept = level.refine_by.as_ref().unwrap();
    let far = |page: &Image, cutoff: f32| {
        let of_mip = page_seen(foliage, level, page, cutoff).into_iter();
        of_mip.map(|mip| (mip.tone - 1.0).abs()).fold(0.0, f32::max)
    };
    // With small pictures, the first mip levels of the whole page are finer than pixels.
    for (halvings, size) in [(1, kept.tests[0].0.size), (0, 32)] {
        let (image, cutoff) = level.for_engines(halvings);
        let dark = image.mapped(|[r, g, b, a]| [r / 2, g / 2, b / 2, a]);
        let pictures = LeafPictures { steps: of_size(&kept.steps, size), tests: of_size(&kept.tests, size) };
        let material = page_material(level, cutoff);
        let on_mips = OnMips { steps: 8, ..on_all_mips(level, &material, cutoff, &pictures) };
        assert!(far(&dark, cutoff) > 2.0, "the test darkens the page");
        let found = far(&on_mips.refined(&dark).unwrap().unwrap(), cutoff);
        assert!(found < 0.15, "{halvings} halvings, pictures of {size} pixels: {found}");
    }
}

#[test]
fn mip_levels_have_pictures_of_the_size_at_which_engines_read_slanting_billboards() {
    let (_, level) = &*REFINED_200;
    let pictures = level.refine_by.as_ref().unwrap();
    for halvings in [0, 1] {
        let (image, cutoff) = level.for_engines(halvings);
        let material = page_material(level, cutoff);
        let on_mips = on_all_mips(level, &material, cutoff, pictures);
        let (view, texel) = (pictures.tests[0].0, level.atlas.texel() * level.frame.radius * f64::from(1 << halvings));
        let sizes: Vec<(usize, usize)> = on_mips.sizes(image).collect();
        assert!(sizes.len() > 2 && sizes.iter().all(|(_, size)| (8..=view.size).contains(size)), "{sizes:?}");
        for (mip, size) in sizes.into_iter().filter(|(_, size)| *size > 16) {
            let read = (2.0 * view.radius / size as f64 / texel).log2() + 0.647;
            assert!(
                (read - mip as f64).abs() < 0.05,
                "{halvings} halvings, pictures of {size} pixels: {read}, not {mip}"
            );
        }
    }
}

#[test]
fn a_page_for_engines_that_covers_too_little_covers_more() {
    let (foliage, level) = &*REFINED_200;
    let (image, cutoff) = level.for_engines(0);
    let sparse = image.mapped(|[r, g, b, a]| [r, g, b, a / 2]);
    let material = page_material(level, cutoff);
    let on_mips = on_all_mips(level, &material, cutoff, level.refine_by.as_ref().unwrap());
    let coverage = |page: &Image| page_seen(foliage, level, page, cutoff)[1].coverage;
    let (before, after) = (coverage(&sparse), coverage(&on_mips.refined(&sparse).unwrap().unwrap()));
    assert!(before < 0.92 && (0.95..1.06).contains(&after), "{before}, then {after}");
}
