"""Levels built in Blender from small literal arrays, with known vertices and attributes."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from fake_levels import FakeLevel, rectangle
from numpy.typing import NDArray

from addon.geometry import Geometry, Tree, is_sheared, world_normals, wound
from addon.levels import clouds
from addon.levels.build import build_levels
from addon.levels.building import Build, BuiltLevel, Costs
from addon.levels.mesh import MeshFaces, create_mesh, polygon_faces, split_vertices
from addon.levels.prune_tables import area_shares, prefix_table
from addon.plan.lod_range import HandOverKind, lod_ranges
from addon.plan.registry import effect_named
from addon.plan.schedule import Schedule
from addon.steps import all_steps
from addon.versions import get_modifier_input

pytestmark = pytest.mark.version

MIRROR = np.diag([-2.0, 2.0, 2.0, 1.0])
FREE_NORMALS = bpy.app.version >= (4, 5, 0)


def leaves() -> Geometry:
    """Return a card of two triangles, a triangle on vertices 4 to 6, and a triangle of the second material."""
    positions = np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [1, 0, 1],
            [0, 0, 1],
            [2, 0, 0],
            [3, 0.1, 0],
            [3, 0, 1],
            [0, 2, 0],
            [1, 2, 0.3],
            [1, 2, 1],
        ],
        np.float32,
    )
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9]], np.int32)
    random = np.random.default_rng(5)
    normals = random.normal(size=(4, 3, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return Geometry(
        positions=positions,
        triangles=triangles,
        uvs=random.random((4, 3, 2), np.float32),
        normals=normals.astype(np.float32),
        colors=None,
        material_ids=np.array([0, 0, 0, 1], np.int32),
        materials=[bpy.data.materials.new("leaf"), bpy.data.materials.new("dry leaf")],
    )


def trunk() -> Geometry:
    return Geometry(
        positions=np.array([[0, 0, -1], [1, 0, -1], [0, 0, 0]], np.float32),
        triangles=np.array([[0, 1, 2]], np.int32),
        uvs=None,
        normals=np.tile(np.array([0, -1, 0], np.float32), (1, 3, 1)),
        colors=None,
        material_ids=np.zeros(1, np.int32),
        materials=[bpy.data.materials.new("bark")],
    )


def tree(*, with_trunk: bool = True) -> Tree:
    matrix = np.eye(4)
    matrix[:3, 3] = (5.0, 6.0, 7.0)
    return Tree("tree", matrix, leaves(), trunk() if with_trunk else None, "", [], [])


FOLIAGE = SimpleNamespace(
    leaf_ids=np.array([0, 0, 1, 2], np.uint32),
    centre=np.array([0.5, 0.0, 0.5]),
    world_centre=np.array([0.5, 0.0, 0.5]),
    radius=1.0,
    mirrored=False,
)
HAND_OVERS = (
    HandOverKind.FADE,
    HandOverKind.MORPH_AND_FADE,
    HandOverKind.MORPH_AND_FADE,
    HandOverKind.FADE,
)
RANKS = np.array([0.5, 0.25, 0.0], np.float32)
"""Of the three leaves."""


def chain() -> SimpleNamespace:
    """Return two billboard levels and the cross impostor.

    One triangle of the card goes to plane 1, and all other triangles go to plane 0.
    """
    random = np.random.default_rng(3)
    first = FakeLevel(
        corners=np.array(rectangle(0.0) + rectangle(1.0)),
        targets=random.random((4, 3, 3)),
        pivots=random.random((4, 3)),
        pivot_targets=random.random((4, 3)),
        ranks=np.array([0.5, 0.0], np.float32),
        cloud=SimpleNamespace(parents=np.array([0, 1, 0, 0], np.uint32)),
    )
    second = FakeLevel(
        corners=np.array(rectangle(0.5) + rectangle(0.5)[::-1]),
        targets=random.random((4, 3, 3)),
        pivots=random.random((4, 3)),
        pivot_targets=random.random((4, 3)),
        ranks=np.zeros(2, np.float32),
        cloud=SimpleNamespace(parents=np.array([0, 1, 2, 2], np.uint32)),
        two_sided=True,
    )
    nothing = np.zeros((0, 3))
    cross = FakeLevel(
        np.array(rectangle(0.5)), nothing.reshape(0, 3, 3), nothing, nothing, np.zeros(1, np.float32), None
    )
    levels = [first, second, cross]
    return SimpleNamespace(levels=levels, clouds=levels, ranks=RANKS, pivots=first.pivots, kept=None)


def context(source: Tree, made: SimpleNamespace, *, transitions: bool = True, pruning: bool = True) -> Build:
    distances = (0.0, 10.0, 40.0, 100.0)
    on = {"far_levels": True, "pruning": pruning, "transitions": transitions}
    return Build(
        name="tree",
        tree=source,
        foliage=FOLIAGE,
        chain=made,
        schedule=Schedule(distances, lod_ranges(distances, HAND_OVERS, transitions=transitions)),
        effects=tuple(effect_named(name) for name, wanted in on.items() if wanted),
        costs=Costs(),
    )


def build(source: Tree, **effects: bool) -> list[BuiltLevel]:
    return all_steps(build_levels(context(source, chain(), **effects)))[1]


def values(mesh: bpy.types.Mesh, name: str) -> NDArray[Any]:
    attribute = mesh.attributes[name]
    kind = {"FLOAT": ("value", 1, np.float32), "INT": ("value", 1, np.int32), "FLOAT_VECTOR": ("vector", 3, np.float32)}
    key, width, dtype = kind[attribute.data_type]
    result = np.empty(len(attribute.data) * width, dtype)
    attribute.data.foreach_get(key, result)
    return result if width == 1 else result.reshape(-1, width)


def corner_vertices(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    result = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", result)
    return result


def at_corners(mesh: bpy.types.Mesh, name: str) -> NDArray[Any]:
    """Return a point attribute at the corners (t, 3, …) of a mesh of triangles."""
    found = values(mesh, name)[corner_vertices(mesh)]
    return found.reshape(-1, 3, *found.shape[1:])


# Arrays


def test_a_vertex_of_triangles_on_two_billboards_is_split() -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    together, apart = split_vertices(triangles, np.array([7, 7])), split_vertices(triangles, np.array([0, 1]))
    assert together.corners.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert len(together.first) == 4
    assert apart.corners.tolist() == [[0, 2, 3], [1, 4, 5]]
    assert triangles.ravel()[apart.first].tolist() == [0, 0, 1, 2, 2, 3]


def test_vertices_that_no_triangle_uses_are_left_out() -> None:
    split = split_vertices(np.array([[9, 4, 6]], np.int32), np.array([0]))
    assert split.corners.tolist() == [[2, 0, 1]]
    assert split.first.tolist() == [1, 2, 0]


def test_triangles_on_the_same_vertices_get_their_own_vertices() -> None:
    triangles = np.array([[0, 1, 2], [2, 1, 0], [1, 2, 3], [1, 0, 2]], np.int32)
    split = split_vertices(triangles, np.zeros(4, np.int32))
    assert len({frozenset(corners) for corners in split.corners.tolist()}) == 4
    assert len(split.first) == 4 + 3 + 3
    assert np.array_equal(triangles.ravel()[split.first][split.corners], triangles)


def test_a_polygon_is_one_face_unless_its_triangles_separate() -> None:
    # A quad and a pentagon with one key each, then one of each with two keys; corners 0 … 17.
    sizes, keys = np.array([4, 5, 4, 5]), np.array([4, 4, 7, 7, 7, 1, 2, 1, 1, 2])
    faces = polygon_faces(sizes, keys, np.array([0, 1, 2, 3]), mirrored=False)
    assert faces.sizes.tolist() == [4, 5, 3, 3, 3, 3, 3]
    assert faces.polygons.tolist() == [0, 1, 2, 2, 3, 3, 3]
    fans = [9, 10, 11, 9, 11, 12, 13, 14, 15, 13, 15, 16, 13, 16, 17]
    assert faces.corners.tolist() == [*range(9), *fans]
    # Each vertex is a corner of a triangle of its polygon: (0, 1, 2), (0, 2, 3) and so on.
    assert faces.triangles.tolist()[:9] == [0, 0, 0, 1, 2, 2, 2, 3, 4]
    assert faces.places.tolist()[:9] == [0, 1, 2, 2, 0, 1, 2, 2, 2]
    assert faces.triangles.tolist()[9:15] == [5, 5, 5, 6, 6, 6]
    assert faces.places.tolist()[9:15] == [0, 1, 2, 0, 1, 2]


def test_polygons_come_in_the_order_asked_for() -> None:
    faces = polygon_faces(np.array([3, 4]), np.zeros(3), np.array([1, 0]), mirrored=False)
    assert faces.corners.tolist() == [3, 4, 5, 6, 0, 1, 2]
    assert faces.vertex_polygons.tolist() == [1, 1, 1, 1, 0, 0, 0]


def test_faces_of_a_mirrored_tree_have_reversed_winding() -> None:
    faces = polygon_faces(np.array([4, 4]), np.array([4, 4, 1, 2]), np.array([0, 1]), mirrored=True)
    assert faces.corners.tolist() == [0, 3, 2, 1, 4, 6, 5, 4, 7, 6]


def test_a_prefix_holds_the_leaves_whose_rank_is_below() -> None:
    surface = MeshFaces(
        positions=np.zeros((0, 3), np.float32),
        corners=np.zeros(0, np.int32),
        sizes=np.array([4, 3, 3, 3], np.int32),
        material_ids=np.array([0, 0, 0, 2], np.int32),
    )
    first, second = prefix_table(surface, np.array([0.0, 0.5, 0.75, 0.25], np.float32))
    assert (first["material"], second["material"]) == (0, 2)
    assert [first["triangles"][step] for step in (0, 1, 32, 33, 48, 49, 64)] == [0, 2, 2, 3, 3, 4, 4]
    assert [second["triangles"][step] for step in (0, 16, 17, 64)] == [0, 0, 1, 1]
    assert len(first["triangles"]) == 65


# The world


def test_a_matrix_with_a_shear_is_detected() -> None:
    sheared = np.eye(4)
    sheared[0, 1] = 0.5
    turned = np.eye(4)
    turned[:2, :2] = [[math.cos(1.0), -math.sin(1.0)], [math.sin(1.0), math.cos(1.0)]]
    assert is_sheared(sheared)
    assert not is_sheared(turned @ np.diag([1.0, 2.0, 3.0, 1.0]))


def test_normals_stay_perpendicular_to_their_faces() -> None:
    normals = np.array([[[0.0, math.sqrt(0.5), math.sqrt(0.5)], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]], np.float32)
    normal = world_normals(replace(trunk(), normals=normals), np.diag([1.0, 1.0, 4.0, 1.0]))
    assert normal[0, 0] @ [0.0, 1.0, -4.0] == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(normal[0, 0]) == pytest.approx(1.0)
    assert normal[0, 1].tolist() == [0.0, 0.0, 0.0]


def test_a_mirror_swaps_two_corners_of_each_triangle() -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    assert wound(triangles, MIRROR).tolist() == [[0, 2, 1], [0, 3, 2]]
    assert wound(triangles, np.eye(4)) is triangles
    assert wound(None, MIRROR) is None


# LOD 0


def test_lod_0_is_the_leaves_bit_for_bit_in_pruning_order() -> None:
    source = tree()
    mesh = build(source)[0].object.data
    order = [2, 0, 1, 3]  # Sorted by material, then rank. The card stays whole.
    positions = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", positions.reshape(-1))
    corners = source.leaves.triangles[order]
    assert np.array_equal(positions[corner_vertices(mesh)].reshape(-1, 3, 3), source.leaves.positions[corners])
    uvs = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers.active.uv.foreach_get("vector", uvs)
    assert np.array_equal(uvs.reshape(-1, 3, 2), source.leaves.uvs[order])
    normals = np.empty(3 * len(mesh.loops), np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    if FREE_NORMALS:
        assert np.array_equal(normals.reshape(-1, 3, 3), source.leaves.normals[order])
    else:  # Normals have 16 bits, relative to the face normal.
        assert (normals.reshape(-1, 3, 3) * source.leaves.normals[order]).sum(axis=2).min() > 0.99
    assert [polygon.material_index for polygon in mesh.polygons] == [0, 0, 0, 1]
    assert [material.name for material in mesh.materials] == ["leaf", "dry leaf"]


def test_lod_0_carries_what_pruning_and_transitions_need() -> None:
    source = tree()
    obj = build(source)[0].object
    mesh, level, order = obj.data, chain().levels[0], [2, 0, 1, 3]
    assert len(mesh.vertices) == 3 + 6 + 3  # The card's triangles separate.
    assert np.array_equal(at_corners(mesh, "leaf_rank"), np.repeat([[0.25], [0.5], [0.5], [0.0]], 3, axis=1))
    assert np.array_equal(at_corners(mesh, "leaf_billboard"), np.repeat([[0], [0], [1], [0]], 3, axis=1))
    assert np.array_equal(at_corners(mesh, "leaf_target"), level.targets[order].astype(np.float32))
    for name, expected in (("leaf_pivot", level.pivots), ("leaf_pivot_target", level.pivot_targets)):
        assert np.array_equal(at_corners(mesh, name), np.repeat(expected[order].astype(np.float32)[:, None], 3, axis=1))


def test_the_shape_key_and_the_groups_hold_the_billboards() -> None:
    obj = build(tree())[0].object
    keys = obj.data.shape_keys.key_blocks
    assert [key.name for key in keys] == ["Basis", "Billboards"]
    assert keys["Billboards"].value == 0.0
    moved = np.empty(3 * len(obj.data.vertices), np.float32)
    keys["Billboards"].points.foreach_get("co", moved)
    assert np.array_equal(moved.reshape(-1, 3), values(obj.data, "leaf_target"))
    assert [group.name for group in obj.vertex_groups] == ["LC_000", "LC_001"]
    billboards = values(obj.data, "leaf_billboard")
    for vertex in obj.data.vertices:
        assert [(element.group, element.weight) for element in vertex.groups] == [(billboards[vertex.index], 1.0)]


def test_the_table_of_prefixes_names_the_materials() -> None:
    mesh = build(tree())[0].object.data
    extras = mesh["leafcloud"].to_dict()
    assert extras["keep_steps"] == 64
    leaf, dry = extras["prefixes"]
    assert (leaf["material"], dry["material"]) == ("leaf", "dry leaf")
    assert [leaf["triangles"][step] for step in (0, 16, 17, 32, 33, 64)] == [0, 0, 1, 1, 3, 3]
    assert [dry["triangles"][step] for step in (0, 1)] == [0, 1]


def test_the_table_of_areas_resolves_few_leaves_and_excludes_protected_leaves() -> None:
    rng = np.random.default_rng(5)
    ranks = np.concatenate([np.full(7, -1.0), rng.permutation(200) / 200, [1.0 / 64, (1.0 / 64) ** 2]]).astype("f4")
    areas = rng.uniform(0.5, 2.0, len(ranks)).astype("f4")
    pruned = np.where(ranks < 0.0, 0.0, areas.astype("f8"))
    expected = [pruned[ranks < (i / 64) ** 2].sum() / pruned.sum() for i in range(65)]
    np.testing.assert_allclose(area_shares(areas, ranks), expected, rtol=1e-12, atol=0.0)
    assert area_shares(areas[:7], ranks[:7]) == [0.0] * 65


# Later levels


def test_a_cloud_lies_in_the_trees_coordinates_and_morphs_to_the_next() -> None:
    source, levels = tree(), chain().levels
    obj = build(source)[1].object
    mesh = obj.data
    assert [len(polygon.vertices) for polygon in mesh.polygons] == [4, 3, 3]  # The second billboard has the lower rank.
    positions = np.array([vertex.co[:] for vertex in mesh.vertices], np.float32)
    assert np.array_equal(positions, levels[0].corners[[4, 5, 6, 7, 0, 1, 2, 0, 2, 3]].astype(np.float32))
    targets = levels[1].targets.reshape(2, 6, 3)
    expected = np.concatenate([targets[1, [0, 1, 2, 5]], targets[0]])
    assert np.array_equal(values(mesh, "leaf_target"), expected.astype(np.float32))
    assert values(mesh, "leaf_billboard").tolist() == [2] * 4 + [0] * 3 + [1] * 3
    assert values(mesh, "leaf_rank").tolist() == [0.0] * 4 + [0.5] * 6
    assert np.array_equal(values(mesh, "leaf_pivot")[[0, 4, 7]], levels[1].pivots[[2, 0, 1]].astype(np.float32))
    assert np.allclose(np.array(obj.matrix_world), source.matrix)


def test_the_last_cloud_and_the_cross_have_nothing_to_morph_to() -> None:
    for level in build(tree())[2:]:
        mesh = level.object.data
        leaf_data = {attribute.name for attribute in mesh.attributes if attribute.name.startswith("leaf_")}
        assert leaf_data == ({"leaf_back", "leaf_back_uv"} if level.number == 2 else set()), "level 2 has a pair"
        assert mesh.shape_keys is None
        assert not level.object.vertex_groups


def test_billboards_face_the_same_way_in_a_mirrored_tree() -> None:
    mirrored = Tree("tree", MIRROR, leaves(), None, "", [], [])
    made = replace(context(mirrored, chain()), foliage=SimpleNamespace(**{**vars(FOLIAGE), "mirrored": True}))
    mesh = all_steps(build_levels(made))[1][2].object.data
    normal = np.array(mesh.polygons[0].normal)
    world = np.linalg.inv(MIRROR)[:3, :3].T @ normal  # The normal of a front in the world.
    corners = chain().levels[1].corners @ MIRROR[:3, :3].T
    assert world @ np.cross(corners[1] - corners[0], corners[2] - corners[1]) > 0.0


def test_all_levels_but_the_cross_share_the_trunk() -> None:
    levels = build(tree())
    assert [level.object.name for level in levels] == ["tree_LOD0", "tree_LOD1", "tree_LOD2", "tree_LOD3"]
    trunks = [level.trunk for level in levels[:-1]]
    assert [trunk.name for trunk in trunks] == ["tree_LOD0_trunk", "tree_LOD1_trunk", "tree_LOD2_trunk"]
    assert {trunk.data.name for trunk in trunks} == {"tree_trunk"}
    assert all(trunk.parent == level.object for trunk, level in zip(trunks, levels, strict=False))
    assert levels[-1].trunk is None


def test_a_tree_without_trunk_has_none() -> None:
    assert [level.trunk for level in build(tree(with_trunk=False))] == [None] * 4


def test_the_node_group_gets_distances_in_the_objects_own_units() -> None:
    source = tree()
    source.matrix[:3, :3] *= 2.0
    levels = build(source)
    leaf, cloud, last, cross = (level.object.modifiers[0] for level in levels)
    assert get_modifier_input(leaf, "Start") == pytest.approx(2.5)
    assert get_modifier_input(leaf, "End") == pytest.approx(5.0)
    assert get_modifier_input(leaf, "Vanish") == pytest.approx(1.08 * get_modifier_input(cloud, "Appear"))
    assert get_modifier_input(leaf, "Prune Start") == pytest.approx(get_modifier_input(leaf, "Vanish"))
    assert get_modifier_input(cross, "Appear") == pytest.approx(50.0)
    assert get_modifier_input(cross, "Appear") == get_modifier_input(last, "Fade Out Start") == pytest.approx(50.0)
    assert get_modifier_input(last, "Vanish") == get_modifier_input(cross, "Fade In End") == pytest.approx(57.5)
    assert get_modifier_input(cross, "Vanish") > 1e8
    trunk = levels[1].trunk.modifiers[0]
    assert get_modifier_input(trunk, "Appear") == get_modifier_input(cloud, "Appear")
    assert get_modifier_input(trunk, "Start") > 1e8
    assert get_modifier_input(leaf, "Centre") == pytest.approx((0.5, 0.0, 0.5))


# Effects


@pytest.mark.parametrize(
    ("effects", "attributes"),
    [
        ({"pruning": False}, {"leaf_billboard", "leaf_target", "leaf_pivot_target"}),
        ({"transitions": False}, {"leaf_rank", "leaf_pivot"}),
        ({"transitions": False, "pruning": False}, set()),
    ],
)
def test_an_effect_that_is_off_leaves_no_trace(effects: dict[str, bool], attributes: set[str]) -> None:
    levels = build(tree(), **effects)
    for level in levels[:2]:
        mesh = level.object.data
        assert {attribute.name for attribute in mesh.attributes if attribute.name.startswith("leaf_")} == attributes
        transitions = effects.get("transitions", True)
        assert (mesh.shape_keys is not None) == transitions
        assert bool(level.object.vertex_groups) == transitions
        assert ("leafcloud" in mesh) == effects.get("pruning", True)
        assert bool(level.object.modifiers) == bool(attributes)
    hidden = [level.object.hide_render for level in levels]
    assert hidden == ([False] * 4 if attributes else [False, True, True, True])


def test_without_transitions_a_vertex_keeps_its_neighbours() -> None:
    mesh = build(tree(), transitions=False)[0].object.data
    assert len(mesh.vertices) == 3 + 4 + 3
    assert [len(polygon.vertices) for polygon in build(tree(), transitions=False)[1].object.data.polygons] == [4, 4]


def test_a_build_counts_the_cost_of_each_effect() -> None:
    made = chain()
    asked = context(tree(), made)
    _, (_, *clouds, _) = all_steps(build_levels(asked))
    costs = asked.costs
    vertices, of_clouds = 12 + 10, sum(len(level.object.data.vertices) for level in clouds)
    assert costs.bytes == {
        "pruning": vertices * 16,
        "transitions": vertices * (4 + 2 * 12 + 12) + 4 * of_clouds,
        "far_levels": sum(level.base_color.nbytes for level in made.levels[1:]),
    }
    assert all(seconds > 0.0 for seconds in costs.seconds.values())


# Cleanup


def count_data() -> dict[str, int]:
    kinds = ("objects", "meshes", "materials", "images", "collections", "node_groups")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def test_a_failed_build_leaves_no_data(monkeypatch: pytest.MonkeyPatch) -> None:
    source = tree()
    before = count_data()

    def fail(*arguments: object, **keywords: object) -> None:
        raise MemoryError

    monkeypatch.setattr(clouds, "atlas_material", fail)
    with pytest.raises(MemoryError):
        all_steps(build_levels(context(source, chain())))
    assert count_data() == before


# Meshes


def test_faces_without_normals_are_flat() -> None:
    corners = np.array([0, 1, 2, 2, 1, 3], np.int32)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]], np.float32)
    mesh = create_mesh("fold", MeshFaces(positions, corners, np.array([3, 3], np.int32), np.zeros(2, np.int32)), [None])
    assert [tuple(normal.vector) for normal in mesh.corner_normals][:3] == [(0.0, 0.0, 1.0)] * 3
