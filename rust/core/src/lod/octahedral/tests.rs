//! Tests against closed forms: a flat leaf seen head-on, and points at known places.

use glam::{DVec2, DVec3};

use super::*;
use crate::foliage::{Attributes, Material};
use crate::lod::ViewCounts;
use crate::lod::octahedral::mapping::from_grid;
use crate::textures::Samples;

/// Squares of side `2·half` at these centers, with these axes.
fn squares(all: &[(DVec3, DVec3, DVec3)]) -> Foliage {
    let corners = |&(c, x, y): &(DVec3, DVec3, DVec3)| [c - x - y, c + x - y, c + x + y, c - x + y];
    let positions: Vec<DVec3> = all.iter().flat_map(corners).collect();
    let triangles = (0..all.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k)));
    let base_color = glam::Vec4::new(0.2, 0.5, 0.1, 1.0);
    let material = Material { base_color, ..Material::default() };
    Foliage::new(&positions, triangles.collect(), Attributes::default(), vec![material]).unwrap()
}

fn settings() -> ChainSettings {
    ChainSettings { samples: Samples::new(4).unwrap(), ..ChainSettings::default() }
}

fn tried(foliage: &Foliage, simpler: Option<&Foliage>, size: Size, settings: &ChainSettings) -> Result<Octahedral> {
    let references = References::new(&[foliage], &[foliage], foliage.frame(), settings).unwrap();
    let shown = Shown { parts: &[foliage], simpler };
    Octahedral::build(shown, size, &references, settings, Progress::silent())
}

fn built(foliage: &Foliage, size: Size, settings: &ChainSettings) -> Octahedral {
    tried(foliage, None, size, settings).unwrap()
}

/// A view that shows ±`radius` around the origin.
fn view(direction: DVec3, radius: f64) -> View {
    View { direction, up: DVec3::Z, centre: DVec3::ZERO, radius, size: 64, samples: Samples::new(2).unwrap() }
}

#[test]
fn a_leaf_seen_head_on_is_reproduced() {
    // The view (10, 10) of 13 × 13 looks along −x at a square of 1 × 1.
    let leaf = squares(&[(DVec3::ZERO, DVec3::Y * 0.5, DVec3::Z * 0.5)]);
    let size = Size { grid: 13, texels: 64 };
    let found = built(&leaf, size, &settings());
    let picture = found.draw(&view(DVec3::X, 1.0), 0.0, None).unwrap();
    let exact = crate::metrics::render(&[&leaf], &view(DVec3::X, 1.0)).unwrap();
    // A texel is 1/26 of the leaf, so its border is blurred over two pixels; all others are equal.
    let border = |i: usize| [i % 64, i / 64].into_iter().any(|x| (13..=18).contains(&x) || (45..=50).contains(&x));
    let inner = (0..64 * 64).filter(|&i| !border(i));
    let off = inner.map(|i| picture.pixels()[i][3].abs_diff(exact.pixels()[i][3])).max().unwrap();
    assert!(off <= 1, "alpha is off by {off} codes");
    let [r, g, b, a] = picture.pixels()[32 * 64 + 32];
    let [x, y, z, _] = exact.pixels()[32 * 64 + 32];
    assert!(a == 255 && r.abs_diff(x) <= 2 && g.abs_diff(y) <= 2 && b.abs_diff(z) <= 2, "{r} {g} {b}, {x} {y} {z}");
}

#[test]
fn depth_moves_a_leaf_to_its_place() {
    // Small leaves far from the center, turned so that they are seen from every side of a cone about x.
    let place = DVec3::new(0.8, 0.2, 0.3);
    let far = DVec3::new(-0.8, -0.2, -0.3);
    let leaf = |c: DVec3| (c, DVec3::Y * 0.1, DVec3::Z * 0.1);
    let foliage = squares(&[leaf(place), leaf(far)]);
    let found = built(&foliage, Size { grid: 8, texels: 64 }, &settings());
    // Halfway between views, where a blend without depth would show each leaf three times.
    let grid_place = DVec2::new(6.6, 6.3);
    let direction = from_grid(grid_place, 8);
    let picture = found.draw(&view(direction, 1.2), 0.0, None).unwrap();
    let [right, up] = mapping::axes(direction);
    let pixel = |p: DVec3| DVec2::new(32.0 + 32.0 * right.dot(p) / 1.2, 32.0 - 32.0 * up.dot(p) / 1.2);
    for centre in [place, far] {
        let at = pixel(centre);
        let near = |i: usize| DVec2::new((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5).distance(at) < 8.0;
        let (mut sum, mut total) = (DVec2::ZERO, 0.0);
        for i in (0..64 * 64).filter(|&i| near(i)) {
            let alpha = f64::from(picture.pixels()[i][3]);
            sum += alpha * DVec2::new((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
            total += alpha;
        }
        assert!((sum / total).distance(at) < 0.4, "the leaf is at {at}, drawn at {}", sum / total);
        assert_eq!(picture.pixels()[at.y as usize * 64 + at.x as usize][3], 255, "all three views agree in its middle");
    }
}

#[test]
fn the_law_is_the_identity_for_a_view_of_the_grid() {
    let foliage = squares(&[(DVec3::ZERO, DVec3::Y * 0.5, DVec3::Z * 0.5), (DVec3::X, DVec3::X * 0.1, DVec3::Z * 0.7)]);
    let layout = Layout::around(&[&foliage], DVec3::Z, Size::default());
    for (column, row) in [(0, 0), (4, 11), (15, 3)] {
        let eye = from_grid(DVec2::new(f64::from(column), f64::from(row)), 16);
        let views = draw::projected(eye, &layout);
        let own = views.iter().find(|view| view.weight > 0.99).unwrap();
        assert!(own.right.distance(DVec2::X / layout.extent.x) < 1e-9);
        assert!(own.up.distance(DVec2::Y / layout.extent.y) < 1e-9);
        assert!(own.shift.length() < 1e-9, "no parallax");
    }
}

#[test]
fn a_point_is_found_in_every_view_at_its_depth() {
    // Projecting the point orthographically must agree with following the ray to the point's depth.
    let foliage = squares(&[(DVec3::ZERO, DVec3::Y, DVec3::Z)]);
    let layout = Layout::around(&[&foliage], DVec3::Z, Size { grid: 9, texels: 32 });
    let point = DVec3::new(0.3, -0.4, 0.2);
    for eye in [DVec3::new(1.0, 0.2, 0.4), DVec3::new(-0.3, 0.1, 0.9), DVec3::new(0.5, 0.5, -0.3)] {
        let eye = eye.normalize();
        let [right, up] = mapping::axes(eye);
        for view in draw::projected(eye, &layout) {
            let toward = from_grid(DVec2::new(view.tile.0 as f64, view.tile.1 as f64), 9);
            let [x, y] = mapping::axes(toward);
            let flat = view.right * right.dot(point) + view.up * up.dot(point);
            let found = flat + view.shift * (toward.dot(point) / layout.extent.z);
            let exact = DVec2::new(x.dot(point) / layout.extent.x, y.dot(point) / layout.extent.y);
            assert!(found.distance(exact) < 1e-9, "{found} {exact}");
        }
    }
}

#[test]
fn the_impostor_stands_upright_for_any_up() {
    // A tall pole along y, with up = y, must be tall in the pictures.
    let pole = squares(&[(DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 2.0), (DVec3::ZERO, DVec3::Z * 0.1, DVec3::Y * 2.0)]);
    let upright = ChainSettings { up: DVec3::Y, ..settings() };
    let found = built(&pole, Size { grid: 6, texels: 32 }, &upright);
    assert!(found.layout.axes.z_axis.distance(DVec3::Y) < 1e-12);
    assert!((found.layout.extent.y / found.layout.extent.x - 20.0).abs() < 0.1, "{}", found.layout.extent);
    let coverage = found.pictures.coverage();
    assert!((coverage - 1.0).abs() < 0.1, "a pole two texels wide: {coverage}");
}

#[test]
fn threads_change_nothing() {
    let foliage = squares(&[(DVec3::ZERO, DVec3::Y, DVec3::Z), (DVec3::X, DVec3::X * 0.3, DVec3::Y * 0.7)]);
    let found = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| built(&foliage, Size { grid: 4, texels: 16 }, &settings()))
    };
    let (one, three) = (found(1), found(3));
    assert_eq!((&one.color, &one.normal_depth), (&three.color, &three.normal_depth));
    assert!(one.pictures == three.pictures && one.alpha_cutoff == three.alpha_cutoff);
}

#[test]
fn normals_are_in_the_axes_of_each_view() {
    let leaf = squares(&[(DVec3::ZERO, DVec3::Y, DVec3::Z)]);
    let found = built(&leaf, Size { grid: 7, texels: 16 }, &settings());
    // The view (5, 5) looks from +x, and (1, 1) from −x.
    let middle = |column: usize, row: usize| found.normal_depth.pixels()[(row * 16 + 8) * 112 + column * 16 + 8];
    let is_middle = |code: u8| code.abs_diff(128) <= 1;
    for view in [middle(5, 5), middle(1, 1)] {
        assert!(is_middle(view[0]) && is_middle(view[1]), "the leaf faces the viewer: {view:?}");
    }
    // The view (4, 4) looks down on it: z / x = (1 - 1/3 - 1/6) / (1/3) = 3/2, and the leaf's normal points down in the picture.
    let [x, y, openness, _] = middle(4, 4).map(f64::from);
    assert!(is_middle(x as u8) && (y / 127.5 - 1.0 + 1.5 / 3.25f64.sqrt()).abs() < 0.02, "{y}");
    assert!((openness - 255.0 / 1.5).abs() < 8.0, "nothing hides the sky from a single leaf, {openness}");
    assert!(middle(5, 5)[3].abs_diff(128) <= 1, "the leaf lies in the middle");
}

#[test]
fn wrong_sizes_are_refused() {
    let leaf = squares(&[(DVec3::ZERO, DVec3::Y, DVec3::Z)]);
    for (grid, texels) in [(1, 64), (33, 64), (16, 8), (16, 1024)] {
        let error = tried(&leaf, None, Size { grid, texels }, &settings()).unwrap_err();
        assert!(error.to_string().contains(&grid.to_string()), "{error}");
    }
}

#[test]
fn the_cost_of_a_tall_box_is_that_of_its_rectangles() {
    // A square of 2 × 2 in the ground plane, and one 6 high: the box is 2 × 2 × 6, and 2 √2 wide across its corners.
    let foliage = squares(&[(DVec3::ZERO, DVec3::X, DVec3::Y), (DVec3::ZERO, DVec3::X, DVec3::Z * 3.0)]);
    let layout = Layout::around(&[&foliage], DVec3::Z, Size::default());
    let margin = 64.0 / 62.0;
    let close = |found: DVec2, x: f64, y: f64| assert!(found.distance(DVec2::new(x, y)) < 1e-9, "{found}");
    close(layout.quad(DVec3::X), 2f64.sqrt() * margin, 3.0);
    close(layout.quad(DVec3::Z), 2f64.sqrt() * margin, 2f64.sqrt() * margin);
    let cost = layout.cost(foliage.frame(), 10.0, DVec3::Z).unwrap();
    assert_eq!((cost.triangles, cost.layers), (2, 3.0));
    assert!((cost.fragments - 300.0 * cost.area).abs() < 1e-9 * cost.fragments, "three for each pixel");
}

#[test]
fn the_transform_from_a_tree_has_the_depth_as_unit() {
    // A tree that stands on its side, twice as large in the world and far away.
    let rows = [[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 6.0], [0.0, 0.0, 2.0, 7.0], [0.0, 0.0, 0.0, 1.0]];
    let placement = Placement::new(rows).unwrap();
    let local = squares(&[(DVec3::ZERO, DVec3::X, DVec3::Z * 3.0)]);
    let layout = Layout { centre: DVec3::new(5.0, 6.0, 7.0), ..Layout::around(&[&local], DVec3::Z, Size::default()) };
    let depth = layout.extent.z;
    let found = layout.of_tree(&placement);
    let exact = DVec3::new(-2.0, 2.0, 6.0) / depth;
    assert!(found.transform_point3(DVec3::new(1.0, 1.0, 3.0)).distance(exact) < 1e-12);
}

#[test]
fn a_lit_leaf_is_as_bright_as_it_faces_the_sun() {
    // Seen head-on, with nothing that hides the sky: the normal and the openness are exact but for their codes.
    let leaf = squares(&[(DVec3::ZERO, DVec3::Y * 0.5, DVec3::Z * 0.5)]);
    let found = built(&leaf, Size { grid: 13, texels: 64 }, &settings());
    for sun in [DVec3::new(0.8, 0.6, 0.0), DVec3::new(0.6, 0.0, 0.8), DVec3::new(-1.0, 0.0, 0.0)] {
        let picture = found.draw(&view(DVec3::X, 1.0), 0.0, Some(sun)).unwrap();
        let exact = crate::metrics::render_lit(&[&leaf], &view(DVec3::X, 1.0), sun, Progress::silent()).unwrap();
        let [green, expected] = [&picture, &exact].map(|picture| picture.pixels()[32 * 64 + 32][1]);
        assert!(green.abs_diff(expected) <= 3, "{sun}: {green} in place of {expected}");
    }
}

#[test]
fn simpler_leaves_are_rendered_in_place_of_the_tree_s_and_judged_by_these() {
    let leaf = squares(&[(DVec3::ZERO, DVec3::Y * 0.5, DVec3::Z * 0.5)]);
    let halves =
        [(DVec3::Y * 0.25, DVec3::Y * 0.25, DVec3::Z * 0.5), (DVec3::Y * -0.25, DVec3::Y * 0.25, DVec3::Z * 0.5)];
    let tree = squares(&halves);
    let size = Size { grid: 9, texels: 32 };
    let build = |simpler| tried(&tree, simpler, size, &settings()).unwrap();
    let (own, other) = (build(None), build(Some(&leaf)));
    assert_eq!(own.color, other.color, "two halves are the whole leaf");
    assert_eq!(own.pictures.flat.base, other.pictures.flat.base);
    let small = squares(&[(DVec3::ZERO, DVec3::Y * 0.3, DVec3::Z * 0.3)]);
    let found = build(Some(&small));
    assert_ne!(own.color, found.color);
    assert_eq!(own.pictures.flat.base, found.pictures.flat.base, "the reference is the tree");
}

#[test]
fn a_sketch_has_what_its_eyes_see() {
    let foliage = squares(&[(DVec3::ZERO, DVec3::X, DVec3::Z), (DVec3::Y, DVec3::Y * 0.5, DVec3::Z * 0.5)]);
    let settings = ChainSettings { views: ViewCounts { amounts: 2, report: 2, ..Default::default() }, ..settings() };
    let references = References::new(&[&foliage], &[&foliage], foliage.frame(), &settings).unwrap();
    let (shown, size) = (Shown { parts: &[&foliage], simpler: None }, Size { grid: 12, texels: 16 });
    let eye = DVec3::new(0.6, 0.0, 0.8);
    let sketch = Sketch::of(shown, size, &references, &[eye], &settings, Progress::silent()).unwrap();
    let whole = sketch.finished(shown, &settings, Progress::silent()).unwrap();
    for sun in [None, Some(DVec3::Z)] {
        let drawn = |impostor: &Octahedral| impostor.draw(&view(eye, 2.0), 0.0, sun).unwrap();
        let [some, all] = [sketch.impostor(), &whole].map(drawn);
        // Colors are scaled by tables that keep the mean of a whole page.
        let apart =
            some.pixels().iter().zip(all.pixels()).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)));
        assert!(apart.max().unwrap() <= 2);
    }
    let plain = Sketch::of(shown, size, &references, &[], &settings, Progress::silent()).unwrap();
    let plain = plain.finished(shown, &settings, Progress::silent()).unwrap();
    assert!(plain.color.pixels() == whole.color.pixels() && plain.normal_depth.pixels() == whole.normal_depth.pixels());
    let shown = |impostor: &Octahedral| impostor.color.pixels().iter().filter(|pixel| pixel[3] > 0).count();
    assert!(shown(sketch.impostor()) * 2 < shown(&whole));
}
