"""Conversion of artists' node trees to materials of the core."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import math_node, new_image, new_material, texture_node
from small_glb import png

from addon.material.describe import describe_material
from addon.material.surface import read_surface

pytestmark = pytest.mark.version

TOP = [(255, 0, 0, 255), (0, 255, 0, 128)]
BOTTOM = [(0, 0, 255, 0), (188, 100, 50, 64)]
IMAGE = png([TOP, BOTTOM])
TEXTURED = {"baseColorTexture": {"index": 0}}


def test_leaves_without_material_have_blender_s_default_gray() -> None:
    assert describe_material(None) == (
        {
            "name": "default",
            "base_color": (0.8, 0.8, 0.8, 1.0),
            "image": None,
            "alpha_mode": "OPAQUE",
            "alpha_cutoff": 0.5,
            "double_sided": True,
            "normal": None,
            "roughness": 1.0,
            "metallic": 0.0,
            "orm": None,
            "translucency": (0.0, 0.0, 0.0),
            "translucency_image": None,
        },
        [],
    )


def test_without_nodes_the_viewport_colour_is_the_material() -> None:
    material = bpy.data.materials.new("m")
    if material.node_tree is not None:  # Blender 5 makes one and always uses it
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.25, 0.5, 0.75, 1.0)
    material.diffuse_color = (0.25, 0.5, 0.75, 1.0)
    material.use_backface_culling = True
    description, messages = describe_material(material)
    assert description["base_color"] == (0.25, 0.5, 0.75, 1.0)
    assert description["alpha_mode"] == "OPAQUE"
    assert not description["double_sided"]
    assert messages == []


@pytest.mark.parametrize(
    ("build", "cutoff"),
    [
        (lambda tree, alpha: math_node(tree, "ROUND", alpha), 0.5),
        (lambda tree, alpha: math_node(tree, "GREATER_THAN", alpha, 0.25), 0.25),
        (lambda tree, alpha: math_node(tree, "GREATER_THAN", alpha, 0.0), 0.5 / 255.0),
        (lambda tree, alpha: math_node(tree, "SUBTRACT", 1.0, math_node(tree, "LESS_THAN", alpha, 0.0)), 0.0),
        (lambda tree, alpha: math_node(tree, "SUBTRACT", 1.0, math_node(tree, "LESS_THAN", alpha, 0.125)), 0.125),
    ],
)
def test_nodes_that_cut_alpha_off_are_read_as_a_cutoff(build: Any, cutoff: float) -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(1, 1, 1, 0.5)]]))
    tree.links.new(build(tree, image.outputs["Alpha"]), principled.inputs["Alpha"])
    description, messages = describe_material(material)
    assert (description["alpha_mode"], description["alpha_cutoff"], messages) == ("MASK", cutoff, [])
    assert description["image"] is not None
    # White, because the base color does not use the image.
    assert description["image"].tolist() == [[[255, 255, 255, 128]]]


@pytest.mark.parametrize(
    ("build", "hidden", "seen"),
    [
        (lambda tree, alpha: math_node(tree, "LESS_THAN", 0.75, alpha), 0.5, 1.0),
        (lambda tree, alpha: math_node(tree, "LESS_THAN", 0.0, alpha), 0.0, 0.25),
        (
            lambda tree, alpha: math_node(tree, "SUBTRACT", 1.0, math_node(tree, "GREATER_THAN", 0.875, alpha)),
            0.75,
            1.0,
        ),
    ],
)
def test_other_cutoffs_are_rendered(build: Any, hidden: float, seen: float) -> None:
    """The left half has an alpha below the cutoff, the right half one above."""
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(1, 1, 1, hidden)] * 32 + [(1, 1, 1, seen)] * 32] * 64))
    image.interpolation = "Closest"
    tree.links.new(build(tree, image.outputs["Alpha"]), principled.inputs["Alpha"])
    description, (message,) = describe_material(material)
    assert "; it is rendered to an image of 64 × 64 texels;" in message
    assert (description["alpha_mode"], description["alpha_cutoff"]) == ("MASK", 0.5)
    assert description["image"] is not None
    assert description["image"][0, :, 3].tolist() == [0] * 32 + [255] * 32


def test_constant_alpha() -> None:
    material, principled, _ = new_material()
    principled.inputs["Alpha"].default_value = 0.25
    description, messages = describe_material(material)
    assert description["base_color"] == (pytest.approx(0.8), pytest.approx(0.8), pytest.approx(0.8), 0.25)
    assert (description["alpha_mode"], messages) == ("BLEND", [])


def test_opacity_in_an_image_of_its_own_and_another_size() -> None:
    material, principled, tree = new_material()
    color = texture_node(tree, new_image("color", [[(1, 0, 0, 1)] * 4] * 2))
    opacity = texture_node(tree, new_image("opacity", [[(1, 1, 1, 1), (0, 0, 0, 1)]], space="Non-Color"))
    tree.links.new(color.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(opacity.outputs["Color"], principled.inputs["Alpha"])
    description, messages = describe_material(material)
    assert messages == []
    assert description["image"] is not None
    # Texels of twice the size, between whose middles renderers look; images repeat.
    dense, thin = [255, 0, 0, 191], [255, 0, 0, 64]
    assert description["image"].tolist() == [[dense, dense, thin, thin]] * 2


def test_a_mask_keeps_its_detail_over_a_palette() -> None:
    material, principled, tree = new_material()
    color = texture_node(tree, new_image("color", [[(1, 0, 0, 1)]]))
    stripes = [[(1, 1, 1, x % 2) for x in range(8)]] * 4
    tree.links.new(color.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(texture_node(tree, new_image("mask", stripes)).outputs["Alpha"], principled.inputs["Alpha"])
    description, messages = describe_material(material)
    assert messages == []
    assert description["image"] is not None
    assert description["image"].tolist() == [[[255, 0, 0, 255 * (x % 2)] for x in range(8)]] * 4


def test_opacity_as_grey_is_read_as_blender_does() -> None:
    material, principled, tree = new_material()
    encoded = texture_node(tree, new_image("i", [[(188 / 255, 188 / 255, 188 / 255, 1)], [(1, 0, 0, 1)]]))
    tree.links.new(encoded.outputs["Color"], principled.inputs["Alpha"])
    description, _ = describe_material(material)
    assert description["image"] is not None
    # sRGB 188 is 0.5029 linear; red alone has the luminance 0.2126.
    assert description["image"][:, 0, 3].tolist() == [128, 54]


@pytest.mark.parametrize(
    ("options", "pixel", "expected"),
    [
        ({}, (188 / 255, 0.0, 1.0, 0.5), [188, 0, 255, 128]),
        ({"space": "Non-Color"}, (0.5, 0.0, 1.0, 0.5), [188, 0, 255, 128]),
        ({"space": "Linear Rec.709"}, (0.5, 0.0, 1.0, 0.5), [188, 0, 255, 128]),
        ({"alpha_mode": "PREMUL"}, (0.25, 0.0, 0.5, 0.5), [128, 0, 255, 128]),
        ({"alpha_mode": "NONE"}, (1.0, 0.0, 0.5, 0.5), [255, 0, 128, 255]),
        ({"is_float": True, "space": "Linear Rec.709"}, (0.25, 0.0, 2.0, 0.5), [188, 0, 255, 128]),
        (
            {"is_float": True, "space": "Linear Rec.709", "alpha_mode": "CHANNEL_PACKED"},
            (0.5, 0, 1, 0.5),
            [188, 0, 255, 128],
        ),
    ],
)
def test_images_are_converted_to_srgb_with_straight_alpha(
    options: dict[str, Any], pixel: tuple[float, ...], expected: list[int]
) -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[pixel]], **options))
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(image.outputs["Alpha"], principled.inputs["Alpha"])
    description, messages = describe_material(material)
    assert messages == []
    assert description["image"] is not None
    np.testing.assert_allclose(description["image"][0, 0].astype(int), expected, atol=1)


def test_groups_reroutes_and_muted_nodes_are_followed() -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0, 1, 0, 1)]]))
    group = bpy.data.node_groups.new("tint", "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    enter, leave = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    mix = group.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs["Factor"].default_value = 1.0
    group.links.new(enter.outputs[0], mix.inputs[6])
    group.links.new(enter.outputs[1], mix.inputs[7])
    group.links.new(mix.outputs[2], leave.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.inputs["Tint"].default_value = (0.5, 0.25, 0.125, 1.0)
    reroute = tree.nodes.new("NodeReroute")
    gamma = tree.nodes.new("ShaderNodeGamma")
    gamma.mute = True
    tree.links.new(image.outputs["Color"], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], node.inputs["In"])
    tree.links.new(node.outputs[0], principled.inputs["Base Color"])
    description, messages = describe_material(material)
    assert messages == []
    assert description["base_color"] == (0.5, 0.25, 0.125, 1.0)
    assert description["image"] is not None
    assert description["image"].tolist() == [[[0, 255, 0, 255]]]


def test_named_uv_map_and_attribute() -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0, 1, 0, 1)]]))
    uv_map = tree.nodes.new("ShaderNodeUVMap")
    uv_map.uv_map = "second"
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "Col"
    tree.links.new(uv_map.outputs[0], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(attribute.outputs["Alpha"], principled.inputs["Alpha"])
    surface = read_surface(material)
    assert surface.texture is not None
    assert (surface.texture.uv_map, surface.alpha_attribute, surface.warnings) == ("second", "Col", ())


def test_transparent_mixed_in_by_the_image_is_alpha() -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0, 1, 0, 0.25)]]))
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(image.outputs["Alpha"], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(principled.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, messages = describe_material(material)
    assert (description["alpha_mode"], messages) == ("BLEND", [])
    assert description["image"] is not None
    assert description["image"].tolist() == [[[0, 255, 0, 64]]]


def test_added_translucency_gives_a_message() -> None:
    material, principled, tree = new_material()
    principled.inputs["Base Color"].default_value = (0.5, 0.25, 0.125, 1.0)
    add, translucent = tree.nodes.new("ShaderNodeAddShader"), tree.nodes.new("ShaderNodeBsdfTranslucent")
    tree.links.new(translucent.outputs[0], add.inputs[0])
    tree.links.new(principled.outputs[0], add.inputs[1])
    tree.links.new(add.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, messages = describe_material(material)
    assert description["base_color"] == (0.5, 0.25, 0.125, 1.0)
    assert messages == ["material 'm' mixes several shaders: only its Principled BSDF 'Principled BSDF' is read"]


def test_two_principled_shaders_are_mixed() -> None:
    """The mix is one quarter of the first and three quarters of the second."""
    material, principled, tree = new_material()
    mix, other = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfPrincipled")
    principled.inputs["Base Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    other.inputs["Base Color"].default_value = (0.0, 1.0, 0.0, 1.0)
    mix.inputs[0].default_value = 0.75
    for number, shader in enumerate((principled, other), 1):
        tree.links.new(shader.outputs[0], mix.inputs[number])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, (message,) = describe_material(material)
    assert message.startswith(
        "material 'm': its surface mixes several shaders at the node 'Mix Shader'; it is rendered"
    )
    assert description["image"] is not None
    # sRGB of 0.25 and 0.75 by the standard's formula.
    assert np.abs(description["image"].astype(int) - [137, 225, 0, 255]).max() <= 1
    assert description["alpha_mode"] == "OPAQUE"


def test_a_cutout_with_an_inverted_factor() -> None:
    """The leaf is transparent at a factor of 1."""
    material, principled, tree = new_material()
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    mask = texture_node(tree, new_image("mask", [[(1, 1, 1, x // 4) for x in range(8)]] * 8))
    mask.interpolation = "Closest"
    tree.links.new(math_node(tree, "SUBTRACT", 1.0, mask.outputs["Alpha"]), mix.inputs[0])
    tree.links.new(principled.outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, _ = describe_material(material)
    assert description["alpha_mode"] == "MASK"
    assert description["image"] is not None
    half = description["image"].shape[1] // 2
    assert (description["image"][:, :half, 3] == 0).all()
    assert (description["image"][:, half:, 3] == 255).all()


EMITS = (
    "material 'm' emits light, but its billboards do not: they keep only its color and need other light; set the "
    "Emission Strength to 0 if the leaves need not emit light, either"
)


@pytest.mark.parametrize(("strength", "color", "told"), [(2.0, 1.0, True), (0.0, 1.0, False), (2.0, 0.0, False)])
def test_emission_gives_a_message(strength: float, color: float, *, told: bool) -> None:
    material, principled, _ = new_material()
    principled.inputs["Emission Strength"].default_value = strength
    principled.inputs["Emission Color"].default_value = (color, color, color, 1.0)
    assert describe_material(material)[1] == told * [EMITS]


def test_inputs_that_billboards_ignore_give_messages() -> None:
    material, principled, tree = new_material()
    principled.inputs["Coat Weight"].default_value = 0.5
    tree.links.new(tree.nodes.new("ShaderNodeDisplacement").outputs[0], tree.nodes["Material Output"].inputs[2])
    add, emission = tree.nodes.new("ShaderNodeAddShader"), tree.nodes.new("ShaderNodeEmission")
    tree.links.new(principled.outputs[0], add.inputs[0])
    tree.links.new(emission.outputs[0], add.inputs[1])
    tree.links.new(add.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert [message for message in describe_material(material)[1] if "rendered" not in message] == [
        EMITS,
        "material 'm': its billboards lack its displacement; connect a Bump node to the Normal of its shader",
        "material 'm': its billboards have one specular layer, without Coat; set the weight to 0",
    ]


def test_a_material_without_a_shader_has_the_viewport_colour() -> None:
    material, principled, tree = new_material()
    material.diffuse_color = (0.25, 0.5, 0.125, 1.0)
    tree.nodes.remove(principled)
    description, (message,) = describe_material(material)
    assert (description["base_color"], description["image"]) == ((0.25, 0.5, 0.125, 1.0), None)
    assert message == (
        "material 'm': its surface has no shader; the viewport display color (0.25, 0.5, 0.125, 1) replaces it. "
        "Connect an Image Texture to a Principled BSDF, or set the viewport color"
    )


def test_shaders_other_than_principled_are_rendered() -> None:
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    shader = tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (0.0, 1.0, 0.0, 1.0)
    shader.inputs["Strength"].default_value = 2.0  # With a strength of 1 it is an unlit material.
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    description, (emits, message) = describe_material(material)
    assert emits == EMITS
    assert description["image"] is not None
    assert (description["image"] == (0, 255, 0, 255)).all()
    assert "its surface comes from the node 'Emission', without a Principled BSDF; it is rendered" in message


def test_a_material_without_an_output() -> None:
    material, _, tree = new_material()
    tree.nodes.clear()
    description, messages = describe_material(material)
    assert description["image"] is None
    assert "its surface has no shader" in messages[0]


@pytest.mark.parametrize("case", ["noise", "generated coordinates", "box", "screen mix", "two images"])
def test_colors_from_unsupported_nodes_are_rendered(case: str) -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0, 1, 0, 1)]]))
    source = image.outputs["Color"]
    if case == "noise":
        source = tree.nodes.new("ShaderNodeTexNoise").outputs["Color"]
    elif case == "generated coordinates":
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], image.inputs["Vector"])
    elif case == "box":
        image.projection = "BOX"
    else:
        mix = tree.nodes.new("ShaderNodeMix")
        mix.data_type, mix.blend_type = "RGBA", "SCREEN" if case == "screen mix" else "MULTIPLY"
        mix.inputs["Factor"].default_value = 1.0
        tree.links.new(source, mix.inputs[6])
        tree.links.new(texture_node(tree, image.image).outputs["Color"], mix.inputs[7])
        source = mix.outputs[2]
    tree.links.new(source, principled.inputs["Base Color"])
    description, (message,) = describe_material(material)
    assert description["image"] is not None
    assert description["base_color"] == (1.0, 1.0, 1.0, 1.0)
    assert message.startswith("material 'm': its base color ")
    assert "; it is rendered to an image of" in message


def test_an_image_node_without_image_gives_the_viewport_color() -> None:
    material, principled, tree = new_material()
    tree.links.new(texture_node(tree, None).outputs["Color"], principled.inputs["Base Color"])
    description, (message,) = describe_material(material)
    assert description["image"] is None
    assert description["base_color"] == pytest.approx((0.8, 0.8, 0.8, 1.0))
    assert message.startswith("material 'm': its base color ")


@pytest.mark.parametrize("case", ["inverted", "other coordinates", "scaled after the cut"])
def test_alpha_from_unsupported_nodes_is_rendered(case: str) -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0, 1, 0, 0.5)]]))
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    if case == "inverted":
        source = math_node(tree, "SUBTRACT", 1.0, image.outputs["Alpha"])
    elif case == "other coordinates":
        other, uv_map = texture_node(tree, image.image), tree.nodes.new("ShaderNodeUVMap")
        uv_map.uv_map = "second"
        tree.links.new(uv_map.outputs[0], other.inputs["Vector"])
        source = other.outputs["Alpha"]
    else:
        source = math_node(tree, "MULTIPLY", math_node(tree, "ROUND", image.outputs["Alpha"]), 0.5)
    tree.links.new(source, principled.inputs["Alpha"])
    description, (message,) = describe_material(material)
    assert message.startswith("material 'm': its alpha ")
    assert description["image"] is not None
    # Half in all cases. (Of an image whose alpha is not asked for, Cycles shows the colour times alpha.)
    assert np.abs(description["image"][..., 3].astype(int) - 128).max() <= 1
    assert description["image"][3, 3, 1] == (128 if case == "other coordinates" else 255)
    assert description["alpha_mode"] == "BLEND"
