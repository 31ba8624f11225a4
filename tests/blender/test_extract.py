"""Extraction of the evaluated scene into arrays: meshes, curves, instances, coordinates."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import SQUARE, TRIANGLE, add_mesh, corners, material, read, winding_normals

from addon.errors import SceneError
from addon.geometry import world_positions
from addon.mesh.extract import extract
from addon.scene.load import load

pytestmark = pytest.mark.version


def scatter_group(source: bpy.types.Object | None, scale: tuple[float, float, float] = (1, 1, 1)) -> bpy.types.NodeTree:
    """Return geometry nodes that replace every point by an instance of `source`, or of a cube without a source."""
    group = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    enter, leave = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    place = group.nodes.new("GeometryNodeInstanceOnPoints")
    place.inputs["Scale"].default_value = scale
    if source is None:
        copied = group.nodes.new("GeometryNodeMeshCube").outputs["Mesh"]
    else:
        info = group.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value = source
        info.inputs["As Instance"].default_value = True
        copied = info.outputs["Geometry"]
    group.links.new(enter.outputs[0], place.inputs["Points"])
    group.links.new(copied, place.inputs["Instance"])
    group.links.new(place.outputs[0], leave.inputs[0])
    return group


def test_a_triangle_is_read_bit_for_bit() -> None:
    third = np.float32(1 / 3)
    obj = add_mesh("leaf", [(third, -0.0, 0.1), (1.0, 0.0, 0.1), (1.0, 1.0, 0.1)], [(0, 1, 2)])
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    tree = read()
    assert tree.leaves.positions.dtype == np.float32
    expected = np.array([(1 / 3, -0.0, 0.1), (1.0, 0.0, 0.1), (1.0, 1.0, 0.1)], np.float32)
    assert tree.leaves.positions.tobytes() == expected.tobytes()
    assert tree.leaves.triangles.tolist() == [[0, 1, 2]]
    assert tree.leaves.uvs is not None
    assert tree.leaves.uvs.tobytes() == np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], np.float32).tobytes()
    assert tree.leaves.normals.tolist() == [[[0, 0, 1]] * 3]
    assert tree.leaves.colors is None
    assert tree.leaves.material_ids.tolist() == [0]
    assert tree.leaves.materials == [None]
    assert (tree.matrix.tolist(), tree.trunk, tree.dropped, tree.warnings) == (np.eye(4).tolist(), None, [], [])
    assert (tree.name, tree.choice) == ("leaf", "'leaf': the names contain a word for leaves.")


def test_polygons_become_triangles_that_cover_them() -> None:
    pentagon = [(2.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 2.0, 0.0), (3.0, 1.0, 0.0), (2.0, 2.0, 0.0)]
    add_mesh("leaf", SQUARE + pentagon, [(0, 1, 2, 3), (4, 5, 6, 7, 8)])
    triangles = np.array(corners(read().leaves))
    assert len(triangles) == 2 + 3
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2] / 2
    assert (areas > 0).all()  # A fan of the concave pentagon would flip a triangle.
    assert areas.sum() == 1.0 + 3.0


def test_leaves_and_trunk_of_several_objects_share_one_frame() -> None:
    leaf, bark = material("leaf"), material("bark")
    add_mesh("b", TRIANGLE, [(0, 1, 2)], materials=[bark])
    add_mesh("a", TRIANGLE, [(0, 1, 2)], materials=[leaf], matrix=Matrix.Translation((10, 0, 0)))
    add_mesh("c", SQUARE[1:], [(0, 1, 2)], materials=[leaf], matrix=Matrix.Translation((10, 5, 0)))
    tree = read()
    assert tree.matrix.tolist() == np.array(Matrix.Translation((10, 0, 0))).tolist()
    assert corners(tree.leaves) == [[(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(1, 5, 0), (1, 6, 0), (0, 6, 0)]]
    assert tree.leaves.materials == [leaf]
    assert tree.trunk is not None
    assert corners(tree.trunk) == [[(-10, 0, 0), (-9, 0, 0), (-9, 1, 0)]]
    assert tree.trunk.materials == [bark]


def test_material_slots_divide_one_mesh_into_leaves_and_trunk() -> None:
    leaf, bark, twig = material("leaf"), material("bark"), material("twig")
    obj = add_mesh("tree", SQUARE, [(0, 1, 2), (0, 2, 3), (1, 2, 3)], materials=[bark, leaf, twig])
    obj.data.polygons.foreach_set("material_index", [0, 1, 2])
    tree = read()
    # The leaves contain no vertices of the trunk.
    assert tree.leaves.positions.tolist() == [list(SQUARE[i]) for i in (0, 2, 3)]
    assert tree.leaves.triangles.tolist() == [[0, 1, 2]]
    assert tree.leaves.materials == [leaf]
    assert tree.trunk is not None
    assert tree.trunk.materials == [bark, twig]
    assert tree.trunk.material_ids.tolist() == [0, 1]


def test_leaf_names_choose_the_leaves() -> None:
    leaf, bark = material("leaf"), material("bark")
    add_mesh("a", TRIANGLE, [(0, 1, 2)], materials=[leaf])
    add_mesh("b", SQUARE, [(0, 1, 2), (0, 2, 3)], materials=[bark])
    assert len(read(leaf_names=["bark"]).leaves.triangles) == 2
    with pytest.raises(SceneError, match="no object or material is named 'needles'; objects: 'a', 'b'; materials"):
        read(leaf_names=["needles"])


def test_many_small_components_are_leaves_if_no_name_matches() -> None:
    cards = [(x + dx, dy, 0.0) for x in range(0, 40, 2) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
    add_mesh("x", cards, [(i, i + 1, i + 2, i + 3) for i in range(0, len(cards), 4)])
    add_mesh("y", SQUARE, [(0, 1, 2), (0, 2, 3)])
    tree = read()
    # A single square is as small as a card, so both objects are leaves.
    assert len(tree.leaves.triangles) == 42
    assert tree.choice == (
        "'x', 'y': 21 small components (the median has 2 triangles), much of the surface, as wide as the tree; "
        "there are no leaf names."
    )


def test_unselected_objects_are_left_out() -> None:
    first = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    add_mesh("leaf2", TRIANGLE, [(0, 1, 2)])
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.collection.objects.link(light)
    bpy.context.view_layer.objects.active = first
    tree = read([first, light])
    assert len(tree.leaves.triangles) == 1
    assert tree.name == "leaf"
    assert tree.dropped == ["'Light' has no faces, or is hidden"]


def test_hidden_objects_are_left_out() -> None:
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    add_mesh("hidden", TRIANGLE, [(0, 1, 2)]).hide_viewport = True
    add_mesh("cutter", TRIANGLE, [(0, 1, 2)]).hide_render = True
    tree = read()
    assert tree.trunk is None
    assert tree.dropped == ["'cutter' is hidden in renders"]


def test_an_empty_selection_and_an_empty_scene_raise() -> None:
    with pytest.raises(SceneError, match="nothing is selected; select the objects of the tree"):
        read([])
    with pytest.raises(SceneError, match="there are no faces: no visible objects"):
        read()


def test_a_mesh_without_faces_raises_or_is_dropped() -> None:
    empty = add_mesh("leaf", SQUARE, [], edges=[(0, 1)])
    with pytest.raises(SceneError, match="there are no faces: 'leaf' has no faces"):
        read()
    with pytest.raises(SceneError, match="there are no faces: 'leaf' has no faces, or is hidden"):
        read([empty])
    add_mesh("leaf2", TRIANGLE, [(0, 1, 2)])
    assert read().dropped == ["'leaf' has no faces"]


def test_loose_vertices_and_edges_are_dropped_and_reported() -> None:
    add_mesh("leaf", [*SQUARE, (5.0, 5.0, 5.0), (6.0, 6.0, 6.0)], [(0, 1, 2)], edges=[(2, 3)])
    tree = read()
    assert len(tree.leaves.positions) == 3
    assert tree.dropped == ["'leaf': 3 vertices and 1 edge without a face"]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_coordinates_that_are_not_finite_raise(bad: float) -> None:
    obj = add_mesh("leaf", SQUARE, [(0, 1, 2, 3)])
    # Setting the property would clamp infinity.
    coordinates = np.array(SQUARE, np.float32)
    coordinates[2] = (0.5, bad, 0.0)
    obj.data.attributes["position"].data.foreach_set("vector", coordinates.ravel())
    with pytest.raises(SceneError) as caught:
        read()
    assert str(caught.value) == (
        f"object 'leaf': vertex 2 lies at (0.5, {bad:g}, 0), which is not finite; move or delete it"
    )


def test_modifiers_are_applied() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    array = obj.modifiers.new("Array", "ARRAY")
    array.count = 3
    array.relative_offset_displace = (2.0, 0.0, 0.0)
    assert [triangle[0] for triangle in corners(read().leaves)] == [(0, 0, 0), (2, 0, 0), (4, 0, 0)]


def test_curves_are_converted_to_meshes() -> None:
    curve = bpy.data.curves.new("stem", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = 0.1
    curve.materials.append(material("bark"))
    points = curve.splines.new("POLY").points
    points.add(1)
    points[1].co = (0.0, 0.0, 1.0, 1.0)
    bpy.context.collection.objects.link(bpy.data.objects.new("stem", curve))
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    tree = read()
    assert tree.trunk is not None
    assert len(tree.trunk.triangles) == 24  # 12 sides of two triangles
    assert [found.name for found in tree.trunk.materials] == ["bark"]


def test_geometry_node_instances_of_an_object_are_read() -> None:
    leaf = material("leaf")
    card = add_mesh("card", TRIANGLE, [(0, 1, 2)], materials=[leaf], link=False)
    points = add_mesh("crown", [(0, 0, 0), (3, 0, 0), (0, 4, 0)], [(0, 1, 2)], matrix=Matrix.Translation((0, 0, 7)))
    points.modifiers.new("scatter", "NODES").node_group = scatter_group(card, (2.0, 2.0, 2.0))
    tree = read()
    assert tree.matrix.tolist() == np.array(Matrix.Translation((0, 0, 7))).tolist()  # of the scattering object
    expected = [[(x, y, 0), (x + 2, y, 0), (x + 2, y + 2, 0)] for x, y in ((0, 0), (3, 0), (0, 4))]
    assert corners(tree.leaves) == expected
    assert tree.leaves.materials == [leaf]
    assert tree.trunk is None
    assert len(read(leaf_names=["crown"]).leaves.triangles) == 3
    assert len(read([points]).leaves.triangles) == 3


def test_geometry_node_instances_of_a_mesh_are_read() -> None:
    points = add_mesh("leaves", [(0, 0, 0), (3, 0, 0)], [], edges=[(0, 1)])
    points.modifiers.new("scatter", "NODES").node_group = scatter_group(None)
    tree = read()
    assert len(tree.leaves.triangles) == 2 * 12
    assert sorted({x for x, _, _ in tree.leaves.positions.tolist()}) == [-0.5, 0.5, 2.5, 3.5]
    assert tree.dropped == []


def test_instances_scaled_to_nothing_are_dropped() -> None:
    card = add_mesh("card", TRIANGLE, [(0, 1, 2)], link=False)
    points = add_mesh("crown", [(0, 0, 0), (3, 0, 0)], [], edges=[(0, 1)])
    points.modifiers.new("scatter", "NODES").node_group = scatter_group(card, (1.0, 1.0, 0.0))
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    tree = read()
    assert len(tree.leaves.triangles) == 1
    assert tree.dropped == ["2 copies of 'card' by 'crown', scaled to zero"]


def test_mirrored_collection_instances_keep_their_normals() -> None:
    leaf = material("leaf")
    library = bpy.data.collections.new("library")
    library.objects.link(add_mesh("card", TRIANGLE, [(0, 1, 2)], materials=[leaf], link=False))
    for name, place, mirror in (("a", 0, 1), ("b", 5, -1)):
        empty = bpy.data.objects.new(name, None)
        empty.instance_type = "COLLECTION"
        empty.instance_collection = library
        empty.location.x, empty.scale.x = place, mirror
        bpy.context.collection.objects.link(empty)
    tree = read()
    # Two corners of the mirrored copy are swapped, so its winding still matches its normal.
    assert corners(tree.leaves) == [[(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(5, 0, 0), (4, 1, 0), (4, 0, 0)]]
    assert tree.leaves.normals.tolist() == [[[0, 0, 1]] * 3] * 2


def test_materials_linked_to_the_object_are_read() -> None:
    of_mesh, of_object = material("bark"), material("leaf")
    obj = add_mesh("x", TRIANGLE, [(0, 1, 2)], materials=[of_mesh])
    obj.material_slots[0].link = "OBJECT"
    obj.material_slots[0].material = of_object
    assert read().leaves.materials == [of_object]


def test_the_first_leaf_object_keeps_its_coordinates_and_others_are_transformed() -> None:
    turn = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (1, 2, 3)) @ Matrix.Diagonal((2.0, 3.0, 0.5, 1.0))
    place = Matrix.Translation((-4, 0, 9)) @ Matrix.Rotation(-1.1, 4, "Y") @ Matrix.Diagonal((0.25, 1.0, 7.0, 1.0))
    points = np.random.default_rng(3).normal(size=(3, 3)).astype(np.float32)
    add_mesh("leaf a", [tuple(point) for point in points.tolist()], [(0, 1, 2)], matrix=turn)
    add_mesh("leaf b", TRIANGLE, [(0, 1, 2)], matrix=place)
    tree = read()
    assert tree.leaves.positions[:3].tobytes() == points.tobytes()
    np.testing.assert_allclose(
        world_positions(tree.leaves, tree.matrix)[3:], [place @ Matrix.Translation(p).translation for p in SQUARE[:3]],
        atol=1e-5,
    )  # fmt: skip
    # In world space normals are perpendicular to their triangles at any scale.
    normals = tree.leaves.normals[1] @ np.linalg.inv(tree.matrix[:3, :3])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, winding_normals(tree.leaves, tree.matrix)[[1, 1, 1]], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(tree.leaves.normals, axis=2), 1.0, atol=1e-6)


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (1.0, 0.0, 1.0)])
def test_a_singular_matrix_raises(scale: tuple[float, float, float]) -> None:
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)], matrix=Matrix.Diagonal((*scale, 1.0)))
    shown = ", ".join(f"{length:g}" for length in scale)
    with pytest.raises(SceneError) as caught:
        read()
    assert str(caught.value) == (
        f"the matrix of object 'leaf' is singular (scale {shown}); give it a scale without zeros"
    )


def test_the_same_scene_gives_the_same_bytes() -> None:
    for name in ("leaf z", "leaf a", "leaf m"):
        add_mesh(name, SQUARE, [(0, 1, 2, 3)], matrix=Matrix.Rotation(len(name) + ord(name[-1]), 4, "Z"))
    first, second = read(), read()
    for field in ("positions", "triangles", "normals", "material_ids"):
        assert getattr(first.leaves, field).tobytes() == getattr(second.leaves, field).tobytes()


def test_the_shrub_of_the_repository_is_read(shrub: Path) -> None:
    load(shrub)
    tree = read()
    assert tree.trunk is not None
    assert len(tree.leaves.triangles) == 672 * 2
    assert tree.leaves.uvs is not None
    assert tree.warnings == []


@pytest.mark.parametrize(
    ("file", "leaf_triangles", "trunk_triangles"),
    [
        ("bush_ash_5k", 4992, 8880),
        ("douglas_fir_105k", 104908, 0),
        ("maple_13k", 14696, 0),
        ("oak_cards_11k", 10640, 3166),
        ("pine_cards_20k", 20400, 12192),
        ("shapespark_tree1", 424, 222),
    ],
)
@pytest.mark.parametrize("named", [True, False])
def test_measured_trees_are_divided_into_leaves_and_trunk(
    foliage_dir: Path, file: str, leaf_triangles: int, trunk_triangles: int, named: bool
) -> None:
    load(foliage_dir / f"{file}.glb")
    if not named:
        for data in (*bpy.data.objects, *bpy.data.materials):
            data.name = "part"
    tree = read()
    assert len(tree.leaves.triangles) == leaf_triangles
    assert (0 if tree.trunk is None else len(tree.trunk.triangles)) == trunk_triangles
    assert (tree.warnings, tree.dropped) == ([], [])


def test_a_million_triangles_are_read_bit_for_bit(foliage_dir: Path) -> None:
    load(foliage_dir / "maple_1m.glb")
    tree = extract(bpy.context.evaluated_depsgraph_get(), None)
    assert len(tree.leaves.triangles) == 1_000_352
    source = np.empty(len(bpy.data.meshes[0].vertices) * 3, np.float32)
    bpy.data.meshes[0].vertices.foreach_get("co", source)
    assert tree.leaves.positions.tobytes() == source.tobytes()
