//! Outlines and textures on an atlas page: none, one and too many of everything.

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};
use leafcloud::atlas::{Atlas, AtlasSettings};
use leafcloud::foliage::{AlphaMode, Attributes, Image, Material, Opacity};
use leafcloud::geometry::{Outline, Plane, minimum_rectangle};
use leafcloud::lod::{Chain, ChainSettings, build_chain};
use leafcloud::textures::{Canvas, Channel, Samples, ScreenTriangle, Window, rasterise};
use leafcloud::{Foliage, Progress};

use crate::common::random::Random;
use crate::common::soups::quick;
use crate::common::stability::{case, worse};

const GROUP: &str = "Pages";

fn rectangle(width: f64, height: f64) -> Outline {
    Outline::along(&[DVec2::ZERO, DVec2::new(width, height)], DVec2::X)
}

fn packed(outlines: &[Outline], size: usize, gutter: usize) -> leafcloud::Result<Atlas> {
    let plane = Plane { normal: DVec3::Z, distance: 0.0 };
    Atlas::pack(&vec![plane; outlines.len()], outlines, AtlasSettings { size: size.into(), gutter, back_sides: false })
}

/// Returns the number of texels shared by two regions, or outside the page.
fn shared(atlas: &Atlas) -> usize {
    let mut owners = vec![0u32; atlas.size.texels()];
    let mut outside = 0;
    for b in &atlas.billboards {
        for y in b.region.y..b.region.y + b.region.height {
            for x in b.region.x..b.region.x + b.region.width {
                match owners.get_mut(y * atlas.size.width + x) {
                    Some(owner) if x < atlas.size.width => *owner += 1,
                    _ => outside += 1,
                }
            }
        }
    }
    owners.into_iter().filter(|&o| o > 1).count() + outside
}

#[test]
fn outlines_of_any_shape_keep_apart() {
    let point = minimum_rectangle(&[DVec2::ONE]);
    let segment = minimum_rectangle(&[DVec2::ZERO, DVec2::new(1.0, 2.0)]);
    let needle = rectangle(1.0, 1e-9);
    let outlines = [point, segment, needle, rectangle(1.0, 1.0), rectangle(1e-12, 1e-12)];
    let atlas = packed(&outlines, 256, 2).unwrap();
    case(GROUP, "points, segments and needles on one page", "definition: no texel has two owners")
        .holds(shared(&atlas) as f64, 0.0);
    let corners = atlas.billboards.iter().flat_map(|b| b.corners).all(DVec3::is_finite);
    case(GROUP, "corners of billboards without area", "definition: finite").equals(corners, true);
}

#[test]
fn more_billboards_than_sixteen_bits_count() {
    let mut random = Random(21);
    let outlines: Vec<Outline> =
        (0..65_537).map(|_| rectangle(1.0 + random.signed() * 0.5, 1.0 + random.signed() * 0.5)).collect();
    let atlas = packed(&outlines, 4096, 2).unwrap();
    assert_eq!(atlas.billboards.len(), 65_537);
    case(GROUP, "65 537 billboards on one page", "definition: no texel has two owners")
        .holds(shared(&atlas) as f64, 0.0);
    let planes = atlas.billboards.iter().enumerate().filter(|(i, b)| b.plane as usize != *i).count();
    case(GROUP, "65 537 billboards keep their numbers", "definition: in the order of planes").holds(planes as f64, 0.0);
}

#[test]
fn more_billboards_than_a_page_holds() {
    let outlines = vec![rectangle(1.0, 1.0); 1000];
    case(GROUP, "1000 billboards on a page of 64 texels", "a named error")
        .refuses(packed(&outlines, 64, 2).map(|_| ()), "1000 billboards");
    case(GROUP, "a page of no texels", "a named error")
        .refuses(packed(&outlines[..1], 0, 2).map(|_| ()), "`texture_size` is 0");
    case(GROUP, "an image of no texels", "a named error").refuses(Image::new(0, 4, vec![]).map(|_| ()), "0 × 4");
    case(GROUP, "an image with fewer texels than its size", "a named error")
        .refuses(Image::new(2, 2, vec![[0; 4]; 3]).map(|_| ()), "2 × 2");
    let huge = Image::new(usize::MAX, 2, vec![[0; 4]; 3]).map(|_| ());
    case(GROUP, "an image whose size overflows", "a named error").refuses(huge, "both sides must be at least 1");
}

/// Returns the base color, premultiplied.
fn drawn(triangles: &[ScreenTriangle], width: usize, height: usize, samples: Samples) -> Canvas {
    rasterise(triangles, width, height, samples, &[Channel::BaseColor]).remove(0)
}

/// A hundred leaf cards with this image, in a ball.
fn cards(image: Image, mode: AlphaMode) -> Foliage {
    let mut random = Random(22);
    let (mut positions, mut triangles, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for card in 0..100u32 {
        let (at, u) = (random.in_ball(), random.in_ball().normalize() * 0.1);
        let v = u.any_orthonormal_vector() * 0.1;
        positions.extend([at - u - v, at + u - v, at + u + v, at - u + v]);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * card + i);
        triangles.extend([[a, b, c], [a, c, d]]);
        uvs.extend([[Vec2::ZERO, Vec2::X, Vec2::ONE], [Vec2::ZERO, Vec2::ONE, Vec2::Y]]);
    }
    let material = Material { image: Some(image), alpha_mode: mode, ..Material::default() };
    Foliage::new(&positions, triangles, Attributes { uvs, ..Attributes::default() }, vec![material]).unwrap()
}

fn image(width: usize, height: usize, alpha: impl Fn(usize) -> u8) -> Image {
    Image::new(width, height, (0..width * height).map(|i| [60, 140, 30, alpha(i)]).collect::<Vec<_>>()).unwrap()
}

fn chain(foliage: &Foliage) -> leafcloud::Result<Chain> {
    let settings = ChainSettings {
        levels: 2,
        texture_size: 512.into(),
        samples: Samples::new(4).unwrap(),
        fit: quick(),
        ..ChainSettings::default()
    };
    build_chain(foliage, None, &settings, Progress::silent())
}

/// Builds and measures a whole chain; returns the share of texels with alpha above 0 on the first level's page.
fn opaque_share(foliage: &Foliage) -> f64 {
    let chain = chain(foliage).unwrap();
    for level in &chain.levels {
        assert!(level.coverage.is_finite(), "{}", level.coverage);
    }
    let page = &chain.levels[0].page.base_color;
    page.pixels().iter().filter(|p| p[3] > 0).count() as f64 / page.pixels().len() as f64
}

#[test]
#[ignore = "long: make test-night runs it"]
fn alpha_at_its_ends() {
    let refused = |name, image, mode| {
        let found = chain(&cards(image, mode)).map(|_| ());
        case(GROUP, name, "a named error").refuses(found, "no leaf is visible");
    };
    refused("alpha all 0, masked", image(8, 8, |_| 0), AlphaMode::Mask(0.5));
    refused("alpha all 0, blended", image(8, 8, |_| 0), AlphaMode::Blend);
    refused("a cutoff of 1 and alpha of 254/255", image(4, 4, |_| 254), AlphaMode::Mask(1.0));
    let all = cards(image(8, 8, |_| 255), AlphaMode::Mask(0.5));
    let plain = cards(image(1, 1, |_| 255), AlphaMode::Opaque);
    assert!(opaque_share(&plain) > 0.05);
    case(GROUP, "alpha all 1", "invariance: as without alpha")
        .holds((opaque_share(&all) - opaque_share(&plain)).abs(), 0.0);
    let one = opaque_share(&cards(image(64, 64, |i| if i == 32 * 64 + 32 { 255 } else { 0 }), AlphaMode::Mask(0.5)));
    case(GROUP, "alpha of one texel in 4096", "definition: more than 0, less than half")
        .equals(one > 0.0 && one < 0.5, true);
    let everything = cards(image(4, 4, |i| (i * 16) as u8), AlphaMode::Mask(0.0));
    case(GROUP, "a cutoff of 0", "invariance: as without alpha")
        .holds((opaque_share(&everything) - opaque_share(&plain)).abs(), 0.0);
}

#[test]
fn textures_of_any_shape() {
    let share = |width, height| opaque_share(&cards(image(width, height, |_| 255), AlphaMode::Mask(0.5)));
    let plain = share(1, 1);
    assert!(plain > 0.05);
    case(GROUP, "a texture of 16 384 × 1", "invariance: same as 1 × 1").holds((share(16_384, 1) - plain).abs(), 0.0);
    case(GROUP, "a texture of 1 × 16 384", "invariance: same as 1 × 1").holds((share(1, 16_384) - plain).abs(), 0.0);
}

#[test]
fn coordinates_beyond_any_texture() {
    let foliage = |uv: f32| {
        let attributes = Attributes { uvs: vec![[Vec2::ZERO, Vec2::X * uv, Vec2::Y]], ..Attributes::default() };
        Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], attributes, vec![]).map(|_| ())
    };
    case(GROUP, "texture coordinates of 10³⁰", "a named error").refuses(foliage(1e30), "may repeat at most");
    case(GROUP, "texture coordinates at infinity", "a named error").refuses(foliage(f32::INFINITY), "not finite");
    case(GROUP, "a texture that repeats 10⁵ times", "definition: allowed").equals(foliage(1e5).is_ok(), true);
}

#[test]
fn no_texel_is_trimmed_away() {
    // One opaque texel anywhere in a card: the hull of the visible part contains its center.
    let mut random = Random(23);
    let mut lost = 0;
    for _ in 0..200 {
        let (x, y) = (random.below(200), random.below(150));
        let foliage = cards(image(200, 150, |i| if i == y * 200 + x { 255 } else { 0 }), AlphaMode::Mask(0.5));
        let seen = Opacity::of(&foliage);
        let middle = DVec2::new((x as f64 + 0.5) / 200.0, 1.0 - (y as f64 + 0.5) / 150.0);
        let uvs = [[DVec2::ZERO, DVec2::X, DVec2::ONE], [DVec2::ZERO, DVec2::ONE, DVec2::Y]];
        let inside = (0..2).any(|t| {
            let hull: Vec<DVec2> =
                seen.get(t).hull.iter().map(|w| uvs[t][0] * w.x + uvs[t][1] * w.y + uvs[t][2] * w.z).collect();
            hull.len() > 2
                && (0..hull.len()).all(|i| (hull[(i + 1) % hull.len()] - hull[i]).perp_dot(middle - hull[i]) >= -1e-9)
        });
        lost += usize::from(!inside);
    }
    case(GROUP, "single opaque texels outside the trimmed outline, of 200", "definition: none")
        .holds(f64::from(lost as u32), 0.0);
}

#[test]
fn triangles_that_leave_the_canvas() {
    let white = cards(image(1, 1, |_| 255), AlphaMode::Opaque);
    let far = [1e3f32, 1e5, 1e7];
    let mut wrong = 0;
    for reach in far {
        // The triangle covers the lower left half of the canvas; the rest lies far outside.
        let corners = [Vec3::new(-reach, -reach, 0.0), Vec3::new(-reach, reach, 0.0), Vec3::new(reach, reach, 0.0)];
        let triangle =
            ScreenTriangle { reach: f32::INFINITY, corners, foliage: &white, triangle: 0, window: &Window::WHOLE };
        let Canvas { pixels, .. } = drawn(&[triangle], 64, 64, Samples::new(1).unwrap());
        // Error bound: f32 rounding of the edges at that size.
        let slack = f64::from(reach) * 2f64.powi(-22) + 1.0;
        for (i, p) in pixels.iter().enumerate() {
            let below = (i / 64) as f64 - (i % 64) as f64;
            wrong += usize::from((below > slack && p.w != 1.0) || (below < -slack && p.w != 0.0));
        }
    }
    case(GROUP, "a triangle that reaches 10⁷ pixels beyond the canvas", "closed form: half of the canvas")
        .holds(wrong as f64, 0.0);
    let vast = [Vec3::new(-1e20, -1e20, 0.0), Vec3::new(-1e20, 1e20, 0.0), Vec3::new(1e20, 1e20, 0.0)];
    let triangle =
        ScreenTriangle { reach: f32::INFINITY, corners: vast, foliage: &white, triangle: 0, window: &Window::WHOLE };
    let any = drawn(&[triangle], 8, 8, Samples::new(2).unwrap()).pixels.iter().any(|p| *p != Vec4::ZERO);
    case(GROUP, "a triangle of 10²⁰ pixels, whose area is beyond f32", "definition: not drawn").equals(any, false);
    let broken = [Vec3::splat(f32::NAN), Vec3::X, Vec3::Y];
    let triangle =
        ScreenTriangle { reach: f32::INFINITY, corners: broken, foliage: &white, triangle: 0, window: &Window::WHOLE };
    let any = drawn(&[triangle], 8, 8, Samples::new(2).unwrap()).pixels.iter().any(|p| *p != Vec4::ZERO);
    case(GROUP, "a corner of NaN", "definition: nothing is drawn").equals(any, false);
}

/// Two triangles over a whole canvas of this size, with their front or their back to the viewer.
fn drawn_whole(of: &Foliage, size: usize, samples: usize, front: bool) -> Image {
    let side = size as f32;
    // Corners in the order of their texture coordinates: lower left, lower right, upper right, upper left; rows go down.
    let [a, b, c, d] = [[0.0, side], [side, side], [side, 0.0], [0.0, 0.0]].map(|[x, y]| {
        let x = if front { x } else { side - x };
        Vec3::new(x, y, 0.0)
    });
    let triangle = |triangle, corners| ScreenTriangle {
        reach: f32::INFINITY,
        corners,
        foliage: of,
        triangle,
        window: &Window::WHOLE,
    };
    let both = [triangle(0, [a, b, c]), triangle(1, [a, c, d])];
    Channel::BaseColor.to_image(&drawn(&both, size, size, Samples::new(samples).unwrap()))
}

#[test]
fn textures_survive_being_drawn() {
    let mut random = Random(24);
    let pixels: Vec<[u8; 4]> = (0..64 * 64).map(|_| std::array::from_fn(|_| random.below(256) as u8)).collect();
    let image = Image::new(64, 64, pixels).unwrap();
    let masked = cards(image.clone(), AlphaMode::Mask(0.5));
    // One sample in the center of a texel: filtering reads that texel alone.
    let found = drawn_whole(&masked, 64, 1, true);
    let wrong = found
        .pixels()
        .iter()
        .zip(image.pixels())
        .filter(|(a, b)| if f32::from(b[3]) / 255.0 >= 0.5 { **a != [b[0], b[1], b[2], 255] } else { a[3] != 0 });
    case(
        GROUP,
        "a texture drawn texel for texel, premultiplied and back",
        "definition: the same codes where alpha reaches the cutoff",
    )
    .holds(wrong.count() as f64, 0.0);
    let mirrored = drawn_whole(&masked, 64, 1, false);
    let turned = (0..64 * 64).filter(|i| found.pixels()[i / 64 * 64 + 63 - i % 64] != mirrored.pixels()[*i]).count();
    case(GROUP, "double-sided leaves seen from behind", "invariance: the mirrored picture").holds(turned as f64, 0.0);
    let single = masked.with_materials(|m| Material { double_sided: false, ..m.clone() });
    let seen = |front| drawn_whole(&single, 64, 1, front).pixels().iter().any(|p| p[3] > 0);
    case(GROUP, "single-sided leaves, from the front and from behind", "definition: visible, not visible")
        .equals([seen(true), seen(false)], [true, false]);
    // Blended alpha is the share of samples with a lower threshold.
    let constant = |alpha: u8| cards(Image::new(1, 1, vec![[90, 90, 90, alpha]]).unwrap(), AlphaMode::Blend);
    let off = |alpha: u8| {
        let found = drawn_whole(&constant(alpha), 8, 16, true);
        // Pixels on the diagonal hold samples of both triangles, with thresholds in two orders.
        let inside = found.pixels().iter().enumerate().filter(|(i, _)| i / 8 + i % 8 != 7);
        inside.map(|(_, p)| (f64::from(p[3]) - f64::from(alpha)).abs()).fold(0.0, worse)
    };
    case(GROUP, "blended alpha of all codes, 256 samples, in codes", "definition: one sample of 256, and half a code")
        .holds((0..=255).map(off).fold(0.0, worse), 1.5);
}

#[test]
fn colours_survive_round_trips() {
    let mut wrong = 0;
    for code in 0..=255u8 {
        for alpha in [1u8, 2, 127, 128, 254, 255] {
            // A canvas holds linear light premultiplied by coverage: convert there and back.
            let linear = {
                let x = f64::from(code) / 255.0;
                if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
            };
            let share = f32::from(alpha) / 255.0;
            let pixel = (Vec3::splat(linear as f32) * share).extend(share);
            let back = Channel::BaseColor.to_image(&Canvas { width: 1, height: 1, pixels: vec![pixel] });
            wrong += usize::from(back.pixels()[0] != [code, code, code, alpha]);
        }
    }
    case(GROUP, "sRGB → linear, premultiplied → sRGB, all codes, alpha from 1/255", "the standard's formula in f64")
        .holds(wrong as f64, 0.0);
}
