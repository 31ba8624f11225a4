"""Files with compressed meshes (`--compress`) hold the numbers of plain files, within the errors that are promised."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import folder_of
from command_line import refusal
from engine_views import levels_of, pictures, views_of_all_levels
from numpy.typing import NDArray

import leafcloud
from addon.export.compression import exponents_of
from leafcloud._glb import GlbFile

COORDINATE, DIRECTION = 2.0**-17, 1.0 / 254.0


@pytest.fixture(scope="module")
def folders() -> dict[str, Path]:
    """Folders of two bakes of the shrub for each engine: *ENGINE* plain, and *ENGINE* compressed."""
    return {name: folder_of(name) for name in ("three", "three compressed", "unity", "unity compressed")}


def primitives(file: GlbFile) -> list[dict[str, Any]]:
    return [primitive for mesh in file.items("meshes") for primitive in mesh["primitives"]]


def numbers(file: GlbFile, accessor: int) -> NDArray[np.float64]:
    """Return the numbers of an accessor as a reader gets them: normalized integers become fractions."""
    described = file.items("accessors")[accessor]
    scale = {5120: 127.0, 5123: 65535.0}[described["componentType"]] if described.pop("normalized", False) else 1.0
    return file.values(accessor) / scale


def allowed(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest error of each column of an attribute that is stored as `values` (v, w) without compression."""
    if name in ("NORMAL", "TANGENT"):
        return np.full(values.shape[1], DIRECTION)
    if name in ("TEXCOORD_0", "TEXCOORD_1") and values.min() >= 0.0 and values.max() <= 1.0:
        return np.full(values.shape[1], COORDINATE)
    return np.maximum(2.0**-16 * np.ptp(values, axis=0), 2.0**-22 * np.abs(values).max(axis=0))


@pytest.mark.parametrize("engine", ["three", "unity"])
@pytest.mark.parametrize("name", ["shrub", "shrub_LOD0", "shrub_LOD1"])
def test_numbers_keep_their_promised_errors(folders: dict[str, Path], engine: str, name: str) -> None:
    plain, packed = (GlbFile(folders[f"{engine}{how}"] / f"{name}.glb") for how in ("", " compressed"))
    pairs = list(zip(primitives(plain), primitives(packed), strict=True))
    assert pairs
    for one, other in pairs:
        for before, after in zip(
            (one["attributes"], *one.get("targets", [])), (other["attributes"], *other.get("targets", [])), strict=True
        ):
            assert before.keys() == after.keys()
            for attribute in before:
                values = plain.values(before[attribute]).astype(np.float64)
                # A fresh reader: `numbers` takes the flags off.
                got = numbers(GlbFile(packed.path), after[attribute])
                assert (np.abs(got - values).max(axis=0) <= 1.0001 * allowed(attribute, values)).all(), attribute
        corners, kept = (file.values(each["indices"]).reshape(-1, 3) for file, each in ((plain, one), (packed, other)))
        turned = [np.roll(kept, turn, axis=1) for turn in range(3)]
        assert np.any([(corners == each).all(axis=1) for each in turned], axis=0).all()


def test_positions_tell_their_bounds(folders: dict[str, Path]) -> None:
    """glTF asks for the least and the largest position as they are stored."""
    file = GlbFile(folders["three compressed"] / "shrub_LOD0.glb")
    for primitive in primitives(file):
        position = primitive["attributes"]["POSITION"]
        values, described = file.values(position), file.items("accessors")[position]
        assert values.min(axis=0).tolist() == described["min"]
        assert values.max(axis=0).tolist() == described["max"]


@pytest.mark.parametrize("engine", ["three", "unity"])
def test_compressed_files_are_valid_and_less_than_two_thirds_as_large(
    folders: dict[str, Path], engine: str, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    files = sorted(folders[f"{engine} compressed"].glob("*.glb"))
    # The validator does not know KTX2.
    unknown = ("VALUE_NOT_IN_LIST", "IMAGE_UNRECOGNIZED_FORMAT")
    issues = [each for each in gltf_issues(*files) if each["code"] not in unknown or "/images/" not in each["pointer"]]
    assert issues == []
    sizes = [(folders[f"{engine}{how}"] / "shrub_LOD0.glb").stat().st_size for how in ("", " compressed")]
    assert sizes[1] < 2 / 3 * sizes[0], sizes


def test_the_command_reads_the_promises_of_compressed_files(folders: dict[str, Path]) -> None:
    from leafcloud.inspection import inspect

    plain, packed = (inspect(folders[name] / "shrub.glb") for name in ("three", "three compressed"))
    # A mip level is checked at image coordinates, which are integers in compressed files; these are not decoded.
    wanted = [(each.name, each.holds) for each in plain.checks if "mip level" not in each.name]
    assert [(each.name, each.holds) for each in packed.checks] == wanted
    assert len(wanted) >= 5
    assert all(each.holds for each in packed.checks)
    assert ("Babylon.js, Blender, Godot, Unreal, Bevy", "cannot open compressed meshes") in packed.engines


def test_engines_that_cannot_read_compressed_meshes_refuse_the_setting(shrub: Path, tmp_path: Path) -> None:
    line = refusal(tmp_path / "out", "--input", shrub, "--engine", "godot", "--compress")
    assert "godot cannot read compressed meshes" in line


@pytest.mark.parametrize(
    ("offset", "spread"), [(0.0, 1.0), (3e4, 2.0), (-1e-3, 1e-6), (0.0, 0.0), (7.0, 0.0), (0.0, 3e30)]
)
def test_steps_suit_the_range_and_leave_room_for_the_largest_number(offset: float, spread: float) -> None:
    """A factor has 24 bits with its sign. A step is at most 2⁻¹⁵ of the range, or 2⁻²¹ of the largest number."""
    random = np.random.default_rng(5)
    values = (offset + spread * random.uniform(-1.0, 1.0, (500, 2))).astype(np.float32)
    steps = np.ldexp(1.0, exponents_of(values))
    factors = np.rint(values.astype(np.float64) / steps)
    assert np.abs(factors).max() < 2**23
    largest = np.maximum(2.0**-15 * np.ptp(values.astype(np.float64), axis=0), 2.0**-21 * np.abs(values).max(axis=0))
    assert (steps <= np.maximum(largest, 2.0**-100)).all()


def test_streams_of_other_contents_are_refused() -> None:
    rows = np.random.default_rng(1).integers(0, 255, (300, 12), np.uint8)
    triangles = np.array([[0, 1, 2], [2, 1, 3]], np.uint32)
    stream, corners = leafcloud.compress_rows(rows), leafcloud.compress_triangles(triangles)
    assert leafcloud.decompress(stream, 300, 12) == rows.tobytes()
    assert leafcloud.decompress(corners, 6, 4, "TRIANGLES") == triangles.tobytes()
    assert leafcloud.decompress(corners, 6, 2, "TRIANGLES") == triangles.astype("<u2").tobytes()
    wrong: list[Callable[[], object]] = [
        lambda: leafcloud.compress_rows(rows[:, :7]),
        lambda: leafcloud.decompress(stream, 400, 12),
        lambda: leafcloud.decompress(stream[:40], 300, 12),
        lambda: leafcloud.decompress(b"", 1, 4),
        lambda: leafcloud.decompress(stream, 2**60, 16),
        lambda: leafcloud.decompress(stream, 300, 11),
        lambda: leafcloud.decompress(corners, 2**62, 4, "TRIANGLES"),
        lambda: leafcloud.decompress(stream, 300, 4, "TRIANGLES"),
        lambda: leafcloud.decompress(corners, 5, 4, "TRIANGLES"),
        lambda: leafcloud.decompress(corners, 6, 4, "OTHER"),
        lambda: leafcloud.decompress(stream, 300, 12, filter="QUATERNION"),
    ]
    for each in wrong:
        with pytest.raises(leafcloud.LeafcloudError, match=r"stream|rows have|the mode|the filter"):
            each()


@pytest.mark.browser
def test_three_js_draws_compressed_and_plain_files_alike(folders: dict[str, Path]) -> None:
    """All levels, in the middle of their transitions, too. A step of positions is far below a pixel."""
    levels = levels_of(folders["three"] / "shrub.glb")
    _, views = views_of_all_levels(levels)
    drawn = [pictures("three", folders[name] / "shrub.glb", views=views) for name in ("three", "three compressed")]
    for plain, packed in zip(*drawn, strict=True):
        assert plain["triangles"] == packed["triangles"]
        assert (plain["pixels"][..., 3] > 0).any()
        differs = np.abs(plain["pixels"].astype(int) - packed["pixels"]).max(axis=-1) > 24
        assert differs.sum() <= 0.02 * (plain["pixels"][..., 3] > 0).sum() + 3


def test_filters_of_streams_are_undone() -> None:
    """By the extension's formulas: 2^e · m of 8 and 24 bits, the octahedron's point (0, 0) is the axis z."""
    words = np.array([[3 | 2 << 24], [(1 << 24) - 5 | 0xFF << 24]], np.uint32)
    stream = leafcloud.compress_rows(words.view(np.uint8))
    floats = np.frombuffer(leafcloud.decompress(stream, 2, 4, filter="EXPONENTIAL"), "<f4")
    assert floats.tolist() == [12.0, -2.5]
    axes = np.array([(0, 0, 127, 5), (127, 0, 127, 9)], np.int8)
    stream = leafcloud.compress_rows(axes.view(np.uint8))
    found = np.frombuffer(leafcloud.decompress(stream, 2, 4, filter="OCTAHEDRAL"), np.int8).reshape(2, 4)
    assert found.tolist() == [[0, 0, 127, 5], [127, 0, 0, 9]]
