//! Channels against closed forms: planes, spheres, maps of one color.

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3, Vec4};

use super::channels::Channel;
use super::raster::{ScreenTriangle, Window, rasterise};
use super::samples::Samples;
use crate::foliage::{AlphaMode, Attributes, Foliage, Image, Material};

/// The square [−1, 1]² turned by `turn`, texture coordinates over all of it.
fn square(turn: DMat3, material: Material) -> Foliage {
    let corners = [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]].map(|[x, y]| turn * DVec3::new(x, y, 0.0));
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let attributes =
        Attributes { uvs: vec![[uvs[0], uvs[1], uvs[2]], [uvs[0], uvs[2], uvs[3]]], ..Attributes::default() };
    Foliage::new(&corners, vec![[0, 1, 2], [0, 2, 3]], attributes, vec![material]).unwrap()
}

/// Renders a channel of a foliage seen along `view`; returns its values as `(column, row) → value`.
fn seen(foliage: &Foliage, channel: Channel, view: Mat3) -> impl Fn(usize, usize) -> Vec3 {
    const SIDE: usize = 16;
    let window = Window { view, ..Window::WHOLE };
    let place = |p: DVec3| {
        let q = view * p.as_vec3();
        Vec3::new(SIDE as f32 / 2.0 * (1.0 + q.x), SIDE as f32 / 2.0 * (1.0 - q.y), q.z)
    };
    let triangles: Vec<ScreenTriangle> = (0..foliage.triangle_count())
        .map(|t| ScreenTriangle {
            reach: f32::INFINITY,
            corners: foliage.corners(t).map(place),
            foliage,
            triangle: t as u32,
            window: &window,
        })
        .collect();
    let canvas = rasterise(&triangles, SIDE, SIDE, Samples::default(), &[channel]).remove(0);
    move |column, row| {
        let pixel = canvas.pixels[row * SIDE + column];
        assert!(pixel.w > 0.99, "nothing is seen at {column} {row}");
        pixel.truncate() / pixel.w
    }
}

fn near(found: Vec3, expected: Vec3) {
    assert!(found.distance(expected) < 2e-3, "{found}, expected {expected}");
}

const FRONT: Mat3 = Mat3::IDENTITY;
/// The view from behind: right is −x, up is y.
const BACK: Mat3 = Mat3::from_cols(Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z);
const NORMAL: Channel<'static> = Channel::Normal(0.0);

#[test]
fn a_tilted_leaf_shows_its_tilt() {
    let tilted = square(DMat3::from_rotation_x(0.5), Material::default());
    near(seen(&tilted, NORMAL, FRONT)(7, 8), Vec3::new(0.0, -0.5f32.sin(), 0.5f32.cos()));
    // From behind, the channel shows the side that faces the viewer: up and down stay.
    near(seen(&tilted, NORMAL, BACK)(7, 8), Vec3::new(0.0, 0.5f32.sin(), 0.5f32.cos()));
}

#[test]
fn corner_normals_override_the_face_normal() {
    let bent = Vec3::new(0.6, 0.0, 0.8);
    let flat = square(DMat3::IDENTITY, Material::default());
    let attributes = Attributes { normals: vec![[bent * 7.0; 3]; 2], ..flat.attributes().clone() };
    let corners: Vec<DVec3> = (0..2).flat_map(|t| flat.corners(t)).collect();
    let foliage = Foliage::new(&corners, vec![[0, 1, 2], [3, 4, 5]], attributes, vec![]).unwrap();
    near(seen(&foliage, NORMAL, FRONT)(3, 12), bent);
    near(seen(&foliage, NORMAL, BACK)(3, 12), Vec3::new(0.6, 0.0, 0.8));
}

#[test]
fn normals_against_the_winding_mean_the_same_surface() {
    let flat = square(DMat3::from_rotation_x(0.5), Material::default());
    let (own, corners) = (Vec3::new(0.0, -0.5f32.sin(), 0.5f32.cos()), (0..2).flat_map(|t| flat.corners(t)));
    let attributes = Attributes { normals: vec![[-own; 3]; 2], ..flat.attributes().clone() };
    let corners: Vec<DVec3> = corners.collect();
    let against = Foliage::new(&corners, vec![[0, 1, 2], [3, 4, 5]], attributes, vec![]).unwrap();
    near(seen(&against, NORMAL, FRONT)(7, 8), own);
    near(seen(&against, NORMAL, BACK)(7, 8), Vec3::new(0.0, 0.5f32.sin(), 0.5f32.cos()));
}

#[test]
fn maps_turn_with_the_leaf() {
    // (0.48, 0.6, 0.64) in codes: to the right, up the texture, out of it.
    let map = Image::new(4, 4, vec![[189, 204, 209, 255]; 16]).unwrap();
    let close = |found: Vec3, expected: Vec3| assert!(found.distance(expected) < 0.01, "{found}, expected {expected}");
    let leaf = |turn| square(turn, Material { normal: Some(map.clone()), ..Material::default() });
    close(seen(&leaf(DMat3::IDENTITY), NORMAL, FRONT)(8, 8), Vec3::new(0.48, 0.6, 0.64));
    let quarter = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2);
    close(seen(&leaf(quarter), NORMAL, FRONT)(8, 8), Vec3::new(-0.6, 0.48, 0.64));
    // From behind, the whole normal is reversed; there, right is −x, up is y, toward the viewer is −z.
    close(seen(&leaf(DMat3::IDENTITY), NORMAL, BACK)(8, 8), Vec3::new(0.48, -0.6, 0.64));
    // Mirrored texture coordinates mirror the normals.
    let mirrored = |flip: fn(Vec2) -> Vec2| {
        let plain = leaf(DMat3::IDENTITY);
        let uvs = plain.attributes().uvs.iter().map(|corners| corners.map(flip)).collect();
        let corners: Vec<DVec3> = (0..2).flat_map(|t| plain.corners(t)).collect();
        let attributes = Attributes { uvs, ..Attributes::default() };
        Foliage::new(&corners, vec![[0, 1, 2], [3, 4, 5]], attributes, vec![plain.material(0).clone()]).unwrap()
    };
    close(seen(&mirrored(|uv| Vec2::new(1.0 - uv.x, uv.y)), NORMAL, FRONT)(8, 8), Vec3::new(-0.48, 0.6, 0.64));
    close(seen(&mirrored(|uv| Vec2::new(uv.x, 1.0 - uv.y)), NORMAL, FRONT)(8, 8), Vec3::new(0.48, -0.6, 0.64));
}

#[test]
fn opaque_materials_ignore_alpha() {
    let clear = |side: usize| Image::new(side, side, vec![[200, 100, 50, 0]; side * side]).unwrap();
    let near_and_far = [8, 256].map(|side| {
        let material =
            Material { image: Some(clear(side)), orm: Some(clear(side)), metallic: 1.0, ..Material::default() };
        let leaf = square(DMat3::IDENTITY, material);
        (seen(&leaf, Channel::BaseColor, FRONT)(7, 8), seen(&leaf, Channel::Orm(None), FRONT)(7, 8))
    });
    near(near_and_far[0].0, near_and_far[1].0);
    near(near_and_far[0].1, near_and_far[1].1);
    near(near_and_far[0].1, Vec3::new(200.0, 100.0, 50.0) / 255.0);
}

#[test]
fn shares_seen_from_far_are_kept_in_the_mean() {
    // Sixteenths of a mask, in stripes, on many small cards beside one another.
    for (share, samples) in [(1, 1), (1, 2), (3, 2), (5, 4), (1, 4)] {
        let sparse = |i: usize| [255, 255, 255, if i % 16 < share { 255 } else { 0 }];
        let image = Image::new(64, 64, (0..64 * 64).map(sparse).collect::<Vec<_>>()).unwrap();
        let material = Material { image: Some(image), alpha_mode: AlphaMode::Mask(0.5), ..Material::default() };
        let leaf = square(DMat3::IDENTITY, material);
        let cards: Vec<ScreenTriangle> = (0..64 * 64)
            .flat_map(|card| {
                let corner =
                    |x: usize, y: usize| Vec3::new((card % 64 + x) as f32 + 0.2, (card / 64 + y) as f32 + 0.1, 0.0);
                let [a, b, c, d] = [corner(0, 1), corner(1, 1), corner(1, 0), corner(0, 0)];
                let triangle = |triangle, corners| ScreenTriangle {
                    reach: f32::INFINITY,
                    corners,
                    foliage: &leaf,
                    triangle,
                    window: &Window::WHOLE,
                };
                [triangle(0, [a, b, c]), triangle(1, [a, c, d])]
            })
            .collect();
        let canvas = rasterise(&cards, 64, 64, Samples::new(samples).unwrap(), &[Channel::BaseColor]).remove(0);
        // No sample lies on an edge between two triangles; the first row is cut.
        let covered = canvas.pixels.iter().skip(64).map(|p| p.w).sum::<f32>() / (63.0 * 64.0);
        let expected = share as f32 / 16.0;
        assert!((covered / expected - 1.0).abs() < 0.06, "{samples}²: {covered}, expected {expected}");
    }
}

#[test]
fn sides_have_colours_of_their_own() {
    let image = Some(Image::new(1, 1, vec![[255, 0, 255, 255]]).unwrap());
    let leaf =
        square(DMat3::IDENTITY, Material { image, base_color: Vec4::new(1.0, 1.0, 0.5, 1.0), ..Material::default() });
    let corners: Vec<DVec3> = (0..2).flat_map(|t| leaf.corners(t)).map(|p| leaf.frame().to_caller(p)).collect();
    let attributes = Attributes {
        colors: vec![[Vec4::new(0.25, 1.0, 0.5, 1.0); 3]; 2],
        back_colors: vec![[Vec3::new(2.0, 1.0, 0.25); 3]; 2],
        ..leaf.attributes().clone()
    };
    let lit = Foliage::new(&corners, vec![[0, 1, 2], [3, 4, 5]], attributes, vec![leaf.material(0).clone()]).unwrap();
    near(seen(&lit, Channel::BaseColor, FRONT)(5, 9), Vec3::new(0.25, 0.0, 0.25));
    near(seen(&lit, Channel::BaseColor, BACK)(5, 9), Vec3::new(2.0, 0.0, 0.125));
}

#[test]
fn bent_all_the_way_normals_point_outward() {
    let flat = square(DMat3::IDENTITY, Material::default());
    // At the height of the crown's center they lie in the plane: a billboard shows them as far as it can.
    let shown = seen(&flat, Channel::Normal(1.0), FRONT)(12, 7);
    assert!(shown.x > 0.98 && shown.z > 0.0, "{shown}");
    let half = seen(&flat, Channel::Normal(0.5), FRONT)(12, 7);
    assert!((half.z - 0.5f32.sqrt()).abs() < 0.01 && half.x > 0.69, "{half}");
}

#[test]
fn factors_multiply_images() {
    let material = Material {
        roughness: 0.5,
        metallic: 1.0,
        orm: Some(Image::new(1, 1, vec![[255, 102, 51, 255]]).unwrap()),
        translucency: Vec3::new(1.0, 0.5, 0.0),
        translucency_image: Some(Image::new(1, 1, vec![[255, 188, 255, 255]]).unwrap()),
        ..Material::default()
    };
    let leaf = square(DMat3::IDENTITY, material);
    near(seen(&leaf, Channel::Orm(None), FRONT)(5, 5), Vec3::new(1.0, 0.2, 0.2));
    // Code 188 is 0.503 by the standard's formula.
    near(seen(&leaf, Channel::Translucency, FRONT)(5, 5), Vec3::new(1.0, 0.2515, 0.0));
}

#[test]
fn distant_textures_show_their_mean() {
    // Rows of black and white, sixteen per pixel, at texture sizes that are powers of two and others.
    for side in [256, 240] {
        let stripes = |i: usize| if (i / side).is_multiple_of(2) { [0, 0, 0, 255] } else { [255, 255, 255, 255] };
        let striped = Image::new(side, side, (0..side * side).map(stripes).collect::<Vec<_>>()).unwrap();
        let leaf = square(DMat3::IDENTITY, Material { image: Some(striped), ..Material::default() });
        let look = seen(&leaf, Channel::BaseColor, FRONT);
        for (column, row) in [(3, 3), (8, 7), (12, 4)] {
            assert!((look(column, row) - 0.5).abs().max_element() < 0.02, "{side}: {}", look(column, row));
        }
    }
}

#[test]
fn channels_become_codes() {
    let canvas = super::Canvas { width: 1, height: 1, pixels: vec![Vec3::new(0.3, 0.0, 0.4).extend(0.5)] };
    let code = |channel: Channel| channel.to_image(&canvas).pixels()[0];
    assert_eq!(code(Channel::Normal(0.0)), [204, 128, 230, 255]);
    assert_eq!(code(Channel::Orm(None)), [153, 0, 204, 255]);
}
