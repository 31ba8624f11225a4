"""Roughness, metallic and normals read from material nodes."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import new_image, new_material, texture_node

from addon.material.describe import describe_material
from addon.material.shading import Reflection, read_shading, reflection_of
from addon.material.surface import read_surface
from addon.material.textures import Texture

CHANNELS = ("normals", "orm")


def data_node(tree: Any, pixel: tuple[float, float, float]) -> bpy.types.Node:
    return texture_node(tree, new_image("data", [[(*pixel, 0.25)]], space="Non-Color"))


def test_constant_roughness_and_metallic_are_read() -> None:
    material, principled, _ = new_material()
    principled.inputs["Roughness"].default_value = 0.25
    principled.inputs["Metallic"].default_value = 0.75
    description, messages = describe_material(material, CHANNELS)
    assert (description["roughness"], description["metallic"], description["orm"], messages) == (0.25, 0.75, None, [])
    assert read_shading(material, None).glossy
    # Without the channel "orm" roughness and metallic keep their defaults.
    description, _ = describe_material(material, ("normals",))
    assert (description["roughness"], description["metallic"]) == (1.0, 0.0)


def test_rough_leaves_are_not_glossy() -> None:
    material, principled, _ = new_material()
    principled.inputs["Roughness"].default_value = 1.0
    assert not read_shading(material, None).glossy
    assert not read_shading(None, None).glossy


def test_an_image_of_roughness_and_metallic_is_read() -> None:
    material, principled, tree = new_material()
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(data_node(tree, (0.5, 0.2, 0.6)).outputs["Color"], parts.inputs[0])
    tree.links.new(parts.outputs["Green"], principled.inputs["Roughness"])
    tree.links.new(parts.outputs["Blue"], principled.inputs["Metallic"])
    description, messages = describe_material(material, CHANNELS)
    assert messages == []
    assert (description["roughness"], description["metallic"]) == (1.0, 1.0)
    assert description["orm"] is not None
    # The codes are unchanged. The alpha of a data image is ignored.
    assert np.abs(description["orm"].astype(int) - [[[128, 51, 153, 255]]]).max() <= 1


def test_a_normal_map_is_read() -> None:
    material, principled, tree = new_material()
    node = tree.nodes.new("ShaderNodeNormalMap")
    tree.links.new(data_node(tree, (0.8, 0.5, 0.9)).outputs["Color"], node.inputs["Color"])
    tree.links.new(node.outputs["Normal"], principled.inputs["Normal"])
    description, messages = describe_material(material, CHANNELS)
    assert messages == []
    assert description["normal"] is not None
    assert np.abs(description["normal"].astype(int) - [[[204, 128, 230, 255]]]).max() <= 1


def test_data_in_an_srgb_image_are_decoded() -> None:
    material, principled, tree = new_material()
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    image = new_image("data", [[(0.5, 0.5, 0.5, 1.0)]], space="sRGB")
    tree.links.new(texture_node(tree, image).outputs["Color"], parts.inputs[0])
    tree.links.new(parts.outputs["Green"], principled.inputs["Roughness"])
    description, _ = describe_material(material, CHANNELS)
    assert description["orm"] is not None
    # The sRGB formula gives 0.214. Blender shades with this value.
    assert abs(int(description["orm"][0, 0, 1]) - 55) <= 1
    assert (description["roughness"], description["metallic"]) == (1.0, 0.0)


@pytest.mark.parametrize("kind", ["bump", "strength", "other extension", "roughness", "half linked"])
def test_channels_other_than_plain_images_are_marked_for_rendering(kind: str) -> None:
    material, principled, tree = new_material()
    image = data_node(tree, (0.5, 0.5, 1.0))
    if kind == "half linked":
        parts = tree.nodes.new("ShaderNodeSeparateColor")
        tree.links.new(image.outputs["Color"], parts.inputs[0])
        tree.links.new(parts.outputs["Blue"], principled.inputs["Metallic"])
        principled.inputs["Roughness"].default_value = 0.5
    elif kind == "roughness":
        tree.links.new(image.outputs["Color"], principled.inputs["Roughness"])
    elif kind == "bump":
        tree.links.new(tree.nodes.new("ShaderNodeBump").outputs["Normal"], principled.inputs["Normal"])
    else:
        node = tree.nodes.new("ShaderNodeNormalMap")
        node.inputs["Strength"].default_value = 0.5 if kind == "strength" else 1.0
        tree.links.new(image.outputs["Color"], node.inputs["Color"])
        tree.links.new(node.outputs["Normal"], principled.inputs["Normal"])
    expected = Texture(None)
    if kind == "other extension":
        colors = texture_node(tree, new_image("colors", [[(1.0, 1.0, 1.0, 1.0)]]))
        colors.extension = "EXTEND"
        tree.links.new(colors.outputs["Color"], principled.inputs["Base Color"])
    shading = read_shading(material, read_surface(material).texture)
    orm = kind in {"roughness", "half linked"}
    assert (shading.orm, shading.normal) == ((expected, None) if orm else (None, expected))
    assert shading.warnings == ()


def test_roughness_is_clamped_as_in_blender() -> None:
    material, principled, tree = new_material()
    value = tree.nodes.new("ShaderNodeValue")
    value.outputs[0].default_value = 1.7
    tree.links.new(value.outputs[0], principled.inputs["Roughness"])
    assert describe_material(material, CHANNELS)[0]["roughness"] == 1.0


def test_the_specular_level_is_the_mean_of_the_materials() -> None:
    materials = []
    for level in (0.0, 0.0, 0.75):
        material, principled, _ = new_material()
        principled.inputs["Specular IOR Level"].default_value = level
        principled.inputs["Roughness"].default_value = 0.25
        materials.append(material)
    assert reflection_of(materials[:2]) == Reflection(0.25, 0.0, None, specular=0.0)
    differing = reflection_of(materials)
    assert differing.specular == 0.25
    assert differing.warnings == (
        "the leaf materials' Specular IOR Levels (0, 0.75) differ: the billboards use their mean, 0.25",
    )


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("normals", "normals come from the node 'Diffuse BSDF'; mesh normals are used; connect a Principled BSDF"),
        ("highlights", "highlights come from the node 'Glossy BSDF'; roughness 1 is used; connect a Principled BSDF"),
    ],
)
def test_shaders_other_than_principled_give_a_warning(kind: str, words: str) -> None:
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse" if kind == "normals" else "ShaderNodeBsdfGlossy")
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    if kind == "normals":
        tree.links.new(tree.nodes.new("ShaderNodeBump").outputs["Normal"], shader.inputs["Normal"])
    assert read_shading(material, None).warnings == (f"material 'm': its {words}",)


def test_equal_materials_need_no_texture() -> None:
    materials = []
    for roughness in (0.25, 0.25, 0.5):
        material, principled, _ = new_material()
        principled.inputs["Roughness"].default_value = roughness
        materials.append(material)
    assert reflection_of(materials[:2]) == Reflection(0.25, 0.0, None)
    assert reflection_of(materials) == Reflection(1.0, 0.0, "m")
