//! Trees with levels of detail that do not pop, from the GLB files that Leafcloud bakes with `--engine bevy`.
//!
//! ```no_run
//! # use bevy::prelude::*;
//! use leafcloud_bevy::{LeafcloudPlugin, LeafcloudTree};
//!
//! fn plant(mut commands: Commands, assets: Res<AssetServer>) {
//!     commands.spawn((LeafcloudTree::load(&assets, "pine.glb"), Transform::from_xyz(3.0, 0.0, 0.0)));
//! }
//!
//! App::new().add_plugins((DefaultPlugins, LeafcloudPlugin)).add_systems(Startup, plant).run();
//! ```

mod file;
mod laws;
mod mips;
mod ready;
mod tree;

use bevy::camera::visibility::VisibilitySystems;
use bevy::gltf::extensions::GltfExtensionHandlers;
use bevy::prelude::*;
use bevy::transform::TransformSystems;

pub use file::{LABEL, LeafcloudFile, Level, Part};
pub use tree::{LeafcloudTree, LevelPart};

/// Reads trees from GLB files, and makes each [`LeafcloudTree`] show the level for its distance. Add it after `DefaultPlugins`.
pub struct LeafcloudPlugin;

impl Plugin for LeafcloudPlugin {
    fn build(&self, app: &mut App) {
        // Nobody else holds the lock while plugins are built, so this does not wait.
        let handlers = app.world().resource::<GltfExtensionHandlers>().0.clone();
        bevy::tasks::block_on(handlers.write()).push(Box::new(file::TreeReader));
        app.init_asset::<LeafcloudFile>().add_systems(Update, (ready::make_ready, tree::plant).chain()).add_systems(
            PostUpdate,
            tree::follow.after(TransformSystems::Propagate).before(VisibilitySystems::CheckVisibility),
        );
    }
}
