//! The trees of a file, read while Bevy's loader reads it.
//!
//! Levels after level 0 are in no scene of the file: `MSFT_lod` on the node of level 0 lists their nodes. Bevy's loader keeps the
//! meshes of all nodes, but drops the list.

use std::ops::Range;

use bevy::asset::LoadContext;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler};
use bevy::gltf::{GltfAssetLabel, GltfLoaderSettings, gltf};
use bevy::prelude::*;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;

use crate::laws::fade_out;

/// Label of the trees in a file, as in `pine.glb#Leafcloud`.
pub const LABEL: &str = "Leafcloud";

/// All trees of a file.
#[derive(Asset, TypePath, Debug)]
pub struct LeafcloudFile {
    /// Trees in the order of the file, each with its levels.
    pub trees: Vec<Vec<Level>>,
    /// Whether the meshes, materials and images have been made ready for drawing.
    pub(crate) is_ready: bool,
}

/// A level of a tree. Distances are those of the file.
#[derive(Debug)]
pub struct Level {
    /// Number of the level, from 0: the leaves.
    pub number: usize,
    /// Place of the center of the leaves, with the turn and scale of the level's mesh.
    pub place: Transform,
    /// The center of the leaves in the coordinates of the mesh.
    pub(crate) centre: Vec3,
    /// Half the sides of a box around the center that holds all levels, in the coordinates of the mesh.
    pub half_box: Vec3,
    /// Distances between which the leaves slide onto the billboards of the next level.
    pub transition: Option<Range<f32>>,
    /// Distances between which this level fades in.
    pub fade_in: Range<f32>,
    /// Distances between which this level fades out.
    pub fade_out: Range<f32>,
    /// Leaves and trunk.
    pub parts: Vec<Part>,
}

/// Part of a level with one material.
#[derive(Debug)]
pub struct Part {
    /// Mesh around the center of the leaves.
    pub mesh: Handle<Mesh>,
    /// Material of the part.
    pub material: Handle<StandardMaterial>,
    /// Numbers of the material that Bevy's loader does not read.
    pub(crate) light: Light,
}

/// Numbers of a material that Bevy's loader does not read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Light {
    /// Fraction of the light that goes through leaves.
    pub through: f32,
    /// Factor on baked light: its colors end at 1.
    pub strength: f32,
}

impl Light {
    /// That of most materials.
    pub const PLAIN: Self = Self { through: 0.0, strength: 1.0 };
}

#[derive(Deserialize)]
struct Extras<T> {
    leafcloud: T,
}

#[derive(Deserialize)]
struct NodeNumbers {
    switch_distance: f32,
    transition_start: Option<f32>,
    transition_end: Option<f32>,
    centre: [f32; 3],
}

impl NodeNumbers {
    fn transition(&self) -> Option<Range<f32>> {
        Some(self.transition_start?..self.transition_end?)
    }
}

#[derive(Default, Deserialize)]
struct MaterialNumbers {
    light_strength: Option<f32>,
}

fn numbers_in<T: DeserializeOwned>(extras: Option<&RawValue>) -> Option<T> {
    serde_json::from_str::<Extras<T>>(extras?.get()).ok().map(|extras| extras.leafcloud)
}

/// Reads the trees at the begin of a load.
#[derive(Clone)]
pub(crate) struct TreeReader;

impl GltfExtensionHandler for TreeReader {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_root(&mut self, context: &mut LoadContext<'_>, file: &gltf::Gltf, _: &GltfLoaderSettings) {
        let trees = trees_in(&file.document, context);
        if !trees.is_empty() {
            context.add_labeled_asset(LABEL, LeafcloudFile { trees, is_ready: false });
        }
    }
}

fn trees_in(document: &gltf::Document, context: &mut LoadContext<'_>) -> Vec<Vec<Level>> {
    chains_in(document)
        .iter()
        .map(|chain| levels_of(chain, document, context))
        .filter(|levels| !levels.is_empty())
        .collect()
}

/// Returns the numbers of the nodes of each tree's levels.
fn chains_in(document: &gltf::Document) -> Vec<Vec<usize>> {
    let of_first = document.nodes().filter_map(|node| {
        let ids = node.extension_value("MSFT_lod")?.get("ids")?.as_array()?;
        let others = ids.iter().filter_map(|id| id.as_u64().map(|id| id as usize));
        Some(std::iter::once(node.index()).chain(others).collect())
    });
    of_first.collect()
}

/// Returns the levels of a tree; none if a node has no numbers, as in files of other tools.
fn levels_of(chain: &[usize], document: &gltf::Document, context: &mut LoadContext<'_>) -> Vec<Level> {
    let nodes = chain.iter().filter_map(|&number| document.nodes().nth(number));
    let read = nodes.map(|node| Some((numbers_in::<NodeNumbers>(node.extras().as_deref())?, node.mesh()?, node)));
    let Some(read) = read.collect::<Option<Vec<_>>>() else {
        return Vec::new();
    };
    let slides: Vec<_> = read.iter().map(|(numbers, ..)| numbers.transition()).collect();
    let switches = read.iter().skip(1).map(|(numbers, ..)| Some(numbers.switch_distance)).chain([None]);
    let fades: Vec<_> = slides.iter().zip(switches).map(|(slide, next)| fade_out(slide.as_ref(), next)).collect();
    let levels = read.into_iter().zip(slides).enumerate().map(|(number, ((numbers, mesh, node), transition))| {
        let centre = Vec3::from(numbers.centre);
        let place = Transform::from_matrix(Mat4::from_cols_array_2d(&node.transform().matrix()));
        Level {
            number,
            place: place * Transform::from_translation(centre),
            centre,
            half_box: Vec3::ZERO,
            transition,
            fade_in: number.checked_sub(1).map_or(0.0..0.0, |before| fades[before].clone()),
            fade_out: fades[number].clone(),
            parts: parts_of(&mesh, context),
        }
    });
    levels.collect()
}

fn parts_of(mesh: &gltf::Mesh<'_>, context: &mut LoadContext<'_>) -> Vec<Part> {
    let parts = mesh.primitives().map(|primitive| {
        let label = GltfAssetLabel::Primitive { mesh: mesh.index(), primitive: primitive.index() };
        let material = primitive.material();
        let numbers: MaterialNumbers = numbers_in(material.extras().as_deref()).unwrap_or_default();
        let name = match material.index() {
            Some(index) => GltfAssetLabel::Material { index, is_scale_inverted: false },
            None => GltfAssetLabel::DefaultMaterial,
        };
        Part {
            mesh: context.get_label_handle(label.to_string()),
            // The label under which bevy_pbr adds the material for drawing.
            material: context.get_label_handle(format!("{name}/std")),
            light: light_of(&material, numbers.light_strength),
        }
    });
    parts.collect()
}

fn light_of(material: &gltf::Material<'_>, strength: Option<f32>) -> Light {
    let transmission = material.extension_value("KHR_materials_diffuse_transmission");
    let through = transmission.and_then(|values| values.get("diffuseTransmissionFactor")?.as_f64());
    Light {
        through: through.map_or(Light::PLAIN.through, |through| through as f32),
        strength: strength.unwrap_or(Light::PLAIN.strength),
    }
}
