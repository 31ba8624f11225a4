"""The root of a baked tree: its levels move with it, files do not have it, and a new bake keeps its place."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from kept_scenes import open_scene
from mathutils import Matrix

from addon.levels.root import is_root, root_of
from addon.mesh.baked_levels import level_number

pytestmark = pytest.mark.usefixtures("registered")

MOVE = Matrix.Translation((5.0, -2.0, 1.0)) @ Matrix.Rotation(0.7, 4, "Z") @ Matrix.Scale(1.5, 4)


@pytest.fixture
def baked(shrub: Path) -> bpy.types.Collection:
    """Return the collection of a baked tree."""
    open_scene("root", lambda: bake(shrub))
    return bpy.data.collections["leaves"]


def bake(shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.data.objects["leaves"].matrix_world = Matrix.Translation((1.0, 2.0, 3.0)) @ Matrix.Rotation(0.3, 4, "X")
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.quality = 64, 1, 0.2, 0.1
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}


def root(collection: bpy.types.Collection) -> bpy.types.Object:
    found = root_of(collection)
    assert found is not None
    return found


def places(collection: bpy.types.Collection) -> dict[str, np.ndarray]:
    bpy.context.view_layer.update()
    return {obj.name: np.array(obj.matrix_world) for obj in collection.objects if obj.type == "MESH"}


def test_the_root_is_selected_with_all_levels_below_it(baked: bpy.types.Collection) -> None:
    above = root(baked)
    assert above == bpy.context.view_layer.objects.active
    assert set(bpy.context.selected_objects) == set(baked.objects)
    assert set(baked.objects) == {above, *above.children_recursive}
    assert {obj.parent for obj in baked.objects if level_number(obj) is not None} == {above}


def test_the_levels_have_the_place_of_the_leaves(baked: bpy.types.Collection) -> None:
    own = np.array(bpy.data.objects["leaves"].matrix_world)
    for place in places(baked).values():
        np.testing.assert_allclose(place, own, atol=1e-6)


def test_the_levels_move_with_the_root(baked: bpy.types.Collection) -> None:
    before = places(baked)
    root(baked).matrix_world = MOVE @ root(baked).matrix_world
    for name, place in places(baked).items():
        np.testing.assert_allclose(place, np.array(MOVE) @ before[name], atol=1e-5)


def test_a_new_bake_keeps_the_place_that_an_artist_gave_the_root(baked: bpy.types.Collection) -> None:
    parent = bpy.data.objects.new("hill", None)
    bpy.context.scene.collection.objects.link(parent)
    root(baked).parent = parent
    root(baked).matrix_world = MOVE @ root(baked).matrix_world
    moved = places(baked)
    bpy.ops.leafcloud.bake()
    again = bpy.data.collections["leaves"]
    assert root(again).parent == parent
    for name, place in places(again).items():
        np.testing.assert_allclose(place, moved[name], atol=1e-5)
    bpy.data.objects["leaves"].location.z += 2.0
    bpy.ops.leafcloud.bake()
    shift = np.array(MOVE.to_3x3()) @ (0.0, 0.0, 2.0)
    for name, place in places(bpy.data.collections["leaves"]).items():
        np.testing.assert_allclose(place[:3, 3], moved[name][:3, 3] + shift, atol=1e-4)


def test_files_have_the_levels_without_the_root(baked: bpy.types.Collection, tmp_path: Path) -> None:
    settings = bpy.context.scene.leafcloud
    settings.directory, settings.files = str(tmp_path), "levels"
    bpy.ops.leafcloud.bake()
    here = places(bpy.data.collections["leaves"])
    assert {obj.parent for obj in bpy.data.collections["leaves"].objects if level_number(obj) is not None} == {
        root(bpy.data.collections["leaves"])
    }
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "leaves_LOD1.glb"))
    assert not any(map(is_root, bpy.data.objects))
    level = bpy.data.objects["leaves_LOD1"]
    assert level.parent is None
    np.testing.assert_allclose(np.array(level.matrix_world), here["leaves_LOD1"], atol=1e-5)


def test_files_for_an_engine_have_the_tree_at_the_origin(baked: bpy.types.Collection, tmp_path: Path) -> None:
    settings = bpy.context.scene.leafcloud
    settings.directory, settings.engine = str(tmp_path), "three"
    bpy.ops.leafcloud.bake()
    turn = places(bpy.data.collections["leaves"])["leaves_LOD0"][:3, :3]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "leaves.glb"))
    place = np.array(bpy.data.objects["leaves_LOD0"].matrix_world)
    np.testing.assert_allclose(place[:3, 3], 0.0, atol=1e-6)
    np.testing.assert_allclose(place[:3, :3], turn, atol=1e-5)


def test_copies_of_a_tree_move_on_their_own(baked: bpy.types.Collection) -> None:
    before = places(baked)
    bpy.ops.object.duplicate(linked=True)
    copy = bpy.context.view_layer.objects.active
    assert is_root(copy)
    assert copy != root(baked)
    assert len(copy.children_recursive) == len(root(baked).children_recursive)
    copy.location.x += 10.0
    for name, place in before.items():
        np.testing.assert_allclose(places(baked)[name], place)
    assert all(obj.data in {each.data for each in baked.objects} for obj in copy.children)


def test_a_new_bake_keeps_animation_and_children_of_the_root(baked: bpy.types.Collection) -> None:
    above = root(baked)
    above.keyframe_insert("location", frame=1)
    nest = bpy.data.objects.new("nest", None)
    bpy.context.scene.collection.objects.link(nest)
    nest.parent = above
    bpy.ops.leafcloud.bake()
    again = root(bpy.data.collections["leaves"])
    assert again.name == "leaves_tree"
    assert again.animation_data is not None
    assert nest.parent == again


def test_a_new_bake_beside_copies_has_the_names_of_the_first(baked: bpy.types.Collection, tmp_path: Path) -> None:
    names = {obj.name for obj in baked.objects}
    bpy.ops.object.duplicate(linked=True)
    copies = set(bpy.context.selected_objects)
    bpy.context.scene.leafcloud.directory = str(tmp_path)
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}, "a copy stands for its tree"
    again = bpy.data.collections["leaves"]
    assert {obj.name for obj in again.objects if obj not in copies} == names
    assert all(
        obj.data.name == obj.name for obj in again.objects if obj not in copies and level_number(obj) is not None
    )
