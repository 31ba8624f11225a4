"""Placed trees: each copy of one object shows the level for its own place, as the levels of the baked tree would."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from kept_scenes import open_scene
from mathutils import Matrix, Vector

from addon.levels.placed_tree import placed_tree as object_of
from addon.levels.placed_tree import tree_group
from addon.levels.planting import width_of
from addon.levels.root import root_of
from addon.mesh.baked_levels import level_number
from addon.nodes.laws import LOD_DISTANCE, STAGGER
from addon.versions import get_modifier_input, set_modifier_input, source_of_input

pytestmark = pytest.mark.usefixtures("registered")

RADII = (1.0, 100.0, 132.0, 150.0, 165.0, 190.0, 210.0, 400.0)
"""Distances of the camera in radii of the tree. Level 1 takes over at 128, level 2 at 160, the cross at 200."""


@pytest.fixture
def baked(registered: None, shrub: Path) -> bpy.types.Collection:
    """Return the collection of a tree that was baked with all levels; a camera looks along −X."""
    open_scene("placed trees", lambda: bake(shrub))
    return bpy.data.collections["leaves"]


def bake(shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.pixels = 64, 2, 0.1, 8.0
    settings.last, settings.every_level = "cross", True
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def placed_tree(collection: bpy.types.Collection, stagger: float = 0.0) -> bpy.types.Object:
    placed = object_of(collection.name, tree_group(collection))
    set_modifier_input(placed.modifiers[0], STAGGER, stagger)
    return placed


def link(obj: bpy.types.Object) -> bpy.types.Object:
    bpy.context.scene.collection.objects.link(obj)
    return obj


def root(collection: bpy.types.Collection) -> bpy.types.Object:
    found = root_of(collection)
    assert found is not None
    return found


def centre_and_radius(collection: bpy.types.Collection) -> tuple[Vector, float]:
    leaves = next(obj for obj in collection.objects if level_number(obj) == 0)
    return Vector(get_modifier_input(leaves.modifiers["Leafcloud LOD"], "Centre")), leaves["leafcloud"]["radius"]


def look_from(collection: bpy.types.Collection, radii: float) -> None:
    """Put the camera beside the tree at the world's origin."""
    centre, radius = centre_and_radius(collection)
    bpy.context.scene.camera.location = centre + Vector((radii * radius, 0.0, 0.0))


def drawn_points(*objects: bpy.types.Object) -> np.ndarray:
    """Return the world positions (n, 3) of all corners that the objects draw, sorted."""
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    found = [np.empty((0, 3))]
    for obj in objects:
        shown = obj.evaluated_get(graph)
        mesh = shown.to_mesh()
        points = np.empty((len(mesh.vertices), 3))
        mesh.vertices.foreach_get("co", points.ravel())
        corners = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        world = np.array(shown.matrix_world)
        found.append(points[corners] @ world[:3, :3].T + world[:3, 3])
        shown.to_mesh_clear()
    points = np.concatenate(found)
    return points[np.lexsort(np.round(points, 4).T)]


def levels(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    return [obj for obj in root(collection).children_recursive if obj.type == "MESH"]


@pytest.mark.parametrize("radii", RADII)
def test_a_placed_tree_draws_what_the_levels_draw(baked: bpy.types.Collection, radii: float) -> None:
    placed = link(placed_tree(baked))
    look_from(baked, radii)
    expected = drawn_points(*levels(baked))
    assert len(expected)
    np.testing.assert_allclose(drawn_points(placed), expected, atol=1e-5)


def test_each_copy_shows_the_level_for_its_own_place(baked: bpy.types.Collection) -> None:
    look_from(baked, 1.0)
    _, radius = centre_and_radius(baked)
    first = link(placed_tree(baked))
    copies = [link(first.copy()) for _ in RADII]
    counts = []
    for copy, radii in zip(copies, RADII, strict=True):
        copy.location.x = -radii * radius
        moved = root(baked)
        moved.location = copy.location
        expected = drawn_points(*levels(baked))
        np.testing.assert_allclose(drawn_points(copy), expected, atol=1e-4 * radii)
        counts.append(len(expected))
    assert len(set(counts)) == 7, "the leaves morph from 64 radii on, and no two levels are alike"
    assert len({copy.data for copy in copies}) == 1


def test_turned_and_scaled_copies_switch_in_proportion(baked: bpy.types.Collection) -> None:
    place = Matrix.Translation((4.0, 2.0, 1.0)) @ Matrix.Rotation(2.0, 4, "Z") @ Matrix.Scale(3.0, 4)
    placed = link(placed_tree(baked))
    placed.matrix_world = root(baked).matrix_world = place
    for radii in RADII:
        look_from(baked, 3.0 * radii)
        np.testing.assert_allclose(drawn_points(placed), drawn_points(*levels(baked)), atol=1e-4)


def test_one_distance_moves_all_levels(baked: bpy.types.Collection) -> None:
    """At twice the distance from a tree of LOD Distance 2 the same is drawn."""
    placed = link(placed_tree(baked))
    for radii in RADII:
        root(baked)[LOD_DISTANCE] = 1.0
        set_modifier_input(placed.modifiers[0], LOD_DISTANCE, 1.0)
        root(baked).update_tag()
        look_from(baked, radii)
        near = drawn_points(*levels(baked))
        root(baked)[LOD_DISTANCE] = 2.0
        set_modifier_input(placed.modifiers[0], LOD_DISTANCE, 2.0)
        root(baked).update_tag()
        look_from(baked, 2.0 * radii)
        np.testing.assert_allclose(drawn_points(*levels(baked)), near, atol=1e-5)
        np.testing.assert_allclose(drawn_points(placed), near, atol=1e-5)


def test_a_copy_of_the_levels_has_a_distance_of_its_own(baked: bpy.types.Collection) -> None:
    look_from(baked, 150.0)
    bpy.ops.object.duplicate(linked=True)
    copy = bpy.context.view_layer.objects.active
    before = drawn_points(*levels(baked))
    copy[LOD_DISTANCE] = 1000.0
    copy.update_tag()
    copied = [obj for obj in copy.children_recursive if obj.type == "MESH"]
    assert len(drawn_points(*copied)) > len(before)
    np.testing.assert_allclose(drawn_points(*levels(baked)), before)


@pytest.mark.parametrize(("turns", "wave"), [(0.0, 0.0), (0.25, 1.0), (0.75, -1.0), (1.125, 0.5)])
def test_neighbors_switch_at_other_distances(baked: bpy.types.Collection, turns: float, wave: float) -> None:
    """A place of so many turns has the wave w: the tree is as at the distance d / (1 + 0.1·w) without stagger."""
    _, radius = centre_and_radius(baked)
    usual = get_modifier_input(object_of("usual", tree_group(baked)).modifiers[0], STAGGER)
    assert usual == pytest.approx(0.1)
    placed, plain = link(placed_tree(baked, usual)), link(placed_tree(baked))
    placed.location.y = plain.location.y = turns / 0.5698
    for radii in RADII:
        look_from(baked, (1.0 + 0.1 * wave) * radii)
        bpy.context.scene.camera.location.y += placed.location.y
        found = drawn_points(placed)
        look_from(baked, radii)
        bpy.context.scene.camera.location.y += placed.location.y
        np.testing.assert_allclose(found, drawn_points(plain), atol=1e-3 * radius)


def test_a_chosen_level_is_drawn_at_any_distance(baked: bpy.types.Collection) -> None:
    placed = link(placed_tree(baked))
    for radii in (1.0, 400.0):
        look_from(baked, radii)
        for number in range(4):
            set_modifier_input(placed.modifiers[0], "Level", number)
            level = next(obj for obj in baked.objects if level_number(obj) == number)
            trunk = [child.data for child in level.children if child.type == "MESH"]
            corners = sum(len(mesh.loops) for mesh in (level.data, *trunk))
            assert len(drawn_points(placed)) == corners


def test_fading_levels_have_their_fading_materials(baked: bpy.types.Collection) -> None:
    placed = link(placed_tree(baked))
    own = {slot.material.name for obj in baked.objects for slot in obj.material_slots if slot.link == "OBJECT"}
    shown = set()
    for radii in RADII:
        look_from(baked, radii)
        bpy.context.view_layer.update()
        mesh = placed.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        shown |= {material.name for material in mesh.materials if material is not None}
    assert own <= shown
    assert any(name.endswith("_fading") for name in own)


def test_a_placed_tree_sways_as_the_levels_do(registered: None, shrub: Path) -> None:
    """Also where the force field changes: it drives the strength."""
    bpy.ops.object.effector_add(type="WIND")
    field = bpy.context.object
    bpy.context.scene.leafcloud.effect_wind = "ON"
    bake(shrub)
    tree = bpy.data.collections["leaves"]
    placed = link(placed_tree(tree))
    bpy.context.scene.frame_set(7)
    for strength, radii, x in ((0.0, 1.0, 0.0), (5.0, 1.0, 0.0), (5.0, 1.0, 3.0), (2.0, 132.0, 3.0)):
        field.field.strength = strength
        placed.location.x = root(tree).location.x = x
        look_from(tree, radii)
        np.testing.assert_allclose(drawn_points(placed), drawn_points(*levels(tree)), atol=1e-5)
    placed.location.x = 0.0
    still = drawn_points(placed)
    field.field.strength = 0.0
    assert np.abs(drawn_points(placed) - still).max() > 1e-3


def test_an_appended_asset_brings_no_levels(baked: bpy.types.Collection, tmp_path: Path) -> None:
    assert bpy.ops.leafcloud.asset() == {"FINISHED"}
    [asset] = [obj for obj in bpy.data.objects if obj.asset_data is not None]
    look_from(baked, 150.0)
    expected = drawn_points(*levels(baked))
    place = tuple(bpy.context.scene.camera.location)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    name = asset.name
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend")) as (_, into):
        into.objects = [name]
    placed = link(bpy.data.objects[name])
    camera = link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    camera.location, bpy.context.scene.camera = place, camera
    np.testing.assert_allclose(drawn_points(placed), expected, atol=1e-5)
    assert not [obj.name for obj in bpy.data.objects if root_of_level(obj)]
    assert not bpy.data.collections.get("leaves")


def root_of_level(obj: bpy.types.Object) -> bool:
    return level_number(obj) is not None or obj.type == "EMPTY"


def test_collection_instances_show_their_own_levels(baked: bpy.types.Collection) -> None:
    """Blender draws the level for the original's place. The operator draws a placed tree in place of each instance."""
    _, radius = centre_and_radius(baked)
    look_from(baked, 1.0)
    baked.instance_offset = (0.5, 0.0, 0.0)
    bpy.ops.object.select_all(action="DESELECT")
    instances = []
    for radii in RADII:
        empty = link(bpy.data.objects.new(f"at {radii}", None))
        empty.instance_type, empty.instance_collection = "COLLECTION", baked
        empty.location.x = 0.5 - radii * radius
        empty.select_set(True)
        instances.append(empty)
    assert bpy.ops.leafcloud.place_instances() == {"FINISHED"}
    for radii in RADII:
        root(baked).location.x = -radii * radius
        shown = bpy.data.objects[f"at {radii}"]
        set_modifier_input(shown.modifiers[0], STAGGER, 0.0)
        shown.update_tag()
        np.testing.assert_allclose(drawn_points(shown), drawn_points(*levels(baked)), atol=1e-4 * radii)
        assert shown.select_get()


def test_a_placed_instance_keeps_parent_children_and_animation(baked: bpy.types.Collection) -> None:
    look_from(baked, 1.0)
    hill = link(bpy.data.objects.new("hill", None))
    hill.location.z = 2.0
    for name in ("still", "moving"):
        empty = link(bpy.data.objects.new(name, None))
        empty.instance_type, empty.instance_collection, empty.parent = "COLLECTION", baked, hill
        empty.rotation_euler.z = 1.0
        nest = link(bpy.data.objects.new(f"nest of {name}", None))
        nest.parent = empty
        empty.select_set(True)
    empty.keyframe_insert("location", frame=1)
    bpy.ops.leafcloud.place_instances()
    expected = Matrix.Translation((0.0, 0.0, 2.0)) @ Matrix.Rotation(1.0, 4, "Z")
    bpy.context.view_layer.update()
    still, moving = bpy.data.objects["still"], bpy.data.objects["moving"]
    [below] = [child for child in moving.children if child.type == "MESH"]
    for shown in (still, below):
        np.testing.assert_allclose(np.array(shown.matrix_world), np.array(expected), atol=1e-6)
    assert moving.instance_type == "NONE"
    assert bpy.data.objects["nest of still"].parent == still
    assert len(drawn_points(still)) == len(drawn_points(below)) > 0


def test_placed_trees_follow_a_new_bake_and_survive_a_removal(baked: bpy.types.Collection) -> None:
    assert bpy.ops.leafcloud.place() == {"FINISHED"}
    placed = bpy.context.view_layer.objects.active
    placed.matrix_world = root(baked).matrix_world
    look_from(baked, 150.0)
    root(baked).select_set(True)
    bpy.context.view_layer.objects.active = root(baked)
    placed.select_set(False)
    bpy.context.scene.leafcloud.epsilon = 0.15
    before = len(drawn_points(placed))
    objects = len(bpy.data.objects)
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert len(bpy.data.objects) == objects
    again = bpy.data.collections["leaves"]
    expected = drawn_points(*levels(again))
    assert len(expected) != before
    np.testing.assert_allclose(drawn_points(placed), expected, atol=1e-5)
    assert bpy.ops.leafcloud.remove() == {"FINISHED"}
    np.testing.assert_allclose(drawn_points(placed), expected, atol=1e-5)


def test_a_placed_tree_is_not_baked_again(baked: bpy.types.Collection) -> None:
    bpy.ops.leafcloud.place()
    with pytest.raises(RuntimeError, match="baked"):
        bpy.ops.leafcloud.bake()


def test_a_deleted_root_leaves_the_levels_as_they_are(baked: bpy.types.Collection) -> None:
    """The drivers of LOD Distance lose their source, and give 0."""
    look_from(baked, 1.0)
    shown = levels(baked)
    before = drawn_points(*shown)
    bpy.data.objects.remove(root(baked))
    np.testing.assert_allclose(drawn_points(*shown), before)
    assert len(drawn_points(link(placed_tree(baked)))) == len(before)


def test_instances_of_several_trees_stay_as_they_are(baked: bpy.types.Collection) -> None:
    """A placed tree shows one tree."""
    above = bpy.data.collections.new("set")
    above.children.link(baked)
    above["leafcloud_bake"] = baked["leafcloud_bake"]
    empty = link(bpy.data.objects.new("set", None))
    empty.instance_type, empty.instance_collection = "COLLECTION", above
    bpy.ops.object.select_all(action="DESELECT")
    empty.select_set(True)
    assert not bpy.ops.leafcloud.place_instances.poll()


def test_instances_with_data_of_their_own_keep_it(baked: bpy.types.Collection) -> None:
    empty = link(bpy.data.objects.new("kept", None))
    empty.instance_type, empty.instance_collection = "COLLECTION", baked
    empty.constraints.new("COPY_LOCATION")
    empty["mine"], empty.hide_render = 3, True
    bpy.ops.object.select_all(action="DESELECT")
    empty.select_set(True)
    assert bpy.ops.leafcloud.place_instances() == {"FINISHED"}
    [shown] = empty.children
    assert (shown.hide_render, empty["mine"], len(empty.constraints)) == (True, 3, 1)


def test_new_bakes_of_a_placed_tree_leave_nothing_behind(baked: bpy.types.Collection) -> None:
    kinds = ("objects", "meshes", "materials", "images", "collections", "node_groups")

    def names() -> dict[str, set[str]]:
        return {kind: {block.name for block in getattr(bpy.data, kind)} for kind in kinds}

    bpy.ops.leafcloud.place()
    bpy.context.view_layer.objects.active.select_set(False)
    root(baked).select_set(True)
    bpy.context.view_layer.objects.active = root(baked)
    before = names()
    for _ in range(2):
        assert bpy.ops.leafcloud.bake() == {"FINISHED"}
        assert names() == before


def test_other_modifiers_on_a_level_or_below_the_root_do_no_harm(baked: bpy.types.Collection) -> None:
    child = link(bpy.data.objects.new("nest", bpy.data.meshes.new("nest")))
    child.parent = root(baked)
    child.modifiers.new("empty", "NODES").node_group = None
    levels(baked)[0].modifiers.new("empty", "NODES").node_group = None
    assert len(drawn_points(link(placed_tree(baked)))) > 0
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert child.parent == root(bpy.data.collections["leaves"])


def test_a_placed_tree_below_the_root_does_not_stop_a_new_bake(baked: bpy.types.Collection) -> None:
    placed = link(placed_tree(baked))
    placed.parent = root(baked)
    bpy.context.view_layer.objects.active = root(baked)
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert placed.parent == root(bpy.data.collections["leaves"])
    assert source_of_input(placed.modifiers[0], LOD_DISTANCE) is None


def test_a_level_beyond_the_last_is_the_last(baked: bpy.types.Collection) -> None:
    placed = link(placed_tree(baked))
    set_modifier_input(placed.modifiers[0], "Level", 3)
    last = drawn_points(placed)
    set_modifier_input(placed.modifiers[0], "Level", 9)
    np.testing.assert_array_equal(drawn_points(placed), last)
    assert len(last)


def test_a_copy_of_the_collection_has_placed_trees_of_its_own(baked: bpy.types.Collection) -> None:
    placed = link(placed_tree(baked))
    look_from(baked, 1.0)
    before = len(drawn_points(placed))
    copy = baked.copy()
    bpy.context.scene.collection.children.link(copy)
    assert tree_group(copy) != placed.modifiers[0].node_group
    assert len(drawn_points(placed)) == before


def test_a_second_mark_is_the_same_asset(baked: bpy.types.Collection) -> None:
    for _ in range(2):
        assert bpy.ops.leafcloud.asset() == {"FINISHED"}
    assert len([obj for obj in bpy.data.objects if obj.asset_data is not None]) == 1


@pytest.mark.night
def test_a_scene_of_many_trees_draws_placed_trees_too(baked: bpy.types.Collection) -> None:
    bpy.context.scene.leafcloud.chain = "both"
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    baked = bpy.data.collections["leaves"]
    for x in (10.0, 20.0):
        link(placed_tree(baked)).location.x = x
    bpy.context.view_layer.update()
    bpy.context.scene.leafcloud_scene.budget = 0
    assert bpy.ops.leafcloud.scene() == {"FINISHED"}
    leaves = next(obj for obj in baked.objects if level_number(obj) == 0)
    xs = drawn_points(bpy.data.objects["Leafcloud Scene"])[:, 0]
    assert len([obj for obj in bpy.context.scene.objects if obj.visible_get() and obj.type == "MESH"]) == 1
    trees = [((xs > x - 5.0) & (xs < x + 5.0)).sum() for x in (0.0, 10.0, 20.0)]
    assert min(trees) > 0.9 * len(leaves.data.loops)


def test_a_copy_stands_beside_the_tree_under_a_name_of_its_own(baked: bpy.types.Collection) -> None:
    bpy.ops.leafcloud.place()
    first = bpy.context.view_layer.objects.active
    root(baked).select_set(True)
    bpy.context.view_layer.objects.active = root(baked)
    bpy.ops.leafcloud.place()
    second = bpy.context.view_layer.objects.active
    assert (first.name, second.name) == ("leaves copy", "leaves copy.001")
    width = width_of(baked)
    for obj, widths in ((first, 1.25), (second, 2.5)):
        away = obj.location - root(baked).matrix_world.translation
        np.testing.assert_allclose(away, (widths * width, 0.0, 0.0), atol=1e-5)


def test_a_copy_shows_one_level_at_all_distances(baked: bpy.types.Collection) -> None:
    look_from(baked, 1.0)
    placed = link(placed_tree(baked))
    whole = len(drawn_points(placed))
    placed.select_set(True)
    assert bpy.ops.leafcloud.show_placed_level(level=2) == {"FINISHED"}
    assert 0 < len(drawn_points(placed)) < whole
    bpy.ops.leafcloud.show_placed_level(level=-1)
    assert len(drawn_points(placed)) == whole
