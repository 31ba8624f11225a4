"""The leaf map: it stores which leaf each texel shows, so that leaves can change color without a new bake."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import bake as bake_files
from node_trees import atlas_image, new_image, new_material, texture_node
from numpy.typing import NDArray
from renders import render
from scenes import add_mesh, bake, read

import leafcloud
from addon.bake.values import Baked
from addon.export.glb_file import Glb
from addon.export.gltf import export_level
from addon.export.ktx2 import Ktx2Textures
from addon.levels.leaf_map import ID_NODE, SEASON_NODE, UV_NODE, add_leaf_map, leaf_map_group
from addon.levels.material import Page, atlas_material
from addon.material.flatten import emitting
from addon.settings.bake import BakeSettings

GREEN, OLIVE, RED, YELLOW = (0.2, 0.5, 0.1), (0.4, 0.4, 0.1), (0.7, 0.1, 0.05), (0.8, 0.6, 0.1)
BARK = (0.1, 0.2, 0.9)
SUMMER, AUTUMN = {"beech": GREEN, "oak": OLIVE}, {"beech": RED, "oak": YELLOW}
SIDE = 64
"""Pixels of a rendering."""

Pixels = NDArray[np.float32]
Color = tuple[float, float, float]


def leaf_image(name: str, color: Color) -> bpy.types.Image:
    """Return an sRGB image of a round leaf on transparency. Its quarters have different colors."""
    y, x = (np.mgrid[0:32, 0:32] + 0.5) / 32.0
    shade = np.where(x < 0.5, 1.0, 0.4) * (0.6 + 0.4 * y)
    pixels = np.dstack([shade[..., None] * np.array(color), np.hypot(x - 0.5, y - 0.5) < 0.48])
    return new_image(name, pixels.tolist())


def leaf(name: str, color: Color) -> bpy.types.Material:
    material, principled, tree = new_material()
    material.name = name
    image = texture_node(tree, leaf_image(name, color))
    cutoff = tree.nodes.new("ShaderNodeMath")
    cutoff.operation = "GREATER_THAN"
    for source, target in ((image.outputs["Color"], principled.inputs["Base Color"]),
                           (image.outputs["Alpha"], cutoff.inputs[0]),
                           (cutoff.outputs[0], principled.inputs["Alpha"])):  # fmt: skip
        tree.links.new(source, target)
    return material


def crown(colors: dict[str, Color]) -> bpy.types.Object:
    """Add square cards that roughly face the viewer at −y, with two alternating materials."""
    random = np.random.default_rng(3)
    centres = random.uniform((-1, -0.3, -1), (1, 0.3, 1), (60, 3))
    across, up = (axis + random.normal(0.0, 0.3, (60, 3)) for axis in ((0.2, 0, 0), (0, 0, 0.2)))
    corners = np.stack([centres + a * across + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))], axis=1)
    faces = [(i, i + 1, i + 2, i + 3) for i in range(0, 240, 4)]
    materials = [leaf(name, color) for name, color in colors.items()]
    obj = add_mesh("leaves", [tuple(corner) for corner in corners.reshape(-1, 3)], faces, materials=materials)
    obj.data.polygons.foreach_set("material_index", np.arange(60, dtype=np.int32) % 2)
    laid_out(obj)
    return obj


def laid_out(obj: bpy.types.Object) -> None:
    """Map the whole texture to each quad, starting at its first corner."""
    uvs = np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), (len(obj.data.polygons), 1))
    obj.data.uv_layers.new(name="UVMap").data.foreach_set("uv", uvs.ravel())


def trunk() -> bpy.types.Object:
    """Add a blue trunk that no leaf covers in the view."""
    material, principled, _ = new_material()
    material.name = "bark"
    principled.inputs["Base Color"].default_value = (*BARK, 1.0)
    return add_mesh("trunk", [(2, 0, -1), (3, 0, -1), (3, 0, 1), (2, 0, 1)], [(0, 1, 2, 3)], materials=[material])


def baked(colors: dict[str, Color], effects: str, *others: bpy.types.Object, **shape: Any) -> Baked:
    obj = crown(colors)
    settings = BakeSettings(
        effects=effects, **{"levels": 1, "cross": False, "texture_size": 256, "epsilon": 0.04, "quality": 0.1, **shape}
    )
    result = bake(read([obj, *others], [obj.name]), settings)
    for made in (obj, *others, *(each for level in result.levels for each in (level.object, level.trunk) if each)):
        made.hide_render = True
    return result


def material_of(result: Baked, number: int) -> bpy.types.Material:
    return result.levels[number].object.data.materials[0]


def wear(material: bpy.types.Material, colors: dict[str, Color]) -> None:
    """Change the season as an artist does: set another image in each leaf's node, and link Season to Base Color."""
    nodes = material.node_tree.nodes
    for name, color in colors.items():
        [node] = [node for node in nodes if node.type == "TEX_IMAGE" and node.label == name]
        node.image = leaf_image(f"{name} in autumn", color)
    show(material, nodes[SEASON_NODE].outputs[0])


def show(material: bpy.types.Material, color: bpy.types.NodeSocket) -> None:
    tree = material.node_tree
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(color, principled.inputs["Base Color"])


def seen(obj: bpy.types.Object, folder: Path, width: float = 3.0) -> Pixels:
    """Render the object's base color without light along y. Return (SIDE, SIDE, 4) with the lowest row first."""
    materials, own = obj.data.materials, obj.data.materials[0]
    with emitting(own) as flat:
        materials[0], obj.hide_render = flat, False
        pixels = render(
            folder,
            (0.0, -5.0, 0.0),
            (np.pi / 2.0, 0.0, 0.0),
            width=width,
            size=(SIDE, SIDE),
            samples=16,
            pixel_filter="BOX",
        )
        materials[0], obj.hide_render = own, True
    return pixels


def mean_color(pixels: Pixels) -> NDArray[np.float32]:
    """Return the mean color of the covered pixels."""
    return pixels[..., :3].sum((0, 1)) / pixels[..., 3].sum()


# Another season


@pytest.mark.night
def test_a_level_with_autumn_images_matches_autumn_leaves(tmp_path: Path) -> None:
    """The mean color matches within 2%, each pixel within 5%. Summer leaves differ much more."""
    summer, autumn = baked(SUMMER, "leaf_map"), baked(AUTUMN, "none")
    before = seen(summer.levels[1].object, tmp_path)
    wear(material_of(summer, 1), AUTUMN)
    after, expected = (seen(result.levels[1].object, tmp_path) for result in (summer, autumn))
    assert np.array_equal(after[..., 3], expected[..., 3])
    np.testing.assert_allclose(mean_color(after), mean_color(expected), rtol=0.02)
    light = expected[..., :3].mean()
    assert np.abs(after - expected).mean() < 0.05 * light
    assert np.abs(before - expected).mean() > 0.5 * light


@pytest.mark.night
def test_later_levels_have_a_leaf_map_too(tmp_path: Path) -> None:
    """Level 2 is baked from level 1 and is coarser, so only its mean color is compared."""
    summer, autumn = (baked(colors, "leaf_map", levels=2) for colors in (SUMMER, AUTUMN))
    wear(material_of(summer, 2), AUTUMN)
    after, expected = (seen(result.levels[2].object, tmp_path) for result in (summer, autumn))
    np.testing.assert_allclose(mean_color(after), mean_color(expected), rtol=0.05)


def test_trunk_in_the_cross_keeps_its_colour(tmp_path: Path) -> None:
    result = baked(SUMMER, "leaf_map", trunk(), cross=True)
    before = seen(result.levels[2].object, tmp_path, 8.0)
    wear(material_of(result, 2), AUTUMN)
    after = seen(result.levels[2].object, tmp_path, 8.0)
    x = 8.0 * ((np.arange(SIDE) + 0.5) / SIDE - 0.5)
    bark, leaves = ((before[..., 3] > 0.99) & of_part for of_part in (x > 1.9, x < 1.5))
    assert bark.sum() > 50 < leaves.sum()
    np.testing.assert_allclose(after[bark], before[bark], rtol=1e-5)
    assert after[leaves][:, 0].mean() > 3.0 * before[leaves][:, 0].mean()
    assert before[bark][:, 2].min() > 0.5 > 0.1 > after[leaves][:, 2].max(), "only bark is blue"


# Nodes


def sheet(uv: NDArray[np.uint8], leaf: NDArray[np.uint8], leaves: list[bpy.types.Material | None]) -> bpy.types.Object:
    """Return a square that faces the viewer and shows all labels (4, 4, 4) on a uniformly blue atlas."""
    page = atlas_image("page", np.full((4, 4, 4), (0, 0, 255, 255), np.uint8))
    material = atlas_material("page", Page(page), alpha_cutoff=0.5, double_sided=True)
    labels = (atlas_image(name, codes, data=True) for name, codes in (("uv", uv), ("id", leaf)))
    add_leaf_map(material, *labels, leaves)
    corners = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]
    obj = add_mesh("sheet", corners, [(0, 1, 2, 3)], materials=[material])
    laid_out(obj)
    return obj


def of_cells(pixels: Pixels) -> Pixels:
    """Return the color (4, 4, 3) in the center of each cell of a sheet. Row 0 is the top row."""
    cell = SIDE // 4
    return pixels[::-1][cell // 2 :: cell, cell // 2 :: cell, :3]


def codes(seed: int) -> NDArray[np.uint8]:
    """Return random labels (4, 4, 4), including the smallest and the largest."""
    labels = np.random.default_rng(seed).integers(0, 256, (4, 4, 4), np.uint8)
    labels[0, :2, :3] = [(0, 0, 0), (255, 255, 255)]
    labels[..., 3] = 255
    return labels


def test_the_group_decodes_labels(tmp_path: Path) -> None:
    uv, leaf = codes(1), codes(2)
    obj = sheet(uv, leaf, [None])
    material = obj.data.materials[0]
    [group] = [node for node in material.node_tree.nodes if node.type == "GROUP"]
    decoded = {}
    for socket in group.outputs:
        show(material, socket)
        decoded[socket.name] = of_cells(seen(obj, tmp_path, 2.0))
    red, green, blue = np.moveaxis(uv[..., :3].astype(float), 2, 0)
    expected = np.dstack([16.0 * red + blue // 16, 16.0 * green + blue % 16]) + 0.5
    np.testing.assert_allclose(decoded["UV"][..., :2], expected / 4096.0, atol=1e-6)
    red, green, blue = np.moveaxis(leaf[..., :3].astype(float), 2, 0)
    np.testing.assert_allclose(decoded["Leaf"][..., 0], red + 256.0 * green, rtol=1e-6)
    np.testing.assert_allclose(decoded["Material"][..., 0], blue, rtol=1e-6)


def test_each_material_has_its_own_colour(tmp_path: Path) -> None:
    """Colors: a number, an image times a factor, or none for rendered materials. Material 16 and later share one color.

    Bark shows the atlas.
    """
    leaves = [new_material() for _ in range(18)]
    for number, (_, principled, _) in enumerate(leaves):
        principled.inputs["Base Color"].default_value = (0.05 * number, 0.5, 0.0, 1.0)
    _, principled, tree = leaves[1]
    image = texture_node(tree, new_image("grey", [[(188 / 255, 188 / 255, 188 / 255, 1.0)]]))
    product = tree.nodes.new("ShaderNodeMix")
    product.data_type, product.blend_type = "RGBA", "MULTIPLY"
    product.inputs[0].default_value, product.inputs[7].default_value = 1.0, (1.0, 0.5, 0.0, 1.0)
    tree.links.new(image.outputs["Color"], product.inputs[6])
    tree.links.new(product.outputs[2], principled.inputs["Base Color"])
    _, principled, tree = leaves[2]
    inverted = tree.nodes.new("ShaderNodeInvert")
    tree.links.new(texture_node(tree, image.image).outputs["Color"], inverted.inputs["Color"])
    tree.links.new(inverted.outputs[0], principled.inputs["Base Color"])

    blue, last = (0.0, 0.0, 1.0), (0.75, 0.5, 0.0)
    expected = {0: (0.0, 0.5, 0.0), 1: (0.503, 0.251, 0.0), 2: blue, 3: (0.15, 0.5, 0.0), 14: (0.7, 0.5, 0.0),
                15: last, 16: last, 17: last, 254: last, 255: blue}  # fmt: skip
    labels = np.zeros((4, 4, 4), np.uint8)
    labels.reshape(16, 4)[: len(expected), 2] = list(expected)
    obj = sheet(codes(1), labels, [material for material, _, _ in leaves])
    wear(obj.data.materials[0], {})
    shown = of_cells(seen(obj, tmp_path, 2.0)).reshape(16, 3)[: len(expected)]
    np.testing.assert_allclose(shown, list(expected.values()), atol=0.002)


def test_the_optional_nodes_share_one_group() -> None:
    result = baked(SUMMER, "leaf_map", levels=2, cross=True, last="cross")
    for number in (1, 2, 3):
        tree = material_of(result, number).node_tree
        [group] = [node for node in tree.nodes if node.type == "GROUP"]
        assert group.node_tree == leaf_map_group()
        assert not tree.nodes[SEASON_NODE].outputs[0].is_linked
        for name, ending in ((UV_NODE, "leaf_uv"), (ID_NODE, "leaf_id")):
            image = tree.nodes[name].image
            assert tree.nodes[name].interpolation == "Closest"
            assert (image.name, image.colorspace_settings.name) == (f"tree_LOD{number}_{ending}", "Non-Color")
            assert image.packed_file is not None
    assert len(bpy.data.node_groups) == 1 + sum("LOD" in group.name for group in bpy.data.node_groups)
    [effect] = [effect for effect in result.effects if effect.name == "leaf_map"]
    assert effect.on
    assert result.costs.bytes["leaf_map"] == 2 * 4 * (256**2 + 128**2 + 64**2)


# glTF


def document_of(path: Path) -> tuple[dict[str, Any], bytes]:
    content = path.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def test_gltf_has_the_labels_as_they_are(tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    """Labels use nearest filtering and PNG for all engines. The standard parts of the material stay unchanged."""
    plain, result = baked(SUMMER, "normals"), baked(SUMMER, "normals,leaf_map")
    file, other = tmp_path / "leaf_map.glb", tmp_path / "plain.glb"
    export_level(result.levels[1], file)
    export_level(plain.levels[1], other)
    assert gltf_issues(file) == []
    glb = Glb.read(file)
    Ktx2Textures({material_of(result, 1).name: result.chain.levels[0]}).add_to(glb)
    glb.write(file)
    (document, binary), (without, _) = document_of(file), document_of(other)
    [material], [known] = document["materials"], without["materials"]
    extras = material.pop("extras")["leafcloud"]
    assert {**material, "name": known["name"]} == known
    assert set(extras) == {"leafUvTexture", "leafIdTexture", "alphaPivots"}
    for key, pixels in (("leafUvTexture", result.chain.levels[0].leaf_uv),
                        ("leafIdTexture", result.chain.levels[0].leaf_id)):  # fmt: skip
        texture = document["textures"][extras[key]["index"]]
        assert "extensions" not in texture
        assert document["samplers"][texture["sampler"]] == {"magFilter": 9728, "minFilter": 9728}
        image = document["images"][texture["source"]]
        assert image["mimeType"] == "image/png"
        view = document["bufferViews"][image["bufferView"]]
        png = binary[view["byteOffset"] :][: view["byteLength"]]
        leafcloud.write_png(str(tmp_path / "labels.png"), pixels)
        assert png == (tmp_path / "labels.png").read_bytes()
    colors, expected = (
        (every["textures"][known["pbrMetallicRoughness"]["baseColorTexture"]["index"]], every["samplers"])
        for every in (document, without)
    )
    assert "KHR_texture_basisu" in colors[0]["extensions"]
    assert colors[1][colors[0]["sampler"]] == expected[1][expected[0]["sampler"]]


@pytest.mark.parametrize("effects", ["none", "auto"])
def test_a_bake_without_the_effect_has_no_leaf_map(tmp_path: Path, effects: str) -> None:
    result = baked(SUMMER, effects)
    tree = material_of(result, 1).node_tree
    assert not {UV_NODE, ID_NODE, SEASON_NODE} & {node.name for node in tree.nodes}
    assert not [image.name for image in bpy.data.images if "leaf_" in image.name]
    assert "leaf_map" not in result.costs.bytes
    assert result.chain.levels[0].leaf_uv is None
    export_level(result.levels[1], tmp_path / "tree.glb")
    document, _ = document_of(tmp_path / "tree.glb")
    assert "extras" not in document["materials"][0]


def test_the_report_counts_the_bytes_of_the_leaf_map(tmp_path: Path, shrub: Path) -> None:
    shape = ("--levels", 1, "--no-cross", "--texture-size", 128, "--epsilon", 0.1, "--quality", 0.1)
    report = bake_files(shrub, tmp_path, "--effects", "leaf_map", *shape)
    told = {effect["name"]: effect for effect in report["effects"]}
    assert told["leaf_map"]["bytes"] == 2 * 128 * 128 * 4
    assert not any(effect["bytes"] for name, effect in told.items() if name != "leaf_map")
