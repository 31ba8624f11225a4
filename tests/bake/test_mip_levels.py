"""Mip levels beside the PNG pages in files for Babylon.js, Bevy and Godot: those of KTX2, decoded with three.js."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import FINE, bake
from glb import read_chunks
from mip_levels import levels_in

import leafcloud

HERE = Path(__file__).parent
THREE = HERE.parents[1] / "engines" / "three" / "node_modules" / "three"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, shrub: Path) -> Path:
    out = tmp_path_factory.mktemp("babylon")
    bake(shrub, out, *FINE, "--engine", "babylon", "--levels", 1, "--last", "cross", "--effects", "none")
    return out


def page_of(path: Path, number: int) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the material of level `number`, and the files of its page: `png`, `mips` and `ktx2`."""
    document, binary = read_chunks(path)
    [material] = [each for each in document["materials"] if each["name"] == f"shrub_LOD{number}"]

    def image(index: int) -> bytes:
        view = document["bufferViews"][document["images"][index]["bufferView"]]
        return binary[view.get("byteOffset", 0) :][: view["byteLength"]]

    color = document["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    mips = document["textures"][material["extras"]["leafcloud"]["mipLevels"]["index"]]
    compressed = color["extensions"]["KHR_texture_basisu"]["source"]
    return material, {"png": image(color["source"]), "mips": image(mips["source"]), "ktx2": image(compressed)}


@pytest.mark.parametrize("number", [1, 2])
def test_mip_levels_are_those_of_the_ktx2(number: int, files: Path, tmp_path: Path) -> None:
    """The encoder keeps each texel on its side of the cutoff."""
    material, page = page_of(files / f"shrub_LOD{number}.glb", number)
    (tmp_path / "page.ktx2").write_bytes(page["ktx2"])
    subprocess.run(["node", HERE / "transcode.mjs", THREE, tmp_path / "page.ktx2", tmp_path], check=True, timeout=60)
    cutoff = 255.0 * material["alphaCutoff"] - 1e-3
    levels = levels_in(leafcloud.decode_image(page["mips"]))
    assert levels[0].shape == leafcloud.decode_image(page["png"]).shape
    of_ktx2 = [np.fromfile(tmp_path / str(i), np.uint8) for i in range(len(list(tmp_path.glob("[0-9]*"))))]
    for level, codes in zip(levels, of_ktx2[-len(levels) :], strict=True):
        seen = codes.reshape(level.shape)
        drawn = level[..., 3] >= cutoff
        assert np.array_equal(drawn, seen[..., 3] >= cutoff)
        if drawn.any():
            assert np.abs(level[drawn].astype(float) - seen[drawn])[:, :3].mean() < 6.0


@pytest.mark.parametrize("engine", ["bevy", "godot"])
def test_the_validator_finds_nothing(
    engine: str, gltf_issues: Callable[..., list[dict[str, Any]]], tmp_path: Path, shrub: Path
) -> None:
    bake(shrub, tmp_path, *FINE, "--engine", engine, "--levels", 1, "--last", "octahedral", "--effects", "none")
    for number in (1, 2):
        document, _ = read_chunks(tmp_path / f"shrub_LOD{number}.glb")
        assert "mipLevels" in str(document["materials"])
    assert gltf_issues(*tmp_path.glob("*.glb")) == []


def test_the_validator_finds_nothing_but_ktx2(files: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    found = gltf_issues(*files.glob("*.glb"))
    assert {issue["code"] for issue in found} <= {"VALUE_NOT_IN_LIST", "IMAGE_UNRECOGNIZED_FORMAT"}


def test_other_engines_get_no_mip_levels(tmp_path: Path, shrub: Path) -> None:
    bake(shrub, tmp_path, *FINE, "--engine", "generic", "--levels", 1, "--no-cross", "--effects", "none")
    document, _ = read_chunks(tmp_path / "shrub_LOD1.glb")
    assert "mipLevels" not in str(document)
