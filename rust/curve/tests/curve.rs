//! Cost curves of a small crown: repeatability, refusals, predictions against known laws, charts.

mod common;

use std::sync::atomic::{AtomicUsize, Ordering};

use common::crown;
use leafcloud::atlas::PageSize;
use leafcloud::error::Error;
use leafcloud::fit::{Effort, FitSettings, Method};
use leafcloud::lod::{Chain, ChainSettings, PruneSettings, Refinement, build_chain};
use leafcloud::{Foliage, Progress};
use leafcloud_curve::chart::{Chart, ChartSize, Cost};
use leafcloud_curve::{
    Choice, Curve, Model, Point, Preset, Stages, Sweep, Wish, build_within, front, measure, offers, sweep,
};
use leafcloud_flip::image_error;

fn small() -> ChainSettings {
    ChainSettings { levels: 1, cross: false, texture_size: 256.into(), ..ChainSettings::default() }
}

fn quick(foliage: &Foliage) -> Curve {
    sweep(foliage, None, &small(), Sweep::Quick, Progress::silent()).unwrap()
}

/// Returns the points without the figures that depend on the machine's speed.
fn timeless(curve: &Curve) -> Vec<Point> {
    let still = |p: &Point| Point { seconds: Stages::default(), peak_bytes: None, front: false, ..p.clone() };
    curve.points.iter().map(still).collect()
}

#[test]
#[ignore = "long: make test-night runs it"]
fn repeated_sweeps_differ_in_seconds_only() {
    let crown = crown(300);
    let (first, second) = (quick(&crown), quick(&crown));
    assert_eq!(timeless(&first), timeless(&second));
    assert_eq!(first.refused, second.refused);
    assert!(first.points.len() >= 8);
}

#[test]
fn a_point_has_the_figures_of_its_chain() {
    let crown = crown(200);
    let (chain, point) = measure(&crown, None, &small(), Progress::silent()).unwrap();
    let level = &chain.levels[0];
    let cloud = level.cloud.as_ref().unwrap();
    assert_eq!(point.image_error, image_error(&level.pictures));
    let triangles = level.foliage().unwrap().triangle_count();
    assert_eq!((point.billboards, point.triangles), (cloud.planes.len(), triangles));
    assert!(point.max_deviation <= 0.04 && point.mean_deviation <= point.max_deviation);
    // Four bytes for each texel, a third more for mip levels, and 32 bytes for each corner: a polygon has two more than triangles.
    let polygons: usize = level.atlas.billboards.iter().map(|billboard| billboard.polygons.len()).sum();
    assert_eq!(point.bytes, 256 * 256 * 4 * 4 / 3 + 32 * (triangles + 2 * polygons) as u64);
    assert_eq!(point.measured_on, 400);
    assert_eq!(point.choice, Choice::of(&small()));
}

#[test]
fn unsuitable_settings_are_refused() {
    let crown = crown(50);
    let refuse =
        |settings: ChainSettings| sweep(&crown, None, &settings, Sweep::Quick, Progress::silent()).unwrap_err();
    let pruning = Some(PruneSettings { keep: 0.5, leaf_pixels: 16.0, half: 0.5, contrast: true });
    assert!(refuse(ChainSettings { pruning, ..small() }).to_string().contains("no pruning"));
    assert!(refuse(ChainSettings { levels: 0, cross: true, ..small() }).to_string().contains("at least one level"));
    assert!(refuse(ChainSettings { texture_size: 8.into(), ..small() }).to_string().contains("between 64 and 16384"));
    let budget = ChainSettings { fit: FitSettings { max_texels: Some(9000), ..small().fit }, ..small() };
    let refused = sweep(&crown, None, &budget, Sweep::Full, Progress::silent()).unwrap_err().to_string();
    assert!(refused.contains("leave `max_billboards` and `max_texels` out"), "{refused}");
    let wish = |wish| build_within(&crown, None, &small(), wish, Progress::silent()).unwrap_err().to_string();
    assert!(wish(Wish::Seconds(0.0)).contains("`seconds` is 0"));
    assert!(wish(Wish::Seconds(f64::NAN)).contains("greater than 0"));
    assert!(wish(Wish::ImageError(1.5)).contains("`image_error` is 1.5"));
    assert!(wish(Wish::Seconds(1e-6)).contains("raise it"));
    assert!(wish(Wish::ImageError(1e-4)).contains("the least that"));
    let fit = FitSettings { max_billboards: Some(9), ..FitSettings::default() };
    let fixed =
        build_within(&crown, None, &ChainSettings { fit, ..small() }, Wish::ImageError(0.5), Progress::silent());
    assert!(fixed.unwrap_err().to_string().contains("`max_billboards` leaves no choice"));
}

#[test]
fn a_sweep_can_be_canceled() {
    let (crown, told) = (crown(200), AtomicUsize::new(0));
    let report = |_: &str, _: f64| told.fetch_add(1, Ordering::Relaxed) < 4;
    let stopped = sweep(&crown, None, &small(), Sweep::Quick, Progress::new(&report));
    assert!(matches!(stopped, Err(Error::Cancelled)));
    assert_eq!(told.load(Ordering::Relaxed), 5);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn an_error_limit_is_kept() {
    let crown = crown(300);
    let offers = offers(&quick(&crown));
    assert!(offers.windows(2).all(|o| o[0].predicted.seconds < o[1].predicted.seconds));
    assert!(offers.windows(2).all(|o| o[0].predicted.image_error > o[1].predicted.image_error));
    let most = offers[offers.len() / 2].predicted.image_error;
    let built = build_within(&crown, None, &small(), Wish::ImageError(most), Progress::silent()).unwrap();
    assert!(image_error(&built.chain.levels[0].pictures) <= most);
    let draft = Preset::Draft.of(&offers).unwrap().choice;
    let built = build_within(&crown, None, &small(), Wish::Preset(Preset::Draft), Progress::silent()).unwrap();
    // The chosen offer depends on the machine's speed; the chain must match its offer.
    assert_eq!(built.chain.levels.len(), draft.levels);
    assert_eq!(built.chain.levels[0].page.base_color.width(), built.offer.choice.texture_size);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn a_wish_chooses_by_levels_without_refinement_and_refines_the_chosen_ones() {
    let crown = crown(100);
    let settings = ChainSettings { refine: Refinement::Short, ..small() };
    let curve = sweep(&crown, None, &settings, Sweep::Quick, Progress::silent()).unwrap();
    assert_eq!(curve.settings.refine, Refinement::Off);
    let built = build_within(&crown, None, &settings, Wish::Preset(Preset::Draft), Progress::silent()).unwrap();
    assert!(built.chain.levels[0].refined.is_some());
    assert_eq!(built.chain.levels[0].page.base_color.width(), built.offer.choice.texture_size);
}

/// With time to spare, no other ε gives a much better result, whatever the predictions.
#[test]
fn with_many_seconds_nothing_is_better() {
    let crown = crown(100);
    let built = build_within(&crown, None, &small(), Wish::Seconds(600.0), Progress::silent()).unwrap();
    let error = |chain: &Chain| image_error(&chain.levels[0].pictures);
    for epsilon in [0.1, 0.04, 0.02] {
        let fit = FitSettings { epsilon, ..small().fit };
        let other = build_chain(&crown, None, &ChainSettings { fit, ..small() }, Progress::silent()).unwrap();
        assert!(
            error(&built.chain) <= 1.1 * error(&other),
            "{} beside {} at {epsilon}",
            error(&built.chain),
            error(&other)
        );
    }
}

/// A curve that follows laws: page² (3 + samples²) · 10⁻⁹ seconds for textures, 0.01 ε^−1.5 seconds for planes, an error of ε^0.6
/// texel^0.2.
fn lawful() -> Curve {
    let base = Choice { samples: 1, levels: 1, cross: false, ..Choice::of(&ChainSettings::default()) };
    let texel = |c: &Choice| 20.0 / c.texture_size as f64 * c.epsilon.powf(-0.3);
    let point = |c: Choice| Point {
        choice: c,
        measured_on: 1000,
        seconds: Stages {
            bake: 1e-9 * (c.texture_size as f64).powi(2) * (3.0 + (c.samples as f64).powi(2)),
            fit: 0.01 * c.epsilon.powf(-1.5),
            ..Stages::default()
        },
        peak_bytes: None,
        billboards: 1,
        triangles: 2,
        texels: 1,
        bytes: 1,
        texel: texel(&c),
        max_deviation: c.epsilon,
        mean_deviation: c.epsilon / 2.0,
        image_error: c.epsilon.powf(0.6) * texel(&c).powf(0.2),
        front: false,
    };
    let mut points = vec![point(base)];
    points.extend([0.01, 0.16].map(|epsilon| point(Choice { epsilon, ..base })));
    points.push(point(Choice { samples: 8, ..base }));
    points.extend([512, 8192].map(|texture_size| point(Choice { texture_size, ..base })));
    Curve {
        points,
        refused: Vec::new(),
        settings: ChainSettings::default(),
        triangles: 1000,
        sweep: Sweep::Full,
        rest: None,
        order: 0.0,
    }
}

#[test]
fn power_laws_are_predicted() {
    let curve = lawful();
    let model = Model::new(&curve);
    for (epsilon, page, samples) in [(0.02, 1024, 1), (0.1, 4096, 4), (0.04, 2048, 2), (0.16, 600, 16)] {
        let choice = Choice { epsilon, texture_size: page, samples, ..curve.points[0].choice };
        let predicted = model.predict(&choice);
        let texels = f64::from(page as u32).powi(2);
        let seconds = 1e-9 * texels * (3.0 + (samples as f64).powi(2)) + 0.01 * epsilon.powf(-1.5);
        let error = epsilon.powf(0.6) * (20.0 / f64::from(page as u32) * epsilon.powf(-0.3)).powf(0.2);
        // Stages of 0 seconds count as the smallest figure.
        assert!((predicted.seconds / seconds - 1.0).abs() < 0.01, "{predicted:?} {seconds}");
        assert!((predicted.image_error / error - 1.0).abs() < 1e-6, "{predicted:?} {error}");
    }
}

#[test]
fn presets_are_on_the_front() {
    let curve = lawful();
    let offers = offers(&curve);
    let costs: Vec<(f64, f64)> = offers.iter().map(|o| (o.predicted.seconds, o.predicted.image_error)).collect();
    assert!(front(&costs).iter().all(|&on| on));
    let least = offers.last().unwrap().predicted.image_error;
    let errors = Preset::ALL.map(|preset| preset.of(&offers).unwrap().predicted.image_error / least);
    assert!(errors[0] <= 2.0 && errors[1] <= 1.25 && errors[2] == 1.0 && errors[0] >= errors[1]);
    assert!(Preset::ALL.iter().all(|p| Preset::from_name(p.name()).unwrap() == *p));
    assert!(Preset::from_name("best").unwrap_err().to_string().contains("draft, balanced, final"));
}

#[test]
fn the_final_preset_is_no_coarser_than_the_settings() {
    // Pages and samples have no effect on the error, as in a quick sweep of a large crown.
    let mut curve = lawful();
    for point in &mut curve.points {
        point.image_error = point.choice.epsilon.powf(0.6);
        point.texel = 1e-3;
    }
    let asked = Choice::of(&curve.settings);
    let offers = offers(&curve);
    let chosen = Preset::Final.of(&offers).unwrap().choice;
    assert!(chosen.is_as_fine_as(&asked), "{chosen:?}");
    let own = Model::new(&curve).predict(&asked);
    for offer in offers.iter().filter(|offer| !offer.choice.is_as_fine_as(&asked)) {
        assert!(offer.predicted.seconds < own.seconds, "coarser and no quicker: {offer:?}");
    }
}

/// Returns the texts of an SVG file with their bounds, as wide as the font draws them.
fn texts(svg: &str) -> Vec<(String, [f64; 4])> {
    use ab_glyph::{Font, FontRef, ScaleFont};
    let font = FontRef::try_from_slice(dejavu::sans::regular()).unwrap();
    let attribute = |tag: &str, name: &str| -> Option<String> {
        let rest = tag.split_once(&format!(" {name}=\""))?.1;
        Some(rest.split_once('"')?.0.to_owned())
    };
    let mut found = Vec::new();
    for part in svg.split("<text ").skip(1) {
        let (tag, rest) = part.split_once('>').unwrap();
        let tag = format!(" {tag}");
        let text = rest.split_once("</text>").unwrap().0.trim().to_owned();
        let number = |name: &str| attribute(&tag, name).unwrap().parse::<f64>().unwrap();
        // SVG's font size is the em size; the font gives the line height for it.
        let scaled = font.as_scaled(font.pt_to_px_scale(number("font-size") as f32 * 0.75).unwrap());
        let wide: f32 = text.chars().map(|c| scaled.h_advance(scaled.glyph_id(c))).sum();
        let (wide, high) = (f64::from(wide), number("font-size"));
        let before = match attribute(&tag, "text-anchor").as_deref() {
            Some("middle") => 0.5,
            Some("end") => 1.0,
            _ => 0.0,
        };
        let (x, y) = (number("x"), number("y"));
        // y is at the baseline; rotated text runs up the page.
        let turned = attribute(&tag, "transform").is_some_and(|t| t.starts_with("rotate"));
        let along = [-before * wide, (1.0 - before) * wide];
        let bounds = if turned {
            [x - high, y - along[1], x + high, y - along[0]]
        } else {
            [x + along[0], y - 0.8 * high, x + along[1], y + 0.25 * high]
        };
        found.push((text, bounds));
    }
    found
}

fn assert_texts_lie_apart(chart: &Chart, size: ChartSize) -> Vec<String> {
    let texts = texts(&chart.svg(size).unwrap());
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    for (i, (name, a)) in texts.iter().enumerate() {
        assert!(a[0] >= 0.0 && a[2] <= width && a[1] >= 0.0 && a[3] <= height, "{name} {a:?} leaves {size:?}");
        for (other, b) in &texts[i + 1..] {
            let apart = a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];
            assert!(apart, "{name:?} {a:?} touches {other:?} {b:?} at {size:?}");
        }
    }
    texts.into_iter().map(|(text, _)| text).collect()
}

/// Otherwise more time could give a worse picture.
#[test]
fn no_texel_on_offer_is_larger_than_the_bound() {
    let texel = |c: &Choice| 20.0 / c.texture_size as f64 * c.epsilon.powf(-0.3);
    let sharp = offers(&lawful());
    assert!(sharp.iter().all(|offer| texel(&offer.choice) <= 1.001 * offer.choice.epsilon));
    let mut coarse = lawful();
    coarse.points.iter_mut().for_each(|point| point.texel *= 1000.0);
    assert!(!offers(&coarse).is_empty(), "choices remain if all texels are larger");
    let tiny = ChainSettings { texture_size: 64.into(), ..small() };
    let built = build_within(&crown(60), None, &tiny, Wish::Preset(Preset::Final), Progress::silent()).unwrap();
    assert_eq!(built.chain.levels[0].page.base_color.width(), 64);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn offers_keep_to_the_size_of_billboards_and_to_the_shape_of_the_page() {
    let crown = crown(60);
    let small_ones = FitSettings { max_size: Some(0.03), epsilon: 0.02, ..small().fit };
    let narrow = ChainSettings { fit: small_ones, ..small() };
    let curve = sweep(&crown, None, &narrow, Sweep::Quick, Progress::silent()).unwrap();
    assert!(curve.refused.is_empty(), "{:?}", curve.refused);
    assert!(offers(&curve).iter().all(|offer| offer.choice.epsilon <= 0.03));
    let flat = ChainSettings { texture_size: PageSize { width: 512, height: 64 }, ..small() };
    let built = build_within(&crown, None, &flat, Wish::Preset(Preset::Draft), Progress::silent()).unwrap();
    assert_eq!(built.chain.levels[0].page.base_color.height(), 64);
}

/// On such a small page, a small ε has more billboards than fit.
#[test]
#[ignore = "long: make test-night runs it"]
fn offers_that_do_not_fit_are_replaced_by_others() {
    let crown = crown(300);
    let tiny = ChainSettings { texture_size: 64.into(), back_sides: Some(true), ..small() };
    for wish in [Wish::Seconds(600.0), Wish::Preset(Preset::Final), Wish::Preset(Preset::Draft)] {
        let built = build_within(&crown, None, &tiny, wish, Progress::silent()).unwrap();
        assert!(built.tries < 20, "{wish:?}: {}", built.tries);
    }
}

#[test]
fn charts_have_units_and_texts_that_do_not_touch() {
    let curve = lawful();
    for cost in Cost::ALL {
        let chart = Chart::of_points("a tree: what accuracy costs", &curve.points, cost);
        for (width, height) in [(960, 640), (640, 440)] {
            let texts = assert_texts_lie_apart(&chart, ChartSize { width, height, text: 1.0 });
            let unit = ["(s)", "(count)", "(MiB)"][cost as usize];
            assert!(texts.iter().any(|t| t.contains(unit)), "{texts:?}");
            assert!(texts.iter().any(|t| t.contains("image error (mean FLIP, 0 to 1)")));
            assert!(texts.len() >= 8);
        }
    }
}

/// A panel is narrow: text is large, and the presets have names beside their points.
#[test]
fn offers_have_names_that_do_not_touch() {
    let chart = Chart::of_offers("a tree", &offers(&lawful()));
    for text in [1.0, 2.0] {
        let texts = assert_texts_lie_apart(&chart, ChartSize { width: 640, height: 480, text });
        assert!(Preset::ALL.iter().all(|preset| texts.iter().any(|t| t == preset.name())), "{texts:?}");
    }
}

#[test]
fn pictures_have_the_requested_size() {
    let curve = lawful();
    let chart = Chart::of_offers("a tree", &offers(&curve));
    let size = ChartSize { width: 480, height: 320, text: 1.0 };
    let picture = chart.picture(size).unwrap();
    assert_eq!((picture.width(), picture.height()), (480, 320));
    assert!(picture.pixels().iter().all(|p| p[3] == 255));
    assert!(picture.pixels().iter().any(|p| *p != [255; 4]));
    assert!(chart.svg(ChartSize { width: 100, ..size }).unwrap_err().to_string().contains("240 to 8192"));
    assert!(chart.svg(ChartSize { text: f64::NAN, ..size }).unwrap_err().to_string().contains("from 0.5 to 4"));
    assert!(Chart::of_points("", &[], Cost::Bytes).svg(size).unwrap_err().to_string().contains("no points"));
    assert!(Cost::from_name("euro").unwrap_err().to_string().contains("seconds, billboards, bytes"));
    let other = Choice { method: Method::Density, effort: Effort::Default, ..curve.points[0].choice };
    let mut points = curve.points.clone();
    points.push(Point { choice: other, ..points[0].clone() });
    let svg = Chart::of_points("two", &points, Cost::Seconds).svg(size).unwrap();
    assert!(svg.contains("density") && svg.contains("stochastic"));
}
