"""Costs of drawing in the report, and levels that are left out because they save nothing."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import kept
from command_line import bake, report_in, run
from glb import read_chunks, read_glb
from small_glb import png, write_quad_glb

import leafcloud
from addon.export.glb_file import Glb
from addon.export.gpu_load import GpuLoad, image_size
from addon.export.report import texture_warnings

KEYS = {
    "crown_pixels", "size", "fragments", "fragments_before", "fragments_leaves", "trunk_fragments", "layers", "area",
    "cheaper",
    "gpu_bytes", "texture_bytes", "written_triangles",
}  # fmt: skip


@pytest.fixture(scope="module")
def baked() -> tuple[Path, dict[str, Any]]:
    out = kept(
        *("--texture-size", 256, "--levels", 1, "--every-level", "--last", "cross", "--form", "billboards"),
        *("--files", "levels"),
    )
    return out, report_in(out)


def test_every_level_tells_its_cost_where_it_takes_over(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    leaves, *levels = report["levels"]
    assert set(leaves["drawing"]) == KEYS
    for level in levels:
        drawing = level["drawing"]
        assert set(drawing) == KEYS
        # A view of 1080 rows and 50°.
        rows_high = 2.0 * math.tan(math.radians(25.0)) * level["switch_distance"]
        assert drawing["size"] == drawing["crown_pixels"] / 1080
        assert drawing["crown_pixels"] == pytest.approx(1080 * 2.0 * report["input"]["radius"] / rows_high)
        assert 0.0 < drawing["fragments"] < drawing["fragments_leaves"] * drawing["layers"]
        assert (drawing["trunk_fragments"] > 0.0) == (level["trunk_triangles"] > 0)
    cloud, cross = (level["drawing"] for level in levels)
    assert cloud["fragments_before"] == cloud["fragments_leaves"] == leaves["drawing"]["fragments"]
    assert (leaves["drawing"]["cheaper"], leaves["drawing"]["area"]) == (1.0, 1.0)
    assert cross["crown_pixels"] < cloud["crown_pixels"] == leaves["drawing"]["crown_pixels"]
    assert cross["fragments"] < cross["fragments_before"]
    total = cross["fragments"] + 8 * levels[1]["triangles"]
    whole = cross["fragments_leaves"] + 8 * (report["levels"][0]["triangles"] + report["levels"][0]["trunk_triangles"])
    assert cross["cheaper"] > whole / total, "the leaves also have a trunk to draw"


def test_areas_are_those_of_the_files(baked: tuple[Path, dict[str, Any]]) -> None:
    out, report = baked

    def area(number: int) -> float:
        node = read_glb(out / "shrub.glb")[f"shrub_LOD{number}"]
        return sum(part.area * (2 if part.material.get("doubleSided") else 1) for part in map(Sided, node.primitives))

    for number in (1, 2):
        found = report["levels"][number]["drawing"]["area"]
        assert found == pytest.approx(area(number) / area(0), rel=1e-4)


class Sided:
    """A primitive with the area of its triangles."""

    def __init__(self, primitive: Any) -> None:
        self.material = primitive.material
        corners = primitive.attributes["POSITION"].astype(float)[primitive.indices]
        edges = corners[:, 1:] - corners[:, :1]
        self.area = float(sum(abs_cross(*each) for each in edges) / 2.0)


def abs_cross(u: Any, v: Any) -> float:
    return math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def test_bytes_are_those_of_the_files_and_of_their_mip_levels(baked: tuple[Path, dict[str, Any]]) -> None:
    """A file of one level has nothing but that level."""
    out, report = baked
    for level in report["levels"]:
        document, binary = read_chunks(out / f"shrub_LOD{level['level']}.glb")
        views = document["bufferViews"]
        geometry = {accessor["bufferView"] for accessor in document["accessors"]}
        expected = float(sum(views[view]["byteLength"] for view in geometry))
        for image in document["images"]:
            width, height = struct.unpack_from(">II", binary, views[image["bufferView"]]["byteOffset"] + 16)
            expected += 4 * width * height * 4 / 3
        assert level["drawing"]["gpu_bytes"] == pytest.approx(expected, abs=4 * len(views))


def test_triangles_are_those_of_leaves_and_trunk_unless_blending_splits_them(
    baked: tuple[Path, dict[str, Any]],
) -> None:
    _, report = baked
    for level in report["levels"]:
        assert level["drawing"]["written_triangles"] == level["triangles"] + level["trunk_triangles"]


@pytest.mark.night
def test_a_small_tree_has_the_triangles_that_make_its_level_1_cheaper() -> None:
    """The 500 triangles of the default budget are not enough for the shrub's 672 cards."""
    level = report_in(kept("--epsilon", 0.04, "--pixels", 8))["levels"][1]
    assert level["method"] == "stochastic"
    assert level["triangles"] > 500
    assert level["drawing"]["cheaper"] > 1.5


def test_a_tree_of_one_leaf_needs_no_levels(tmp_path: Path) -> None:
    leaf = write_quad_glb(tmp_path / "leaf.glb")
    done = run("--input", leaf, "--out", tmp_path / "out", "--texture-size", 64)
    assert done.returncode == 0, done.stderr
    assert "leaf: 2 levels" in done.stdout
    assert done.stderr.count("was left out: where the crown is as high as") == 2
    assert "--every-level makes it" in done.stderr
    assert "the tree needs no levels" in done.stderr


@pytest.mark.night
def test_every_level_is_made_on_request(tmp_path: Path) -> None:
    leaf = write_quad_glb(tmp_path / "leaf.glb")
    report = bake(leaf, tmp_path / "out", "--texture-size", 64, "--every-level")
    assert [level["method"] for level in report["levels"]] == ["leaves", "stochastic", "stochastic", "cross"]
    assert report["left_out"] == []


def test_the_size_of_images(tmp_path: Path) -> None:
    assert image_size(png([[(0, 0, 0, 0)] * 5] * 3)) == (5, 3)
    image = bpy.data.images.new("sized", 37, 21)
    image.file_format = "JPEG"
    image.save(filepath=str(tmp_path / "sized.jpg"))
    assert image_size((tmp_path / "sized.jpg").read_bytes()) == (37, 21)
    assert image_size(b"") == image_size(b"\xff\xd8\xff\xe0") == image_size(b"RIFF0000WEBP") == (0, 0)


def test_textures_that_outweigh_the_leaves_are_told() -> None:
    def level(number: int, method: str, geometry: float, textures: float) -> dict[str, Any]:
        drawing = {"gpu_bytes": int(1e6 * (geometry + textures)), "texture_bytes": int(1e6 * textures)}
        return {"level": number, "method": method, "drawing": drawing}

    leaves, cloud = level(0, "leaves", 2.0, 1.0), level(1, "stochastic", 0.5, 6.0)
    [warning] = texture_warnings([leaves, cloud, level(2, "octahedral", 0.0, 11.0)])
    assert "17.0 MB on a graphics card, 6 times as much as the leaves with theirs (3.0 MB)" in warning
    assert "most of it for level 2: set `last=cross`" in warning
    [warning] = texture_warnings([leaves, level(1, "stochastic", 0.5, 20.0), level(2, "cross", 0.0, 0.1)])
    assert "most of it for level 1: set a smaller `texture_size`" in warning
    assert texture_warnings([leaves, cloud, level(2, "cross", 0.0, 0.1)]) == [], "few bytes"
    assert texture_warnings([level(0, "leaves", 9.0, 1.0), level(1, "stochastic", 0.5, 30.0)]) == [], "few times"


def test_an_image_as_png_and_as_ktx2_counts_twice() -> None:
    glb = Glb({"buffers": [{}], "bufferViews": [], "accessors": []}, bytearray())
    positions, indices = glb.append_accessor(np.zeros((3, 3), np.float32)), glb.append_indices(np.arange(3))
    picture = leafcloud.encode_png([np.zeros((6, 8, 4), np.uint8)])
    glb.document |= {
        "images": [{"bufferView": glb.append_view(picture)}],
        "textures": [{"source": 0}, {"source": 0, "extensions": {"KHR_texture_basisu": {"source": 0}}}],
        "materials": [{"emissiveTexture": {"index": 0}, "normalTexture": {"index": 1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": positions}, "indices": indices, "material": 0}]}],
        "nodes": [{"name": "leaves", "mesh": 0}],
    }
    load = GpuLoad()
    load.read(glb)
    texels = 8 * 6 * 4 / 3
    assert load.texture_bytes_of("leaves") == texels * (4 + 1)
