"""Extraction: what the evaluated scene shows, as arrays."""

from __future__ import annotations

import math
import time
import warnings
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from small_glb import png, write_quad_glb

from addon.scene.extract import Geometry, SceneError, Tree, extract, texture_uvs, world_positions
from addon.scene.load import load

SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
TRIANGLE = SQUARE[:3]
WHITE = png([[(255, 255, 255, 255)]])


def add_mesh(
    name: str,
    vertices: list[tuple[float, float, float]],
    faces: list[tuple[int, ...]],
    *,
    edges: list[tuple[int, int]] | None = None,
    materials: list[bpy.types.Material] | None = None,
    matrix: Matrix | None = None,
    link: bool = True,
) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges or [], faces)
    for material in materials or []:
        mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    obj.matrix_world = matrix or Matrix()
    if link:
        bpy.context.collection.objects.link(obj)
    return obj


def material(name: str) -> bpy.types.Material:
    return bpy.data.materials.new(name)


def use_nodes(material: bpy.types.Material) -> None:
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates the setting
        warnings.simplefilter("ignore", DeprecationWarning)
        material.use_nodes = True


def read(objects: list[bpy.types.Object] | None = None, leaf_names: list[str] | None = None) -> Tree:
    return extract(bpy.context.evaluated_depsgraph_get(), objects, leaf_names=leaf_names)


def corners(geometry: Geometry) -> list[list[tuple[float, ...]]]:
    """The coordinates of each triangle's corners."""
    return [[tuple(corner) for corner in triangle] for triangle in geometry.positions[geometry.triangles].tolist()]


def winding_normals(geometry: Geometry, matrix: np.ndarray) -> np.ndarray:
    """(t, 3) in the world, by the right-hand rule."""
    a, b, c = world_positions(geometry, matrix)[geometry.triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def scatter_group(source: bpy.types.Object | None, scale: tuple[float, float, float] = (1, 1, 1)) -> bpy.types.NodeTree:
    """Geometry nodes that place an object, or a cube of their own without one, on every point; the points go."""
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


def test_a_square_bit_for_bit() -> None:
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
    assert (tree.matrix.tolist(), tree.wood, tree.dropped, tree.warnings) == (np.eye(4).tolist(), None, [], [])
    assert (tree.name, tree.choice) == ("leaf", "'leaf': the names say leaf, leaves, foliage, needle or frond.")


def test_polygons_become_triangles_that_cover_them() -> None:
    pentagon = [(2.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 2.0, 0.0), (3.0, 1.0, 0.0), (2.0, 2.0, 0.0)]
    add_mesh("leaf", SQUARE + pentagon, [(0, 1, 2, 3), (4, 5, 6, 7, 8)])
    triangles = np.array(corners(read().leaves))
    assert len(triangles) == 2 + 3
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2] / 2
    assert (areas > 0).all()  # the pentagon is concave: a fan would turn a triangle over
    assert areas.sum() == 1.0 + 3.0


def test_several_objects_and_materials() -> None:
    leaf, bark = material("leaf"), material("bark")
    add_mesh("b", TRIANGLE, [(0, 1, 2)], materials=[bark])
    add_mesh("a", TRIANGLE, [(0, 1, 2)], materials=[leaf], matrix=Matrix.Translation((10, 0, 0)))
    add_mesh("c", SQUARE[1:], [(0, 1, 2)], materials=[leaf], matrix=Matrix.Translation((10, 5, 0)))
    tree = read()
    assert tree.matrix.tolist() == np.array(Matrix.Translation((10, 0, 0))).tolist()
    assert corners(tree.leaves) == [[(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(1, 5, 0), (1, 6, 0), (0, 6, 0)]]
    assert tree.leaves.materials == [leaf]
    assert tree.wood is not None
    assert corners(tree.wood) == [[(-10, 0, 0), (-9, 0, 0), (-9, 1, 0)]]
    assert tree.wood.materials == [bark]


def test_leaf_and_wood_slots_of_one_mesh() -> None:
    leaf, bark, twig = material("leaf"), material("bark"), material("twig")
    obj = add_mesh("tree", SQUARE, [(0, 1, 2), (0, 2, 3), (1, 2, 3)], materials=[bark, leaf, twig])
    obj.data.polygons.foreach_set("material_index", [0, 1, 2])
    tree = read()
    # Vertices of the other part do not come along.
    assert tree.leaves.positions.tolist() == [list(SQUARE[i]) for i in (0, 2, 3)]
    assert tree.leaves.triangles.tolist() == [[0, 1, 2]]
    assert tree.leaves.materials == [leaf]
    assert tree.wood is not None
    assert tree.wood.materials == [bark, twig]
    assert tree.wood.material_ids.tolist() == [0, 1]


def test_names_given_choose_other_leaves() -> None:
    leaf, bark = material("leaf"), material("bark")
    add_mesh("a", TRIANGLE, [(0, 1, 2)], materials=[leaf])
    add_mesh("b", SQUARE, [(0, 1, 2), (0, 2, 3)], materials=[bark])
    assert len(read(leaf_names=["bark"]).leaves.triangles) == 2
    with pytest.raises(SceneError, match="no object or material is named 'needles'; objects: 'a', 'b'; materials"):
        read(leaf_names=["needles"])


def test_many_small_components_without_names() -> None:
    cards = [(x + dx, dy, 0.0) for x in range(0, 40, 2) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
    add_mesh("x", cards, [(i, i + 1, i + 2, i + 3) for i in range(0, len(cards), 4)])
    add_mesh("y", SQUARE, [(0, 1, 2), (0, 2, 3)])
    tree = read()
    # A lone square is as small as a card: one kind.
    assert tree.choice == "'x', 'y': 21 small components (the median has 2 triangles), and no name says leaf."


def test_objects_that_are_not_chosen_stay_out() -> None:
    first = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    add_mesh("leaf2", TRIANGLE, [(0, 1, 2)])
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.collection.objects.link(light)
    bpy.context.view_layer.objects.active = first
    tree = read([first, light])
    assert len(tree.leaves.triangles) == 1
    assert tree.name == "leaf"
    assert tree.dropped == ["'Light' has no faces, or is hidden"]


def test_hidden_objects_stay_out() -> None:
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    add_mesh("hidden", TRIANGLE, [(0, 1, 2)]).hide_viewport = True
    add_mesh("cutter", TRIANGLE, [(0, 1, 2)]).hide_render = True
    tree = read()
    assert tree.wood is None
    assert tree.dropped == ["'cutter' is hidden in renders"]


def test_empty_selection_and_empty_scene() -> None:
    with pytest.raises(SceneError, match="nothing is selected; select the objects of the tree"):
        read([])
    with pytest.raises(SceneError, match="there are no faces: no visible objects"):
        read()


def test_a_mesh_without_faces() -> None:
    empty = add_mesh("leaf", SQUARE, [], edges=[(0, 1)])
    with pytest.raises(SceneError, match="there are no faces: 'leaf' has no faces"):
        read()
    with pytest.raises(SceneError, match="there are no faces: 'leaf' has no faces, or is hidden"):
        read([empty])
    add_mesh("leaf2", TRIANGLE, [(0, 1, 2)])
    assert read().dropped == ["'leaf' has no faces"]


def test_loose_parts_are_dropped_and_told() -> None:
    add_mesh("leaf", [*SQUARE, (5.0, 5.0, 5.0), (6.0, 6.0, 6.0)], [(0, 1, 2)], edges=[(2, 3)])
    tree = read()
    assert len(tree.leaves.positions) == 3
    assert tree.dropped == ["'leaf': 3 vertices and 1 edge of no face"]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_coordinates_that_are_not_finite(bad: float) -> None:
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


def test_curves_count_with_their_meshes() -> None:
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
    assert tree.wood is not None
    assert len(tree.wood.triangles) == 24  # 12 sides of two triangles
    assert [found.name for found in tree.wood.materials] == ["bark"]


def test_geometry_node_instances_of_an_object() -> None:
    leaf = material("leaf")
    card = add_mesh("card", TRIANGLE, [(0, 1, 2)], materials=[leaf], link=False)
    points = add_mesh("crown", [(0, 0, 0), (3, 0, 0), (0, 4, 0)], [(0, 1, 2)], matrix=Matrix.Translation((0, 0, 7)))
    points.modifiers.new("scatter", "NODES").node_group = scatter_group(card, (2.0, 2.0, 2.0))
    tree = read()
    assert tree.matrix.tolist() == np.array(Matrix.Translation((0, 0, 7))).tolist()  # of what places the leaves
    expected = [[(x, y, 0), (x + 2, y, 0), (x + 2, y + 2, 0)] for x, y in ((0, 0), (3, 0), (0, 4))]
    assert corners(tree.leaves) == expected
    assert tree.leaves.materials == [leaf]
    assert tree.wood is None
    assert len(read(leaf_names=["crown"]).leaves.triangles) == 3
    assert len(read([points]).leaves.triangles) == 3


def test_geometry_node_instances_of_a_mesh() -> None:
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
    assert tree.dropped == ["2 copies of 'card' by 'crown', scaled to nothing"]


def test_collection_instances_also_mirrored() -> None:
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
    # The mirrored copy swaps two corners, so that it still winds about its normal.
    assert corners(tree.leaves) == [[(0, 0, 0), (1, 0, 0), (1, 1, 0)], [(5, 0, 0), (4, 1, 0), (4, 0, 0)]]
    assert tree.leaves.normals.tolist() == [[[0, 0, 1]] * 3] * 2


def test_materials_linked_to_the_object() -> None:
    of_mesh, of_object = material("bark"), material("leaf")
    obj = add_mesh("x", TRIANGLE, [(0, 1, 2)], materials=[of_mesh])
    obj.material_slots[0].link = "OBJECT"
    obj.material_slots[0].material = of_object
    assert read().leaves.materials == [of_object]


def test_a_transformed_frame_keeps_its_bits_and_carries_others() -> None:
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
    # In the world, normals stand upright on their triangles, whatever the scales.
    normals = tree.leaves.normals[1] @ np.linalg.inv(tree.matrix[:3, :3])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, winding_normals(tree.leaves, tree.matrix)[[1, 1, 1]], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(tree.leaves.normals, axis=2), 1.0, atol=1e-6)


@pytest.mark.parametrize("frame_mirrors", [False, True])
@pytest.mark.parametrize("part_mirrors", [False, True])
def test_winding_agrees_with_normals(frame_mirrors: bool, part_mirrors: bool) -> None:
    """In the tree's coordinates always; in the world, triangles flip together where the frame's matrix mirrors."""
    upright = Matrix.Rotation(0.4, 4, "X")
    mirror = upright @ Matrix.Diagonal((-1.0, 2.0, 1.0, 1.0))
    add_mesh("leaf a", TRIANGLE, [(0, 1, 2)], matrix=mirror if frame_mirrors else upright)
    add_mesh("leaf b", TRIANGLE, [(0, 1, 2)], matrix=mirror if part_mirrors else upright)
    tree = read()
    assert tree.leaves.positions[:3].tolist() == [list(point) for point in SQUARE[:3]]
    np.testing.assert_allclose(winding_normals(tree.leaves, np.eye(4)), tree.leaves.normals[:, 0], atol=1e-6)
    # Blender shows the upper side as the front of both, mirrored or not.
    up = np.array(upright.col[2][:3])
    flip = -1.0 if frame_mirrors else 1.0
    np.testing.assert_allclose(winding_normals(tree.leaves, tree.matrix) * flip, [up, up], atol=1e-6)


def test_mirrored_parts_swap_all_that_lies_at_corners() -> None:
    add_mesh("leaf a", TRIANGLE, [(0, 1, 2)])
    part = add_mesh("leaf b", TRIANGLE, [(0, 1, 2)])
    part.scale.x = -1
    part.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    tree = read()
    assert corners(tree.leaves)[1] == [(0, 0, 0), (-1, 1, 0), (-1, 0, 0)]
    assert tree.leaves.uvs is not None
    expected = np.array([[[0, 0]] * 3, [[0.1, 0.2], [0.5, 0.6], [0.3, 0.4]]], np.float32)
    assert tree.leaves.uvs.tolist() == expected.tolist()  # zeros where an object has none


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (1.0, 0.0, 1.0)])
def test_a_singular_matrix(scale: tuple[float, float, float]) -> None:
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)], matrix=Matrix.Diagonal((*scale, 1.0)))
    shown = ", ".join(f"{length:g}" for length in scale)
    with pytest.raises(SceneError) as caught:
        read()
    assert str(caught.value) == (
        f"the matrix of object 'leaf' is singular (scale {shown}); give it a scale without zeros"
    )


def test_custom_normals_come_along() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.normals_split_custom_set([(0.0, 0.6, 0.8)] * 3)
    np.testing.assert_allclose(read().leaves.normals, [[(0.0, 0.6, 0.8)] * 3], atol=1e-3)


def test_the_uv_map_that_renders() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.uv_layers.new(name="first").uv.foreach_set("vector", [0.0] * 6)
    second = obj.data.uv_layers.new(name="second")
    second.uv.foreach_set("vector", [0.25] * 6)
    obj.data.uv_layers["second"].active_render = True
    uvs = read().leaves.uvs
    assert uvs is not None
    assert (uvs == 0.25).all()


def test_texture_coordinates_that_are_not_finite() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0.5, math.nan, 0.5, 0.5, 0.5, 0.5])
    tree = read()
    assert tree.leaves.uvs is not None
    assert tree.leaves.uvs[0].tolist() == [[0.5, 0.0], [0.5, 0.5], [0.5, 0.5]]
    assert tree.warnings == ["object 'leaf' has texture coordinates that are not finite: 0 stands for them"]


def test_vertex_colours_of_a_glb(tmp_path: Path) -> None:
    colors = [(1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0)]
    masked = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    load(write_quad_glb(tmp_path / "a.glb", material=masked, image=WHITE, colors=colors))
    tree = read()
    assert tree.leaves.colors is not None
    by_corner = {
        tuple(position): tuple(color)
        for position, color in zip(
            tree.leaves.positions[tree.leaves.triangles].reshape(-1, 3).tolist(),
            tree.leaves.colors.reshape(-1, 4).tolist(),
            strict=True,
        )
    }
    # The importer turns Y up into Z up: (x, y, 0) lies at (x, 0, y).
    assert by_corner == {(x, -0.0, y): color for (x, y, _), color in zip(SQUARE, colors, strict=True)}


def test_colours_are_linear_and_only_where_a_material_asks() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)], materials=[material("plain")])
    attribute = obj.data.color_attributes.new("Col", "BYTE_COLOR", "POINT")
    attribute.data.foreach_set("color_srgb", [188 / 255, 0.0, 1.0, 1.0] * 4)
    assert read().leaves.colors is None
    shader = material("tinted")
    use_nodes(shader)
    node = shader.node_tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Col"
    shader.node_tree.links.new(node.outputs["Color"], shader.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    obj.data.materials[0] = shader
    add_mesh("leaf2", TRIANGLE, [(0, 1, 2)])
    colors = read().leaves.colors
    assert colors is not None
    np.testing.assert_allclose(colors[0], [(0.5029, 0.0, 1.0, 1.0)] * 3, atol=1e-4)
    assert (colors[1] == 1.0).all()
    node.layer_name = "gone"
    tree = read()
    assert tree.leaves.colors is None
    assert tree.warnings == ["object 'leaf' has no colour attribute 'gone' for 'tinted': white stands for it"]


def test_texture_coordinates_through_a_mapping(tmp_path: Path) -> None:
    transform = {"offset": [0.5, 0.0], "scale": [0.5, 0.25]}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    masked = {"pbrMetallicRoughness": {"baseColorTexture": texture}}
    load(write_quad_glb(tmp_path / "a.glb", material=masked, image=WHITE))
    tree = read()
    looked_up = texture_uvs(tree.leaves)
    assert tree.leaves.uvs is not None
    assert looked_up is not None
    # In glTF v counts from the top: (u, v) looks up (0.5 + u / 2, v / 4), in Blender (0.5 + u / 2, 1 − (1 − v) / 4).
    expected = np.stack([0.5 + tree.leaves.uvs[..., 0] / 2, 1 - (1 - tree.leaves.uvs[..., 1]) / 4], axis=2)
    np.testing.assert_allclose(looked_up, expected, atol=1e-6)
    assert {tuple(uv) for uv in tree.leaves.uvs.reshape(-1, 2).tolist()} == {(0, 0), (1, 0), (1, 1), (0, 1)}


def test_texture_coordinates_without_a_mapping_are_the_same() -> None:
    add_mesh("leaf", TRIANGLE, [(0, 1, 2)]).data.uv_layers.new(name="UVMap")
    geometry = read().leaves
    assert texture_uvs(geometry) is geometry.uvs


def test_a_texture_that_is_clamped_where_it_should_repeat(tmp_path: Path) -> None:
    textured = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    clamped = {"wrapS": 33071, "wrapT": 33071}
    load(write_quad_glb(tmp_path / "a.glb", material=textured, image=WHITE, sampler=clamped))
    assert read().warnings == []
    layer = bpy.data.meshes[0].uv_layers[0]
    layer.uv.foreach_set("vector", np.full(len(layer.uv) * 2, 1.5, np.float32))
    bpy.data.meshes[0].update()
    (warning,) = read().warnings
    assert warning.startswith("object 'leaves' uses the image 'Image_0' (extend) outside of [0, 1]")


def test_the_same_scene_gives_the_same_bytes() -> None:
    for name in ("leaf z", "leaf a", "leaf m"):
        add_mesh(name, SQUARE, [(0, 1, 2, 3)], matrix=Matrix.Rotation(len(name) + ord(name[-1]), 4, "Z"))
    first, second = read(), read()
    for field in ("positions", "triangles", "normals", "material_ids"):
        assert getattr(first.leaves, field).tobytes() == getattr(second.leaves, field).tobytes()


def test_the_tree_that_comes_with_the_repository(shrub: Path) -> None:
    load(shrub)
    tree = read()
    assert tree.wood is not None
    assert len(tree.leaves.triangles) == 672 * 2
    assert tree.leaves.uvs is not None
    assert tree.warnings == []


@pytest.mark.parametrize(
    ("file", "leaf_triangles", "wood_triangles"),
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
def test_measured_trees(foliage_dir: Path, file: str, leaf_triangles: int, wood_triangles: int, named: bool) -> None:
    load(foliage_dir / f"{file}.glb")
    if not named:
        for data in (*bpy.data.objects, *bpy.data.materials):
            data.name = "part"
    tree = read()
    assert len(tree.leaves.triangles) == leaf_triangles
    assert (0 if tree.wood is None else len(tree.wood.triangles)) == wood_triangles
    assert (tree.warnings, tree.dropped) == ([], [])


def test_a_million_triangles_take_seconds(foliage_dir: Path) -> None:
    load(foliage_dir / "maple_1m.glb")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    start = time.perf_counter()
    tree = extract(depsgraph, None)
    assert time.perf_counter() - start < 10.0
    assert len(tree.leaves.triangles) == 1_000_352
    source = np.empty(len(bpy.data.meshes[0].vertices) * 3, np.float32)
    bpy.data.meshes[0].vertices.foreach_get("co", source)
    assert tree.leaves.positions.tobytes() == source.tobytes()
