"""Translucency: read from the leaves' materials, and equally bright through billboards and through leaves."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import math_node, new_image, new_material, texture_node
from renders import LUMINANCE, render
from scenes import add_mesh, bake, read

from addon.bake.values import Baked
from addon.export.glb_file import Glb
from addon.export.gltf import export_level
from addon.export.ktx2 import Ktx2Textures
from addon.material.describe import describe_material
from addon.material.flatten import flatten
from addon.material.surface import read_surface
from addon.material.textures import Texture
from addon.material.translucency import Translucent, read_translucency, translucent_of
from addon.settings.bake import BakeSettings

GREEN, YELLOW = (0.1, 0.3, 0.05), (0.3, 0.5, 0.1)
"""What the leaves reflect, and what shines through them."""


def shader(tree: Any, kind: str, color: tuple[float, float, float]) -> bpy.types.Node:
    node = tree.nodes.new(f"ShaderNodeBsdf{kind}")
    node.inputs["Color"].default_value = (*color, 1.0)
    return node


def mixed(tree: Any, first: bpy.types.Node, second: bpy.types.Node, share: float | None) -> bpy.types.Node:
    """Add a Mix Shader, or an Add Shader without a factor."""
    node = tree.nodes.new("ShaderNodeAddShader" if share is None else "ShaderNodeMixShader")
    if share is not None:
        node.inputs[0].default_value = share
    for source, target in zip((first, second), list(node.inputs)[-2:], strict=True):
        tree.links.new(source.outputs[0], target)
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return node


def leaf(share: float | None = 0.4, kind: str = "Principled") -> bpy.types.Material:
    """Return a material without highlights, mixed with a Translucent BSDF."""
    material, principled, tree = new_material()
    principled.inputs["Base Color"].default_value = (*GREEN, 1.0)
    principled.inputs["Roughness"].default_value, principled.inputs["Specular IOR Level"].default_value = 1.0, 0.0
    front = principled if kind == "Principled" else shader(tree, kind, GREEN)
    mixed(tree, front, shader(tree, "Translucent", YELLOW), share)
    return material


def field(material: bpy.types.Material) -> bpy.types.Object:
    """Add nearly flat leaves side by side, so that no leaf shades another."""
    heights = np.random.default_rng(2).uniform(-0.02, 0.02, 16)
    corners = [
        (x + dx, y + dy, float(heights[4 * x + y]))
        for x in range(4)
        for y in range(4)
        for dx, dy in ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9))
    ]
    faces = [(i, i + 1, i + 2, i + 3) for i in range(0, 64, 4)]
    return add_mesh("leaves", corners, faces, materials=[material])


def baked(material: bpy.types.Material, effects: str, *others: bpy.types.Object, **shape: Any) -> Baked:
    """A field of leaves, and others that are none."""
    obj = field(material)
    tree = read([obj, *others], ["leaves"])
    settings = BakeSettings(
        effects=effects, **{"levels": 1, "cross": False, "texture_size": 128, "quality": 0.1, **shape}
    )
    result = bake(tree, settings)
    for source in (obj, *others):
        source.hide_render = True
    return result


def seen(result: Baked, shown: int, folder: Path, *, behind: bool) -> float:
    """Return the mean luminance of one level from above, with the sun above or below."""
    scene = bpy.context.scene
    for level in result.levels:
        level.object.hide_render = level.number != shown
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = math.pi, (math.pi if behind else 0.0, 0.0, 0.0)
    scene.collection.objects.link(sun)
    pixels = render(folder, (2.0, 2.0, 5.0), width=4.0)
    bpy.data.objects.remove(sun)
    return float((pixels[..., :3] @ LUMINANCE).mean())


# Reading


def test_a_mix_keeps_its_colours() -> None:
    """If all leaves have the same factor, base color and translucency equal the nodes' colors."""
    description, messages = describe_material(leaf(0.4), share=0.4)
    assert description["base_color"] == pytest.approx((*GREEN, 1.0))
    assert description["translucency"] == pytest.approx(YELLOW)
    assert (description["translucency_image"], messages) == (None, [])
    assert translucent_of([None, leaf(0.4), leaf(0.6)]) == Translucent(pytest.approx(0.6), "m.001")


def test_the_translucent_shader_may_come_first() -> None:
    material, principled, tree = new_material()
    mixed(tree, shader(tree, "Translucent", YELLOW), principled, 0.75)
    assert translucent_of([material]).share == 0.25


def test_leaves_that_are_less_translucent_than_others_reflect_more() -> None:
    """One quarter beside one half: R = ¾ green = ½ · 1½ green, T = ¼ yellow = ½ · ½ yellow."""
    description, messages = describe_material(leaf(0.25), share=0.5)
    assert description["base_color"][:3] == pytest.approx([1.5 * part for part in GREEN])
    assert description["translucency"] == pytest.approx([0.5 * part for part in YELLOW])
    assert messages == []
    opaque, _, _ = new_material()
    assert describe_material(opaque, share=0.5) == describe_material(opaque)


def test_added_shaders_have_half_the_light_each() -> None:
    material = leaf(None)
    assert translucent_of([material]).share == 0.5
    description, messages = describe_material(material, share=0.5)
    assert description["base_color"][:3] == pytest.approx([2.0 * part for part in GREEN])
    assert description["translucency"] == pytest.approx([2.0 * part for part in YELLOW])
    assert messages == []


@pytest.mark.parametrize(
    ("transmission", "subsurface", "share"), [(0.5, 0.0, 0.5), (0.0, 0.5, 0.25), (0.5, 0.5, 0.625), (1.0, 0.0, 0.9)]
)
def test_the_weights_of_a_principled_bsdf(transmission: float, subsurface: float, share: float) -> None:
    """Translucency includes transmission and half of the subsurface scattering. A tenth is left for reflection."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (*GREEN, 1.0)
    principled.inputs["Transmission Weight"].default_value = transmission
    principled.inputs["Subsurface Weight"].default_value = subsurface
    assert translucent_of([material]).share == pytest.approx(share)
    description, _ = describe_material(material, share=0.9)
    through = min(1.0 - (1.0 - transmission) * (1.0 - 0.5 * subsurface), 1.0)
    assert description["translucency"] == pytest.approx([min(through * part / 0.9, 1.0) for part in GREEN])
    reflected = [(1.0 - through) * part / 0.1 for part in GREEN]
    assert description["base_color"][:3] == pytest.approx([min(part, 1.0) for part in reflected])


def test_images_are_read_and_brightened() -> None:
    """The codes 188 and 137 are 0.503 and 0.251 in linear light. Doubled, they are 1 (clipped) and code 188."""
    material = leaf(0.25)
    tree = material.node_tree
    translucent = next(node for node in tree.nodes if node.type == "BSDF_TRANSLUCENT")
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    through = texture_node(tree, new_image("through", [[(10 / 255, 200 / 255, 0.0, 1.0)]]))
    front = texture_node(tree, new_image("front", [[(188 / 255, 137 / 255, 0.0, 1.0)]]))
    tree.links.new(through.outputs["Color"], translucent.inputs["Color"])
    tree.links.new(front.outputs["Color"], principled.inputs["Base Color"])
    description, messages = describe_material(material, share=0.25)
    assert (description["base_color"], description["translucency"], messages) == ((1.0,) * 4, (1.0,) * 3, [])
    assert description["translucency_image"].tolist() == [[[10, 200, 0, 255]]]
    assert description["image"].tolist() == [[[188, 137, 0, 255]]]
    brighter, [message] = describe_material(material, share=0.625)
    assert np.abs(brighter["image"].astype(int) - [[[255, 188, 0, 255]]]).max() <= 1
    assert brighter["translucency"] == pytest.approx((0.4,) * 3)
    assert message.startswith("material 'm' reflects more than 38% of the light, ")


def test_black_translucency_counts_as_none() -> None:
    material = leaf()
    translucent = next(node for node in material.node_tree.nodes if node.type == "BSDF_TRANSLUCENT")
    translucent.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    assert translucent_of([material, leaf(0.0), None]) == Translucent(0.0, None)


def test_a_mix_is_not_warned_of_where_it_is_read_whole() -> None:
    material = leaf()
    assert describe_material(material, share=0.4)[1] == []
    assert describe_material(material)[1] == ["material 'm' mixes several shaders: only its Principled BSDF "
                                              "'Principled BSDF' is read"]  # fmt: skip


@pytest.mark.parametrize("case", ["factor", "weight", "glossy", "both", "layout", "attribute", "nothing"])
def test_unsupported_shaders_are_rendered(case: str) -> None:
    material = leaf()
    tree = material.node_tree
    principled, translucent, mix = (
        next(node for node in tree.nodes if node.type == kind)
        for kind in ("BSDF_PRINCIPLED", "BSDF_TRANSLUCENT", "MIX_SHADER")
    )
    image = texture_node(tree, new_image("i", [[(0.5, 0.5, 0.5, 1.0)]]))
    if case == "factor":
        tree.links.new(image.outputs["Color"], mix.inputs[0])
    elif case == "weight":
        tree.links.new(principled.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        tree.links.new(image.outputs["Color"], principled.inputs["Subsurface Weight"])
    elif case == "glossy":
        mixed(tree, mix, tree.nodes.new("ShaderNodeBsdfGlossy"), 0.5)
    elif case == "both":
        principled.inputs["Transmission Weight"].default_value = 0.5
    elif case == "layout":
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], image.inputs["Vector"])
        image.extension = "CLIP"
        tree.links.new(image.outputs["Color"], translucent.inputs["Color"])
    elif case == "attribute":
        tree.links.new(tree.nodes.new("ShaderNodeVertexColor").outputs["Color"], translucent.inputs["Color"])
    else:
        tree.links.remove(mix.inputs[1].links[0])
        mixed(tree, mix, principled, 0.5)
    surface = read_surface(material)
    read = read_translucency(material, surface)
    if case in {"glossy", "nothing"}:  # The base color is not understood either.
        assert surface.gaps == ("its surface mixes several shaders at the node 'Mix Shader.001'",)
    else:
        assert read.gap.startswith("its translucency ")
    assert (read.texture, read.color, read.warnings) == (
        Texture(None, extension=read.texture.extension),
        (1.0,) * 3,
        (),
    )
    assert translucent_of([material]) == Translucent(read.share, "m")


@pytest.mark.parametrize("case", ["no image", "moved", "other map"])
def test_translucency_that_cannot_be_rendered_gives_a_message(case: str) -> None:
    material = leaf()
    tree = material.node_tree
    mix, principled = (
        next(node for node in tree.nodes if node.type == kind) for kind in ("MIX_SHADER", "BSDF_PRINCIPLED")
    )
    image = texture_node(tree, None if case == "no image" else new_image("i", [[(0.5, 0.5, 0.5, 1.0)]]))
    tree.links.new(image.outputs["Color"], mix.inputs[0])
    layout = tree.nodes.new("ShaderNodeMapping" if case == "moved" else "ShaderNodeUVMap")
    if case == "moved":
        layout.inputs["Scale"].default_value = (2.0, 2.0, 1.0)
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], layout.inputs["Vector"])
        tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    else:
        layout.uv_map = "Other"
    if case != "no image":
        tree.links.new(layout.outputs[0], image.inputs["Vector"])
    read = read_translucency(material, read_surface(material))
    [warning] = read.warnings
    assert warning.startswith("material 'm': its translucency varies at the node 'Mix Shader', ")
    assert warning.endswith("; its leaves count as opaque")
    assert read.share == 0.0
    assert describe_material(material, share=0.4)[0]["translucency"] == (0.0, 0.0, 0.0)


def test_a_share_that_varies_is_rendered() -> None:
    """The factor f is ¼ on the left, ¾ on the right. R = (1 − f) green and T = f yellow, each relative to one half."""
    material = leaf()
    tree = material.node_tree
    principled, mix = (next(n for n in tree.nodes if n.type == kind) for kind in ("BSDF_PRINCIPLED", "MIX_SHADER"))
    principled.inputs["Base Color"].default_value = (0.2, 0.4, 0.1, 1.0)
    share = texture_node(tree, new_image("share", [[(0.25,) * 3 + (1.0,), (0.75,) * 3 + (1.0,)]], space="Non-Color"))
    share.interpolation = "Closest"
    tree.links.new(share.outputs["Color"], mix.inputs[0])
    description, [message] = describe_material(material, share=0.5)
    assert message.startswith(
        "material 'm': its translucency varies at the node 'Mix Shader', because its factor is not constant; it is "
        "rendered to an image of 64 × 64 texels"
    )
    # By the standard's formula: 0.3, 0.6, 0.15 and 0.1, 0.2, 0.05; 0.15, 0.25, 0.05 and 0.45, 0.75, 0.15.
    for image, factor, left, right in (
        (description["image"], description["base_color"], (149, 203, 108), (89, 124, 63)),
        (description["translucency_image"], description["translucency"], (108, 137, 63), (178, 225, 108)),
    ):
        assert image is not None
        assert factor[:3] == (1.0, 1.0, 1.0)
        assert np.abs(image[32, [8, 56], :3].astype(int) - [left, right]).max() <= 2
    assert description["alpha_mode"] == "OPAQUE"
    # Without the effect, or in an opaque tree, the colours are read as they are.
    assert describe_material(material)[0]["base_color"] == pytest.approx((0.2, 0.4, 0.1, 1.0))


def test_translucency_is_rendered_together_with_colors() -> None:
    """The leaf is half diffuse, half translucent, with a cutoff. Check the reflected and the transmitted light."""
    material = leaf(0.5, "Diffuse")
    tree = material.node_tree
    mixed(tree, tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes["Mix Shader"], 0.75)
    for light, color in (("reflected", GREEN), ("transmitted", YELLOW)):
        expected = (*(0.375 * part for part in color), 0.75)
        np.testing.assert_allclose(flatten(material, light).pixels[3, 5], expected, atol=1e-3)
    description, [message] = describe_material(material, share=0.5)
    assert "it is rendered" in message
    # Linear 0.1, 0.3, 0.05 and 0.3, 0.5, 0.1 by the standard's formula: half the light is the share of each.
    assert np.abs(description["image"][3, 5].astype(int) - (89, 149, 63, 191)).max() <= 2
    assert np.abs(description["translucency_image"][3, 5, :3].astype(int) - (149, 188, 89)).max() <= 2
    assert description["translucency"] == (1.0, 1.0, 1.0)


# Planning


def test_the_plan_names_the_material() -> None:
    result = baked(leaf(), "auto")
    [effect] = [effect for effect in result.effects if effect.name == "translucency"]
    assert effect.on
    assert effect.reason == "light may come from anywhere, and the material 'm' is translucent"
    assert result.prepared.warnings == ()
    assert result.costs.bytes["translucency"] == 128 * 128 * 4


# Building


def test_level_1_is_lit_as_its_leaves_are_whose_share_is_rendered(tmp_path: Path) -> None:
    material = leaf()
    tree = material.node_tree
    tree.links.new(math_node(tree, "MULTIPLY", 0.5, 0.6), tree.nodes["Mix Shader"].inputs[0])
    result = baked(material, "normals,translucency")
    for behind, color, part in ((True, YELLOW, 0.3), (False, GREEN, 0.7)):
        leaves, cloud = (seen(result, number, tmp_path, behind=behind) for number in (0, 1))
        assert leaves == pytest.approx(0.64 * part * float(LUMINANCE @ color), rel=0.03)
        assert cloud == pytest.approx(leaves, rel=0.05)


@pytest.mark.parametrize(("share", "kind"), [(0.4, "Principled"), (None, "Principled"), (0.4, "Diffuse")])
def test_level_1_is_lit_as_its_leaves_are(share: float | None, kind: str, tmp_path: Path) -> None:
    """Levels match within 5% from both sides, and match the nodes' colors. Leaves cover 64% of the view."""
    result = baked(leaf(share, kind), "normals,translucency")
    through, reflected = (1.0, 1.0) if share is None else (share, 1.0 - share)
    for behind, color, part in ((True, YELLOW, through), (False, GREEN, reflected)):
        leaves, cloud = (seen(result, number, tmp_path, behind=behind) for number in (0, 1))
        assert leaves == pytest.approx(0.64 * part * float(LUMINANCE @ color), rel=0.03)
        assert cloud == pytest.approx(leaves, rel=0.05)


def test_without_the_effect_level_1_is_dark_from_behind(tmp_path: Path) -> None:
    result = baked(leaf(), "normals")
    leaves, cloud = (seen(result, number, tmp_path, behind=True) for number in (0, 1))
    assert cloud < 0.1 * leaves


# glTF


EXTENSION = "KHR_materials_diffuse_transmission"


def document_of(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    return json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])


def trunk() -> bpy.types.Object:
    """Add an opaque trunk that no leaf covers in the view."""
    material, principled, _ = new_material()
    material.name = "bark"
    principled.inputs["Base Color"].default_value = (0.7, 0.6, 0.5, 1.0)
    return add_mesh("trunk", [(5, 0, -1), (6, 0, -1), (6, 0, 1), (5, 0, 1)], [(0, 1, 2, 3)], materials=[material])


def test_gltf_files_have_diffuse_transmission(tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    result = baked(leaf(), "translucency")
    file = tmp_path / "tree_LOD1.glb"
    export_level(result.levels[1], file)
    document = document_of(file)
    assert EXTENSION in document["extensionsUsed"]
    assert EXTENSION not in document.get("extensionsRequired", [])
    [material] = document["materials"]
    said = material["extensions"][EXTENSION]
    assert set(said) == {"diffuseTransmissionFactor", "diffuseTransmissionColorTexture"}, "no part of it is opaque"
    assert said["diffuseTransmissionFactor"] == pytest.approx(0.4)
    image = document["images"][document["textures"][said["diffuseTransmissionColorTexture"]["index"]]["source"]]
    assert (image["name"], image["mimeType"]) == ("tree_LOD1_translucency", "image/png")
    assert (material["alphaMode"], "baseColorTexture" in material["pbrMetallicRoughness"]) == ("MASK", True)
    assert gltf_issues(file) == []
    export_level(result.levels[0], tmp_path / "tree_LOD0.glb")
    [own] = document_of(tmp_path / "tree_LOD0.glb")["materials"]
    assert own["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([*GREEN, 1.0])


def test_trunk_in_the_cross_is_opaque(tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    result = baked(leaf(), "translucency", trunk(), cross=True)
    cross = result.levels[2]
    color, through = (
        np.array(cross.object.active_material.node_tree.nodes[name].image.pixels).reshape(64, 64, 4)
        for name in ("Leafcloud Page", "Leafcloud Translucency")
    )
    # Bark is the only thing that is as blue.
    bark = (color[..., 3] > 0.9) & (color[..., 2] > 0.6)
    leaves = (color[..., 3] > 0.9) & (color[..., 2] < 0.3)
    assert bark.sum() > 50 < leaves.sum()
    assert through[bark][:, 3].max() == 0.0
    assert through[leaves][:, 3].min() == 1.0
    file = tmp_path / "cross.glb"
    export_level(cross, file)
    said = document_of(file)["materials"][0]["extensions"][EXTENSION]
    assert "diffuseTransmissionTexture" in said
    assert gltf_issues(file) == []


def test_ktx2_is_only_used_for_the_colors_of_translucency(tmp_path: Path) -> None:
    """Its alpha says nothing, so the texture of the opaque parts stays PNG."""
    result = baked(leaf(), "translucency", trunk(), cross=True)
    file = tmp_path / "cross.glb"
    export_level(result.levels[2], file)
    glb = Glb.read(file)
    Ktx2Textures({"tree_LOD2": result.chain.levels[1]}).add_to(glb)
    glb.write(file)
    document = document_of(file)
    said = document["materials"][0]["extensions"][EXTENSION]
    colors, opaque = (
        document["textures"][said[f"diffuseTransmission{name}Texture"]["index"]] for name in ("Color", "")
    )
    assert "KHR_texture_basisu" in colors["extensions"]
    assert "extensions" not in opaque
    assert colors["source"] == opaque["source"]
    assert len(result.chain.levels[1].ktx2("translucency")) == document["bufferViews"][-1]["byteLength"]


def test_files_without_the_effect_have_no_transmission(tmp_path: Path) -> None:
    result = baked(leaf(), "none")
    export_level(result.levels[1], tmp_path / "a.glb")
    assert EXTENSION not in document_of(tmp_path / "a.glb").get("extensionsUsed", [])
    assert [effect.name for effect in result.effects if effect.on] == ["far_levels"]
