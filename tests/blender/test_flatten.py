"""Rendering of materials with unsupported nodes into textures over their UV map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import math_node, new_image, new_material, texture_node
from scenes import SQUARE, add_mesh
from small_glb import png

from addon.errors import SceneError
from addon.material.describe import describe_material
from addon.material.flatten import flatten
from addon.material.surface import read_surface
from addon.material.textures import Texture
from addon.mesh.extract import extract

pytestmark = pytest.mark.version

QUARTERS = [[(1, 0, 0, 1), (0, 1, 0, 1)], [(0, 0, 1, 1), (1, 1, 1, 0)]]
"""The upper row first: red, green; blue, nothing."""


def quarters(tree: Any, side: int = 64) -> bpy.types.Node:
    """Return an image of four fields, in the texture's own pixels."""
    rows = [[QUARTERS[2 * y // side][2 * x // side] for x in range(side)] for y in range(side)]
    node = texture_node(tree, new_image("quarters", rows))
    node.interpolation = "Closest"
    return node


def fields(pixels: np.ndarray) -> np.ndarray:
    """Return the colors in the centers of the four fields."""
    side = len(pixels)
    return pixels[[[side // 4], [3 * side // 4]], [[side // 4, 3 * side // 4]]]


def to_surface(tree: Any, shader: bpy.types.Node) -> None:
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


@pytest.mark.parametrize(
    ("pattern", "first", "second"),
    [("a.<UDIM>.png", "a.1001.png", "a.1012.png"), ("a.<UVTILE>.png", "a.u1_v1.png", "a.u2_v2.png")],
)
def test_a_tiled_image_needs_all_its_files(tmp_path: Path, pattern: str, first: str, second: str) -> None:
    for name in (first, second):
        (tmp_path / name).write_bytes(png([[(255, 0, 0, 255)] * 8] * 8))
    image = bpy.data.images.load(str(tmp_path / first))
    image.source, image.filepath = "TILED", str(tmp_path / pattern)
    image.name = "tiles"
    image.tiles.new(tile_number=1012)
    material, principled, tree = new_material()
    tree.links.new(texture_node(tree, image).outputs["Color"], principled.inputs["Base Color"])
    assert describe_material(material)[0]["image"] is not None
    (tmp_path / second).unlink()
    with pytest.raises(SceneError) as caught:
        describe_material(material)
    assert str(caught.value) == (
        f"texture 'tiles' of material 'm' cannot be read: {tmp_path / second}; "
        f"put the file there, or pack it into the .blend"
    )


def test_rendering_keeps_the_result_of_color_nodes() -> None:
    """Invert gives cyan, magenta and yellow. The mask of the image stays a mask."""
    material, principled, tree = new_material()
    image, invert = quarters(tree), tree.nodes.new("ShaderNodeInvert")
    tree.links.new(image.outputs["Color"], invert.inputs["Color"])
    tree.links.new(invert.outputs[0], principled.inputs["Base Color"])
    tree.links.new(image.outputs["Alpha"], principled.inputs["Alpha"])
    description, messages = describe_material(material)
    assert description["image"] is not None
    assert fields(description["image"])[[0, 0, 1], [0, 1, 0]].tolist() == [
        [0, 255, 255, 255],
        [255, 0, 255, 255],
        [255, 255, 0, 255],
    ]
    assert fields(description["image"])[1, 1, 3] == 0
    assert (description["alpha_mode"], description["base_color"]) == ("MASK", (1.0, 1.0, 1.0, 1.0))
    (message,) = messages
    assert message.startswith("material 'm': its base color comes from the node 'Invert")
    assert "; it is rendered to an image of 64 × 64 texels;" in message


def test_a_factor_above_one_is_rendered() -> None:
    """An image of a linear quarter and of a half, three times: ¾, and 1, where it is cut."""
    material, principled, tree = new_material()
    dark, bright = (0.25, 0.25, 0.25, 1.0), (0.5, 0.5, 0.5, 1.0)
    texels = [[dark] * 32 + [bright] * 32] * 64
    image, mix = texture_node(tree, new_image("i", texels, is_float=True)), tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs[0].default_value, mix.inputs[7].default_value = 1.0, (3.0, 3.0, 3.0, 1.0)
    tree.links.new(image.outputs["Color"], mix.inputs[6])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    description, (message,) = describe_material(material)
    assert description["base_color"] == (1.0, 1.0, 1.0, 1.0)
    assert description["image"] is not None
    # sRGB's code of ¾ is 225.
    assert description["image"][32, [16, 48], 0].tolist() == [225, 255]
    assert "its base color has the factor (3, 3, 3), which is outside [0, 1]; it is rendered" in message


def test_mixed_shaders_are_weighted_by_their_coverage() -> None:
    """A quarter of transparent, three of (half diffuse red, half translucent green): alpha ¾, (½, ½, 0)."""
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    kinds = ("BsdfDiffuse", "BsdfTranslucent", "MixShader", "BsdfTransparent", "MixShader")
    diffuse, translucent, inner, clear, outer = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    diffuse.inputs["Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    translucent.inputs["Color"].default_value = (0.0, 1.0, 0.0, 1.0)
    inner.inputs[0].default_value, outer.inputs[0].default_value = 0.5, 0.75
    tree.links.new(diffuse.outputs[0], inner.inputs[1])
    tree.links.new(translucent.outputs[0], inner.inputs[2])
    tree.links.new(clear.outputs[0], outer.inputs[1])
    tree.links.new(inner.outputs[0], outer.inputs[2])
    to_surface(tree, outer)
    np.testing.assert_allclose(flatten(material).pixels[3, 5], (0.375, 0.375, 0.0, 0.75), atol=1e-3)
    description, _ = describe_material(material)
    assert description["alpha_mode"] == "BLEND"


def test_shaders_in_groups_are_found() -> None:
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    inside = bpy.data.node_groups.new("leaf", "ShaderNodeTree")
    inside.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    inside.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    start, end, paint = (
        inside.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeBsdfDiffuse")
    )
    inside.links.new(start.outputs["Tint"], paint.inputs["Color"])
    inside.links.new(paint.outputs[0], end.inputs["Shader"])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inside
    group.inputs["Tint"].default_value = (0.25, 0.5, 0.125, 1.0)
    to_surface(tree, group)
    np.testing.assert_allclose(flatten(material).pixels[0, 0], (0.25, 0.5, 0.125, 1.0), atol=1e-3)
    assert {item.name for item in inside.interface.items_tree} == {"Tint", "Shader"}, "the group itself is not touched"


def test_a_shader_linked_into_a_group_is_found() -> None:
    """The group makes half of its input shader transparent."""
    material, principled, tree = new_material()
    principled.inputs["Base Color"].default_value = (0.25, 0.5, 0.125, 1.0)
    inside = bpy.data.node_groups.new("cut", "ShaderNodeTree")
    inside.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketShader")
    inside.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketShader")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeMixShader", "ShaderNodeBsdfTransparent")
    start, end, mix, clear = (inside.nodes.new(kind) for kind in kinds)
    inside.links.new(clear.outputs[0], mix.inputs[1])
    inside.links.new(start.outputs["In"], mix.inputs[2])
    inside.links.new(mix.outputs[0], end.inputs["Out"])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inside
    tree.links.new(principled.outputs[0], group.inputs["In"])
    to_surface(tree, group)
    np.testing.assert_allclose(flatten(material).pixels[0, 0], (0.125, 0.25, 0.0625, 0.5), atol=1e-3)


def test_unlinked_nodes_have_no_effect() -> None:
    """Unlinked: a missing image, a UV map, and an image for roughness."""
    material, principled, tree = new_material()
    image, curve = quarters(tree), tree.nodes.new("ShaderNodeGamma")
    tree.links.new(image.outputs["Color"], curve.inputs["Color"])
    tree.links.new(curve.outputs[0], principled.inputs["Base Color"])
    texture_node(tree, None)
    tree.links.new(texture_node(tree, None).outputs["Color"], principled.inputs["Roughness"])
    tree.nodes.new("ShaderNodeUVMap").uv_map = "other"
    description, (message,) = describe_material(material)
    assert description["image"] is not None
    assert "it is rendered" in message
    assert read_surface(material).texture == Texture(None)


def test_the_image_decides_the_uv_map() -> None:
    """A gradient on a second UV map does not move the leaf's image."""
    material, principled, tree = new_material()
    image, gradient, layout, mix = (
        quarters(tree),
        *(tree.nodes.new(kind) for kind in ("ShaderNodeTexGradient", "ShaderNodeUVMap", "ShaderNodeMix")),
    )
    layout.uv_map, mix.data_type, mix.blend_type = "gradient", "RGBA", "SCREEN"
    tree.links.new(layout.outputs["UV"], gradient.inputs["Vector"])
    tree.links.new(image.outputs["Color"], mix.inputs[6])
    tree.links.new(gradient.outputs["Color"], mix.inputs[7])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    # The image repeats, the gradient does not.
    assert read_surface(material).texture == Texture(None, extension="MIXED")
    _, (message,) = describe_material(material)
    assert "texels, as if its UV maps (the active one and 'gradient') were all the active one;" in message


def test_a_failed_render_is_refused_and_leaves_no_data(monkeypatch: pytest.MonkeyPatch) -> None:
    material, principled, tree = new_material()
    tree.links.new(math_node(tree, "SINE", 1.0), principled.inputs["Base Color"])
    kinds = ("scenes", "objects", "meshes", "cameras", "materials", "node_groups", "images")
    before = {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds}

    def no_folder(*_: Any, **__: Any) -> None:
        raise RuntimeError("no space")

    monkeypatch.setattr("addon.material.flatten.tempfile.TemporaryDirectory", no_folder)
    with pytest.raises(SceneError, match=r"material 'm' has to be rendered, but Cycles failed \(no space\)"):
        flatten(material)
    assert {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds} == before


def test_the_render_uses_the_named_uv_map() -> None:
    material, principled, tree = new_material()
    image, layout, curve = quarters(tree), tree.nodes.new("ShaderNodeUVMap"), tree.nodes.new("ShaderNodeGamma")
    layout.uv_map = "leaves"
    tree.links.new(layout.outputs["UV"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], curve.inputs["Color"])
    tree.links.new(curve.outputs[0], principled.inputs["Base Color"])
    expected = [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1)]
    np.testing.assert_allclose(fields(flatten(material).pixels).reshape(4, 4)[:3], expected, atol=1e-3)
    texture = read_surface(material).texture
    assert texture is not None
    assert texture.uv_map == "leaves"


def test_lost_properties_give_messages() -> None:
    material, principled, tree = new_material()
    random, ramp = tree.nodes.new("ShaderNodeParticleInfo"), tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(random.outputs["Random"], ramp.inputs[0])
    tree.links.new(ramp.outputs["Color"], principled.inputs["Base Color"])
    _, (message,) = describe_material(material)
    assert ", so per-leaf variation from Particle Info is dropped;" in message


def test_a_colour_attribute_counts_as_white() -> None:
    material, principled, tree = new_material()
    attribute, curve = tree.nodes.new("ShaderNodeVertexColor"), tree.nodes.new("ShaderNodeGamma")
    attribute.layer_name = "tint"
    tree.links.new(attribute.outputs["Color"], curve.inputs["Color"])
    tree.links.new(curve.outputs[0], principled.inputs["Base Color"])
    np.testing.assert_allclose(flatten(material).pixels[0, 0], (1.0, 1.0, 1.0, 1.0), atol=1e-3)


def test_rendering_leaves_no_data() -> None:
    material, principled, tree = new_material()
    tree.links.new(math_node(tree, "SINE", 1.0), principled.inputs["Base Color"])
    kinds = ("scenes", "objects", "meshes", "cameras", "materials", "node_groups", "images")
    before = {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds}
    settings = bpy.context.scene.name
    flatten(material)
    assert {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds} == before
    assert bpy.context.scene.name == settings


def test_a_mesh_without_a_uv_map_gives_a_message() -> None:
    material, principled, tree = new_material()
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], principled.inputs["Base Color"])
    obj = add_mesh("leaves", SQUARE, [(0, 1, 2, 3)])
    obj.data.materials.append(material)
    tree_found = extract(bpy.context.evaluated_depsgraph_get(), [obj], leaf_names=["leaves"])
    assert tree_found.warnings == ["object 'leaves' has no UV map for its rendering"]


def test_an_added_shader_keeps_the_cutout() -> None:
    """Green light is added to red leaves that the left half of the image hides, as in Cycles."""
    material, principled, tree = new_material()
    principled.inputs["Base Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    mask = texture_node(tree, new_image("mask", [[(1, 1, 1, x // 32) for x in range(64)]] * 64))
    mask.interpolation = "Closest"
    kinds = ("BsdfTranslucent", "BsdfTransparent", "MixShader", "AddShader")
    green, clear, mix, add = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    green.inputs["Color"].default_value = (0.0, 0.5, 0.0, 1.0)
    for source, target in zip(
        (mask.outputs["Alpha"], clear.outputs[0], principled.outputs[0]), mix.inputs, strict=True
    ):
        tree.links.new(source, target)
    for source, target in zip((green, mix), add.inputs, strict=True):
        tree.links.new(source.outputs[0], target)
    to_surface(tree, add)
    description, _ = describe_material(material)
    assert description["image"] is not None
    assert description["alpha_mode"] == "MASK"
    assert (description["image"][:, :32, 3] == 0).all()
    # The sRGB code of 0.5 is 188.
    assert np.abs(description["image"][:, 32:].astype(int) - (255, 188, 0, 255)).max() <= 1
