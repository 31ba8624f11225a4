"""NAME.glb with all levels: plain readers show the leaves and the trunk, readers of MSFT_lod find the other levels."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake, run, saved
from glb import Node, read_chunks, read_glb, read_scene
from mathutils import Euler, Matrix, Vector

import leafcloud
from addon.mesh.extract import extract
from addon.scene.load import load, load_beside

PLACE = Matrix.LocRotScale(Vector((30.0, -7.0, 4.0)), Euler((0.3, 0.2, 2.0)), Vector((2.5, 2.5, 2.5)))


def placed(shrub: Path, place: Matrix) -> None:
    """Import the shrub and move it."""
    known = set(bpy.context.scene.objects)
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    for obj in set(bpy.context.scene.objects) - known:
        if obj.parent is None:
            obj.matrix_world = place @ obj.matrix_world


@pytest.fixture(scope="module")
def baked(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bake of the shrub, rotated, scaled and far from the origin."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    placed(shrub, PLACE)
    out = tmp_path_factory.mktemp("whole")
    bake(saved(tmp_path_factory.mktemp("source") / "shrub.blend"), out, *QUICK)
    return out


def report_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def chains(path: Path) -> dict[str, list[str]]:
    """Return the names of the other levels for each root node with MSFT_lod."""
    document, _ = read_chunks(path)
    nodes = document["nodes"]
    roots = [nodes[number] for number in document["scenes"][document["scene"]]["nodes"]]
    ids = {root["name"]: root.get("extensions", {}).get("MSFT_lod", {}).get("ids") for root in roots}
    return {name: [nodes[number]["name"] for number in numbers] for name, numbers in ids.items() if numbers}


def triangles(nodes: dict[str, Node]) -> int:
    return sum(len(primitive.indices) for node in nodes.values() for primitive in (*node.primitives, *node.trunk))


def test_a_plain_reader_sees_the_leaves_and_their_trunk_alone(baked: Path) -> None:
    seen, alone = read_scene(baked / "shrub.glb"), read_scene(baked / "shrub_LOD0.glb")
    assert set(seen) == set(alone) == {"shrub_LOD0"}
    level = report_of(baked)["levels"][0]
    assert triangles(seen) == triangles(alone) == level["triangles"] + level["trunk_triangles"]


def test_a_reader_of_the_extension_finds_the_other_levels_with_their_trunks(baked: Path) -> None:
    path = baked / "shrub.glb"
    assert chains(path) == {"shrub_LOD0": ["shrub_LOD1", "shrub_LOD2", "shrub_LOD3"]}
    document, _ = read_chunks(path)
    assert "MSFT_lod" in document["extensionsUsed"]
    assert "extensionsRequired" not in document
    nodes = read_glb(path)
    for level in report_of(baked)["levels"]:
        node = nodes[f"shrub_LOD{level['level']}"]
        assert len(node.trunk) == (1 if level["level"] < 3 else 0)
        found = {node.name: node}
        assert triangles(found) == triangles(read_scene(baked / f"{node.name}.glb"))
        assert triangles(found) == level["triangles"] + level["trunk_triangles"]
        assert np.array_equal(node.matrix, nodes["shrub_LOD0"].matrix)


def test_screen_coverage_matches_the_switch_distances(baked: Path) -> None:
    """The oracle is the crown's sphere at each switch distance in a field of view of 50°."""
    report = report_of(baked)
    shares = read_glb(baked / "shrub.glb")["shrub_LOD0"].extras["MSFT_screencoverage"]
    halves = [level["switch_distance"] * math.tan(math.radians(25.0)) for level in report["levels"][1:]]
    assert shares == pytest.approx([*(report["input"]["radius"] / half for half in halves), 0.0])
    assert shares == sorted(shares, reverse=True)


def test_files_of_single_levels_have_no_extension(baked: Path) -> None:
    for number in range(4):
        assert "MSFT_lod" not in str(read_chunks(baked / f"shrub_LOD{number}.glb")[0])


def test_each_level_stores_the_crown_s_center_and_radius(baked: Path) -> None:
    """The center is that of the leaves' bounding box in world space. The radius reaches the farthest vertex."""
    leaves = read_glb(baked / "shrub_LOD0.glb")["shrub_LOD0"]
    # The box has the axes of the world, as the file does.
    places = leaves.to_world(np.concatenate([each.attributes["POSITION"] for each in leaves.primitives]))
    middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
    radius = np.linalg.norm(places - middle, axis=1).max()
    assert report_of(baked)["input"]["radius"] == pytest.approx(radius, rel=1e-5)
    for number in range(4):
        node = read_glb(baked / f"shrub_LOD{number}.glb")[f"shrub_LOD{number}"]
        extras = node.extras["leafcloud"]
        scale = abs(np.linalg.det(node.matrix[:3, :3])) ** (1.0 / 3.0)
        assert node.to_world(np.array([extras["centre"]]))[0] == pytest.approx(middle, abs=1e-5 * radius)
        assert scale * extras["radius"] == pytest.approx(radius, rel=1e-5)


def test_the_report_counts_the_trunk_beside_each_level(baked: Path) -> None:
    nodes = read_glb(baked / "shrub.glb")
    for level in report_of(baked)["levels"]:
        trunk = nodes[f"shrub_LOD{level['level']}"].trunk
        assert level["trunk_triangles"] == sum(len(primitive.indices) for primitive in trunk)
    counts = [level["trunk_triangles"] for level in report_of(baked)["levels"]]
    assert counts[0] > counts[1] >= counts[2] > counts[3] == 0


@pytest.mark.night
def test_each_of_several_trees_has_its_own_chain(shrub: Path, tmp_path: Path) -> None:
    (tmp_path / "bush.glb").write_bytes(shrub.read_bytes())
    quick = ("--texture-size", 128, "--epsilon", 0.1, "--quality", 0.1, "--levels", 1, "--effects", "transitions")
    done = run("--input", shrub, tmp_path / "bush.glb", "--out", tmp_path / "out", *quick)
    assert done.returncode == 0, done.stderr
    path = tmp_path / "out" / "shrub_bush.glb"
    expected = {f"{tree}_LOD0": [f"{tree}_LOD1", f"{tree}_LOD2"] for tree in ("shrub", "bush")}
    assert chains(path) == expected
    assert set(read_scene(path)) == set(expected)


# Readers


def test_loading_a_bake_gives_its_leaves_and_trunk(baked: Path) -> None:
    load(baked / "shrub.glb")
    level = report_of(baked)["levels"][0]
    assert [obj.name for obj in bpy.data.objects] == ["shrub_LOD0"]
    tree = extract(bpy.context.evaluated_depsgraph_get(), None)
    assert tree.trunk is not None
    assert len(tree.leaves.triangles) == level["triangles"]
    assert len(tree.trunk.triangles) == level["trunk_triangles"]


def test_loading_a_bake_beside_another_keeps_the_other_s_levels(baked: Path) -> None:
    load(baked / "shrub_LOD1.glb")
    objects, notes = load_beside(baked / "shrub.glb")
    assert (len(objects), notes) == (1, [])
    assert {obj.name for obj in bpy.data.objects} >= {"shrub_LOD1", "shrub_LOD0"}
    assert not [obj.name for obj in bpy.data.objects if "LOD2" in obj.name]


def test_a_baked_file_can_be_baked_again(baked: Path, tmp_path: Path) -> None:
    again = bake(baked / "shrub.glb", tmp_path, *QUICK, "--levels", 1)
    assert again["input"]["triangles"] == report_of(baked)["input"]["triangles"]
    assert chains(tmp_path / "shrub.glb") == {"shrub_LOD0": ["shrub_LOD1", "shrub_LOD2"]}


def test_the_core_reads_only_the_leaves_of_a_bake(baked: Path) -> None:
    foliage = leafcloud.read_gltf(str(baked / "shrub.glb"))
    assert foliage.triangle_count == report_of(baked)["levels"][0]["triangles"]
