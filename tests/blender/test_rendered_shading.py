"""Roughness, metallic and normals rendered from node trees, compared with the nodes in Blender's manual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import math_node, new_image, new_material, texture_node
from scenes import SQUARE, add_mesh

from addon.material.describe import describe_material, describe_materials, unit_sizes
from addon.material.shading import read_shading, reflection_of
from addon.material.surface import read_surface
from addon.mesh.extract import extract

CHANNELS = ("normals", "orm")


def data_node(tree: Any, rows: list[list[tuple[float, ...]]]) -> bpy.types.Node:
    """Return an image node with data and without interpolation."""
    node = texture_node(tree, new_image("data", [[(*pixel, 1.0) for pixel in row] for row in rows], space="Non-Color"))
    node.interpolation = "Closest"
    return node


def normal_map(tree: Any, color: bpy.types.NodeSocket, strength: float = 1.0) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.inputs["Strength"].default_value = strength
    tree.links.new(color, node.inputs["Color"])
    return node


def ramp(tree: Any, axis: str, slope: float) -> bpy.types.Node:
    """Return a Bump node. The height grows by `slope` per unit along an axis of the UV map."""
    parts, bump = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeBump")
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], parts.inputs[0])
    tree.links.new(math_node(tree, "MULTIPLY", parts.outputs[axis], slope), bump.inputs["Height"])
    bump.inputs["Strength"].default_value = bump.inputs["Distance"].default_value = 1.0
    return bump


def codes_of(normal: Sequence[float]) -> list[int]:
    """Return the 8-bit codes of a normal, as in files: 0 is −1, 255 is 1."""
    unit = np.array(normal) / np.linalg.norm(normal)
    return np.rint(127.5 * (unit + 1.0)).astype(int).tolist()


def assert_codes(image: Any, expected: Any, *, off: int = 1) -> None:
    """Compare all texels except the rim, where a Bump node reads beyond the edge."""
    assert image is not None
    assert image.dtype == np.uint8
    inner = image[2:-2, 2:-2].astype(int)
    assert np.abs(inner - [*expected, 255]).max() <= off


def described(principled: bpy.types.Node, source: bpy.types.NodeSocket, name: str = "Normal") -> tuple[Any, str]:
    """Link a socket to an input. Return the description of the material and its only message."""
    tree = principled.id_data
    tree.links.new(source, principled.inputs[name])
    material = next(each for each in bpy.data.materials if each.node_tree == tree)
    description, [message] = describe_material(material, CHANNELS)
    return description, message


def leaves_of(material: bpy.types.Material, **options: Any) -> Any:
    obj = add_mesh("leaves", SQUARE, [(0, 1, 2, 3)], materials=[material], **options)
    return extract(bpy.context.evaluated_depsgraph_get(), [obj], leaf_names=["leaves"])


UNIT_SQUARE_UVS = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def lay(obj: bpy.types.Object, scale: float = 1.0) -> None:
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", (scale * np.array(UNIT_SQUARE_UVS)).ravel())


# Normals


@pytest.mark.parametrize("strength", [0.0, 0.5, 2.0])
def test_the_strength_of_a_normal_map_is_rendered(strength: float) -> None:
    """A strength up to 1 mixes the surface's normal with the map's, like glTF's scale. More scales only x and y."""
    _, principled, tree = new_material()
    normal = 2.0 * np.array((204, 102, 217)) / 255.0 - 1.0
    color = data_node(tree, [[(204 / 255, 102 / 255, 217 / 255)]]).outputs["Color"]
    description, message = described(principled, normal_map(tree, color, strength).outputs["Normal"])
    x, y, z = normal
    assert_codes(description["normal"], codes_of((strength * x, strength * y, 1.0 + min(strength, 1.0) * (z - 1.0))))
    assert message.startswith(
        "material 'm': its normals are more than a tangent-space map of strength 1; they are rendered"
    )
    assert "to an image of 64 × 64 texels; glTF level 0 uses Blender's own material export" in message


@pytest.mark.parametrize(("axis", "slope"), [("X", 0.5), ("Y", 0.5), ("Y", -2.0)])
def test_a_height_ramp_tilts_the_normal(axis: str, slope: float) -> None:
    """The surface z = slope · x has the normal (−slope, 0, 1)."""
    _, principled, tree = new_material()
    description, _ = described(principled, ramp(tree, axis, slope).outputs["Normal"])
    assert_codes(description["normal"], codes_of((-slope, 0.0, 1.0) if axis == "X" else (0.0, -slope, 1.0)))


def test_a_bump_is_as_steep_as_on_the_leaves() -> None:
    """One unit of the UV map is three meters long, so the same height gives a third of the slope."""
    material, principled, tree = new_material()
    tree.links.new(ramp(tree, "X", 0.9).outputs["Normal"], principled.inputs["Normal"])
    obj = add_mesh("leaves", SQUARE, [(0, 1, 2, 3)], materials=[material])
    side = np.ptp(np.array(SQUARE)[:, 0])
    lay(obj, float(side))
    found = extract(bpy.context.evaluated_depsgraph_get(), [obj], leaf_names=["leaves"])
    matrix = np.diag([3.0, 3.0, 3.0, 1.0])
    assert unit_sizes(found.leaves, matrix) == pytest.approx([3.0])
    result = describe_materials(found.leaves, CHANNELS, matrix)
    assert_codes(result.materials[0]["normal"], codes_of((-0.3, 0.0, 1.0)))


def test_a_bump_without_height_keeps_its_normal_map() -> None:
    _, principled, tree = new_material()
    bump = ramp(tree, "X", 0.0)
    tilted = normal_map(tree, data_node(tree, [[(0.8, 0.5, 0.9)]]).outputs["Color"])
    tree.links.new(tilted.outputs["Normal"], bump.inputs["Normal"])
    description, _ = described(principled, bump.outputs["Normal"])
    assert_codes(description["normal"], codes_of((0.6, 0.0, 0.8)))


def test_normals_between_texels_have_length_1() -> None:
    """The mean of two tilted normals is shorter than 1."""
    _, principled, tree = new_material()
    image = data_node(tree, [[(0.9, 0.5, 0.8), (0.1, 0.5, 0.8)]])
    image.interpolation = "Linear"
    description, _ = described(principled, normal_map(tree, image.outputs["Color"], 0.9).outputs["Normal"])
    lengths = np.linalg.norm(description["normal"][..., :3] / 127.5 - 1.0, axis=2)
    assert np.abs(lengths - 1.0).max() < 0.01
    assert np.ptp(description["normal"][..., 0].astype(int)) > 100


def test_the_rendering_is_not_upside_down() -> None:
    """The two halves of the image tilt to different sides."""
    _, principled, tree = new_material()
    image = data_node(tree, [[(0.8, 0.5, 0.9)], [(0.5, 0.8, 0.9)]])
    description, _ = described(principled, normal_map(tree, image.outputs["Color"], 0.999).outputs["Normal"])
    assert_codes(description["normal"][:32], codes_of((0.6, 0.0, 0.8)), off=2)
    assert_codes(description["normal"][32:], codes_of((0.0, 0.6, 0.8)), off=2)


def test_a_rendering_uses_the_mapping_of_the_base_color() -> None:
    """One Mapping node tiles both images twice, and the rendering is one tile. Another Mapping node gives a warning."""
    material, principled, tree = new_material()
    moved = tree.nodes.new("ShaderNodeMapping")
    moved.inputs["Scale"].default_value = (2.0, 2.0, 1.0)
    moved.inputs["Location"].default_value = (0.25, 0.0, 0.0)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], moved.inputs["Vector"])
    colors = texture_node(tree, new_image("colors", [[(1.0, 1.0, 1.0, 1.0)]]))
    image = data_node(tree, [[(0.8, 0.5, 0.9), (0.5, 0.8, 0.9)]])
    for node in (colors, image):
        tree.links.new(moved.outputs[0], node.inputs["Vector"])
    tree.links.new(colors.outputs["Color"], principled.inputs["Base Color"])
    description, _ = described(principled, normal_map(tree, image.outputs["Color"], 0.999).outputs["Normal"])
    assert_codes(description["normal"][:, :32], codes_of((0.6, 0.0, 0.8)), off=2)
    assert_codes(description["normal"][:, 32:], codes_of((0.0, 0.6, 0.8)), off=2)
    tree.links.remove(image.inputs["Vector"].links[0])
    [warning] = read_shading(material, read_surface(material).texture).warnings
    assert describe_material(material, CHANNELS)[0]["normal"] is None
    assert warning == (
        "material 'm': its normal and the base color use different Mapping nodes; mesh normals are used instead"
    )


@pytest.mark.parametrize(
    ("turn", "scale", "strength", "expected"),
    [
        (np.pi / 2, (1.0, 1.0), 1.0, (0.0, 0.6, 0.8)),
        (np.pi / 2, (1.0, 1.0), 0.999, (0.0, 0.6, 0.8)),
        (0.0, (-1.0, 1.0), 1.0, (-0.6, 0.0, 0.8)),
        (0.0, (3.0, 3.0), 0.999, (0.6, 0.0, 0.8)),
    ],
)
def test_a_mapping_node_turns_normals(
    turn: float, scale: tuple[float, float], strength: float, expected: tuple[float, ...]
) -> None:
    """Blender's tangent space has the axes of the UV map. The core's has the axes of the image."""
    _, principled, tree = new_material()
    moved = tree.nodes.new("ShaderNodeMapping")
    moved.inputs["Rotation"].default_value = (0.0, 0.0, turn)
    moved.inputs["Scale"].default_value = (*scale, 1.0)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], moved.inputs["Vector"])
    colors = texture_node(tree, new_image("colors", [[(1.0, 1.0, 1.0, 1.0)]]))
    image = data_node(tree, [[(0.8, 0.5, 0.9)]])
    for node in (colors, image):
        tree.links.new(moved.outputs[0], node.inputs["Vector"])
    tree.links.new(colors.outputs["Color"], principled.inputs["Base Color"])
    description, _ = described(principled, normal_map(tree, image.outputs["Color"], strength).outputs["Normal"])
    assert_codes(description["normal"], codes_of(expected), off=2)


@pytest.mark.parametrize("kind", ["object space", "other map", "no image", "position"])
def test_normals_that_cannot_be_rendered_give_a_warning(kind: str) -> None:
    material, principled, tree = new_material()
    image = data_node(tree, [[(0.8, 0.5, 0.9)]])
    node = normal_map(tree, image.outputs["Color"], 0.5)
    words = "come from the node 'Normal Map', not from tangent-space maps and bumps"
    if kind == "object space":
        node.space = "OBJECT"
    elif kind == "other map":
        layout = tree.nodes.new("ShaderNodeUVMap")
        layout.uv_map = "Other"
        tree.links.new(layout.outputs["UV"], image.inputs["Vector"])
        words = "uses the UV map 'Other', but the base color uses the active UV map"
    elif kind == "no image":
        image.image = None
        words = "depends on the node 'Image Texture', which has no image"
    else:
        node, words = tree.nodes.new("ShaderNodeNewGeometry"), "come from the node 'Geometry', not from tangent-space"
    tree.links.new(node.outputs["Position" if kind == "position" else "Normal"], principled.inputs["Normal"])
    shading = read_shading(material, None)
    assert shading.normal is None
    [warning] = shading.warnings
    assert words in warning
    assert warning.endswith("; mesh normals are used instead")


def test_leaves_without_a_uv_map_give_a_warning() -> None:
    material, principled, tree = new_material()
    tree.links.new(ramp(tree, "X", 0.5).outputs["Normal"], principled.inputs["Normal"])
    result = describe_materials(leaves_of(material).leaves, CHANNELS)
    [message] = result.messages
    assert message.endswith(
        "and its leaves have none; roughness 1, metallic 0 and mesh normals are used; unwrap the leaves"
    )
    assert result.materials[0]["normal"] is None


# Roughness and metallic


def test_an_image_multiplied_by_half_is_rendered() -> None:
    _, principled, tree = new_material()
    image = data_node(tree, [[(0.2, 0.2, 0.2)], [(0.8, 0.8, 0.8)]])
    principled.inputs["Metallic"].default_value = 0.4
    description, message = described(principled, math_node(tree, "MULTIPLY", image.outputs["Color"], 0.5), "Roughness")
    assert (description["roughness"], description["metallic"]) == (1.0, 1.0)
    assert_codes(description["orm"][:32], (255, 26, 102))
    assert_codes(description["orm"][32:], (255, 102, 102))
    assert "its roughness and metallic are neither constants nor channels of one image; they are rendered" in message


def test_values_are_clamped_before_averaging() -> None:
    """Cycles clamps roughness to [0, 1]: 3 · 0.2 stays 0.6, 3 · 0.8 becomes 1."""
    _, principled, tree = new_material()
    image = data_node(tree, [[(0.2, 0.2, 0.2)], [(0.8, 0.8, 0.8)]])
    description, _ = described(principled, math_node(tree, "MULTIPLY", image.outputs["Color"], 3.0), "Roughness")
    assert_codes(description["orm"][:32], (255, 153, 0))
    assert_codes(description["orm"][32:], (255, 255, 0))


def test_a_principled_bsdf_in_nested_groups_is_rendered() -> None:
    """The groups are two deep. An input of the outer group has the roughness."""
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    inner, outer = (bpy.data.node_groups.new(name, "ShaderNodeTree") for name in ("inner", "outer"))
    for group in (inner, outer):
        for name in ("Value", "Other"):
            group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat")
        group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    for group, kind, name in ((inner, "ShaderNodeBsdfPrincipled", "Roughness"), (outer, "ShaderNodeGroup", "Value")):
        start, end, node = (group.nodes.new(each) for each in ("NodeGroupInput", "NodeGroupOutput", kind))
        if kind == "ShaderNodeGroup":
            node.node_tree = inner
        group.links.new(start.outputs["Value"], node.inputs[name])
        group.links.new(node.outputs[0], end.inputs["Shader"])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = outer
    image = data_node(tree, [[(0.6, 0.6, 0.6)]])
    tree.links.new(image.outputs["Color"], node.inputs["Value"])
    tree.links.new(tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"], node.inputs["Other"])
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, [message] = describe_material(material, CHANNELS)
    assert_codes(description["orm"], (255, 153, 0))
    assert "dropped" not in message, "an input that does not reach the roughness is ignored"
    assert len(inner.interface.items_tree) == len(outer.interface.items_tree) == 3, "the groups are unchanged"


def test_per_leaf_variation_is_dropped_with_a_warning() -> None:
    _, principled, tree = new_material()
    description, message = described(principled, tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"], "Roughness")
    assert_codes(description["orm"], (255, 128, 0))
    assert ", so per-leaf variation from Object Info is dropped;" in message


# Nothing is rendered without need


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> None:
        raise AssertionError("nothing may be rendered")

    monkeypatch.setattr("addon.material.flatten.rendered", refused)


@pytest.mark.usefixtures("unrendered")
def test_the_plan_needs_no_rendering() -> None:
    material, principled, tree = new_material()
    image = data_node(tree, [[(0.6, 0.6, 0.6)]])
    tree.links.new(image.outputs["Color"], principled.inputs["Roughness"])
    reflection = reflection_of([material])
    assert (reflection.varies, reflection.warnings) == ("m", ())
    description, messages = describe_material(material, ("normals",))
    assert (description["orm"], description["roughness"], messages) == (None, 1.0, [])


@pytest.mark.usefixtures("unrendered")
def test_readable_channels_are_not_rendered() -> None:
    material, principled, tree = new_material()
    principled.inputs["Metallic"].default_value = 0.25
    image = data_node(tree, [[(0.8, 0.5, 0.9)]])
    tree.links.new(normal_map(tree, image.outputs["Color"]).outputs["Normal"], principled.inputs["Normal"])
    description, messages = describe_material(material, CHANNELS)
    assert messages == []
    assert description["normal"] is not None
    assert description["normal"].tolist() == [[[204, 128, 230, 255]]]


def test_rendering_leaves_no_data_behind() -> None:
    material, principled, tree = new_material()
    tree.links.new(ramp(tree, "X", 0.5).outputs["Normal"], principled.inputs["Normal"])
    kinds = ("scenes", "objects", "meshes", "cameras", "materials", "node_groups", "images")
    before = {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds}
    nodes = set(tree.nodes.keys())
    describe_material(material, CHANNELS)
    assert {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds} == before
    assert set(tree.nodes.keys()) == nodes
