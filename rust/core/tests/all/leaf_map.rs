//! Label textures against the colors of the leaves: the leaves' texture shows its coordinates, their corner colors the leaf's index.

use glam::{DVec3, Vec2, Vec4};
use leafcloud::fit::FitSettings;
use leafcloud::foliage::{Attributes, Image, Material};
use leafcloud::lod::{ChainSettings, Level, build_chain};
use leafcloud::textures::Channels;
use leafcloud::{Foliage, Progress};

const LEAVES: usize = 40;

/// Squares on a coil; for each, red is u and green is v of its texture, and blue is its index.
fn coil() -> Foliage {
    let (mut positions, mut triangles, mut attributes) = (Vec::new(), Vec::new(), Attributes::default());
    for leaf in 0..LEAVES {
        let angle = leaf as f64 * 0.7;
        let out = DVec3::new(angle.cos(), angle.sin(), leaf as f64 / 20.0 - 1.0);
        let (across, up) = (DVec3::new(-angle.sin(), angle.cos(), 0.0) * 0.25, DVec3::new(0.1, 0.05, 0.4));
        positions.extend([out, out + across, out + across + up, out + up]);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| (4 * leaf + i) as u32);
        triangles.extend([[a, b, c], [a, c, d]]);
        attributes.uvs.extend([[Vec2::ZERO, Vec2::X, Vec2::ONE], [Vec2::ZERO, Vec2::ONE, Vec2::Y]]);
        attributes.colors.extend([[Vec4::new(1.0, 1.0, leaf as f32 / LEAVES as f32, 1.0); 3]; 2]);
        attributes.material_ids.extend([(leaf % 2) as u32; 2]);
    }
    let shown = |i: usize| [(i % 256) as u8, 255 - (i / 256) as u8, 255, 255];
    let image = Image::new(256, 256, (0..65_536).map(shown).collect::<Vec<_>>()).unwrap();
    let material = Material { image: Some(image), ..Material::default() };
    Foliage::new(&positions, triangles, attributes, vec![material.clone(), material]).unwrap()
}

fn linear(code: u8) -> f64 {
    let c = f64::from(code) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Returns the share of opaque texels with labels that match their color, within `within` texels of the leaves' texture. Blue on the page
/// differs from the leaves' blue by one factor, the tone: it is estimated as the median ratio.
fn agreement(level: &Level, within: f64) -> f64 {
    let [uv, id] = [&level.page.leaf_uv, &level.page.leaf_id].map(|image| image.as_ref().unwrap().pixels());
    let whole = || level.page.base_color.pixels().iter().zip(uv.iter().zip(id)).filter(|(color, _)| color[3] == 255);
    let leaf_of = |id: &[u8; 4]| u32::from(id[0]) | u32::from(id[1]) << 8;
    let mut tones: Vec<f64> = whole()
        .filter(|(_, (_, id))| leaf_of(id) > 0)
        .map(|(color, (_, id))| linear(color[2]) * LEAVES as f64 / f64::from(leaf_of(id)))
        .collect();
    tones.sort_by(f64::total_cmp);
    let tone = tones[tones.len() / 2];
    assert!((tone - 1.0).abs() < 0.1, "{tone}");
    let agrees = |(&[red, green, blue, _], (uv, id)): (&[u8; 4], (&[u8; 4], &[u8; 4]))| {
        let (u, v) = (u16::from(uv[0]) << 4 | u16::from(uv[2]) >> 4, u16::from(uv[1]) << 4 | u16::from(uv[2]) & 15);
        let near = |code: u8, coordinate: u16| (f64::from(code) - f64::from(coordinate) / 16.0).abs() <= within;
        let (leaf, number) = (leaf_of(id), linear(blue) / tone * LEAVES as f64);
        near(red, u) && near(green, v) && (number - f64::from(leaf)).abs() < 0.6 && u32::from(id[2]) == leaf % 2
    };
    let (agreeing, all) = whole().fold((0, 0), |(yes, all), texel| (yes + usize::from(agrees(texel)), all + 1));
    assert!(all > 500, "{all} whole texels");
    f64::from(u32::try_from(agreeing).unwrap()) / f64::from(u32::try_from(all).unwrap())
}

fn settings() -> ChainSettings {
    ChainSettings {
        fit: FitSettings { epsilon: 0.1, ..FitSettings::default() },
        texture_size: 512.into(),
        channels: Channels { leaf_map: true, ..Channels::default() },
        ..ChainSettings::default()
    }
}

#[test]
#[ignore = "long: make test-night runs it"]
fn labels_match_colors_on_both_sides_and_with_closed_gaps() {
    let leaves = coil();
    let shown = [
        ChainSettings { back_sides: Some(true), ..settings() },
        ChainSettings { close_gaps: true, ..settings() },
        ChainSettings { back_sides: Some(true), close_gaps: true, ..settings() },
    ];
    for settings in shown {
        let settings = ChainSettings { levels: 1, cross: false, ..settings };
        let chain = build_chain(&leaves, None, &settings, Progress::silent()).unwrap();
        let share = agreement(&chain.levels[0], 6.0);
        assert!(share > 0.85, "{:?}, {}: {share}", settings.back_sides, settings.close_gaps);
    }
}

#[test]
fn labels_match_colors_on_every_level() {
    let settings = settings();
    let leaves = coil();
    let chain = build_chain(&leaves, None, &settings, Progress::silent()).unwrap();
    // Where leaves cross, a texel averages their colors but has one label; a texel of the cross impostor is a fifth of a leaf, and takes the
    // color of texels below the cutoff around it.
    for (level, within) in chain.levels.iter().zip([6.0, 12.0, 40.0]) {
        let share = agreement(level, within);
        assert!(share > 0.8, "{}: {share}", level.method);
    }
    let leaves = leaves.with_materials(|material| Material { image: None, ..material.clone() });
    let other = build_chain(&leaves, None, &settings, Progress::silent()).unwrap();
    assert_ne!(other.levels[0].page.base_color, chain.levels[0].page.base_color);
    assert_eq!(other.levels[0].page.leaf_uv, chain.levels[0].page.leaf_uv, "labels do not depend on the texture");
}
