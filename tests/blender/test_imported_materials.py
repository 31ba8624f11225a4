"""Materials of imported files, described for the core."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import math_node, new_image, new_material, texture_node
from small_glb import png, write_quad_glb

from addon.errors import SceneError
from addon.material.describe import describe_material
from addon.material.surface import read_surface
from addon.scene.load import load

pytestmark = pytest.mark.version

TOP = [(255, 0, 0, 255), (0, 255, 0, 128)]
BOTTOM = [(0, 0, 255, 0), (188, 100, 50, 64)]
IMAGE = png([TOP, BOTTOM])
TEXTURED = {"baseColorTexture": {"index": 0}}


def imported(path: Path, **options: Any) -> bpy.types.Material:
    """Write a small GLB and return its material from Blender's importer."""
    load(write_quad_glb(path / "a.glb", **options))
    return bpy.data.meshes[0].materials[0]


@pytest.mark.parametrize("double_sided", [True, False])
def test_the_factor_of_an_opaque_glb_is_read_without_alpha(tmp_path: Path, double_sided: bool) -> None:
    factor = {"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.5, 0.75, 0.5]}, "doubleSided": double_sided}
    description, messages = describe_material(imported(tmp_path, material=factor))
    assert description["name"] == "leaf"
    assert description["base_color"] == (0.25, 0.5, 0.75, 1.0)
    assert (description["alpha_mode"], description["image"]) == ("OPAQUE", None)
    assert description["double_sided"] == double_sided
    assert messages == []


def test_the_texture_of_an_opaque_glb_has_no_alpha(tmp_path: Path) -> None:
    description, messages = describe_material(
        imported(tmp_path, material={"pbrMetallicRoughness": TEXTURED}, image=IMAGE)
    )
    assert description["image"] is not None
    assert description["image"].dtype == np.uint8
    opaque = [[(*pixel[:3], 255) for pixel in row] for row in (TOP, BOTTOM)]
    assert description["image"].tolist() == [[list(pixel) for pixel in row] for row in opaque]
    assert (description["alpha_mode"], messages) == ("OPAQUE", [])


@pytest.mark.parametrize("cutoff", [None, 0.5, 0.25, 0.9])
def test_texture_and_cutoff_of_a_masked_glb_are_read(tmp_path: Path, cutoff: float | None) -> None:
    masked: dict[str, Any] = {"pbrMetallicRoughness": TEXTURED, "alphaMode": "MASK"}
    if cutoff is not None:
        masked["alphaCutoff"] = cutoff
    description, messages = describe_material(imported(tmp_path, material=masked, image=IMAGE))
    assert description["image"] is not None
    assert description["image"].tolist() == [[list(pixel) for pixel in row] for row in (TOP, BOTTOM)]
    assert description["alpha_mode"] == "MASK"
    assert description["alpha_cutoff"] == pytest.approx(0.5 if cutoff is None else cutoff)
    assert description["base_color"] == (1.0, 1.0, 1.0, 1.0)
    assert messages == []


def test_a_masked_glb_with_vertex_colors_keeps_factor_texture_and_cutoff(tmp_path: Path) -> None:
    masked = {
        "pbrMetallicRoughness": {**TEXTURED, "baseColorFactor": [0.5, 0.25, 1.0, 0.75]},
        "alphaMode": "MASK",
        "alphaCutoff": 0.3,
    }
    material = imported(tmp_path, material=masked, image=IMAGE, colors=[(1.0, 0.5, 0.0, 1.0)] * 4)
    description, messages = describe_material(material)
    assert description["base_color"] == pytest.approx((0.5, 0.25, 1.0, 0.75))
    assert description["image"] is not None
    assert description["alpha_cutoff"] == pytest.approx(0.3)
    assert messages == []
    surface = read_surface(material)
    assert (surface.color_attribute, surface.alpha_attribute) == ("", "")


def test_a_blended_glb_keeps_its_alpha(tmp_path: Path) -> None:
    blended = {"pbrMetallicRoughness": {**TEXTURED, "baseColorFactor": [1, 1, 1, 0.5]}, "alphaMode": "BLEND"}
    description, messages = describe_material(imported(tmp_path, material=blended, image=IMAGE))
    assert description["alpha_mode"] == "BLEND"
    assert description["base_color"] == (1.0, 1.0, 1.0, 0.5)
    assert description["image"] is not None
    assert description["image"][0, 1].tolist() == [0, 255, 0, 128]
    assert messages == []


def test_vertex_colors_of_a_glb_do_not_change_the_base_color(tmp_path: Path) -> None:
    plain: dict[str, Any] = {"pbrMetallicRoughness": {}}
    material = imported(tmp_path, material=plain, colors=[(1.0, 0.5, 0.0, 1.0)] * 4)
    description, messages = describe_material(material)
    assert (description["base_color"], description["image"], messages) == ((1.0, 1.0, 1.0, 1.0), None, [])
    assert read_surface(material).color_attribute == ""


@pytest.mark.parametrize(
    ("sampler", "extension"),
    [
        ({"wrapS": 10497, "wrapT": 10497}, "REPEAT"),
        ({"wrapS": 33071, "wrapT": 33071}, "EXTEND"),
        ({"wrapS": 33648, "wrapT": 33648}, "MIRROR"),
        ({"wrapS": 10497, "wrapT": 33071}, "MIXED"),
        ({"wrapS": 33648, "wrapT": 10497}, "MIXED"),
    ],
)
def test_the_wrapping_of_a_glb_is_read(tmp_path: Path, sampler: dict[str, Any], extension: str) -> None:
    masked = {"pbrMetallicRoughness": TEXTURED, "alphaMode": "MASK"}
    surface = read_surface(imported(tmp_path, material=masked, image=IMAGE, sampler=sampler))
    assert surface.warnings == ()
    assert surface.texture is not None
    assert surface.texture.extension == extension


def test_the_scale_of_a_normal_map_is_rendered(tmp_path: Path) -> None:
    """Blender renders a scale of 0.5 as the mean of (0.6, 0, 0.8) and (0, 0, 1)."""
    tilted = png([[(204, 128, 230, 255)] * 2] * 2)
    material = imported(tmp_path, material={"normalTexture": {"index": 0, "scale": 0.5}}, image=tilted)
    description, [message] = describe_material(material, ("normals",))
    assert "its normals are more than a tangent-space map of strength 1; they are rendered" in message
    assert description["normal"] is not None
    x, z = np.array([0.3, 0.9]) / np.hypot(0.3, 0.9)
    expected = [127.5 * (1.0 + x), 128, 127.5 * (1.0 + z), 255]
    assert np.abs(description["normal"] - np.array(expected)).max() <= 1.5


def test_the_factors_of_roughness_and_metallic_are_applied(tmp_path: Path) -> None:
    """The codes are 0.5 · 204 for roughness and 0.25 · 80 for metallic."""
    orm = {"metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.5, "metallicFactor": 0.25}
    pixels = png([[(0, 204, 80, 255)] * 2] * 2)
    material = imported(tmp_path, material={"pbrMetallicRoughness": orm}, image=pixels)
    description, _ = describe_material(material, ("orm",))
    assert description["orm"] is not None
    assert np.abs(description["orm"].astype(int) - (255, 102, 20, 255)).max() <= 1
    assert (description["roughness"], description["metallic"]) == (1.0, 1.0)


def test_the_texture_transform_of_a_glb_is_read(tmp_path: Path) -> None:
    quarter_turn = {"offset": [0.5, 0.0], "rotation": np.pi / 2, "scale": [2.0, 4.0]}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": quarter_turn}}
    material = imported(tmp_path, material={"pbrMetallicRoughness": {"baseColorTexture": texture}}, image=IMAGE)
    surface = read_surface(material)
    assert surface.warnings == ()
    assert surface.texture is not None
    rows = np.reshape(surface.texture.transform, (2, 3))
    # From the specification: glTF's (u, v) looks up (0.5 + cos·2u + sin·4v, −sin·2u + cos·4v), here (0.5 + 4v, −2u);
    # Blender's v is 1 − glTF's.
    for u, v in ((0.0, 0.0), (1.0, 0.0), (0.25, 0.75)):
        looked_up = rows @ (u, 1 - v, 1)
        np.testing.assert_allclose((looked_up[0], 1 - looked_up[1]), (0.5 + 4 * v, -2 * u), atol=1e-6)


def test_a_glb_without_its_texture_raises(tmp_path: Path) -> None:
    material = imported(tmp_path, material={"pbrMetallicRoughness": TEXTURED}, image_uri="gone.png")
    with pytest.raises(SceneError) as caught:
        describe_material(material)
    assert str(caught.value) == (
        f"texture 'gone.png' of material 'leaf' cannot be read: {tmp_path / 'gone.png'}; "
        f"put the file there, or pack it into the .blend"
    )


def test_a_texture_that_is_not_an_image_raises(tmp_path: Path) -> None:
    material = imported(tmp_path, material={"pbrMetallicRoughness": TEXTURED}, image=b"no image at all")
    with pytest.raises(
        SceneError, match="'Image_0' of material 'leaf' cannot be read: its packed data is not an image"
    ):
        describe_material(material)


@pytest.mark.parametrize("with_opacity", [True, False])
def test_the_materials_of_an_obj_are_read(tmp_path: Path, with_opacity: bool) -> None:
    (tmp_path / "tex.png").write_bytes(IMAGE)
    maps = "map_Kd tex.png\n" + ("map_d tex.png\n" if with_opacity else "")
    (tmp_path / "a.mtl").write_text(f"newmtl leaf\nKd 0.1 0.5 0.2\n{maps}")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl leaf\nf 1/1 2/2 3/3\n"
    )
    load(tmp_path / "a.obj")
    description, messages = describe_material(bpy.data.materials["leaf"])
    assert messages == []
    assert description["image"] is not None
    assert description["image"][0, 0].tolist() == [255, 0, 0, 255]
    assert description["image"][1, 0, :3].tolist() == [0, 0, 255]
    assert description["alpha_mode"] == ("BLEND" if with_opacity else "OPAQUE")


def test_a_greater_than_node_survives_export_and_import(tmp_path: Path) -> None:
    """The material has the nodes of Leafcloud's own levels: Principled BSDF, image, Greater Than."""
    material, principled, tree = new_material()
    pixels = [[tuple(value / 255 for value in pixel) for pixel in row] for row in (TOP, BOTTOM)]
    image = texture_node(tree, new_image("i", pixels, alpha_mode="CHANNEL_PACKED"))
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(math_node(tree, "GREATER_THAN", image.outputs["Alpha"], 0.25), principled.inputs["Alpha"])
    mesh = bpy.data.meshes.new("q")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0)], [], [(0, 1, 2)])
    mesh.uv_layers.new(name="UVMap")
    mesh.materials.append(material)
    bpy.context.collection.objects.link(bpy.data.objects.new("q", mesh))
    before, _ = describe_material(material)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "a.glb"), export_format="GLB")
    load(tmp_path / "a.glb")
    after, messages = describe_material(bpy.data.materials["m"])
    assert messages == []
    assert before["image"] is not None
    assert after["image"] is not None
    assert after["image"].tolist() == before["image"].tolist() == [[list(p) for p in row] for row in (TOP, BOTTOM)]
    assert (after["alpha_mode"], after["alpha_cutoff"]) == ("MASK", pytest.approx(0.25))


def test_an_image_file_without_alpha_is_opaque(tmp_path: Path) -> None:
    (tmp_path / "rgb.bmp").write_bytes(_bmp([(10, 20, 30)]))
    material, principled, tree = new_material()
    image = texture_node(tree, bpy.data.images.load(str(tmp_path / "rgb.bmp")))
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    description, _ = describe_material(material)
    assert description["image"] is not None
    assert description["image"].tolist() == [[[10, 20, 30, 255]]]


def _bmp(row: list[tuple[int, int, int]]) -> bytes:
    """Return one row of RGB pixels as a BMP file."""
    body = b"".join(bytes((blue, green, red)) for red, green, blue in row)
    body += b"\0" * (-len(body) % 4)
    header = struct.pack("<2sIHHI", b"BM", 54 + len(body), 0, 0, 54)
    return header + struct.pack("<IiiHHIIiiII", 40, len(row), 1, 1, 24, 0, len(body), 2835, 2835, 0, 0) + body
