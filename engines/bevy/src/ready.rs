//! Makes the meshes, materials and images of a loaded file ready for drawing, once a file.

use std::collections::HashSet;

use bevy::camera::primitives::MeshAabb;
use bevy::prelude::*;

use crate::file::{LeafcloudFile, Level, Light};
use crate::mips::add_mips;

pub(crate) fn make_ready(
    mut events: MessageReader<AssetEvent<LeafcloudFile>>,
    mut files: ResMut<Assets<LeafcloudFile>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut images: ResMut<Assets<Image>>,
) {
    for event in events.read() {
        let AssetEvent::LoadedWithDependencies { id } = event else {
            continue;
        };
        let Some(mut file) = files.get_mut(*id) else {
            continue;
        };
        let mut lit = HashSet::new(); // Trees of a file may share materials.
        for levels in &mut file.trees {
            centre_meshes(levels, &mut meshes);
            add_light(levels, &mut materials, &mut lit);
            add_mips_of(levels, &materials, &mut images);
            smooth_cutouts(levels, &mut materials);
        }
        file.is_ready = true;
    }
}

/// Replaces the meshes by meshes around the center of the leaves: Bevy measures the distance of a fading mesh from its origin.
fn centre_meshes(levels: &mut [Level], meshes: &mut Assets<Mesh>) {
    let mut half_box = Vec3::ZERO;
    for level in levels.iter_mut() {
        for part in &mut level.parts {
            let Some(read) = meshes.get(&part.mesh) else {
                continue;
            };
            let centred = read.clone().translated_by(-level.centre);
            if let Some(bounds) = centred.compute_aabb() {
                half_box = half_box.max(Vec3::from(bounds.min().abs())).max(Vec3::from(bounds.max().abs()));
            }
            part.mesh = meshes.add(centred);
        }
    }
    for level in levels {
        level.half_box = half_box;
    }
}

fn add_light(levels: &[Level], materials: &mut Assets<StandardMaterial>, lit: &mut HashSet<AssetId<StandardMaterial>>) {
    for part in levels.iter().flat_map(|level| &level.parts) {
        if part.light == Light::PLAIN || !lit.insert(part.material.id()) {
            continue;
        }
        if let Some(mut material) = materials.get_mut(&part.material) {
            material.diffuse_transmission = part.light.through;
            let color = material.base_color.to_linear();
            material.base_color = (color * part.light.strength).with_alpha(color.alpha).into();
        }
    }
}

/// Makes multisampling smooth the edges of cutouts. Bevy draws those edges at an alpha of one half, so alpha changes until the cutoff is there.
fn smooth_cutouts(levels: &[Level], materials: &mut Assets<StandardMaterial>) {
    for part in levels.iter().flat_map(|level| &level.parts) {
        if let Some(mut material) = materials.get_mut(&part.material)
            && let AlphaMode::Mask(cutoff) = material.alpha_mode
        {
            let alpha = material.base_color.alpha() * 0.5 / cutoff.max(f32::EPSILON);
            material.base_color.set_alpha(alpha);
            material.alpha_mode = AlphaMode::AlphaToCoverage;
        }
    }
}

/// Gives images mip levels, except cutouts of the leaves themselves, which mip levels would thin out.
fn add_mips_of(levels: &[Level], materials: &Assets<StandardMaterial>, images: &mut Assets<Image>) {
    let materials_of = |level: &Level| -> Vec<&StandardMaterial> {
        level.parts.iter().filter_map(|part| materials.get(&part.material)).collect()
    };
    let own = levels.iter().take(1).flat_map(materials_of);
    let leaves: HashSet<_> = own
        .filter(|material| material.alpha_mode != AlphaMode::Opaque)
        .filter_map(|material| material.base_color_texture.clone())
        .collect();
    for material in levels.iter().flat_map(materials_of) {
        for texture in images_of(material).filter(|&texture| !leaves.contains(texture)) {
            let cutoff = match material.alpha_mode {
                AlphaMode::Mask(cutoff) if Some(texture) == material.base_color_texture.as_ref() => Some(cutoff),
                _ => None,
            };
            if let Some(mut image) = images.get_mut(texture) {
                add_mips(&mut image, cutoff);
            }
        }
    }
}

fn images_of(material: &StandardMaterial) -> impl Iterator<Item = &Handle<Image>> {
    [
        &material.base_color_texture,
        &material.normal_map_texture,
        &material.metallic_roughness_texture,
        &material.occlusion_texture,
        &material.emissive_texture,
    ]
    .into_iter()
    .flatten()
}
