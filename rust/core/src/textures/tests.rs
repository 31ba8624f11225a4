use glam::{DVec2, Vec2, Vec3, Vec4};

use super::*;
use crate::atlas::AtlasSettings;
use crate::foliage::Image;
use crate::foliage::{AlphaMode, Attributes, Material};
use crate::geometry::{Outline, Plane};

/// Two triangles, the square [0, 1]² at height `z`.
fn square(z: f64, material: Material) -> Foliage {
    let positions = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(|[x, y]| DVec3::new(x, y, z));
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let attributes = Attributes {
        uvs: vec![[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]],
        ..Attributes::default()
    };
    Foliage::new(&positions, vec![[0, 1, 2], [0, 2, 3]], attributes, vec![material]).unwrap()
}

fn coloured(color: Vec4) -> Material {
    Material { base_color: color, ..Material::default() }
}

/// The square drawn over `size` pixels of a canvas, from above.
fn screen(foliage: &Foliage, size: f32, z: f32) -> Vec<ScreenTriangle<'_>> {
    let corner = |x: f32, y: f32| Vec3::new(x * size, (1.0 - y) * size, z);
    let [a, b, c, d] = [corner(0., 0.), corner(1., 0.), corner(1., 1.), corner(0., 1.)];
    [[a, b, c], [a, c, d]]
        .into_iter()
        .enumerate()
        .map(|(triangle, corners)| ScreenTriangle {
            reach: f32::INFINITY,
            corners,
            foliage,
            triangle: triangle as u32,
            window: &Window::WHOLE,
        })
        .collect()
}

/// Returns the base color, premultiplied.
fn drawn(triangles: &[ScreenTriangle], width: usize, height: usize, samples: Samples) -> Canvas {
    rasterise(triangles, width, height, samples, &[Channel::BaseColor]).remove(0)
}

fn samples(count: usize) -> Samples {
    Samples::new(count).unwrap()
}

#[test]
fn coverage_is_exact_on_the_sample_grid() {
    let white = square(0.0, Material::default());
    // 2.5 pixels wide: two full pixels and a half one, with 4 samples a side.
    let canvas = drawn(&screen(&white, 2.5, 0.0), 4, 4, samples(4));
    let alpha: Vec<f32> = canvas.pixels[4 * 3..].iter().map(|p| p.w).collect();
    assert_eq!(alpha, [0.0; 4], "the square hangs from the top: row 3 is empty");
    let top: Vec<f32> = canvas.pixels[..4].iter().map(|p| p.w).collect();
    assert_eq!(top, [1.0, 1.0, 0.5, 0.0]);
}

#[test]
fn a_canvas_of_many_tiles_has_no_seams() {
    let white = square(0.0, Material::default());
    let canvas = drawn(&screen(&white, 100.0, 0.0), 100, 100, samples(2));
    assert!(canvas.pixels.iter().all(|p| *p == Vec4::ONE));
}

#[test]
fn nothing_is_drawn_outside_the_clip() {
    let white = square(0.0, Material::default());
    let mut triangles = screen(&white, 100.0, 0.0);
    let window = Window { columns: 30..66, rows: 1..33, ..Window::WHOLE };
    for t in &mut triangles {
        t.window = &window;
    }
    let canvas = drawn(&triangles, 100, 100, samples(3));
    for (i, p) in canvas.pixels.iter().enumerate() {
        let inside = (30..66).contains(&(i % 100)) && (1..33).contains(&(i / 100));
        assert_eq!(p.w, if inside { 1.0 } else { 0.0 }, "pixel {} {}", i % 100, i / 100);
    }
}

#[test]
fn a_triangle_beside_its_window_in_the_same_tile_is_not_drawn() {
    let white = square(0.0, Material::default());
    for (columns, rows) in [(26..32, 0..32), (0..32, 26..32), (0..0, 0..32), (90..99, 90..99)] {
        let window = Window { columns, rows, ..Window::WHOLE };
        for place in [3.0, 8.0, 18.0] {
            let mut triangles = screen(&white, 8.0, 0.0);
            for triangle in &mut triangles {
                triangle.window = &window;
                triangle.corners = triangle.corners.map(|corner| corner + Vec3::new(place, place, 0.0));
            }
            let canvas = drawn(&triangles, 32, 32, samples(4));
            assert!(canvas.pixels.iter().all(|pixel| *pixel == Vec4::ZERO), "window {window:?}");
        }
    }
}

#[test]
fn the_nearer_hides_the_farther_in_any_order() {
    let red = square(0.0, coloured(Vec4::new(1.0, 0.0, 0.0, 1.0)));
    let blue = square(0.0, coloured(Vec4::new(0.0, 0.0, 1.0, 1.0)));
    let (near, far) = (screen(&red, 4.0, 1.0), screen(&blue, 4.0, 0.0));
    for order in [[near.clone(), far.clone()].concat(), [far, near].concat()] {
        let canvas = drawn(&order, 4, 4, samples(1));
        assert!(canvas.pixels.iter().all(|p| *p == Vec4::new(1.0, 0.0, 0.0, 1.0)));
    }
}

#[test]
fn single_sided_backs_are_not_drawn() {
    let material = Material { double_sided: false, ..Material::default() };
    let foliage = square(0.0, material);
    let mut triangles = screen(&foliage, 4.0, 0.0);
    assert_eq!(drawn(&triangles, 4, 4, samples(1)).pixels[5].w, 1.0);
    for t in &mut triangles {
        t.corners.swap(1, 2);
    }
    assert_eq!(drawn(&triangles, 4, 4, samples(1)).pixels[5].w, 0.0);
}

/// An image with a transparent green left half and an opaque mid-gray right half.
fn half_image() -> Image {
    let pixel = |i: usize| if i % 8 < 4 { [0, 255, 0, 0] } else { [128, 128, 128, 255] };
    Image::new(8, 8, (0..64).map(pixel).collect::<Vec<_>>()).unwrap()
}

#[test]
fn masked_texels_are_transparent_and_do_not_tint() {
    let material = Material { image: Some(half_image()), alpha_mode: AlphaMode::Mask(0.5), ..Material::default() };
    let foliage = square(0.0, material);
    let image = Channel::BaseColor.to_image(&drawn(&screen(&foliage, 8.0, 0.0), 8, 8, samples(4)));
    for y in 0..8 {
        // The test passes from the middle between two texels on; the repeating image blends at its rim, too.
        assert_eq!(image.pixels()[y * 8 + 1][3], 0);
        for x in 4..7 {
            assert_eq!(image.pixels()[y * 8 + x], [128, 128, 128, 255]);
        }
    }
}

#[test]
fn alpha_equal_to_the_cutoff_has_no_holes() {
    // 255/255 and 102/255, filtered and as a factor of 0.8 in 32 bits.
    for (code, factor, cutoff) in [(255, 1.0, 1.0), (255, 0.8, 0.8), (102, 1.0, 0.4), (102, 0.5, 0.2)] {
        let image = Image::new(7, 7, vec![[9, 9, 9, code]; 49]).unwrap();
        let base_color = Vec4::new(1.0, 1.0, 1.0, factor);
        let mode = AlphaMode::Mask(cutoff);
        let material = Material { image: Some(image), alpha_mode: mode, base_color, ..Material::default() };
        let canvas = drawn(&screen(&square(0.0, material), 64.0, 0.0), 64, 64, samples(4));
        assert!(canvas.pixels.iter().all(|pixel| pixel.w == 1.0), "{code} {factor} {cutoff}");
    }
}

#[test]
fn blended_alpha_is_coverage() {
    for (count, alpha) in [(4, 0.25), (4, 0.5), (5, 0.4), (1, 1.0)] {
        let material = Material { alpha_mode: AlphaMode::Blend, ..coloured(Vec4::new(1.0, 1.0, 1.0, alpha)) };
        let foliage = square(0.0, material);
        let canvas = drawn(&screen(&foliage, 4.0, 0.0), 4, 4, samples(count));
        // Exact within a triangle; pixels on the diagonal hold samples of two triangles.
        let within = (0..16).filter(|i| i % 4 + i / 4 != 3);
        assert!(within.map(|i| canvas.pixels[i].w).all(|w| (w - alpha).abs() < 1e-6), "{count} {alpha}");
    }
}

#[test]
fn a_billboard_shows_its_front_upright_and_its_back_mirrored() {
    // Red at the lower left of the leaf, transparent elsewhere.
    let quarter = |i: usize| if i % 8 < 4 && i / 8 >= 4 { [255, 0, 0, 255] } else { [0, 0, 0, 0] };
    let image = Image::new(8, 8, (0..64).map(quarter).collect::<Vec<_>>()).unwrap();
    let foliage = square(0.0, Material { image: Some(image), alpha_mode: AlphaMode::Mask(0.5), ..Material::default() });
    let corner = |x: f64, y: f64| foliage.frame().to_local(DVec3::new(x, y, 0.0));
    let plane = Plane::through(corner(0., 0.), DVec3::Z);
    // A wide outline cannot be rotated unnoticed.
    let (low, high) = (corner(-1.0, 0.0), corner(2.0, 1.0));
    let (x, y) = plane.axes();
    let along = |p: DVec3| DVec2::new(x.dot(p), y.dot(p));
    let outline = Outline::along(&[along(low), along(high)], DVec2::X);
    let settings = AtlasSettings { size: 64.into(), gutter: 2, back_sides: true };
    let atlas = Atlas::pack(&[plane], &[outline], settings).unwrap();
    let shown = |_: u32| {
        let drawn = |t| Drawn {
            reach: f64::INFINITY,
            foliage: &foliage,
            triangle: t,
            targets: foliage.corners(t),
            corners: foliage.corners(t),
        };
        (0..2).map(drawn).collect()
    };
    let page = bake(&atlas, samples(4), (&Channels::default(), None), shown).base_color;
    for billboard in &atlas.billboards {
        let to_page = ToPage::new(billboard);
        let look = |x: f64, y: f64| {
            let p = corner(x, y);
            let placed = to_page.place(&Drawn {
                reach: f64::INFINITY,
                foliage: &foliage,
                triangle: 0,
                targets: [p; 3],
                corners: [p; 3],
            });
            let [column, row] = placed.corners[0].truncate().to_array().map(|c| c.floor() as usize);
            page.pixels()[row * 64 + column]
        };
        assert_eq!(look(0.25, 0.25), [255, 0, 0, 255]);
        for empty in [look(0.75, 0.25), look(0.25, 0.75), look(-0.5, 0.25)] {
            assert_eq!(empty, [255, 0, 0, 0], "color is filled in under transparent texels");
        }
    }
}

#[test]
fn edges_keep_the_stated_bound() {
    use crate::common::random::Random;
    use crate::common::stability::{case, worse};
    // Triangles anywhere on the largest page. The pixels around them are checked by exact orientation tests in f64.
    let white = square(0.0, Material::default());
    let mut random = Random(52);
    let mut worst: f64 = 0.0;
    for _ in 0..60 {
        let at = Vec2::new(random.signed() as f32 + 1.0, random.signed() as f32 + 1.0) * 8000.0;
        let corners: [Vec3; 3] = std::array::from_fn(|_| {
            (at + Vec2::new(random.signed() as f32, random.signed() as f32) * 40.0).max(Vec2::ZERO).extend(0.0)
        });
        // Drawn at its place, but only the part of the page around it is checked.
        let origin = (at - 45.0).max(Vec2::ZERO).floor();
        let page = 16_384;
        let columns = origin.x as usize..(origin.x as usize + 90).min(page);
        let rows = origin.y as usize..(origin.y as usize + 90).min(page);
        let window = Window { columns: columns.clone(), rows: rows.clone(), ..Window::WHOLE };
        let drawn = covered_pixels(&ScreenTriangle {
            reach: f32::INFINITY,
            corners,
            foliage: &white,
            triangle: 0,
            window: &window,
        });
        let [a, b, c] = corners.map(|c| c.truncate().as_dvec2());
        let turn = (b - a).perp_dot(c - a).signum();
        for y in rows {
            for x in columns.clone() {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let depth = |from: DVec2, to: DVec2| turn * (to - from).perp_dot(p - from) / (to - from).length();
                let inside = depth(a, b).min(depth(b, c)).min(depth(c, a));
                if (inside >= 0.0) != drawn.contains(&(x, y)) {
                    worst = worse(worst, inside.abs());
                }
            }
        }
    }
    case("Kernels", "pixels on the wrong side of an edge, distance in texels", "orientation in f64; the stated bound")
        .holds(worst, 2f64.powi(-8));
}

/// Returns the pixels with a center that a triangle covers, anywhere on the largest page, drawn tile by tile as the rasterizer does.
fn covered_pixels(triangle: &ScreenTriangle) -> std::collections::HashSet<(usize, usize)> {
    let Window { columns, rows, view } = triangle.window.clone();
    let width = columns.end;
    // Only the rows of the clip are drawn. Moving the strip up by whole tiles keeps the coordinates within a tile.
    let first = rows.start / 32 * 32;
    let up = Vec3::Y * first as f32;
    let window = Window { columns, rows: rows.start - first..rows.end - first, view };
    let moved = ScreenTriangle { corners: triangle.corners.map(|c| c - up), window: &window, ..triangle.clone() };
    let height = window.rows.end;
    let canvas = drawn(&[moved], width, height, samples(1));
    let drawn = canvas.pixels.iter().enumerate().filter(|(_, p)| p.w > 0.0);
    drawn.map(|(i, _)| (i % width, i / width + first)).collect()
}

#[test]
fn common_triangles_hide_others_and_each_picture_has_its_own() {
    let white = square(0.0, Material::default());
    let (wall, [near, far]) = (screen(&white, 40.0, 1.0), [2.0, 0.0].map(|z| screen(&white, 50.0, z)));
    let pictures = seen_among(&wall, &[near, far.clone(), Vec::new()], 60, 60, samples(2));
    let seen = |picture: &SeenTriangles| picture.pieces.iter().map(|piece| piece.count).sum::<u32>();
    assert_eq!(pictures.iter().map(seen).collect::<Vec<_>>(), [4 * 2500, 4 * (2500 - 1600), 0]);
    assert_eq!(pictures.iter().map(|p| p.covered).collect::<Vec<_>>(), [4 * 2500, 4 * 2500, 4 * 1600]);
    assert!(
        pictures[1].pieces.iter().all(|piece| piece.pixel % 60 >= 40 || piece.pixel / 60 >= 40),
        "not through the wall"
    );
    assert_eq!(seen_among(&wall, &[far], 60, 60, samples(2))[0], pictures[1]);
}

#[test]
fn the_canvas_ends_inside_a_tile() {
    let white = square(0.0, Material::default());
    let pictures = seen_among(&[], &[screen(&white, 100.0, 0.0)], 37, 35, samples(4));
    assert_eq!(pictures[0].covered, 16 * 37 * 35);
    assert_eq!(count_seen(screen(&white, 100.0, 0.0), 37, 35, samples(4)).iter().sum::<u32>(), 16 * 37 * 35);
}

/// Returns the color of each pixel's middle by the definition: the nearest of all triangles that contain it.
fn by_definition(triangles: &[(ScreenTriangle, Vec4)], side: usize) -> Vec<Vec4> {
    let middle = |i: usize| DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
    let depth = |[a, b, c]: [DVec3; 3], p: DVec2| {
        let twice = |a: DVec3, b: DVec3| (b.truncate() - a.truncate()).perp_dot(p - a.truncate());
        let areas = [twice(b, c), twice(c, a), twice(a, b)];
        let inside = areas.iter().all(|&area| area >= 0.0) || areas.iter().all(|&area| area <= 0.0);
        let sum: f64 = areas.iter().sum();
        inside.then(|| (a.z * areas[0] + b.z * areas[1] + c.z * areas[2]) / sum)
    };
    let color = |i: usize| {
        let hits = triangles
            .iter()
            .filter_map(|(triangle, color)| Some((depth(triangle.corners.map(Vec3::as_dvec3), middle(i))?, *color)));
        hits.reduce(|nearest, hit| if hit.0 > nearest.0 { hit } else { nearest }).map_or(Vec4::ZERO, |hit| hit.1)
    };
    (0..side * side).map(color).collect()
}

#[test]
fn layers_of_large_and_small_triangles_show_the_nearest_one_in_any_order() {
    let side = 70;
    let mut random = crate::common::random::Random(7);
    let colors: Vec<Foliage> = (0..300)
        .map(|i| square(0.0, coloured(Vec4::new(1.0, (i % 17) as f32 / 17.0, i as f32 / 300.0, 1.0))))
        .collect();
    let mut triangles: Vec<(ScreenTriangle, Vec4)> = Vec::new();
    for (i, foliage) in colors.iter().enumerate() {
        let size = if i % 3 == 0 { 60.0 } else { 9.0 };
        let place = Vec2::new(random.signed() as f32, random.signed() as f32) * 40.0 + 35.0;
        let mut corner =
            || Vec3::new(random.signed() as f32 * size, random.signed() as f32 * size, random.signed() as f32 * 5.0);
        let corners = std::array::from_fn(|_| corner() + place.extend(i as f32 % 40.0));
        let color = foliage.material(0).base_color;
        triangles.push((
            ScreenTriangle { reach: f32::INFINITY, corners, foliage, triangle: 0, window: &Window::WHOLE },
            color,
        ));
    }
    let wanted = by_definition(&triangles, side);
    for turned in [false, true] {
        if turned {
            triangles.reverse();
        }
        let shown: Vec<ScreenTriangle> = triangles.iter().map(|(triangle, _)| triangle.clone()).collect();
        let found = drawn(&shown, side, side, samples(1)).pixels;
        // Middles within roundings of an edge may show its other side.
        let other = found.iter().zip(&wanted).filter(|(found, wanted)| found.distance(**wanted) > 1e-5).count();
        assert!(other <= 2, "{other} pixels of {} show another triangle", side * side);
    }
    // Most pixels show large triangles over some that are hidden as a whole.
    assert!(wanted.iter().filter(|color| color.w > 0.0).count() > side * side * 9 / 10);
}

#[test]
fn the_first_of_equally_near_triangles_is_shown() {
    let colors = [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 1.0, 0.0, 1.0)];
    let pair = colors.map(|color| square(0.0, coloured(color)));
    for [first, second] in [[0, 1], [1, 0]] {
        let mut triangles = screen(&pair[first], 8.0, 0.5);
        triangles.truncate(1);
        triangles[0].corners = [Vec3::new(-8.0, -8.0, 0.5), Vec3::new(24.0, -8.0, 0.5), Vec3::new(4.0, 90.0, 0.5)];
        // As near in the middles of the pixels. Its last corner is nearer, so it is drawn first.
        let mut other = triangles[0].clone();
        other.foliage = &pair[second];
        other.corners = [Vec3::new(-8.0, 0.5, 0.5), Vec3::new(24.0, 0.5, 0.5), Vec3::new(4.0, 90.0, 0.75)];
        triangles.push(other);
        let canvas = drawn(&triangles, 8, 1, samples(1));
        assert!(canvas.pixels.iter().all(|pixel| *pixel == colors[first]), "{:?}", canvas.pixels);
        let alone = drawn(&triangles[1..], 8, 1, samples(1));
        assert!(alone.pixels.iter().all(|pixel| *pixel == colors[second]), "the second is there");
    }
}
