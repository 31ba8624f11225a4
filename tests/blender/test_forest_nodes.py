"""Forests, checked by the instances that Blender draws, and the pruned variants of a bake.

A tree of scale 1 switches at its own distance between D and (1 + width)·D from the camera. A tree of scale s switches
between s·D and s·(1 + width)·D. The kept fraction λ(d) = (d₀/d)^(ln ½ / ln h) is ½ⁿ at d₀/hⁿ. Kept leaves grow by s,
where s² is the total area over the area of the kept leaves.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np
import pytest
from lod_scenes import Floats, Leaves, add_camera, build, many_leaves, place, points_of, store, triangle_areas
from mathutils import Euler, Matrix, Quaternion, Vector
from scenes import TRIANGLE, add_mesh, bake, read

from addon.levels.building import BuiltLevel
from addon.levels.forest import Forest, build_forest, pruned_mesh
from addon.nodes.forest import GROUP_NAME, ForestSettings, add_forest_modifier, forest_group
from addon.settings.bake import BakeSettings
from addon.versions import set_corner_normals

pytestmark = pytest.mark.version


class Instance(NamedTuple):
    variant: str
    matrix: Floats

    @property
    def location(self) -> tuple[float, ...]:
        return tuple(self.matrix[:3, 3].round(4).tolist())


def points(locations: Any, **attributes: Any) -> bpy.types.Object:
    """Add a mesh of points with attributes: integers, floats, vectors, or quaternions (n, 4)."""
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata(np.asarray(locations, float).tolist(), [], [])
    for name, values in attributes.items():
        values = np.asarray(values)
        if values.dtype == int:
            mesh.attributes.new(name, "INT", "POINT").data.foreach_set("value", values)
        elif values.shape[-1] == 4 and values.ndim == 2:
            mesh.attributes.new(name, "QUATERNION", "POINT").data.foreach_set(
                "value", values.astype(np.float32).ravel()
            )
        else:
            store(mesh, name, values.astype(np.float32))
    return place(mesh, "Points")


def add_variants(*names: str) -> bpy.types.Collection:
    """Return a collection outside of all scenes with one object for each name."""
    variants = bpy.data.collections.new("Variants")
    for name in names:
        variants.objects.link(add_mesh(name, TRIANGLE, [(0, 1, 2)], link=False))
    return variants


def planted(obj: bpy.types.Object) -> list[Instance]:
    graph = bpy.context.evaluated_depsgraph_get()
    return [
        Instance(each.object.original.name, np.array(each.matrix_world, np.float64))
        for each in graph.object_instances
        if each.is_instance and each.parent.original == obj
    ]


def drawn(obj: bpy.types.Object) -> list[str]:
    return [each.variant for each in planted(obj)]


def test_the_distance_decides_which_variant_is_drawn() -> None:
    obj = points([(x, 0, 0) for x in (0, 9.99, 10.01, 19.99, 20.01, 1e6)])
    add_forest_modifier(obj, add_variants("a", "b", "c"), ForestSettings((10.0, 20.0), width=0.0))
    camera = add_camera((0.0, 0.0, 0.0))
    assert [(each.variant, each.location[0]) for each in planted(obj)] == [
        *(("a", 0.0), ("a", 9.99), ("b", 10.01), ("b", 19.99), ("c", 20.01), ("c", 1e6)),
    ]
    camera.location.x = 30.0
    assert drawn(obj) == ["c", "c", "b", "b", "a", "c"]


def test_a_variant_is_drawn_from_its_very_distance_on() -> None:
    obj = points([(10.0, 0.0, 0.0)])
    add_forest_modifier(obj, add_variants("a", "b"), ForestSettings((10.0,), width=0.0))
    add_camera((0.0, 0.0, 0.0))
    assert drawn(obj) == ["b"]


def test_variants_come_in_the_order_of_their_names() -> None:
    obj = points([(x + 0.5, 0, 0) for x in range(4)])
    variants = add_variants("tree_10", "tree_9", "tree_2", "Tree_1")
    add_forest_modifier(obj, variants, ForestSettings((1.0, 2.0, 3.0), width=0.0))
    add_camera((0.0, 0.0, 0.0))
    assert drawn(obj) == ["Tree_1", "tree_2", "tree_9", "tree_10"]


def test_all_sixteen_variants_can_be_drawn() -> None:
    names = [f"{number:02d}" for number in range(16)]
    obj = points([(x + 0.5, 0, 0) for x in range(16)])
    distances = tuple(map(float, range(1, 16)))
    add_forest_modifier(obj, add_variants(*names), ForestSettings(distances, width=0.0))
    add_camera((0.0, 0.0, 0.0))
    assert drawn(obj) == names


def test_the_coarsest_variant_replaces_missing_variants() -> None:
    obj = points([(5.0, 0, 0), (50.0, 0, 0)])
    add_forest_modifier(obj, add_variants("a", "b"), ForestSettings((1.0, 2.0, 3.0), width=0.0))
    add_camera((0.0, 0.0, 0.0))
    assert drawn(obj) == ["b", "b"]


def test_without_a_camera_the_finest_is_drawn_and_without_variants_nothing() -> None:
    obj = points([(5.0, 0, 0), (50.0, 0, 0)])
    add_forest_modifier(obj, add_variants("a", "b"), ForestSettings((1.0,), centre=(9.0, 0.0, 0.0), far=3.0))
    assert drawn(obj) == ["a", "a"]
    empty = points([(5.0, 0, 0)])
    add_forest_modifier(empty, bpy.data.collections.new("Empty"), ForestSettings((1.0,)))
    assert drawn(empty) == []


def test_each_tree_switches_at_its_own_distance_within_the_width() -> None:
    count = 4000
    obj = points(np.zeros((count, 3)))
    add_forest_modifier(obj, add_variants("a", "b"), ForestSettings((100.0,), width=0.2))
    camera = add_camera((0.0, 0.0, 0.0))
    before = np.zeros(count, bool)
    for distance, share in [(99.9, 0.0), (102.0, 0.1), (110.0, 0.5), (118.0, 0.9), (120.1, 1.0)]:
        camera.location.z = distance
        switched = np.array(drawn(obj)) == "b"
        assert switched.mean() == pytest.approx(share, abs=0.03 if 0.0 < share < 1.0 else 0.0)
        assert (switched >= before).all()
        before = switched
    camera.location.z = 110.0
    neighbours = np.array(drawn(obj)) == "b"
    assert np.corrcoef(neighbours[1:], neighbours[:-1])[0, 1] == pytest.approx(0.0, abs=0.06)


def test_a_tree_is_identified_by_its_id_or_else_by_its_index() -> None:
    ids = np.random.default_rng(1).permutation(500) + 7
    locations = np.stack([ids, np.zeros(500), np.zeros(500)], axis=1)
    settings, variants = ForestSettings((1000.0,), width=1.0), add_variants("a", "b")
    camera = add_camera((0.0, 0.0, 1500.0))

    def by_location(obj: bpy.types.Object) -> dict[float, str]:
        add_forest_modifier(obj, variants, settings)
        found = {each.location[0]: each.variant for each in planted(obj)}
        bpy.data.objects.remove(obj)
        return found

    whole = by_location(points(locations, id=ids))
    assert set(whole.values()) == {"a", "b"}
    assert by_location(points(np.sort(locations, axis=0), id=np.sort(ids))) == whole
    some = by_location(points(locations[100:200], id=ids[100:200]))
    assert some == {x: variant for x, variant in whole.items() if x in set(locations[100:200, 0])}
    without = by_location(points(locations))
    assert without != whole
    camera.location.z = 1500.0
    assert by_location(points(locations)) == without


def test_a_tree_twice_as_large_switches_twice_as_far_away() -> None:
    locations = [(0, y, 0) for y in range(6)]
    sizes = [1.0, 1.0, 2.0, 2.0, 0.5, 0.5]
    camera = add_camera((0.0, 0.0, 0.0))
    variants = add_variants("a", "b")
    for scale in (sizes, [(s, s, s) for s in sizes]):
        obj = points(locations, scale=scale)
        add_forest_modifier(obj, variants, ForestSettings((100.0,), width=0.0))
        for distance, expected in [(49.0, "aaaaaa"), (51.0, "aaaabb"), (99.0, "aaaabb"), (101.0, "bbaabb")]:
            camera.location.x = distance
            assert "".join(drawn(obj)) == expected
        camera.location.x = 199.0
        assert "".join(drawn(obj)) == "bbaabb"
        camera.location.x = 201.0
        assert "".join(drawn(obj)) == "bbbbbb"
        bpy.data.objects.remove(obj)


EULER = Euler((0.3, 1.1, -0.7))


@pytest.mark.parametrize("rotation", [tuple(EULER), tuple(EULER.to_quaternion())], ids=["euler", "quaternion"])
def test_trees_are_turned_scaled_and_measured_from_their_centre(rotation: tuple[float, ...]) -> None:
    where, size = Vector((5.0, -2.0, 1.0)), Vector((2.0, 3.0, 0.5))
    obj = points([where], rotation=[rotation], scale=[size])
    obj.matrix_world = Matrix.LocRotScale((7.0, 1.0, 0.0), Quaternion((0.0, 0.0, 1.0), 0.4), None)
    own = Matrix.LocRotScale(Vector((0.5, 0.0, 0.25)), Quaternion((1.0, 0.0, 0.0), 0.2), Vector((1.5, 1.5, 1.5)))
    variants = add_variants("a", "b")
    for variant in variants.objects:
        variant.matrix_basis = own
    centre = (1.0, 2.0, 4.0)
    add_forest_modifier(obj, variants, ForestSettings((30.0,), centre, width=0.0))
    tree = obj.matrix_basis @ Matrix.LocRotScale(where, EULER, size)
    camera = add_camera((0.0, 0.0, 0.0))
    for distance, expected in [(29.99, "a"), (30.01, "b")]:
        camera.location = tree @ (Vector(centre) + distance * Vector((0.6, 0.0, 0.8)))
        (found,) = planted(obj)
        assert found.variant == expected
        np.testing.assert_allclose(found.matrix, np.array(tree @ own), atol=2e-5)


def test_points_beyond_the_far_distance_are_not_drawn() -> None:
    obj = points([(x, 0, 0) for x in (5, 49.9, 50.1, 500)], scale=[1.0, 9.0, 9.0, 9.0])
    settings = ForestSettings((10.0,), centre=(0.0, 0.0, 3.0), far=50.0)
    add_forest_modifier(obj, add_variants("a", "b"), settings)
    add_camera((0.0, 0.0, 0.0))
    assert [each.location[0] for each in planted(obj)] == [5.0, 49.9]


def test_a_variant_may_be_a_collection() -> None:
    variants = bpy.data.collections.new("Variants")
    for name in ("a", "b"):
        variant = bpy.data.collections.new(name)
        for part in ("leaves", "trunk"):
            variant.objects.link(add_mesh(f"{name}_{part}", TRIANGLE, [(0, 1, 2)], link=False))
        variants.children.link(variant)
    obj = points([(5.0, 0, 0), (15.0, 0, 0)])
    add_forest_modifier(obj, variants, ForestSettings((10.0,), width=0.0))
    add_camera((0.0, 0.0, 0.0))
    found = sorted((each.variant, each.location) for each in planted(obj))
    near, far = (5.0, 0.0, 0.0), (15.0, 0.0, 0.0)
    assert found == [("a_leaves", near), ("a_trunk", near), ("b_leaves", far), ("b_trunk", far)]


def test_points_of_a_curve_are_planted_too() -> None:
    curve = bpy.data.curves.new("Row", "CURVE")
    curve.splines.new("POLY").points.add(2)
    for number, point in enumerate(curve.splines[0].points):
        point.co = (8.0 * number + 1.0, 0.0, 0.0, 1.0)
    obj = bpy.data.objects.new("Row", curve)
    bpy.context.scene.collection.objects.link(obj)
    add_forest_modifier(obj, add_variants("a", "b"), ForestSettings((10.0,), width=0.0))
    add_camera((0.0, 0.0, 0.0))
    assert drawn(obj) == ["a", "a", "b"]


# A small bake result: quads of two materials, some protected, with the attributes of level 0.


def leaf_mesh(leaves: Leaves) -> bpy.types.Mesh:
    mesh = build(leaves)
    for name in ("Spring", "Autumn"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.polygons.foreach_set("material_index", np.arange(len(mesh.polygons), dtype=np.int32) % 2)
    uvs = np.random.default_rng(5).random(2 * len(mesh.loops), np.float32)
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uvs)
    mesh["leafcloud"] = {"keep_steps": 64}
    return mesh


def level(number: int, mesh: bpy.types.Mesh, trunk: bpy.types.Mesh | None, matrix: Matrix) -> BuiltLevel:
    obj = bpy.data.objects.new(f"tree_LOD{number}", mesh)
    obj.matrix_world = matrix
    obj.modifiers.new("Leafcloud LOD", "NODES")
    return BuiltLevel(number, obj, None if trunk is None else bpy.data.objects.new(f"{obj.name}_trunk", trunk), 0)


TURNED = Matrix.LocRotScale(Vector((9.0, 8.0, 7.0)), Quaternion((1.0, 0.0, 0.0), math.pi / 2.0), Vector((2.0,) * 3))


def small_forest(**settings: Any) -> tuple[list[BuiltLevel], Forest]:
    """Build a forest of leaves, a billboard level and a cross impostor. The first two have a trunk."""
    trunk = bpy.data.meshes.new("trunk")
    meshes = [leaf_mesh(many_leaves(64)), build(many_leaves(5)), build(many_leaves(2))]
    levels = [level(i, mesh, trunk if i < 2 else None, TURNED) for i, mesh in enumerate(meshes)]
    settings = {"switch_distances": (0.0, 90.0, 200.0), "centre": (0.0, 1.0, 3.0), **settings}
    return levels, build_forest(levels, "Oaks", **settings)


def test_a_forest_has_halvings_up_to_the_first_cloud_and_then_the_levels() -> None:
    levels, forest = small_forest(prune_start=10.0)
    assert forest.distances == (20.0, 40.0, 80.0, 90.0, 200.0)
    variants = sorted(forest.variants.children, key=lambda variant: variant.name)
    assert [variant.name for variant in variants] == [f"Oaks_{number:02d}" for number in range(6)]
    leaves = [variant.objects[variant.name] for variant in variants]
    assert [len(obj.data.polygons) for obj in leaves] == [64, 32, 16, 8, 5, 2]
    assert [leaves[number].data for number in (0, 4, 5)] == [each.object.data for each in levels]
    assert [variant.objects[-1].data.name for variant in variants[:5]] == ["trunk"] * 5
    assert [len(variant.objects) for variant in variants] == [2, 2, 2, 2, 2, 1]
    for variant in variants:
        for obj in variant.objects:
            assert not obj.modifiers
            assert obj.matrix_basis.translation.length == 0.0
            np.testing.assert_allclose(obj.matrix_basis.to_3x3(), TURNED.to_3x3(), atol=1e-6)
    np.testing.assert_allclose(forest.centre, (0.0, -6.0, 2.0), atol=1e-6)
    assert not bpy.context.scene.collection.children


@pytest.mark.parametrize(
    ("settings", "distances"),
    [
        ({}, (90.0, 200.0)),
        ({"prune_start": 10.0, "prune_half": 0.25}, (40.0, 90.0, 200.0)),
        ({"prune_start": 0.5}, (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 90.0, 200.0)),
        ({"prune_start": 0.1}, (0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 90.0, 200.0)),
    ],
)
def test_pruning_follows_start_and_half_down_to_a_128th(
    settings: dict[str, float], distances: tuple[float, ...]
) -> None:
    assert small_forest(**settings)[1].distances == pytest.approx(distances)


def test_a_planted_forest_shows_the_levels_by_their_distances() -> None:
    _, forest = small_forest(prune_start=10.0)
    obj = points([(x, 0, 0) for x in (1, 30, 50, 85, 150, 300)])
    forest.plant(obj, width=0.0)
    add_camera((0.0, -6.0, 2.0))  # The camera is as high as the centers.
    found = planted(obj)
    leaves = [each for each in found if not each.variant.endswith("trunk")]
    assert [each.variant for each in leaves] == [f"Oaks_{number:02d}" for number in range(6)]
    assert len(found) == 11
    np.testing.assert_allclose(leaves[4].matrix[:3, :3], TURNED.to_3x3(), atol=1e-6)
    assert [each.location[0] for each in leaves] == [1, 30, 50, 85, 150, 300]


def test_a_pruned_variant_keeps_the_area_about_the_pivots() -> None:
    leaves = many_leaves(200)
    ranks = leaves.ranks.copy()
    ranks[:20] = -1.0
    leaves = Leaves(leaves.points, leaves.targets, ranks, leaves.pivots, leaves.pivot_targets)
    mesh = leaf_mesh(leaves)
    made = pruned_mesh(mesh, 0.25, "quarter", (0.0, 0.0))

    kept, free = ranks < 0.25, ranks >= 0.0
    scale = math.sqrt(leaves.areas[free].sum() / leaves.areas[free & kept].sum())
    factor = np.where(free, scale, 1.0)[:, None, None]
    pivots = leaves.pivots.astype(np.float64)[:, None]
    expected = (pivots + (leaves.points.reshape(-1, 3, 3) - pivots) * factor)[kept].reshape(-1, 3)
    np.testing.assert_allclose(points_of(made), expected, atol=1e-5)
    assert triangle_areas(points_of(made)).sum() == pytest.approx(leaves.areas.sum(), rel=1e-5)

    assert points_of(mesh).tobytes() == leaves.points.tobytes()
    assert [material.name for material in made.materials] == ["Spring", "Autumn"]
    assert [face.material_index for face in made.polygons] == (np.flatnonzero(kept) % 2).tolist()
    uvs = np.empty((len(made.loops), 2), np.float32)
    made.uv_layers["UVMap"].data.foreach_get("uv", uvs.ravel())
    before = np.empty((len(mesh.loops), 2), np.float32)
    mesh.uv_layers["UVMap"].data.foreach_get("uv", before.ravel())
    assert np.array_equal(uvs, before[np.repeat(kept, 3)])


def test_leaves_of_a_pruned_variant_grow_by_the_measured_factor() -> None:
    leaves = many_leaves(50)
    plain, grown = (points_of(pruned_mesh(leaf_mesh(leaves), 0.25, "quarter", g)) for g in ((0.0, 0.0), (0.1, 0.02)))
    pivots = np.repeat(leaves.pivots[leaves.ranks < 0.25], 3, axis=0)
    factor = math.exp(math.log(0.25) * (0.1 + 0.02 * math.log(0.25)))
    np.testing.assert_allclose(grown - pivots, factor * (plain - pivots), atol=1e-5)


def test_a_pruned_variant_has_no_attributes_for_transitions() -> None:
    obj = place(leaf_mesh(many_leaves(40)))
    obj.shape_key_add(name="Basis")
    obj.shape_key_add(name="Billboards").points.foreach_set("co", np.zeros(360, np.float32))
    obj.vertex_groups.new(name="LC_000").add([0, 1, 2], 1.0, "REPLACE")
    made = pruned_mesh(obj.data, 0.5, "half", (0.0, 0.0))
    assert made.shape_keys is None
    assert not [layer for layer in made.attributes if layer.name.startswith("leaf_")]
    assert "leafcloud" not in made
    assert not place(made).vertex_groups
    assert np.abs(points_of(made)).max() > 0.5
    assert obj.data.shape_keys.key_blocks.keys() == ["Basis", "Billboards"]
    assert obj.vertex_groups.keys() == ["LC_000"]
    assert "leaf_rank" in obj.data.attributes


def test_a_pruned_variant_keeps_its_normals() -> None:
    mesh = leaf_mesh(many_leaves(40))
    normals = np.tile(np.float32([0.6, 0.0, 0.8]), (120, 1))
    set_corner_normals(mesh, normals)
    before = np.empty((120, 3), np.float32)
    mesh.corner_normals.foreach_get("vector", before.ravel())
    made = pruned_mesh(mesh, 0.5, "half", (0.0, 0.0))
    after = np.empty((60, 3), np.float32)
    made.corner_normals.foreach_get("vector", after.ravel())
    kept = np.repeat(many_leaves(40).ranks < 0.5, 3)
    np.testing.assert_allclose(after, before[kept], atol=2e-4)
    np.testing.assert_allclose(after, normals[:60], atol=2e-2)


def test_a_failed_forest_leaves_no_data() -> None:
    bare = level(0, build(many_leaves(4), attributes=False), None, Matrix())
    with pytest.raises(ValueError, match="has no leaf_rank"):
        build_forest([bare], "Oaks", switch_distances=(0.0,), centre=(0.0, 0.0, 0.0), prune_start=1.0)
    many = [level(i, bare.object.data, None, Matrix()) for i in range(17)]
    with pytest.raises(ValueError, match="would have 17 variants, it may have 16"):
        build_forest(many, "Oaks", switch_distances=range(17), centre=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"prune_start is 0\.0"):
        build_forest([bare], "Oaks", switch_distances=(0.0,), centre=(0.0, 0.0, 0.0), prune_start=0.0)
    assert not bpy.data.collections


READ_WITHOUT_ADDON = """
import json, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)
graph = bpy.context.evaluated_depsgraph_get()
drawn = [each.object.original.name for each in graph.object_instances if each.is_instance]
with open(sys.argv[2], "w") as file:
    json.dump({"drawn": drawn, "addon": [name for name in sys.modules if name.split(".")[0] == "addon"]}, file)
"""


def test_a_baked_tree_becomes_a_forest_that_needs_no_addon(shrub: Path, tmp_path: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    settings = BakeSettings(epsilon=0.2, pixels=8.0, levels=1, texture_size=256, effects="+pruning")
    baked = bake(read(), settings)
    centre = baked.prepared.foliage.centre
    near = baked.switch_distances[1]
    forest = build_forest(
        baked.levels,
        "Shrubs",
        switch_distances=baked.switch_distances,
        centre=tuple(centre.tolist()),
        prune_start=near / 3.0,
    )
    assert len(forest.distances) == 3
    full, half = (forest.variants.children[f"Shrubs_{i:02d}"].objects[0].data for i in (0, 1))
    assert len(half.polygons) == pytest.approx(len(full.polygons) / 2, rel=0.02)
    assert sum(face.area for face in half.polygons) == pytest.approx(sum(face.area for face in full.polygons), rel=1e-4)

    obj = points([(0.0, 0.0, 0.0), (0.9 * near, 0.0, 0.0), (1.5 * near, 0.0, 0.0), (99.0 * near, 0.0, 0.0)])
    forest.plant(obj)
    add_camera((0.0, 0.0, 0.0))
    saved, found = tmp_path / "forest.blend", tmp_path / "found.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))
    command = [sys.executable, "-I", "-c", READ_WITHOUT_ADDON, str(saved), str(found)]
    subprocess.run(command, check=True, cwd=tmp_path, timeout=120)
    result = json.loads(found.read_text())
    assert result["addon"] == []
    trees = [f"Shrubs_{number:02d}" for number in range(4)]
    assert sorted(result["drawn"]) == sorted([*trees, *(f"{tree}_trunk" for tree in trees[:3])])


def test_the_group_is_made_once_and_is_its_own() -> None:
    foreign = bpy.data.node_groups.new(GROUP_NAME, "GeometryNodeTree")
    group = forest_group()
    assert group != foreign
    assert forest_group() == group
    assert sorted(tree.name for tree in bpy.data.node_groups) == ["Leafcloud Eye", GROUP_NAME, f"{GROUP_NAME}.001"]


def test_the_inputs_have_the_promised_names() -> None:
    sockets = [item for item in forest_group().interface.items_tree if item.item_type == "SOCKET"]
    assert [socket.name for socket in sockets if socket.in_out == "OUTPUT"] == ["Geometry"]
    assert [socket.name for socket in sockets if socket.in_out == "INPUT"] == [
        *("Geometry", "Variants", "Centre", "Width", "Far", "Kind", "LOD Distance"),
        *(f"From {number}" for number in range(1, 16)),
    ]
    assert all(socket.description for socket in sockets if socket.name != "Geometry")


def test_the_group_can_be_read_by_an_artist() -> None:
    nodes = [node for node in forest_group().nodes if node.bl_idname != "NodeFrame"]
    assert all(node.parent.label for node in nodes)
    assert len({(node.parent.name, *node.location) for node in nodes}) == len(nodes)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"distances": (2.0, 1.0)}, "must be at least 0 and not fall"),
        ({"distances": (-1.0, 1.0)}, "must be at least 0 and not fall"),
        ({"distances": (math.nan,)}, "distances is"),
        ({"distances": tuple(map(float, range(16)))}, "at most 15 numbers"),
        ({"width": -0.1}, r"width is -0.1, it must be in \[0, 1\]"),
        ({"far": math.nan}, "far is nan, it must be at least 0"),
        ({"centre": (0.0, math.inf, 0.0)}, "it must be finite"),
    ],
)
def test_settings_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ForestSettings(**{"distances": (1.0,), **values})
