"""Bakes with the command line from end to end: the files, the error bound, different inputs and settings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import BAKES, folder_of, kept, report_of
from command_line import QUICK, bake, report_in, saved
from glb import Node, Primitive, read_glb
from night import rest_at_night
from numpy.typing import NDArray

from addon.settings.effects import EFFECTS

DEPTH_ORDER = 1.0 / 4096.0
"""The share of its height above the plane that a point keeps at a = 1."""
ROUNDING = 1e-5
"""Share of R: what single precision in the files, and planes from the corners of small billboards, may add."""

CHUNK = 128
"""Triangles that are compared with all planes at once."""

LEVEL_KEYS = {
    "level", "method", "epsilon", "candidates", "billboards", "triangles", "texels", "atlas_occupancy",
    "max_deviation", "mean_deviation", "max_deviation_leaves", "in_plane_motion", "image_error", "switch_distance",
    "refined", "refined_planes", "seconds", "trunk_triangles", "drawing", "texture_size",
}  # fmt: skip


@pytest.fixture(scope="module")
def baked() -> tuple[Path, dict[str, Any]]:
    """Folder and report of a bake of the shrub with the default effects and with pruning."""
    return folder_of("sharp"), report_of("sharp")


# Files


@pytest.mark.version
def test_the_report_has_the_documented_keys_and_values(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    facts = {"leafcloud", "blender", "input", "predicted", "effects", "files", "warnings", "seconds"}
    assert set(report) == {*facts, "quality", "levels", "hidden_triangles", "left_out", "needs_no_levels"}
    assert (report["left_out"], report["needs_no_levels"]) == ([], None)
    assert report["hidden_triangles"] == 0, "pruning keeps the visible leaves"
    assert report["predicted"] is None, "no cost curve was measured"
    assert set(report["input"]) == {"triangles", "leaves", "radius", "dropped", "choice", "materials"}
    assert (report["input"]["leaves"], report["input"]["materials"]) == (672, ["leaves"])
    assert [level["level"] for level in report["levels"]] == [0, 1, 2, 3]
    assert [level["method"] for level in report["levels"]] == ["leaves", "stochastic", "stochastic", "octahedral"]
    *near, last = report["levels"]
    for level in near:
        assert set(level) == {*LEVEL_KEYS, "trunk"}
    assert set(last) == {*LEVEL_KEYS, "trunk", "plain"}
    assert last["plain"]["method"] == "cross"
    assert {"start", "read", "prepare", "fit", "build", "write"} <= set(report["seconds"])
    for level in report["levels"]:
        assert set(level["seconds"]) == {"fit", "pack", "bake", "look", "refine", "write"}
    assert report["levels"][0]["triangles"] == report["input"]["triangles"]
    clouds = report["levels"][1:3]
    for level in clouds:
        assert 0.0 < level["mean_deviation"] < level["max_deviation"] <= level["epsilon"]
        assert level["max_deviation_leaves"] >= level["max_deviation"]
        assert 0.0 < level["atlas_occupancy"] <= 1.0
    distances = [level["switch_distance"] for level in report["levels"]]
    assert distances[0] == 0.0
    assert distances == sorted(set(distances))
    told = {"name", "on", "reason", "seconds", "bytes", "estimate"}
    assert all(set(effect) == told for effect in report["effects"])
    assert [effect["name"] for effect in report["effects"]] == list(EFFECTS)
    states = {effect["name"]: effect["on"] for effect in report["effects"]}
    assert (states["normals"], states["roughness_metallic"]) == (True, False), "the shrub's leaves are all alike"
    assert report["warnings"] == []


def test_the_document_of_the_files_names_every_key_of_the_report(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    text = (Path(__file__).parents[2] / "docs" / "files.md").read_text()
    named = set(re.findall(r"`(\w+)`", text[text.index("## The report") : text.index("## The whole chain")]))
    effects = {key for effect in report["effects"] for key in effect}
    levels = {key for level in report["levels"] for key in level}
    seconds = report["levels"][1]["seconds"]
    assert {*report, *report["input"], *effects, *levels, *seconds} <= named


def test_levels_take_over_where_they_look_like_the_leaves(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    quality = report["quality"]
    assert (quality["quality"], quality["scene"], quality["memory_budget"]) == (0.5, 50.0, 4.0)
    for level, found in zip(report["levels"][1:], quality["levels"], strict=True):
        assert level["drawing"]["crown_pixels"] <= found["crown_pixels"] * (1.0 + 1e-9)
        assert found["size"] == pytest.approx(found["crown_pixels"] / 1080.0)
        assert found["passes"] == (found["judged"]["excess"] <= 1.0)
        assert found["passes"] or found["crown_pixels"] <= 12.0


@pytest.mark.version
def test_all_files_are_there_and_no_others(baked: tuple[Path, dict[str, Any]]) -> None:
    out, report = baked
    levels = [f"shrub_LOD{number}.glb" for number in range(4)]
    flights = [f"shrub_flight{number}.png" for number in (1, 2, 3)]
    shown = [*flights, "preview.png", "report.html"]
    assert report["files"] == sorted(["shrub.glb", *levels, "shrub.blend", *shown, "report.json"])
    assert sorted(file.name for file in out.iterdir()) == report["files"]


@pytest.mark.version
def test_every_level_is_one_mesh_with_its_trunk(baked: tuple[Path, dict[str, Any]]) -> None:
    out, report = baked
    nodes = read_glb(out / "shrub.glb")
    clouds = [f"shrub_LOD{number}" for number in range(3)]
    assert set(nodes) == {*clouds, "shrub_LOD3"}
    for level in report["levels"]:
        node = nodes[f"shrub_LOD{level['level']}"]
        written = level.get("plain", level)  # Files have a cross impostor in place of an octahedral one.
        assert len(node.trunk) == (1 if level["level"] < 3 else 0)
        assert node.extras["leafcloud"]["level"] == level["level"]
        assert node.extras["leafcloud"]["switch_distance"] == pytest.approx(written["switch_distance"])
        assert sum(len(primitive.indices) for primitive in node.primitives) == written["triangles"]
        alone = read_glb(out / f"{node.name}.glb")
        assert set(alone) == {node.name}
        assert np.array_equal(alone[node.name].primitives[0].indices, node.primitives[0].indices)


@pytest.mark.version
def test_clouds_are_cut_out_by_alpha(baked: tuple[Path, dict[str, Any]]) -> None:
    nodes = read_glb(baked[0] / "shrub.glb")
    for number in (1, 2, 3):
        node = nodes[f"shrub_LOD{number}"]
        (primitive,) = node.primitives
        assert primitive.material["alphaMode"] == "MASK"
        assert 0.0 < primitive.material["alphaCutoff"] < 1.0
        assert "baseColorTexture" in primitive.material["pbrMetallicRoughness"]
        assert "normalTexture" in primitive.material
        leaves = nodes["shrub_LOD0"].primitives[0].material["pbrMetallicRoughness"]
        assert "metallicRoughnessTexture" not in primitive.material["pbrMetallicRoughness"]
        for factor in ("roughnessFactor", "metallicFactor"):
            assert primitive.material["pbrMetallicRoughness"].get(factor, 1.0) == leaves.get(factor, 1.0)


@pytest.mark.version
def test_tangents_lie_along_the_texture(baked: tuple[Path, dict[str, Any]]) -> None:
    """Billboards are rectangles with textures along their sides. Green of a normal map points up the texture."""
    nodes = read_glb(baked[0] / "shrub.glb")
    assert "TANGENT" not in nodes["shrub_LOD0"].primitives[0].attributes, "the leaves have no normal map"
    for number in (1, 2, 3):
        (primitive,) = nodes[f"shrub_LOD{number}"].primitives
        tangents, normals, places, uvs = (
            primitive.attributes[name][primitive.indices].astype(float)
            for name in ("TANGENT", "NORMAL", "POSITION", "TEXCOORD_0")
        )
        sides, steps = (np.roll(values, -1, axis=1) - values for values in (places, uvs))
        upward = np.cross(normals, tangents[..., :3]) * tangents[..., 3:]
        for axis, expected, other in ((tangents[..., :3], steps[..., 0], 1), (upward, -steps[..., 1], 0)):
            along = np.einsum("tci,tci->tc", axis, sides) / np.linalg.norm(sides, axis=2)
            straight = np.abs(steps[..., other]) < 1e-6
            assert straight.any()
            np.testing.assert_allclose(along[straight], np.sign(expected[straight]), atol=1e-3)


@pytest.mark.version
def test_leaves_are_stored_in_rank_order_and_whole(baked: tuple[Path, dict[str, Any]]) -> None:
    node = read_glb(baked[0] / "shrub.glb")["shrub_LOD0"]
    extras = node.mesh_extras["leafcloud"]
    assert extras["keep_steps"] == 64
    for primitive, row in zip(node.primitives, extras["prefixes"], strict=True):
        ranks = primitive.attributes["_LEAF_RANK"][primitive.indices, 0]
        assert (ranks == ranks[:, :1]).all()
        assert (np.diff(ranks[:, 0]) >= 0.0).all()
        assert (np.unique(ranks, return_counts=True)[1] == 6).all()  # a card is two triangles
        keep = np.arange(65, dtype=np.float32) / 64
        assert row["triangles"] == np.searchsorted(ranks[:, 0], keep).tolist()
        assert row["material"] == primitive.material["name"]
    corners, ranks = (
        np.concatenate([each.attributes[name][each.indices] for each in node.primitives])
        for name in ("POSITION", "_LEAF_RANK")
    )
    sides = np.diff(corners.astype(float), axis=1)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    expected = [areas[ranks[:, 0, 0] < (i / 64) ** 2].sum() / areas.sum() for i in range(65)]
    np.testing.assert_allclose(extras["area_shares"], expected, atol=1e-6)


@pytest.mark.version
def test_pivots_are_turned_to_y_up(baked: tuple[Path, dict[str, Any]]) -> None:
    node = read_glb(baked[0] / "shrub.glb")["shrub_LOD0"]
    for primitive in node.primitives:
        places = primitive.attributes["POSITION"]
        targets = places + primitive.targets[0]["POSITION"]
        for name, points in (("_LEAF_PIVOT", places), ("_LEAF_PIVOT_TARGET", targets)):
            corners = points[primitive.indices]
            pivots = primitive.attributes[name][primitive.indices[:, 0]]
            sizes = np.ptp(corners, axis=1).max(axis=1)
            assert (np.abs(pivots - corners.mean(axis=1)).max(axis=1) <= 2.0 * sizes).all()


@pytest.mark.version
def test_the_blend_file_holds_the_levels_and_no_data_for_engines(baked: tuple[Path, dict[str, Any]]) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(baked[0] / "shrub.blend"))
    objects = {obj.name for obj in bpy.context.scene.objects}
    trunks = {f"shrub_LOD{number}_trunk" for number in range(3)}
    assert objects == {*read_glb(baked[0] / "shrub.glb"), *trunks, "shrub_tree"}
    assert {collection.name for collection in bpy.data.collections} == {"shrub"}
    leaves = bpy.data.objects["shrub_LOD0"]
    names = {attribute.name for attribute in leaves.data.attributes}
    assert {"leaf_rank", "leaf_pivot", "leaf_billboard", "leaf_target", "leaf_pivot_target"} <= names
    assert not [name for name in names if name.startswith("_")]
    assert len(leaves.data.uv_layers) == 1
    assert [modifier.type for modifier in leaves.modifiers] == ["NODES"]
    assert all(image.packed_file is not None for image in bpy.data.images if image.source == "FILE")
    assert not bpy.data.texts


@pytest.mark.version
def test_the_camera_s_distance_decides_which_level_is_drawn(baked: tuple[Path, dict[str, Any]]) -> None:
    out, report = baked
    bpy.ops.wm.open_mainfile(filepath=str(out / "shrub.blend"))
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    switch = [level["switch_distance"] for level in report["levels"]]
    for distance, expected in [(0.4 * switch[1], 0), (1.1 * switch[1], 1), (1.1 * switch[2], 2), (1.3 * switch[3], 3)]:
        scene.camera.location = (0.0, -distance, 0.0)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        drawn = [number for number in range(4) if _polygons(depsgraph, f"shrub_LOD{number}")]
        assert drawn == [expected]
        trunk_object = [number for number in range(3) if _polygons(depsgraph, f"shrub_LOD{number}_trunk")]
        assert trunk_object == [number for number in drawn if number < 3]


def _polygons(depsgraph: bpy.types.Depsgraph, name: str) -> int:
    return len(bpy.data.objects[name].evaluated_get(depsgraph).data.polygons)


# The error bound


def world(node: Node, primitive: Primitive, target: int | None = None) -> NDArray[np.float64]:
    """Return the corners (t, 3, 3) of the triangles in world space, at rest or moved by a morph target."""
    positions = primitive.attributes["POSITION"].astype(np.float64)
    if target is not None:
        positions = positions + primitive.targets[target]["POSITION"].astype(np.float64)
    return node.to_world(positions)[primitive.indices]


def planes(node: Node) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit normals (k, 3) and offsets (k,) of the planes of a level's triangles."""
    corners = np.concatenate([world(node, primitive) for primitive in node.primitives])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, (normals * corners[:, 0]).sum(axis=1)


def deviations_on_parents(level: Node, following: Node, radius: float) -> NDArray[np.float64]:
    """Return for each triangle (t,) the largest distance of its corners to the plane that it morphs to.

    This plane is a plane of the next level that holds all three morphed corners. The corners may keep a small fraction
    of their height, which preserves the depth order. A triangle without such a plane has an infinite distance, and one
    that shrinks into a point NaN.
    """
    normals, offsets = planes(following)
    result = []
    for primitive in level.primitives:
        rest, moved = world(level, primitive), world(level, primitive, 0)
        best = np.full(len(rest), math.inf)
        for first in range(0, len(rest), CHUNK):
            # The first corner tells which planes may hold a triangle; few do.
            start = slice(first, first + CHUNK)
            allowed = np.abs(rest[start, 0] @ normals.T - offsets) * DEPTH_ORDER + ROUNDING * radius
            triangles, on = np.nonzero(np.abs(moved[start, 0] @ normals.T - offsets) <= allowed)
            triangles += first
            heights = np.abs(np.einsum("tcx,tx->tc", rest[triangles], normals[on]) - offsets[on, None])
            left = np.abs(np.einsum("tcx,tx->tc", moved[triangles], normals[on]) - offsets[on, None])
            lies_on = (left <= DEPTH_ORDER * heights + ROUNDING * radius).all(axis=1)
            np.minimum.at(best, triangles[lies_on], heights[lies_on].max(axis=1))
        shrinks = np.ptp(moved, axis=1).max(axis=1) < ROUNDING * radius
        result.append(np.where(shrinks, math.nan, best))
    return np.concatenate(result)


@pytest.mark.timeout(1200)  # The tree of a million triangles takes minutes, and a time-out would end the whole run.
def test_a_bake_keeps_its_bound_and_is_valid(
    tree_path: Path, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    """Check the error bound in f64 from the files alone, on every tree, and run the Khronos validator."""
    flags = ("--texture-size", 512, "--every-level", "--levels", 2, "--epsilon", 0.04, "--quality", 0.1)
    report = bake(tree_path, tmp_path, *flags)
    name, radius = tree_path.stem, report["input"]["radius"]
    assert sorted(file.name for file in tmp_path.iterdir()) == report["files"]
    nodes = read_glb(tmp_path / f"{name}.glb")
    # Before the first cloud there may be simplified leaves.
    before = int(report["levels"][1]["method"] == "simplified")
    for number, epsilon in [(before, 0.04), (before + 1, 0.1)]:
        level, following = nodes[f"{name}_LOD{number}"], nodes[f"{name}_LOD{number + 1}"]
        found = deviations_on_parents(level, following, radius)
        farthest = np.nanmax(found)
        assert farthest <= (epsilon + ROUNDING) * radius, f"LOD {number}"
        assert farthest == pytest.approx(report["levels"][number + 1]["max_deviation"] * radius, rel=1e-3)
        assert np.isnan(found).sum() == (report["hidden_triangles"] if number == before else 0)
    assert not nodes[f"{name}_LOD{before + 2}"].primitives[0].targets
    assert gltf_issues(*tmp_path.glob("*.glb")) == []


@pytest.mark.night
def test_the_fitters_options_reach_the_files(
    shrub: Path, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    fit = ("--max-billboards", 20, "--effort", "final", "--max-corners", 4, "--compact", 0.5)
    report = bake(shrub, tmp_path, "--texture-size", 256, "--every-level", *fit)
    first, second = report["levels"][1:3]
    assert first["epsilon"] > 0.04
    assert second["epsilon"] == pytest.approx(2.5 * first["epsilon"])
    for number in (1, 2):
        polygons = bpy.data.objects[f"shrub_LOD{number}"].data.polygons
        assert max(len(polygon.vertices) for polygon in polygons) == 4, "by default 5"
    nodes = read_glb(tmp_path / "shrub.glb")
    radius = report["input"]["radius"]
    for number, level in [(0, first), (1, second)]:
        found = deviations_on_parents(nodes[f"shrub_LOD{number}"], nodes[f"shrub_LOD{number + 1}"], radius)
        assert found.max() <= (level["epsilon"] + ROUNDING) * radius
    assert gltf_issues(*tmp_path.glob("*.glb")) == []


@pytest.mark.night
@pytest.mark.parametrize("method", [["density"], ["kmeans", "--max-billboards", 16]])
def test_other_methods_bake(method: list[object]) -> None:
    report = report_in(kept(*QUICK, "--method", *method))
    assert [level["method"] for level in report["levels"][1:3]] == [method[0]] * 2
    assert all(level["max_deviation"] <= level["epsilon"] for level in report["levels"][1:3])


def placed_shrub(shrub: Path, *, mirrored: bool, sheared: bool) -> bpy.types.Object:
    """Import only the shrub's leaves, and move them far away, rotated and scaled.

    The material is single-sided, so that the leaves' fronts matter.
    """
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.data.objects.remove(bpy.data.objects["branches"])
    leaves = bpy.data.objects["leaves"]
    leaves.rotation_mode = "XYZ"
    leaves.location, leaves.rotation_euler = (1000.0, -500.0, 20.0), (0.3, 0.2, 1.0)
    leaves.scale = (-2.0 if mirrored else 2.0, 2.0, 2.0)
    leaves.active_material.use_backface_culling = True
    if sheared:
        parent = bpy.data.objects.new("stretched", None)
        parent.scale = (1.0, 1.0, 2.0)
        bpy.context.scene.collection.objects.link(parent)
        leaves.parent = parent
    bpy.context.view_layer.update()
    return leaves


@pytest.mark.parametrize(("mirrored", "sheared"), rest_at_night([(True, False), (False, True), (True, True)]))
def test_a_tree_may_lie_anywhere(mirrored: bool, sheared: bool, shrub: Path, tmp_path: Path) -> None:
    leaves = placed_shrub(shrub, mirrored=mirrored, sheared=sheared)
    matrix = np.array(leaves.matrix_world, np.float64)
    rest = np.empty(3 * len(leaves.data.vertices), np.float32)
    leaves.data.vertices.foreach_get("co", rest)
    expected = rest.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    report = bake(saved(tmp_path / "far.blend"), tmp_path / "out", *QUICK)
    assert len(report["warnings"]) == sheared
    nodes, radius = read_glb(tmp_path / "out" / "far.glb"), report["input"]["radius"]
    levels = [nodes[f"far_LOD{number}"] for number in range(4)]
    for number, epsilon in [(0, 0.1), (1, 0.25)]:
        found = deviations_on_parents(levels[number], levels[number + 1], radius)
        assert found.max() <= (epsilon + ROUNDING) * radius
    corners = np.concatenate([world(levels[0], primitive) for primitive in levels[0].primitives]).reshape(-1, 3)
    z_up = np.column_stack([corners[:, 0], -corners[:, 2], corners[:, 1]])
    for bound in (np.min, np.max):
        np.testing.assert_allclose(bound(z_up, axis=0), bound(expected, axis=0), atol=1e-3 * radius)


def corner_rows(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return position, texture coordinate and normal (t, 3, 8) of the corners of a mesh of triangles."""

    def read(values: Any, key: str, width: int) -> NDArray[np.float32]:
        result = np.empty(len(values) * width, np.float32)
        values.foreach_get(key, result)
        return result.reshape(-1, width)

    vertices = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertices)
    positions = read(mesh.vertices, "co", 3)[vertices]
    rows = np.hstack([positions, read(mesh.uv_layers[0].uv, "vector", 2), read(mesh.corner_normals, "vector", 3)])
    return rows.reshape(-1, 3, 8)


@pytest.mark.version
def test_lod_0_is_the_input_bit_for_bit_until_it_moves(shrub: Path, baked: tuple[Path, dict[str, Any]]) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    source = corner_rows(bpy.data.objects["leaves"].data)
    bpy.ops.wm.open_mainfile(filepath=str(baked[0] / "shrub.blend"))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    lod_0 = corner_rows(bpy.data.objects["shrub_LOD0"].evaluated_get(depsgraph).data)
    exact = 8 if bpy.app.version >= (4, 5, 0) else 5  # Before 4.5 Blender keeps normals in 16 bits.
    pairs = [rows[np.lexsort(rows[:, :, :5].reshape(len(rows), -1).T)] for rows in (source, lod_0)]
    assert np.array_equal(pairs[0][..., :exact], pairs[1][..., :exact])
    assert np.abs(pairs[0][..., 5:] - pairs[1][..., 5:]).max() < 0.02


@pytest.mark.fresh
def test_two_runs_write_the_same_bytes(shrub: Path, tmp_path: Path, baked: tuple[Path, dict[str, Any]]) -> None:
    first, report = baked
    again = bake(shrub, tmp_path, *BAKES["sharp"])
    for name in report["files"]:
        if not name.endswith((".blend", ".json", ".html")):  # Both texts have seconds.
            assert (first / name).read_bytes() == (tmp_path / name).read_bytes(), name
    assert _timeless(report) == _timeless(again)


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if key != "seconds"}
    return [_timeless(item) for item in value] if isinstance(value, list) else value


# Inputs and effects


def test_effects_that_are_off_are_not_in_the_files() -> None:
    folder = kept(*QUICK, "--levels", 1, "--effects", "none")
    report = report_in(folder)
    assert [effect["name"] for effect in report["effects"]] == list(EFFECTS)
    off = [effect for effect in report["effects"] if effect["name"] != "far_levels"]  # --levels turns far levels on.
    assert not any(effect["on"] or effect["bytes"] for effect in off)
    nodes = read_glb(folder / "shrub.glb")
    for primitive in [*nodes["shrub_LOD0"].primitives, *nodes["shrub_LOD1"].primitives]:
        assert set(primitive.attributes) == {"POSITION", "NORMAL", "TEXCOORD_0"}
        assert not primitive.targets
    assert "normalTexture" not in nodes["shrub_LOD1"].primitives[0].material


def test_blended_leaves_are_cut_out_in_gltf_and_stay_blended_in_blender(shrub: Path, tmp_path: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    tree = bpy.data.objects["leaves"].active_material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    texture = next(node for node in tree.nodes if node.type == "TEX_IMAGE")
    tree.links.new(texture.outputs["Alpha"], surface.inputs["Alpha"])
    report = bake(saved(tmp_path / "blended.blend"), tmp_path / "out", *QUICK, "--levels", 1, "--no-cross")
    assert any("'leaves' is blended: the glTF files cut it out" in warning for warning in report["warnings"])
    for name in ("blended.glb", "blended_LOD0.glb"):
        (primitive,) = read_glb(tmp_path / "out" / name)["blended_LOD0"].primitives
        assert primitive.material["alphaMode"] == "MASK"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "blended.blend"))
    material = bpy.data.objects["blended_LOD0"].active_material
    alpha = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED").inputs["Alpha"]
    assert alpha.links[0].from_node.type == "TEX_IMAGE"


def test_leaves_in_one_plane_have_increasing_switch_distances(tmp_path: Path) -> None:
    mesh = bpy.data.meshes.new("leaves")
    corners = [(x + dx, y + dy, 0.0) for x in range(5) for y in range(5) for dx, dy in ((0, 0), (0.5, 0), (0, 0.5))]
    mesh.from_pydata(corners, [], [(i, i + 1, i + 2) for i in range(0, 75, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("leaves", mesh))
    report = bake(saved(tmp_path / "flat.blend"), tmp_path / "out", *QUICK)
    distances = [level["switch_distance"] for level in report["levels"]]
    assert all(nearer < farther for nearer, farther in pairwise(distances))
