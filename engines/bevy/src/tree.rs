//! Trees of a scene, which show the level for their distance.

use std::ops::Range;

use bevy::asset::AssetPath;
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::{NoAutoAabb, VisibilityRange};
use bevy::ecs::query::QueryData;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::prelude::*;

use crate::file::{LABEL, LeafcloudFile, Level, Part};
use crate::laws::{STAGGER, stagger_at, stepped, transition_at, view_factor};

/// A tree that shows the level for its distance from the camera. Its levels become its children once the file has been read.
#[derive(Component, Clone, Debug)]
#[require(Transform, Visibility)]
pub struct LeafcloudTree {
    /// File of the tree.
    pub file: Handle<LeafcloudFile>,
    /// Number of the tree in its file.
    pub number: usize,
    /// Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
    pub lod_distance: f32,
    /// Largest change of a tree's switch distances by its place, as a fraction, so that neighbors do not switch together.
    pub stagger: f32,
}

impl LeafcloudTree {
    /// Returns the first tree of a file. Trees of one file share its meshes and textures.
    ///
    /// `path`: a GLB file with all levels, as for [`AssetServer::load`].
    #[must_use]
    pub fn load(assets: &AssetServer, path: impl Into<AssetPath<'static>>) -> Self {
        Self::new(assets.load(path.into().with_label(LABEL)))
    }

    /// Returns the first tree of a file.
    #[must_use]
    pub const fn new(file: Handle<LeafcloudFile>) -> Self {
        Self { file, number: 0, lod_distance: 1.0, stagger: STAGGER }
    }
}

/// Part of a level of a [`LeafcloudTree`], its child. Distances are those of the file.
#[derive(Component, Clone, Debug)]
pub struct LevelPart {
    /// Number of the level, from 0: the leaves.
    pub level: usize,
    transition: Option<Range<f32>>,
    fade_in: Range<f32>,
    fade_out: Range<f32>,
}

impl LevelPart {
    fn visibility(&self, factor: f32) -> VisibilityRange {
        let scaled = |range: &Range<f32>| range.start * factor..range.end * factor;
        VisibilityRange { start_margin: scaled(&self.fade_in), end_margin: scaled(&self.fade_out), use_aabb: false }
    }
}

/// A tree that has its children.
#[derive(Component)]
pub(crate) struct Planted;

pub(crate) fn plant(
    mut commands: Commands,
    files: Res<Assets<LeafcloudFile>>,
    trees: Query<(Entity, &LeafcloudTree), Without<Planted>>,
) {
    for (entity, tree) in &trees {
        let Some(file) = files.get(&tree.file).filter(|file| file.is_ready) else {
            continue;
        };
        if tree.number >= file.trees.len() {
            error!("The file has {} trees, so there is no tree of number {}.", file.trees.len(), tree.number);
        }
        commands.entity(entity).insert(Planted).with_children(|parent| {
            for level in file.trees.get(tree.number).into_iter().flatten() {
                for part in &level.parts {
                    let mut child = parent.spawn(drawn(level, part));
                    if level.transition.is_some() {
                        // Also the trunk's: its mesh has a target with all corners in place.
                        child.insert(MeshMorphWeights::Value { weights: vec![0.0] });
                    }
                }
            }
        });
    }
}

fn drawn(level: &Level, part: &Part) -> impl Bundle {
    let laws = LevelPart {
        level: level.number,
        transition: level.transition.clone(),
        fade_in: level.fade_in.clone(),
        fade_out: level.fade_out.clone(),
    };
    (
        Name::new(format!("LOD{}", level.number)),
        laws.visibility(1.0),
        laws,
        level.place,
        Mesh3d(part.mesh.clone()),
        MeshMaterial3d(part.material.clone()),
        // The mesh's own bounds do not hold the leaves that slide.
        (Aabb::from_min_max(-level.half_box, level.half_box), NoAutoAabb),
    )
}

/// A part of a level, as [`follow`] sees it.
#[derive(QueryData)]
#[query_data(mutable)]
pub(crate) struct Follower {
    part: &'static LevelPart,
    place: &'static GlobalTransform,
    visibility: &'static mut VisibilityRange,
    bounds: &'static mut Aabb,
    morph: Option<&'static mut MeshMorphWeights>,
}

/// Sets visibility ranges and morph weights for the first active camera.
pub(crate) fn follow(
    cameras: Query<(&Camera, &Projection, &GlobalTransform), With<Camera3d>>,
    trees: Query<(&LeafcloudTree, &GlobalTransform, &Children), With<Planted>>,
    mut parts: Query<Follower>,
) {
    let active = cameras.iter().filter(|(camera, ..)| camera.is_active);
    let Some((camera, projection, eye)) = active.min_by_key(|(camera, ..)| camera.order) else {
        return;
    };
    let of_view = factor_of(camera, projection);
    for (tree, place, children) in &trees {
        let staggered = stagger_at(place.translation().to_array(), tree.stagger);
        let factor = stepped(of_view * tree.lod_distance * scale_of(place) * staggered);
        let mut followers = parts.iter_many_mut(children);
        while let Some(mut follower) = followers.fetch_next() {
            follower.visibility.set_if_neq(follower.part.visibility(factor));
            let distance = eye.translation().distance(follower.place.translation()) / factor;
            let is_drawn = (follower.part.fade_in.start..follower.part.fade_out.end).contains(&distance);
            if let (Some(transition), Some(morph), true) = (&follower.part.transition, &mut follower.morph, is_drawn) {
                **morph = MeshMorphWeights::Value { weights: vec![transition_at(distance, transition)] };
                // Bevy 0.19 prepares a mesh that comes into view before its morph targets, and looks at it again only after a change:
                // without one the leaves would never slide.
                follower.bounds.set_changed();
            }
        }
    }
}

/// Returns the factor on the file's distances for a view. Other projections than perspective keep the file's distances.
fn factor_of(camera: &Camera, projection: &Projection) -> f32 {
    match (projection, camera.physical_viewport_size()) {
        (Projection::Perspective(view), Some(size)) => view_factor(view.fov, size.y as f32),
        _ => 1.0,
    }
}

fn scale_of(place: &GlobalTransform) -> f32 {
    place.affine().matrix3.determinant().abs().cbrt()
}
