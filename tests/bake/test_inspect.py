"""`leafcloud inspect`: figures and promises of a baked file, of a broken one, and of another tool's."""

from __future__ import annotations

import io
import json
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import folder_of
from command_line import QUICK, bake
from glb import read_glb, rewritten
from PIL import Image

from leafcloud.command import main
from leafcloud.comparison import _copy_beside


@pytest.fixture(scope="module")
def folder() -> Path:
    return folder_of("three")


def inspected(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict[str, Any]]:
    """Return the exit status and the printed JSON."""
    capsys.readouterr()  # A bake's own output.
    status = main(["inspect", *map(str, arguments), "--json"])
    return status, json.loads(capsys.readouterr().out)


def test_each_level_has_its_figures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found = inspected(capsys, folder / "shrub.glb")
    assert status == 0
    nodes = read_glb(folder / "shrub.glb")
    for row in found["levels"]:
        primitives = [*nodes[row["name"]].primitives, *nodes[row["name"]].trunk]
        assert row["triangles"] == sum(len(primitive.indices) for primitive in primitives)
        assert row["vertices"] == sum(len(primitive.attributes["POSITION"]) for primitive in primitives)
    clouds = [row for row in found["levels"] if row["number"] in (1, 2)]
    assert all(picture["kind"] == "KTX2" for row in clouds for picture in row["pictures"][:1])
    assert {each["name"]: each["holds"] for each in found["checks"]}["plain readers show one level of each tree"]
    assert any("drop _LEAF" in loss and "_LEAF_PIVOT" in loss for _, loss in found["engines"])


def test_triangles_out_of_order_are_found(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def reverse(document: dict[str, Any], body: bytearray) -> None:
        [mesh] = [each for each in document["meshes"] if each["name"] == "shrub_LOD0"]
        accessor = document["accessors"][mesh["primitives"][0]["indices"]]
        start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        kind = {5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        indices = np.frombuffer(body, kind, accessor["count"], start).reshape(-1, 3)[::-1].copy()
        body[start : start + indices.nbytes] = indices.tobytes()

    status, found = inspected(capsys, rewritten(folder / "shrub.glb", tmp_path / "reversed.glb", reverse))
    assert status == 1
    assert [each["name"] for each in found["checks"] if not each["holds"]] == [
        "shrub_LOD0: triangles in the order of ranks"
    ]


def test_leaves_that_end_beside_their_billboards_are_found(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def drop_targets(document: dict[str, Any], body: bytearray) -> None:
        for mesh in document["meshes"]:
            for primitive in mesh["primitives"]:
                primitive.pop("targets", None)

    status, found = inspected(capsys, rewritten(folder / "shrub.glb", tmp_path / "still.glb", drop_targets))
    assert status == 1
    assert "shrub_LOD0: leaves end on the next level" in [each["name"] for each in found["checks"] if not each["holds"]]


def test_leaves_that_move_too_far_are_found(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Level 1 claims half of the deviation that it has, or less."""
    name = "shrub_LOD0: leaves move at most by the error bound"
    status, found = inspected(capsys, folder / "shrub.glb")
    assert (status, {each["name"]: each["holds"] for each in found["checks"]}[name]) == (0, True)

    def claim(document: dict[str, Any], body: bytearray) -> None:
        for node in document["nodes"]:
            if node["name"] == "shrub_LOD1":
                node["extras"]["leafcloud"]["max_deviation"] *= 0.25

    status, found = inspected(capsys, rewritten(folder / "shrub.glb", tmp_path / "claimed.glb", claim))
    assert (status, [each["name"] for each in found["checks"] if not each["holds"]]) == (1, [name])


def test_textures_that_dissolve_in_mip_levels_are_found(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A texture of fine noise, a quarter of it opaque: in means of 2 × 2 texels few reach the cutoff of a half."""
    saved = io.BytesIO()
    texels = np.full((256, 256, 4), 255, np.uint8)
    texels[..., 3] = 255 * (np.random.default_rng(2).random((256, 256)) < 0.25)
    Image.fromarray(texels).save(saved, "PNG")

    def replace(document: dict[str, Any], body: bytearray) -> None:
        [material] = [each for each in document["materials"] if each["name"] == "shrub_LOD1"]
        material["alphaCutoff"] = 0.7
        texture = document["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
        body += b"\0" * (-len(body) % 4)
        view = {"buffer": 0, "byteOffset": len(body), "byteLength": len(saved.getvalue())}
        body += saved.getvalue() + b"\0" * (-len(saved.getvalue()) % 4)
        document["images"][texture["source"]]["bufferView"] = len(document["bufferViews"])
        document["bufferViews"].append(view)
        document["buffers"][0]["byteLength"] = len(body)

    name = "shrub_LOD1: the first plain mip level of the PNG keeps the coverage"
    _, found = inspected(capsys, folder / "shrub.glb")
    assert {each["name"]: each["holds"] for each in found["checks"]}[name]
    status, found = inspected(capsys, rewritten(folder / "shrub.glb", tmp_path / "noise.glb", replace))
    assert (status, [each["name"] for each in found["checks"] if not each["holds"]]) == (1, [name])


def test_another_tools_file_is_one_level_without_promises(shrub: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found = inspected(capsys, shrub)
    assert (status, len(found["levels"]), found["checks"]) == (0, 1, [])


def test_levels_of_another_tool_are_found_by_their_names(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def foreign(document: dict[str, Any], body: bytearray) -> None:
        for node in document["nodes"]:
            node.pop("extras", None)
            node.pop("extensions", None)
        document["scenes"][0]["nodes"] = list(range(len(document["nodes"])))

    path = rewritten(folder_of("generic") / "shrub.glb", tmp_path / "other.glb", foreign)
    status, found = inspected(capsys, path, "--against", path)
    names = [row["name"] for row in found["levels"]]
    assert (status, names[:2], found["levels"][0]["number"]) == (0, ["shrub_LOD0", "shrub_LOD1"], None)
    assert [each["level"] for each in found["scores"]] == [name for name in names for _ in range(4)]
    costs = [each["cost"] for each in found["scores"][::4]]
    assert costs[0] == 1.0 > costs[-1]


def test_a_file_is_like_itself_and_a_level_is_near_the_leaves(
    folder: Path, shrub: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, same = inspected(capsys, shrub, "--against", shrub)
    assert [each["size"] for each in same["scores"]] == [256, 128, 64, 32]
    assert all((each["flip"], each["coverage"], each["cost"]) == (0.0, 1.0, 1.0) for each in same["scores"])
    _, level = inspected(capsys, folder / "shrub_LOD1.glb", "--against", shrub)
    errors = [each["flip"] for each in level["scores"]]
    assert errors == sorted(errors, reverse=True)
    # The crown has 27 pixels here, and level 1 takes over at 19: its page is made for these and for fewer.
    assert 0.0 < errors[-1] < 0.12
    assert 0.8 < level["scores"][0]["coverage"] < 1.2
    assert level["scores"][0]["cost"] < 1.0


def test_the_tables_name_every_level(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(folder / "shrub.glb")]) == 0
    printed = capsys.readouterr().out
    for number in range(3):
        assert f"shrub_LOD{number}" in printed
    assert "BROKEN" not in printed


def test_several_files_are_read(folder: Path, shrub: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, found = inspected(capsys, folder / "shrub.glb", shrub)
    assert (status, [row["file"] for row in found]) == (0, [str(folder / "shrub.glb"), str(shrub)])
    alone = [inspected(capsys, file)[1] for file in (folder / "shrub.glb", shrub)]
    assert [{key: value for key, value in row.items() if key != "file"} for row in found] == alone
    (tmp_path / "broken.glb").write_bytes(b"")
    assert main(["inspect", str(tmp_path / "broken.glb"), str(shrub)]) == 1
    printed = capsys.readouterr()
    assert "broken.glb is no GLB file" in printed.err
    assert printed.out.startswith(f"{shrub}\n")
    assert "no levels of Leafcloud" in printed.out


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is no GLB file"),
        (b"no tree at all, but long enough", "is no GLB file"),
        (struct.pack("<4sII", b"glTF", 2, 5000) + b"JSON", "is no GLB file"),
        (struct.pack("<4sIII4s", b"glTF", 2, 22, 2, b"JSON") + b"[]", "is no GLB file"),
        (struct.pack("<4sIII4s", b"glTF", 2, 22, 2, b"JSON") + b"{}", "has no asset"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(
    content: bytes, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "broken.glb"
    path.write_bytes(content)
    assert main(["inspect", str(path)]) == 1
    said = capsys.readouterr().err
    assert reason in said
    assert said.count("\n") == 1


@pytest.mark.night
def test_each_tree_of_a_file_is_checked_alone(shrub: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "bush.glb"
    shutil.copy(shrub, other)
    bake(shrub, tmp_path / "out", "--input", shrub, other, *QUICK, "--effects=+transitions")
    status, found = inspected(capsys, tmp_path / "out" / "shrub_bush.glb")
    assert status == 0
    assert len([each for each in found["checks"] if "one after the other" in each["name"]]) == 2
    assert found["checks"][0]["figure"] == "2 of 2 trees"


def test_ranks_in_texture_coordinates_are_found(capsys: pytest.CaptureFixture[str]) -> None:
    status, found = inspected(capsys, folder_of("godot") / "shrub.glb")
    assert status == 0
    assert "shrub_LOD0: triangles in the order of ranks" in [each["name"] for each in found["checks"]]


@pytest.mark.parametrize(
    "document",
    [
        {"nodes": [{"mesh": 0}], "meshes": [{"primitives": []}]},
        {"nodes": [], "scenes": [{}]},
        {"scenes": [{"nodes": [0]}], "nodes": [{"children": [0]}]},
    ],
)
def test_sparse_documents_are_read(
    document: dict[str, Any], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def replace(own: dict[str, Any], body: bytearray) -> None:
        own.clear()
        own.update(document, asset={"version": "2.0"})

    status, found = inspected(capsys, rewritten(folder / "shrub.glb", tmp_path / "sparse.glb", replace))
    assert (status, found["levels"][0]["triangles"]) == (0, 0)


@pytest.mark.parametrize("name", [5, "\ud800", "a\x1b[2Jb"])
def test_odd_names_are_printed(name: object, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def rename(document: dict[str, Any], body: bytearray) -> None:
        for node in document["nodes"]:
            node["name"] = name

    assert main(["inspect", str(rewritten(folder / "shrub.glb", tmp_path / "odd.glb", rename))]) == 0
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("count", ["1e999", "-1", "null", '"many"'])
def test_wrong_counts_are_refused(count: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def claim(document: dict[str, Any], body: bytearray) -> None:
        document["accessors"][0]["count"] = json.loads(count)

    assert main(["inspect", str(rewritten(folder / "shrub.glb", tmp_path / "count.glb", claim))]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_numbers_outside_of_the_file_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def claim(document: dict[str, Any], body: bytearray) -> None:
        for accessor in document["accessors"]:
            accessor["count"] = 2**40

    path = rewritten(folder / "shrub.glb", tmp_path / "huge.glb", claim)
    assert main(["inspect", str(path)]) == 1
    assert "the limit is 67,108,864" in capsys.readouterr().err
    assert main(["inspect", str(tmp_path / "missing.glb")]) == 1
    assert "check the path" in capsys.readouterr().err


def test_images_outside_of_the_folder_are_not_copied(tmp_path: Path) -> None:
    home, folder = tmp_path / "home", tmp_path / "folder"
    for each in (home, folder):
        each.mkdir()
    (home / "leaf.png").write_bytes(b"leaf")
    (tmp_path / "secret.png").write_bytes(b"secret")
    for name in ("leaf.png", "../secret.png", "../home/leaf.png", str(tmp_path / "secret.png"), "", "data:,x"):
        _copy_beside(name, home, folder)
    assert [each.name for each in folder.iterdir()] == ["leaf.png"]
    assert {each.name for each in tmp_path.iterdir()} == {"home", "folder", "secret.png"}
