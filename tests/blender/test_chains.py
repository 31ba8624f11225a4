"""Chains with pruning: the kept leaves at the switch to the next level, their size and their color."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import bake as bake_file
from command_line import refusal
from lod_scenes import FOUR, build, evaluate, many_leaves, place, points_of, store
from night import rest_at_night
from node_trees import new_image, new_material, texture_node
from numpy.typing import NDArray
from renders import render
from scenes import add_mesh, bake, read

import leafcloud
from addon.bake.pipeline import prepare
from addon.bake.values import Baked
from addon.export.gltf import export_level
from addon.export.plain_materials import plain_colors
from addon.levels.contrast import CONTRAST_NODE, contrast_material, mean_color
from addon.material.node_links import MEAN_SHARE
from addon.mesh.meshes import PROTECT
from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual
from addon.plan.pruning import CUT_OFF, cut_off_distance, share_left, start_for
from addon.settings.bake import BakeSettings
from addon.versions import get_modifier_input, set_modifier_input


def crown(count: int = 400, material: bpy.types.Material | None = None) -> bpy.types.Object:
    """Add square leaves with sides of 0.1 in a ball of radius 1."""
    rng = np.random.default_rng(11)
    middles = rng.normal(size=(count, 3))
    middles *= (rng.random(count) ** (1 / 3) / np.linalg.norm(middles, axis=1))[:, None]
    across, along = np.linalg.qr(rng.normal(size=(count, 3, 2)))[0].transpose(2, 0, 1)
    corners = [middles + 0.05 * (i * across + j * along) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    points = np.stack(corners, axis=1).reshape(-1, 3)
    faces = [tuple(range(i, i + 4)) for i in range(0, 4 * count, 4)]
    return add_mesh("leaves", points.tolist(), faces, materials=None if material is None else [material])


def baked(obj: bpy.types.Object, chain: str, **settings: object) -> Baked:
    shape = {
        "levels": 1,
        "texture_size": 256,
        "epsilon": 0.1,
        "quality": 0.1,
        "effects": "transitions,pruning,contrast",
        **settings,
    }
    return bake(read([obj], [obj.name]), BakeSettings(chain=chain, **shape))  # type: ignore[arg-type]


def input_of(obj: bpy.types.Object, name: str) -> float:
    [modifier] = obj.modifiers
    return float(get_modifier_input(modifier, name))


def attribute(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32]:
    values = np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


# The plan


@pytest.mark.parametrize("half", [0.5, 0.2, 0.01])
def test_shares_and_distances_belong_together(half: float) -> None:
    for distance in (7.0, 10.0, 35.0, 400.0):
        expected = max(leafcloud.keep(distance, 10.0, half), CUT_OFF)
        assert share_left(10.0, distance, half) == pytest.approx(expected, rel=1e-12)
    assert leafcloud.keep(80.0, start_for(0.3, 80.0, half), half) == pytest.approx(0.3, rel=1e-12)
    assert leafcloud.keep(cut_off_distance(10.0, half), 10.0, half) == pytest.approx(CUT_OFF, rel=1e-12)


# The node group


def test_protected_leaves_stay_as_they_are() -> None:
    """Ranks are −1, ½, ¼, ¾. At λ = ½, the leaf of rank ¼ alone replaces the area of three prunable leaves."""
    obj = place(build(FOUR))
    store_ranks = np.float32([-1.0, 0.5, 0.25, 0.75])
    obj.data.attributes["leaf_rank"].data.foreach_set("value", np.repeat(store_ranks, 3))
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0)), transition=0.0, keep=0.5)
    found = points_of(evaluate(obj))
    assert found[:3].tolist() == FOUR.points[:3].tolist()
    scale = math.sqrt((0.5 + 2.0 + 1.0) / 2.0)
    np.testing.assert_allclose(found[3:], [[0, 4, -1], [2 * scale, 4, -1], [0, 4 + 2 * scale, -1]], atol=1e-6)


@pytest.mark.parametrize("keep", [0.5, 0.03])
def test_growth_multiplies_the_scale_of_kept_leaves(keep: float) -> None:
    leaves = many_leaves(300)
    obj = place(build(leaves))
    modifier = add_lod_modifier(obj, LodSettings(start=1.0, end=2.0))
    set_manual(modifier, transition=0.0, keep=keep)
    plain = points_of(evaluate(obj)).astype(np.float64)
    set_modifier_input(modifier, "Growth", 0.06)
    set_modifier_input(modifier, "Growth Quadratic", -0.01)
    grown = points_of(evaluate(obj)).astype(np.float64)
    pivots = np.repeat(leaves.pivots[leaves.ranks < np.float32(keep)], 3, axis=0)
    factor = math.exp(math.log(keep) * (0.06 - 0.01 * math.log(keep)))
    np.testing.assert_allclose(grown - pivots, factor * (plain - pivots), atol=1e-5)


@pytest.mark.parametrize("keep", [0.5, 0.03])
def test_materials_receive_the_contrast_of_the_kept_leaves(keep: float) -> None:
    obj = place(build(many_leaves(300)))
    settings = LodSettings(start=1.0, end=2.0, contrast=(0.3, -0.02))
    set_manual(add_lod_modifier(obj, settings), transition=0.0, keep=keep)
    contrast = math.exp(math.log(keep) * (0.3 - 0.02 * math.log(keep)))
    np.testing.assert_allclose(attribute(evaluate(obj), MEAN_SHARE), 1.0 - contrast, atol=1e-5)


@pytest.mark.parametrize(("contrast", "keep"), [((0.0, 0.0), 0.25), ((-0.1, 0.0), 0.25), ((0.3, 0.0), 1.0)])
def test_a_level_with_full_contrast_stores_no_contrast(contrast: tuple[float, float], keep: float) -> None:
    """The nodes never raise contrast either."""
    obj = place(build(many_leaves(30)))
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0, contrast=contrast)), transition=0.0, keep=keep)
    assert MEAN_SHARE not in evaluate(obj).attributes


# Painted leaves


@pytest.mark.parametrize("painted_as", ["group", "attribute"])
def test_painted_leaves_are_never_pruned(painted_as: str) -> None:
    """One vertex with a weight above one half protects a leaf."""
    obj = crown(40)
    if painted_as == "group":
        group = obj.vertex_groups.new(name=PROTECT)
        group.add([8, 81], 0.75, "REPLACE")  # One vertex each of the leaves 2 and 20.
        group.add([100], 0.25, "REPLACE")
    else:
        weights = np.zeros(160, np.float32)
        weights[[8, 81, 100]] = 0.75, 0.75, 0.25
        store(obj.data, PROTECT, weights)
    result = baked(obj, "both")
    ranks = result.chain.ranks
    assert np.flatnonzero(ranks < 0.0).tolist() == [2, 20]
    assert sorted(ranks[ranks >= 0.0].tolist()) == pytest.approx([i / 38 for i in range(38)])
    leaves = result.levels[0].object
    set_manual(leaves.modifiers[0], transition=0.0, keep=0.0)
    assert len(evaluate(leaves).polygons) == 4, "two leaves of two triangles each"


@pytest.mark.parametrize("kind", ["INT", "INT8", "BOOLEAN"])
def test_leaves_may_be_painted_in_whole_numbers(kind: str) -> None:
    obj = crown(20)
    painted = obj.data.attributes.new(PROTECT, kind, "POINT")
    painted.data[8].value = 1
    protected = read([obj], ["leaves"]).leaves.protected
    assert protected is not None
    assert np.flatnonzero(protected).tolist() == [4, 5], "both triangles of the third leaf"


@pytest.mark.parametrize("domain", ["CORNER", "FACE"])
def test_corners_and_faces_may_be_painted(domain: str) -> None:
    obj = add_mesh("leaves", [(x, y, 0.0) for x in range(3) for y in range(4)], [(0, 1, 2), (3, 4, 5, 6), (7, 8, 9)])
    painted = obj.data.attributes.new(PROTECT, "FLOAT", domain)
    painted.data.foreach_set("value", [0.0, 1.0, 0.0] if domain == "FACE" else [0.0] * 3 + [1.0] * 4 + [0.0] * 3)
    assert read([obj], ["leaves"]).leaves.protected.tolist() == [False, True, True, False]


def test_unpainted_trees_have_no_protected_leaves() -> None:
    assert read([crown(20)], ["leaves"]).leaves.protected is None


# Pruning before billboards


def test_level_1_is_made_of_the_kept_leaves() -> None:
    """At the switch, level 0 draws exactly these leaves at the same size, and they lie on level 1's planes."""
    result = baked(crown(), "both", prune_pixels=24.0)
    chain, leaves = result.chain, result.levels[0].object
    assert chain.kept is not None
    kept, growth = chain.kept
    hand_over = input_of(result.levels[1].object, "Appear")
    share = leafcloud.keep(hand_over, input_of(leaves, "Prune Start"), input_of(leaves, "Prune Half"))
    assert 0.05 < share < 0.7
    assert len(np.unique(result.prepared.foliage.leaf_ids[kept])) == math.ceil(share * 400 - 1e-6)
    set_manual(leaves.modifiers[0], transition=1.0, keep=share)
    mesh = evaluate(leaves)
    points = points_of(mesh).astype(np.float64)
    assert len(mesh.polygons) == len(kept)
    cloud = chain.levels[0].cloud
    assert cloud is not None
    billboards = np.empty(len(mesh.vertices), np.int32)
    mesh.attributes["leaf_billboard"].data.foreach_get("value", billboards)
    planes = cloud.planes[billboards]
    radius = result.prepared.foliage.radius
    assert np.abs((planes[:, :3] * points).sum(axis=1) - planes[:, 3]).max() < 1e-4 * radius
    # The same total area as the leaves of level 1, except for leaves that are fading out.
    sizes = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", sizes)
    targets = chain.levels[0].targets
    expected = np.linalg.norm(np.cross(targets[:, 1] - targets[:, 0], targets[:, 2] - targets[:, 0]), axis=1)
    assert 2.0 * sizes.sum() == pytest.approx(expected.sum(), rel=2e-3)
    assert growth.max() < 0.5 / math.sqrt(share) + 1.0


def test_leaves_pruned_before_the_switch_have_no_billboard() -> None:
    result = baked(crown(), "both", prune_pixels=24.0)
    obj = result.levels[0].object
    billboards = np.empty(len(obj.data.vertices), np.int32)
    obj.data.attributes["leaf_billboard"].data.foreach_get("value", billboards)
    targets = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.attributes["leaf_target"].data.foreach_get("vector", targets.ravel())
    gone = billboards < 0
    assert 0 < gone.sum() < len(gone)
    pivots = np.empty_like(targets)
    obj.data.attributes["leaf_pivot"].data.foreach_get("vector", pivots.ravel())
    np.testing.assert_allclose(targets[gone], pivots[gone], atol=1e-6)
    assert not any(group.group >= 0 for i in np.flatnonzero(gone)[:50] for group in obj.data.vertices[i].groups)


def test_a_crown_of_large_leaves_is_not_pruned_before_level_1() -> None:
    result = baked(crown(), "both", prune_pixels=0.5)
    obj = result.levels[0].object
    assert result.chain.kept is None
    assert input_of(obj, "Prune Start") == pytest.approx(input_of(obj, "Vanish"))
    assert input_of(obj, "Growth") == 0.0


def test_pruning_alone_ends_in_the_cross() -> None:
    result = baked(crown(), "pruning", prune_pixels=4.0, levels=2)
    assert [level.method for level in result.chain.levels] == ["cross"]
    leaves, cross = (level.object for level in result.levels)
    start, half = input_of(leaves, "Prune Start"), input_of(leaves, "Prune Half")
    assert input_of(leaves, "Fade Out Start") == pytest.approx(input_of(cross, "Appear"))
    assert leafcloud.keep(input_of(cross, "Appear"), start, half) <= CUT_OFF * (1.0 + 1e-6)
    size = leafcloud.switch_distance(0.1, 4.0, result.view.resolution, result.view.field_of_view)
    assert start == pytest.approx(size, rel=1e-5), "a leaf is 0.1 across"
    assert "leaf_target" not in leaves.data.attributes


# Contrast


def test_contrast_mixes_the_mean_into_base_color(tmp_path: Path) -> None:
    """White leaves over a black world mix in a quarter of the stored mean (0.2, 0.4, 0.6)."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    principled.inputs["Roughness"].default_value, principled.inputs["Specular IOR Level"].default_value = 1.0, 0.0
    square = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    copy = contrast_material(material, (0.2, 0.4, 0.6))
    assert copy is not None
    assert copy != material
    obj = add_mesh("leaf", square, [(0, 1, 2, 3)], materials=[copy])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = math.pi
    bpy.context.scene.collection.objects.link(sun)

    def seen() -> NDArray[np.float32]:
        return render(tmp_path, (0.5, 0.5, 2.0), width=0.8, size=(4, 4), samples=16)[..., :3].mean((0, 1))

    np.testing.assert_allclose(seen(), 1.0, rtol=0.02)
    store(obj.data, MEAN_SHARE, np.full(4, 0.25, np.float32))
    np.testing.assert_allclose(seen(), 0.75 + 0.25 * np.array([0.2, 0.4, 0.6]), rtol=0.02)


def test_the_mean_color_is_the_mean_of_the_visible_leaves() -> None:
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (0.25, 0.5, 0.125, 1.0)
    foliage = prepare(read([crown(60, material)], ["leaves"]), BakeSettings()).foliage
    assert mean_color(foliage) == pytest.approx((0.25, 0.5, 0.125), abs=0.01)


def test_files_have_the_leaves_own_colours(tmp_path: Path) -> None:
    material, principled, tree = new_material()
    texture = texture_node(tree, new_image("leaf", [[(0.2, 0.5, 0.1, 1.0)] * 2] * 2))
    tree.links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    obj = crown(60, material)
    obj.data.uv_layers.new(name="UVMap")
    result = baked(obj, "both", prune_pixels=100.0)
    [copy] = result.levels[0].object.data.materials
    assert CONTRAST_NODE in copy.node_tree.nodes
    with plain_colors(result.levels):
        export_level(result.levels[0], tmp_path / "leaves.glb")
    data = (tmp_path / "leaves.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert "baseColorTexture" in document["materials"][0]["pbrMetallicRoughness"]
    extras = next(node["extras"]["leafcloud"] for node in document["nodes"] if "extras" in node)
    assert extras["prune_half"] == 0.5
    assert len(extras["mean_color"]) == 3
    assert len(extras["growth"]) == 2
    socket = next(node for node in copy.node_tree.nodes if node.type == "BSDF_PRINCIPLED").inputs["Base Color"]
    assert socket.links[0].from_node.name == CONTRAST_NODE, "in Blender it is back"


# Command line


@pytest.mark.parametrize(
    ("chain", "methods"), rest_at_night([("both", ["leaves", "stochastic", "cross"]), ("pruning", ["leaves", "cross"])])
)
def test_chains_bake_from_the_command_line(
    chain: str, methods: list[str], shrub: Path, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    coarse = ("--levels", 1, "--texture-size", 128, "--epsilon", 0.1, "--pixels", 8)
    report = bake_file(shrub, tmp_path, "--chain", chain, *coarse, "--prune-pixels", 60)
    assert [level["method"] for level in report["levels"]] == methods
    assert {effect["name"]: effect["on"] for effect in report["effects"]}["contrast"] is True
    assert report["warnings"] == []
    assert gltf_issues(*tmp_path.glob("*.glb")) == []


def test_a_chain_that_prunes_needs_the_effect(shrub: Path, tmp_path: Path) -> None:
    words = refusal(tmp_path / "out", "--input", shrub, "--chain", "both", "--effects", "transitions")
    assert words == "--chain both needs the effect pruning, which is off: turn it on, or choose --chain billboards"
