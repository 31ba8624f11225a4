"""The operators that make a scene or a forest of baked trees: instances, refusals, cleanup."""

from __future__ import annotations

import math
import re

import bpy
import numpy as np
import pytest
from lod_scenes import add_camera, evaluate, place
from scenes import add_mesh, bake, read

import leafcloud
from addon.bake.values import Baked
from addon.levels.baked_trees import baked_tree
from addon.levels.planting import width_of
from addon.levels.root import root_of
from addon.nodes.scene import SceneSettings
from addon.settings.bake import BakeSettings
from addon.versions import get_modifier_input

pytestmark = pytest.mark.usefixtures("registered")

LEAVES, SIDE = 60, 0.1


def baked_crown(name: str = "tree", chain: str = "both", *, trunk: bool = True) -> Baked:
    """Bake square leaves with sides of 0.1 in a ball of radius 1, on a trunk. Remove the sources."""
    rng = np.random.default_rng(3)
    corners = SIDE * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    turns = np.linalg.qr(rng.normal(size=(LEAVES, 3, 3)))[0]
    places = rng.uniform(-0.6, 0.6, size=(LEAVES, 1, 3)) + corners @ turns
    faces = [tuple(range(i, i + 4)) for i in range(0, 4 * LEAVES, 4)]
    sources = [add_mesh(f"{name} leaves", places.reshape(-1, 3).tolist(), faces)]
    if trunk:
        trunk = [(0.05 * x, 0.05 * y, z) for z in (-2.0, 0.0) for x, y in ((1, 0), (-1, 1), (-1, -1))]
        sources.append(add_mesh(f"{name} trunk", trunk, [(0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)]))
    settings = BakeSettings(
        chain=chain,
        levels=1,
        texture_size=64,
        quality=0.1,
        epsilon=0.1,
        prune_pixels=60.0,
        effects="transitions,pruning",
    )
    result = bake(read(sources, [sources[0].name]), settings)
    for source in sources:
        bpy.data.objects.remove(source)
    return result


def grid(count: int, step: float) -> bpy.types.Object:
    """Add points in a row along x, starting at the origin."""
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([(step * i, 0.0, 0.0) for i in range(count)], [], [])
    return place(mesh, "Points")


def drawn(obj: bpy.types.Object) -> list[str]:
    """Return the instances of `obj` without trunks."""
    graph = bpy.context.evaluated_depsgraph_get()
    instances = (each for each in graph.object_instances if each.is_instance and each.parent.original == obj)
    names = [each.object.original.name for each in instances]
    return [name for name in names if not name.endswith("trunk")]


def counts() -> dict[str, int]:
    kinds = ("objects", "meshes", "materials", "images", "collections", "node_groups")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def triangles(mesh: bpy.types.Mesh) -> int:
    return len(mesh.loops) - 2 * len(mesh.polygons)


# A scene of many trees


def test_all_visible_trees_make_a_scene_and_their_own_objects_are_hidden() -> None:
    baked = baked_crown()
    leaves, trunk = baked.levels[0].object, baked.levels[0].trunk
    assert trunk is not None
    bpy.context.scene.leafcloud_scene.budget = 0
    assert bpy.ops.leafcloud.scene() == {"FINISHED"}
    obj = bpy.data.objects["Leafcloud Scene"]
    assert [each for each in bpy.context.view_layer.objects if each.visible_get()] == [obj]
    assert all(each.hide_render for each in baked.collection.objects)
    assert triangles(evaluate(obj)) == triangles(leaves.data) + triangles(trunk.data)
    [modifier] = obj.modifiers
    assert get_modifier_input(modifier, "Centre") == get_modifier_input(leaves.modifiers[0], "Centre")
    for name in ("Prune Start", "Prune Half", "Growth", "Growth Quadratic", "Contrast", "Contrast Quadratic"):
        assert get_modifier_input(modifier, name) == get_modifier_input(leaves.modifiers[0], name)


def test_a_changed_budget_builds_the_scene_again() -> None:
    """The first scene hides its trees, and the second one finds them all the same, and replaces the first."""
    baked_crown()
    settings = bpy.context.scene.leafcloud_scene
    settings.budget = 0
    bpy.ops.leafcloud.scene()
    whole = triangles(evaluate(bpy.data.objects["Leafcloud Scene"]))
    before = {kind: len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "collections", "node_groups")}
    settings.budget = whole - 10
    assert bpy.ops.leafcloud.scene() == {"FINISHED"}
    assert {kind: len(getattr(bpy.data, kind)) for kind in before} == before
    assert [obj.name for obj in bpy.context.view_layer.objects if obj.visible_get()] == ["Leafcloud Scene"]
    add_camera((0.0, 0.0, 3.0))
    assert triangles(evaluate(bpy.data.objects["Leafcloud Scene"])) <= whole - 10


def test_scenes_of_other_trees_stay() -> None:
    first, second = baked_crown("one"), baked_crown("two")
    settings = bpy.context.scene.leafcloud_scene
    for baked in (first, second):
        settings.trees = baked.collection
        bpy.ops.leafcloud.scene()
    visible = [obj.name for obj in bpy.context.view_layer.objects if obj.visible_get()]
    assert sorted(visible) == ["Leafcloud Scene", "Leafcloud Scene.001"]
    settings.trees = None
    bpy.ops.leafcloud.scene()
    assert [obj.name for obj in bpy.context.view_layer.objects if obj.visible_get()] == ["Leafcloud Scene"]


def test_the_settings_of_a_scene_start_as_those_of_the_node_group() -> None:
    wanted, usual = bpy.context.scene.leafcloud_scene, SceneSettings()
    assert (wanted.full_models, wanted.far, wanted.strength) == (usual.full_models, usual.far, usual.strength)
    assert wanted.budget == 1_000_000


def test_copies_and_instances_of_a_tree_stand_where_they_stood() -> None:
    baked = baked_crown(trunk=False)
    leaves = baked.levels[0].object
    copy = leaves.copy()
    copy.location.x += 10.0
    bpy.context.scene.collection.objects.link(copy)
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", baked.collection
    instance.location = (0.0, 20.0, 0.0)
    bpy.context.scene.collection.objects.link(instance)
    bpy.context.view_layer.update()
    bpy.context.scene.leafcloud_scene.budget = 0
    bpy.ops.leafcloud.scene()
    mesh = evaluate(bpy.data.objects["Leafcloud Scene"])
    points = np.array([vertex.co for vertex in mesh.vertices]).reshape(3, -1, 3)
    own = np.array([leaves.matrix_world @ vertex.co for vertex in leaves.data.vertices])
    found = sorted(tuple(offset) for offset in (points - own).mean(axis=1).round(4).tolist())
    assert found == [(0.0, 0.0, 0.0), (0.0, 20.0, 0.0), (10.0, 0.0, 0.0)]
    assert not instance.visible_get()
    assert not copy.visible_get()


def test_the_budget_holds_for_the_trees_of_a_chosen_collection() -> None:
    baked_crown("far", trunk=False)
    chosen = baked_crown("near", trunk=False)
    settings = bpy.context.scene.leafcloud_scene
    settings.trees, settings.budget = chosen.collection, 30
    add_camera((0.0, 0.0, 3.0))
    bpy.ops.leafcloud.scene()
    assert 27 < triangles(evaluate(bpy.data.objects["Leafcloud Scene"])) <= 30
    assert bpy.data.objects["tree_LOD0"].visible_get()
    assert not chosen.levels[0].object.visible_get()


def test_trees_baked_without_pruning_are_pruned_once_leaves_are_small() -> None:
    baked_crown(chain="billboards", trunk=False)
    bpy.context.scene.leafcloud.prune_pixels = 16.0
    bpy.ops.leafcloud.scene()
    [modifier] = bpy.data.objects["Leafcloud Scene"].modifiers
    expected = leafcloud.switch_distance(SIDE, 16.0, 1080.0, math.radians(50.0))
    assert get_modifier_input(modifier, "Prune Start") == pytest.approx(expected, rel=1e-4)


def test_trunk_does_not_count_as_a_tree_of_its_own() -> None:
    baked_crown(trunk=True)
    bpy.context.scene.leafcloud_scene.full_models = 4.0
    bpy.ops.leafcloud.scene()
    [modifier] = bpy.data.objects["Leafcloud Scene"].modifiers
    assert get_modifier_input(modifier, "Full Models") == 8.0


def test_a_scene_without_baked_trees_is_refused() -> None:
    add_mesh("leaves", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])["leafcloud"] = "something else"
    assert not bpy.ops.leafcloud.scene.poll()
    with pytest.raises(RuntimeError, match="No baked tree is visible"):
        bpy.ops.leafcloud.scene()


def test_leaves_without_ranks_are_refused_and_nothing_is_left() -> None:
    baked = baked_crown(trunk=False)
    leaves = baked.levels[0].object
    leaves.data.attributes.remove(leaves.data.attributes["leaf_rank"])
    before = counts()
    with pytest.raises(RuntimeError, match="has no leaf_rank: bake it with the chain Both or Pruning"):
        bpy.ops.leafcloud.scene()
    assert counts() == before
    assert leaves.visible_get()


# A forest


def test_the_only_tree_is_planted_on_the_active_object() -> None:
    baked = baked_crown()
    points = grid(2, 100.0 * baked.switch_distances[-1])
    bpy.context.view_layer.objects.active = points
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    add_camera((0.0, 0.0, 0.0))
    names = drawn(points)
    variants = sorted(collection.name for collection in bpy.data.collections if "_forest_" in collection.name)
    assert names == [variants[0], variants[-1]]
    assert len(bpy.data.objects[names[0]].data.polygons) == len(baked.levels[0].object.data.polygons)
    assert baked.levels[0].object.visible_get()


def test_a_forest_has_pruned_variants_where_the_tree_was_baked_to_be_pruned() -> None:
    def distances(chain: str) -> tuple[Baked, list[float]]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        baked, points = baked_crown(chain=chain), grid(3, 1.0)
        bpy.context.view_layer.objects.active = points
        bpy.ops.leafcloud.forest()
        modifier = points.modifiers["Leafcloud Forest"]
        found = [get_modifier_input(modifier, f"From {number}") for number in range(1, 16)]
        return baked, [distance for distance in found if distance < 1e8]

    baked, found = distances("billboards")
    assert found == pytest.approx(baked.switch_distances[1:], rel=0.01)
    baked, found = distances("both")
    halves = [baked.schedule.pruning.start / baked.schedule.pruning.half**number for number in (1, 2, 3)]
    expected = sorted([*(half for half in halves if half < baked.switch_distances[1]), *baked.switch_distances[1:]])
    assert len(expected) > len(baked.switch_distances[1:])
    assert found == pytest.approx(expected, rel=0.01)


def test_a_forest_stands_as_its_tree_does_under_a_parent() -> None:
    """The forest is rotated and scaled, and its distances scale, too."""
    baked = baked_crown()
    plain = baked_tree(baked.collection)
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale, parent.rotation_euler = (4.0, 4.0, 4.0), (0.5 * math.pi, 0.0, 0.0)
    for obj in baked.collection.objects:
        if obj.parent is None:
            obj.parent = parent
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = grid(1, 1.0)
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    first = bpy.data.objects["Points"].modifiers["Leafcloud Forest"]
    variants = get_modifier_input(first, "Variants")
    for obj in variants.all_objects:
        assert np.allclose(obj.matrix_basis.to_3x3(), parent.matrix_world.to_3x3(), atol=1e-5)
    assert baked_tree(baked.collection).switch_distances == pytest.approx([4.0 * d for d in plain.switch_distances])


def test_a_mirrored_tree_is_planted_as_it_stands() -> None:
    baked = baked_crown()
    distances = baked_tree(baked.collection).switch_distances
    for obj in baked.collection.objects:
        if obj.parent is None:
            obj.scale.x *= -1.0
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = grid(1, 1.0)
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    assert baked_tree(baked.collection).switch_distances == pytest.approx(distances)


def test_the_settings_of_a_forest_reach_the_node_group() -> None:
    baked = baked_crown(trunk=False)
    settings = bpy.context.scene.leafcloud_forest
    settings.tree, settings.points, settings.width, settings.far = baked.collection, grid(3, 4.0), 0.5, 6.0
    bpy.ops.leafcloud.forest()
    add_camera((0.0, 0.0, 0.0))
    modifier = settings.points.modifiers["Leafcloud Forest"]
    assert get_modifier_input(modifier, "Width") == 0.5
    assert len(drawn(settings.points)) == 2


def test_planting_again_replaces_the_forest() -> None:
    baked_crown(trunk=False)
    points = grid(3, 1.0)
    bpy.context.view_layer.objects.active = points
    bpy.ops.leafcloud.forest()
    bpy.ops.leafcloud.forest()
    assert [modifier.name for modifier in points.modifiers] == ["Leafcloud Points", "Leafcloud Forest"]
    assert len(drawn(points)) == 3
    forests = [each.name for each in bpy.data.collections if re.fullmatch(r"tree_forest(\.\d+)?", each.name)]
    assert forests == ["tree_forest"], "the one before is gone"


def test_a_forest_follows_the_lod_distance_of_its_tree() -> None:
    baked = baked_crown(trunk=False)
    points = grid(1, 1.0)
    bpy.context.view_layer.objects.active = points
    bpy.ops.leafcloud.forest()
    add_camera((0.0, 0.0, baked.switch_distances[1]))
    root = root_of(baked.collection)
    assert root is not None
    shown = {}
    for factor in (10.0, 0.1):
        root["LOD Distance"] = factor
        root.update_tag()
        bpy.context.view_layer.update()
        [shown[factor]] = drawn(points)
    assert shown[10.0] == "tree_forest_00"
    assert shown[0.1] > "tree_forest_01"
    bpy.ops.leafcloud.forest()
    root["LOD Distance"] = 1.0
    root.update_tag()
    bpy.context.view_layer.update()
    [usual] = drawn(points)
    assert "00" < usual[-2:] < shown[0.1][-2:], "planted again, the factor counts once"


def test_a_forest_mixes_all_trees_of_the_scene() -> None:
    for name in ("one", "two"):
        baked_crown(name, trunk=False)
    ground = grid(40, 1.0)
    bpy.context.view_layer.objects.active = ground
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    names = [name.partition("_forest")[0] for name in drawn(ground)]
    assert len(names) == 40
    assert set(names) == {"tree", "tree.001"}
    assert [modifier.name for modifier in ground.modifiers] == [
        *("Leafcloud Points", "Leafcloud Forest", "Leafcloud Forest.001")
    ]


def test_the_defaults_plant_a_forest_on_a_ground() -> None:
    """The crown is 1.3 wide at least, so a ground of 60 × 60 holds hundreds. Its scale moves into the mesh."""
    baked = baked_crown(trunk=False)
    ground = add_mesh("ground", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    ground.scale = (60.0, 60.0, 1.0)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = ground
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    assert tuple(ground.scale) == (1.0, 1.0, 1.0)
    expected = 3600.0 / width_of(baked.collection) ** 2
    assert 500 < expected < 3000
    assert abs(len(drawn(ground)) - expected) < 5.0 * math.sqrt(expected)


def test_points_are_chosen_where_faces_are_not_meant() -> None:
    baked_crown(trunk=False)
    ground = add_mesh("ground", [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0)], [(0, 1, 2, 3)])
    bpy.context.view_layer.objects.active = ground
    bpy.context.scene.leafcloud_forest.on = "points"
    bpy.ops.leafcloud.forest()
    assert len(drawn(ground)) == 4


def test_objects_that_cannot_be_planted_give_a_message() -> None:
    def refused(words: str, active: bpy.types.Object | None) -> None:
        bpy.context.view_layer.objects.active = active
        before = counts()
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.leafcloud.forest()
        assert counts() == before

    points = grid(2, 1.0)
    refused("No baked tree is in the scene", points)
    baked = baked_crown()
    refused("make it active", None)
    refused("belongs to a baked tree", baked.levels[0].object)
    refused("belongs to a baked tree", baked.levels[0].trunk)
    parent = bpy.data.objects.new("parent", None)
    points.parent, points.scale = parent, (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    refused("has a scale, which would stretch the trees", points)
    points.scale = (1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    refused("has no points", add_camera((0.0, 0.0, 0.0)))
    empty = bpy.data.collections.new("empty")
    bpy.context.scene.leafcloud_forest.tree = empty
    refused("'empty' has no baked levels", points)
    twice = baked.levels[0].object.copy()
    baked.collection.objects.link(twice)
    bpy.context.scene.leafcloud_forest.tree = baked.collection
    refused("choose a collection with one tree", points)
    bpy.data.objects.remove(twice)
    baked.levels[1].object.modifiers.clear()
    refused("has no modifier 'Leafcloud LOD'", points)
