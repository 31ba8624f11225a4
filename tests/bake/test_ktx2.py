"""KTX2 textures with their own mip levels in files for engines that read them, decoded with three.js."""

from __future__ import annotations

import json
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import folder_of, kept
from command_line import QUICK, report_in
from night import rest_at_night

import leafcloud
from addon.material.surface import read_surface
from addon.scene.load import load

HERE = Path(__file__).parent
THREE = HERE.parents[1] / "engines" / "three" / "node_modules" / "three"
WORDS = ("format", "type_size", "width", "height", "depth", "layers", "faces", "levels", "scheme")


def header(file: bytes) -> dict[str, int]:
    assert file[:12] == b"\xabKTX 20\xbb\r\n\x1a\n"
    return dict(zip(WORDS, struct.unpack_from("<9I", file, 12), strict=True))


def transfer(file: bytes) -> str:
    """Return the transfer function in the data format descriptor: linear or sRGB."""
    start = struct.unpack_from("<I", file, 48)[0]
    assert file[start + 12] == 166, "UASTC"
    return {1: "linear", 2: "sRGB"}[file[start + 14]]


def document_of(path: Path) -> tuple[dict[str, Any], bytes]:
    content = path.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + size]), content[28 + size :]


@pytest.fixture(scope="module")
def files() -> Path:
    return folder_of("three shaded")


def test_each_texture_of_a_level_is_stored_as_png_and_ktx2(files: Path) -> None:
    document, binary = document_of(files / "shrub_LOD1.glb")
    assert document["extensionsUsed"].count("KHR_texture_basisu") == 1
    assert "KHR_texture_basisu" not in document.get("extensionsRequired", [])
    [material] = [material for material in document["materials"] if material["name"] == "shrub_LOD1"]
    surface = material["pbrMetallicRoughness"]
    expected = {
        surface["baseColorTexture"]["index"]: "sRGB",
        surface["metallicRoughnessTexture"]["index"]: "linear",
        material["normalTexture"]["index"]: "linear",
        material["extras"]["leafcloud"]["bentNormalTexture"]["index"]: "linear",
    }
    assert len(expected) == 4
    for number, codes in expected.items():
        texture = document["textures"][number]
        assert document["images"][texture["source"]]["mimeType"] == "image/png"
        image = document["images"][texture["extensions"]["KHR_texture_basisu"]["source"]]
        assert image["mimeType"] == "image/ktx2"
        view = document["bufferViews"][image["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        file = binary[view["byteOffset"] :][: view["byteLength"]]
        assert header(file) == dict(zip(WORDS, (0, 1, 128, 128, 0, 0, 1, 8, 2), strict=True))
        assert transfer(file) == codes


@pytest.mark.parametrize("effects", rest_at_night(["none", "blend_order"]))
def test_a_page_that_is_not_square_has_all_mip_levels(effects: str) -> None:
    shape = ("--levels", 1, "--no-cross", "--texture-height", 64, "--effects", effects)
    document, binary = document_of(kept(*QUICK, "--engine", "three", *shape) / "shrub_LOD1.glb")
    [image] = [image for image in document["images"] if image["mimeType"] == "image/ktx2"]
    view = document["bufferViews"][image["bufferView"]]
    found = header(binary[view["byteOffset"] :][: view["byteLength"]])
    assert (found["width"], found["height"], found["levels"]) == (128, 64, 8)


def test_the_leaves_keep_their_own_textures(files: Path) -> None:
    document, _ = document_of(files / "shrub_LOD0.glb")
    assert "KHR_texture_basisu" not in document.get("extensionsUsed", [])


def test_occlusion_and_roughness_share_a_texture(files: Path) -> None:
    document, _ = document_of(files / "shrub_LOD1.glb")
    [material] = [material for material in document["materials"] if material["name"] == "shrub_LOD1"]
    orm = material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"]
    assert material["occlusionTexture"]["index"] == orm


def test_the_validator_finds_nothing_but_the_extension(
    files: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    found = gltf_issues(*files.glob("*.glb"))
    # The validator does not know KTX2.
    assert {issue["code"] for issue in found} <= {"VALUE_NOT_IN_LIST", "IMAGE_UNRECOGNIZED_FORMAT"}
    assert all("/images/" in issue["pointer"] for issue in found)


def chain(side: int) -> leafcloud.Chain:
    positions = np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], np.float32)
    foliage = leafcloud.Foliage(positions, np.array([(0, 1, 2), (0, 2, 3)], np.int32))
    return leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=side)


def test_missing_channels_and_odd_sizes_are_refused() -> None:
    [level] = chain(64).levels
    assert header(level.ktx2("base_color"))["levels"] == 7
    with pytest.raises(leafcloud.LeafcloudError, match=r'no channel "normal" with mips; it has base_color'):
        level.ktx2("normal")
    [odd] = chain(66).levels
    with pytest.raises(leafcloud.LeafcloudError, match=r"66 × 66 pixels; both sides must be multiples of 4"):
        odd.ktx2("base_color")


@pytest.mark.night
def test_pages_with_sizes_that_gltf_forbids_stay_png() -> None:
    """The side 132 is a multiple of 4, the side 66 is not."""
    folder = kept("--engine", "three", "--texture-size", 132, "--epsilon", 0.1, "--every-level", "--files", "levels")
    assert any("pages of 66 × 66 stay PNG only" in warning for warning in report_in(folder)["warnings"])
    first, second = (document_of(folder / f"shrub_LOD{number}.glb")[0] for number in (1, 2))
    assert "extensionsUsed" in first
    assert "extensionsUsed" not in second


def needles() -> leafcloud.Level:
    """Return level 1 of random cards. Each card shows a thin needle."""
    random = np.random.default_rng(5)
    places, sides = random.normal(size=(300, 1, 3)), random.normal(size=(300, 2, 3)) * 0.15
    corners = places + np.stack([-sides[:, 0], sides[:, 1], sides[:, 0], -sides[:, 1]], axis=1)
    first = 4 * np.arange(300)[:, None, None]
    image = np.full((64, 64, 4), (30, 150, 40, 0), np.uint8)
    image[:, 26:38, 3] = 255
    foliage = leafcloud.Foliage(
        corners.reshape(-1, 3),
        (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3),
        uvs=np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), (300, 1)),
        materials=[leafcloud.Material(image=image, alpha_mode="MASK")],
    )
    [level] = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=512).levels
    return level


def test_compression_keeps_the_mips(tmp_path: Path) -> None:
    """Alpha of every mip within some codes, and the share above the cutoff, which is that of the page."""
    level = needles()
    (tmp_path / "page.ktx2").write_bytes(level.ktx2("base_color"))
    command = ["node", HERE / "transcode.mjs", THREE, tmp_path / "page.ktx2", tmp_path]
    subprocess.run(command, check=True, timeout=60)
    code = 255.0 * level.alpha_cutoff - 1e-3
    mips = level.mips("base_color")
    own = float((mips[0][..., 3] >= code).mean())
    for number, mip in enumerate(mips[:4]):
        seen = np.fromfile(tmp_path / str(number), np.uint8).reshape(mip.shape)
        assert np.abs(seen[..., 3].astype(int) - mip[..., 3]).mean() < 4.0, number
        assert float((seen[..., 3] >= code).mean()) == pytest.approx(own, rel=0.3), number


def test_materials_tell_the_pivots_of_alpha(files: Path) -> None:
    document, _ = document_of(files / "shrub_LOD1.glb")
    [material] = [each for each in document["materials"] if each["name"] == "shrub_LOD1"]
    pivots = material["extras"]["leafcloud"]["alphaPivots"]
    assert pivots[0] == pytest.approx(material["alphaCutoff"], abs=1e-3)
    assert all(0.0 < pivot < 1.0 for pivot in pivots)


def test_a_file_with_ktx2_is_read_again(files: Path) -> None:
    """The scene has the KTX2 texture in place of the PNG, with nearly its colors where leaves are opaque."""
    load(files / "shrub_LOD1.glb")
    material = bpy.data.objects["shrub_LOD1"].data.materials[0]
    surface = read_surface(material)
    assert surface.color_texture is not None
    page = surface.color_texture.image
    document, binary = document_of(files / "shrub_LOD1.glb")
    [level] = [each for each in document["materials"] if each["name"] == material.name]
    own = level["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    view = document["bufferViews"][document["images"][document["textures"][own]["source"]]["bufferView"]]
    png = leafcloud.decode_image(binary[view.get("byteOffset", 0) :][: view["byteLength"]])
    assert tuple(page.size) == png.shape[1::-1]
    read = leafcloud.decode_image(page.packed_file.data)
    inside = (png[..., 3] == 255) & (read[..., 3] == 255)
    assert inside.mean() > 0.05
    assert np.abs(read[inside].astype(int) - png[inside])[:, :3].mean() < 6.0
