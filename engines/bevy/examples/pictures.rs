//! Draws pictures of trees without a window, for the tests:
//!
//!     pictures SHOTS.json FOLDER
//!
//! SHOTS.json lists the pictures ([`Shot`]). Each becomes FOLDER/NAME.png. FOLDER/drawn.json lists for each name the levels that Bevy
//! draws, by its visibility ranges, and the morph weights of the leaves.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::camera::visibility::VisibleEntityRanges;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::gltf::GltfAssetLabel;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::view::screenshot::{Captured, Screenshot, save_to_disk};
use bevy::window::ExitCondition;
use bevy::world_serialization::WorldAssetRoot;
use leafcloud_bevy::{LeafcloudFile, LeafcloudPlugin, LeafcloudTree, LevelPart};
use serde::{Deserialize, Serialize};

/// Frames in which Bevy takes new meshes and textures over.
const FRAMES: usize = 4;

/// Most frames that a file or a picture takes.
const PATIENCE: usize = 10_000;

#[derive(Deserialize)]
struct Shot {
    name: String,
    /// A GLB file.
    file: PathBuf,
    /// The file's own scene, without levels.
    is_plain: bool,
    /// Number of the tree in the file.
    tree: usize,
    lod_distance: f32,
    /// Place of the tree: scale, turn in radians, position.
    scale: f32,
    turn: f32,
    position: Vec3Numbers,
    /// Center of the picture, and distance of the camera from there.
    centre: Vec3Numbers,
    distance: f32,
    /// Vertical, in degrees.
    field_of_view: f32,
    /// Width and height of the picture.
    pixels: u32,
    is_multisampled: bool,
}

type Vec3Numbers = [f32; 3];

#[derive(Default, Serialize)]
struct Drawn {
    levels: Vec<usize>,
    weights: BTreeMap<usize, f32>,
}

#[derive(Resource, Default)]
struct Files(Vec<Handle<LeafcloudFile>>);

fn main() {
    let arguments: Vec<_> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [list, folder] = &arguments[..] else {
        panic!("usage: pictures SHOTS.json FOLDER");
    };
    let shots: Vec<Shot> = serde_json::from_slice(&std::fs::read(list).expect("SHOTS.json")).expect("a list of shots");
    let mut app = new_app();
    let drawn: BTreeMap<_, _> = shots.iter().map(|shot| (shot.name.clone(), take(&mut app, shot, folder))).collect();
    std::fs::write(folder.join("drawn.json"), serde_json::to_vec(&drawn).expect("numbers")).expect("a folder");
}

fn new_app() -> App {
    let mut app = App::new();
    app.add_plugins((
        DefaultPlugins
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
            .set(AssetPlugin { file_path: "/".into(), ..default() })
            .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() }),
        LeafcloudPlugin,
    ));
    app.insert_resource(ClearColor(Color::srgb(0.2, 0.3, 0.8)));
    app.insert_resource(GlobalAmbientLight { brightness: 500.0, ..default() });
    app.finish();
    app.cleanup();
    let sun = DirectionalLight { illuminance: 3_000.0, ..default() };
    app.world_mut().spawn((sun, Transform::from_xyz(1.0, 2.0, 2.0).looking_at(Vec3::ZERO, Vec3::Y)));
    app
}

fn take(app: &mut App, shot: &Shot, folder: &Path) -> Drawn {
    let tree = spawn_tree(app, shot);
    keep_file(app, tree);
    let (camera, target) = spawn_camera(app, shot);
    (0..FRAMES).for_each(|_| app.update());
    let drawn = drawn_by(app, camera);
    let path = folder.join(format!("{}.png", shot.name));
    let picture = app.world_mut().spawn(Screenshot::image(target)).observe(save_to_disk(path)).id();
    update_until(app, "no picture", |world| {
        world.get::<Captured>(picture).is_some() || world.get_entity(picture).is_err()
    });
    app.world_mut().despawn(tree);
    app.world_mut().despawn(camera);
    drawn
}

/// Keeps the tree's file for later pictures: Bevy would read it again for each.
fn keep_file(app: &mut App, tree: Entity) {
    if let Some(tree) = app.world().get::<LeafcloudTree>(tree) {
        let file = tree.file.clone();
        app.world_mut().get_resource_or_init::<Files>().0.push(file);
    }
}

fn update_until(app: &mut App, failure: &str, mut is_done: impl FnMut(&World) -> bool) {
    for _ in 0..PATIENCE {
        app.update();
        if is_done(app.world()) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    panic!("{failure}");
}

fn spawn_tree(app: &mut App, shot: &Shot) -> Entity {
    let assets = app.world().resource::<AssetServer>().clone();
    let path = shot.file.strip_prefix("/").expect("an absolute path").to_owned();
    let place = Transform::from_translation(shot.position.into())
        .with_rotation(Quat::from_rotation_y(shot.turn))
        .with_scale(Vec3::splat(shot.scale));
    let mut entity = app.world_mut().spawn(place);
    if shot.is_plain {
        entity.insert(WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(path))));
    } else {
        entity.insert(LeafcloudTree {
            number: shot.tree,
            lod_distance: shot.lod_distance,
            ..LeafcloudTree::load(&assets, path)
        });
    }
    let tree = entity.id();
    update_until(app, "no tree", |world| world.get::<Children>(tree).is_some());
    tree
}

fn spawn_camera(app: &mut App, shot: &Shot) -> (Entity, Handle<Image>) {
    let size = Extent3d { width: shot.pixels, height: shot.pixels, depth_or_array_layers: 1 };
    let format = TextureFormat::Rgba8UnormSrgb;
    let mut image = Image::new_fill(size, TextureDimension::D2, &[0; 4], format, RenderAssetUsages::default());
    image.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
    let target = app.world_mut().resource_mut::<Assets<Image>>().add(image);
    let centre = Vec3::from(shot.centre);
    let eye = centre + Vec3::new(0.4, 0.15, 1.0).normalize() * shot.distance;
    let view = PerspectiveProjection {
        fov: shot.field_of_view.to_radians(),
        near: 0.05 * shot.distance,
        far: 3.0 * shot.distance,
        ..default()
    };
    let camera = (
        Camera3d::default(),
        RenderTarget::Image(target.clone().into()),
        Projection::Perspective(view),
        Transform::from_translation(eye).looking_at(centre, Vec3::Y),
        (Tonemapping::None, if shot.is_multisampled { Msaa::Sample4 } else { Msaa::Off }),
    );
    (app.world_mut().spawn(camera).id(), target)
}

fn drawn_by(app: &mut App, camera: Entity) -> Drawn {
    let mut drawn = Drawn::default();
    let mut parts = app.world_mut().query::<(Entity, &LevelPart, Option<&MeshMorphWeights>)>();
    let ranges = app.world().resource::<VisibleEntityRanges>();
    for (entity, part, morph) in parts.iter(app.world()) {
        if ranges.entity_is_in_range_of_view(entity, camera) && !drawn.levels.contains(&part.level) {
            drawn.levels.push(part.level);
        }
        if let Some(MeshMorphWeights::Value { weights }) = morph {
            drawn.weights.insert(part.level, weights[0]);
        }
    }
    drawn
}
