"""Extraction of corner data: winding and normals, texture coordinates, colors."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import SQUARE, TRIANGLE, add_mesh, corners, material, read, use_nodes, winding_normals
from small_glb import png, write_quad_glb

from addon.material.describe import texture_uvs
from addon.scene.load import load

pytestmark = pytest.mark.version

WHITE = png([[(255, 255, 255, 255)]])


@pytest.mark.parametrize("frame_mirrors", [False, True])
@pytest.mark.parametrize("part_mirrors", [False, True])
def test_winding_agrees_with_normals(frame_mirrors: bool, part_mirrors: bool) -> None:
    """They always agree in the tree's coordinates. In the world, a mirroring matrix flips all triangles together."""
    upright = Matrix.Rotation(0.4, 4, "X")
    mirror = upright @ Matrix.Diagonal((-1.0, 2.0, 1.0, 1.0))
    add_mesh("leaf a", TRIANGLE, [(0, 1, 2)], matrix=mirror if frame_mirrors else upright)
    add_mesh("leaf b", TRIANGLE, [(0, 1, 2)], matrix=mirror if part_mirrors else upright)
    tree = read()
    assert tree.leaves.positions[:3].tolist() == [list(point) for point in SQUARE[:3]]
    np.testing.assert_allclose(winding_normals(tree.leaves, np.eye(4)), tree.leaves.normals[:, 0], atol=1e-6)
    # Blender shows the upper side as the front of both, with and without mirroring.
    up = np.array(upright.col[2][:3])
    flip = -1.0 if frame_mirrors else 1.0
    np.testing.assert_allclose(winding_normals(tree.leaves, tree.matrix) * flip, [up, up], atol=1e-6)


def test_mirrored_parts_swap_all_corner_data() -> None:
    add_mesh("leaf a", TRIANGLE, [(0, 1, 2)])
    part = add_mesh("leaf b", TRIANGLE, [(0, 1, 2)])
    part.scale.x = -1
    part.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    tree = read()
    assert corners(tree.leaves)[1] == [(0, 0, 0), (-1, 1, 0), (-1, 0, 0)]
    assert tree.leaves.uvs is not None
    expected = np.array([[[0, 0]] * 3, [[0.1, 0.2], [0.5, 0.6], [0.3, 0.4]]], np.float32)
    assert tree.leaves.uvs.tolist() == expected.tolist()  # Objects without texture coordinates get zeros.


def test_custom_normals_come_along() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.normals_split_custom_set([(0.0, 0.6, 0.8)] * 3)
    np.testing.assert_allclose(read().leaves.normals, [[(0.0, 0.6, 0.8)] * 3], atol=1e-3)


def test_the_active_render_uv_map_is_read() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.uv_layers.new(name="first").uv.foreach_set("vector", [0.0] * 6)
    second = obj.data.uv_layers.new(name="second")
    second.uv.foreach_set("vector", [0.25] * 6)
    obj.data.uv_layers["second"].active_render = True
    uvs = read().leaves.uvs
    assert uvs is not None
    assert (uvs == 0.25).all()


def test_texture_coordinates_that_are_not_finite_become_0() -> None:
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)])
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0.5, math.nan, 0.5, 0.5, 0.5, 0.5])
    tree = read()
    assert tree.leaves.uvs is not None
    assert tree.leaves.uvs[0].tolist() == [[0.5, 0.0], [0.5, 0.5], [0.5, 0.5]]
    assert tree.warnings == ["object 'leaf' has texture coordinates that are not finite: they are set to 0"]


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
    # The importer converts Y up to Z up: (x, y, 0) lies at (x, 0, y).
    assert by_corner == {(x, -0.0, y): color for (x, y, _), color in zip(SQUARE, colors, strict=True)}


@pytest.mark.parametrize("place", ["POINT", "CORNER"])
def test_a_named_attribute_may_be_the_texture_coordinates(place: str) -> None:
    """Geometry nodes store such attributes, and an Attribute node reads them. The active render map is another one."""
    shader = material("leaf")
    use_nodes(shader)
    tree = shader.node_tree
    image, attribute = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeAttribute")
    image.image, attribute.attribute_name = bpy.data.images.new("i", 4, 4), "stored"
    tree.links.new(attribute.outputs["Vector"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    obj = add_mesh("leaf", TRIANGLE, [(0, 1, 2)], materials=[shader])
    obj.data.uv_layers.new(name="UVMap")
    expected = [(0.125, 0.5), (0.75, 0.25), (0.5, 1.0)]
    stored = obj.data.attributes.new("stored", "FLOAT2", place)
    stored.data.foreach_set("vector", np.array(expected, np.float32).ravel())
    tree_read = read()
    assert tree_read.leaves.uvs is not None
    np.testing.assert_array_equal(tree_read.leaves.uvs[0], expected)
    assert tree_read.warnings == []


def test_colors_are_linear_and_read_only_if_a_material_uses_them() -> None:
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
    for place, kind, field in [("FACE", "FLOAT_COLOR", "color"), ("POINT", "FLOAT_VECTOR", "vector")]:
        node.layer_name = place
        stored = obj.data.attributes.new(place, kind, place)
        stored.data.foreach_set(field, [0.125, 0.5, 0.25, 1.0][: 4 if field == "color" else 3] * len(stored.data))
        colors = read().leaves.colors
        assert colors is not None
        np.testing.assert_array_equal(colors[0], [(0.125, 0.5, 0.25, 1.0)] * 3)
    node.layer_name = "gone"
    tree = read()
    assert tree.leaves.colors is not None
    np.testing.assert_array_equal(tree.leaves.colors[0], [(0.0, 0.0, 0.0, 1.0)] * 3)
    assert (tree.leaves.colors[1] == 1.0).all()
    assert tree.warnings == [
        "object 'leaf' has no color attribute 'gone' for material 'tinted': it counts as black with alpha 0, as in "
        "Blender; add that attribute"
    ]


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
    assert warning.startswith("object 'leaves' uses the image 'Image_0' (extend) outside [0, 1]")
