//! Compares the atlas page of a tiny foliage, channel by channel, with pictures that a person has approved. The comparison uses FLIP,
//! because machines may round the last digit differently. The new pictures are left in target/golden. `LEAFCLOUD_GOLDEN=write` replaces the
//! approved pictures; look at the new ones then.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};
use leafcloud::fit::FitSettings;
use leafcloud::foliage::{AlphaMode, Attributes, Image, Material};
use leafcloud::lod::{ChainSettings, build_chain};
use leafcloud::textures::Channels;
use leafcloud::textures::image::write_png;
use leafcloud::{Foliage, Progress};
use leafcloud_flip::flip;

/// Greatest mean FLIP near covered texels.
const MOST: f64 = 0.01;

/// Images of a leaf with a midrib: an ellipse, brighter along its middle, and its normals, which bend away from the middle.
fn leaf_images(side: usize) -> (Image, Image) {
    let place = |i: usize| {
        let at = |x: usize| (x as f32 + 0.5) / side as f32 * 2.0 - 1.0;
        Vec2::new(at(i % side), -at(i / side))
    };
    let color = |i: usize| {
        let p = place(i);
        let inside = (p * Vec2::new(1.8, 1.05)).length() < 1.0;
        let shade = if p.x.abs() < 0.06 { 200 } else { 120 - (p.y * 40.0) as i32 };
        [shade as u8 / 2, shade as u8, shade as u8 / 4, if inside { 255 } else { 0 }]
    };
    let normal = |i: usize| {
        let n = (Vec3::new(place(i).x, 0.4, 1.0).normalize() * 0.5 + 0.5) * 255.0;
        [n.x as u8, n.y as u8, n.z as u8, 255]
    };
    let image =
        |of: &dyn Fn(usize) -> [u8; 4]| Image::new(side, side, (0..side * side).map(of).collect::<Vec<_>>()).unwrap();
    (image(&color), image(&normal))
}

/// Nine leaves of two materials around an axis.
fn tiny() -> Foliage {
    let (mut positions, mut triangles, mut attributes) = (Vec::new(), Vec::new(), Attributes::default());
    for leaf in 0..9u32 {
        let angle = f64::from(leaf) * 2.4;
        let out = DVec3::new(angle.cos(), angle.sin(), 0.3 * f64::from(leaf % 3) - 0.3);
        let across = DVec3::new(-angle.sin(), angle.cos(), 0.0) * 0.3;
        let up = (out.cross(across).normalize() + out * 0.4) * 0.6;
        positions.extend([out - across, out + across, out + across + up, out - across + up]);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * leaf + i);
        triangles.extend([[a, b, c], [a, c, d]]);
        attributes.uvs.extend([[Vec2::ZERO, Vec2::X, Vec2::ONE], [Vec2::ZERO, Vec2::ONE, Vec2::Y]]);
        attributes.material_ids.extend([leaf % 2; 2]);
    }
    let (image, normal) = leaf_images(64);
    let material = |tint: Vec3, roughness: f32| Material {
        base_color: tint.extend(1.0),
        image: Some(image.clone()),
        alpha_mode: AlphaMode::Mask(0.5),
        normal: Some(normal.clone()),
        roughness,
        translucency: tint * 0.5,
        translucency_image: Some(image.clone()),
        ..Material::default()
    };
    let materials = vec![material(Vec3::ONE, 0.4), material(Vec3::new(1.0, 0.5, 0.2), 0.8)];
    Foliage::new(&positions, triangles, attributes, materials).unwrap()
}

fn read(path: &Path) -> Image {
    let picture = image::open(path).unwrap().to_rgba8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Image::new(width, height, picture.into_raw().as_chunks::<4>().0.to_vec()).unwrap()
}

#[test]
fn every_channel_looks_as_it_did() {
    let settings = ChainSettings {
        fit: FitSettings { epsilon: 0.3, candidates: 200, ..FitSettings::default() },
        levels: 1,
        texture_size: 128.into(),
        fitting_pages: false,
        channels: Channels {
            normal: Some(0.2),
            orm: true,
            translucency: true,
            occlusion: true,
            bent_normal: true,
            leaf_map: true,
        },
        ..ChainSettings::default()
    };
    let chain = build_chain(&tiny(), None, &settings, Progress::silent()).unwrap();
    let crate_folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let (golden, found) = (crate_folder.join("tests/golden"), crate_folder.join("../../target/golden"));
    std::fs::create_dir_all(&found).unwrap();
    let write = std::env::var("LEAFCLOUD_GOLDEN").is_ok_and(|wish| wish == "write");
    let mut worst = Vec::new();
    for (number, level) in chain.levels.iter().enumerate() {
        for (channel, image) in level.page.images() {
            let name = format!("{number}_{channel}.png");
            write_png(if write { &golden } else { &found }.join(&name).as_path(), image).unwrap();
            let expected = read(&golden.join(&name));
            let error = flip(&expected, image);
            if error > MOST {
                worst.push(format!("{name}: mean FLIP {error:.3}"));
            }
        }
    }
    let (golden, found) = (golden.display(), found.display());
    assert!(worst.is_empty(), "{}; compare {golden} with {found}", worst.join(", "));
}
