"""Bakes of several trees: how objects group into trees, shared atlases, and files."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import QUICK, refusal, run, saved
from command_line import bake as bake_files
from glb import read_glb
from node_trees import new_material
from numpy.typing import NDArray
from scenes import add_mesh, collected

import leafcloud
from addon.bake.pipeline import layer_of
from addon.bake.tree_set import bake_tree_set, plan_tree_set, prepare_tree_set, start_tree_set
from addon.bake.values import TreeSet
from addon.errors import SceneError
from addon.export.files import write
from addon.geometry import Tree
from addon.mesh.trees import extract_trees, grouped, rendered
from addon.plan.effects import is_on, joint_effects
from addon.settings.bake import BakeSettings

RED, GREEN, BLUE = (0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.8)
SMALL = {"every_level": True, "texture_size": 128, "quality": 0.1, "levels": 1, "samples": 2}


def crown(
    name: str, color: Sequence[float], parent: bpy.types.Object | None = None, roughness: float = 0.5
) -> bpy.types.Object:
    """Add forty triangular leaves of one color in a ball of radius 1 around the parent or the origin."""
    random = np.random.default_rng(len(name))
    places, along, across = random.uniform(-0.5, 0.5, (3, 40, 3))
    corners = np.stack([places, places + 0.3 * along, places + 0.3 * across], axis=1).reshape(-1, 3)
    faces = [tuple(face) for face in np.arange(120).reshape(-1, 3).tolist()]
    leaf, shader, _ = new_material()
    leaf.name = f"{name}_leaf"
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    obj = add_mesh(f"{name}_leaves", [tuple(corner) for corner in corners.tolist()], faces, materials=[leaf])
    obj.parent = parent
    return obj


def red_and_blue() -> None:
    collected("maple", crown("red", RED))
    collected("spruce", crown("blue", BLUE))
    bpy.context.view_layer.update()


def read_trees(how: str = "collections", leaf_names: list[str] | None = None) -> dict[str, Tree]:
    layer = bpy.context.view_layer
    groups = grouped(rendered(layer), how)
    return extract_trees(bpy.context.evaluated_depsgraph_get(), groups, leaf_names=leaf_names)


def bake(trees: dict[str, Tree], name: str = "trunk", **settings: Any) -> TreeSet:
    scene = bpy.context.scene
    prepared = prepare_tree_set(trees, BakeSettings(**{**SMALL, **settings}), layer_of(scene))
    return bake_tree_set(prepared, scene, name, lambda stage, fraction: None)


def page_of(obj: bpy.types.Object) -> bpy.types.Image:
    return obj.data.materials[0].node_tree.nodes["Leafcloud Page"].image


def colors_seen(obj: bpy.types.Object) -> NDArray[np.float32]:
    """Return the sRGB colors (n, 3) of all opaque texels in the regions of the object's faces on its atlas page."""
    page = page_of(obj)
    width, height = page.size
    pixels = np.array(page.pixels[:], np.float32).reshape(height, width, 4)
    uvs = np.empty(2 * len(obj.data.loops), np.float32)
    obj.data.uv_layers[0].data.foreach_get("uv", uvs)
    found = []
    for polygon in obj.data.polygons:
        own = uvs.reshape(-1, 2)[polygon.loop_start : polygon.loop_start + polygon.loop_total] * (width, height)
        (left, bottom), (right, top) = np.rint(own.min(axis=0)).astype(int), np.rint(own.max(axis=0)).astype(int)
        region = pixels[bottom:top, left:right].reshape(-1, 4)
        found.append(region[region[:, 3] > 0.5, :3])
    return np.concatenate(found)


def json_of(glb: Path) -> dict[str, Any]:
    content = glb.read_bytes()
    return json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])


# Grouping


def test_objects_group_into_trees_by_their_topmost_parent() -> None:
    oak, elm = (
        add_mesh(f"{name}_trunk", [(0.0, 0.0, -1.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)], [(0, 1, 2)])
        for name in ("oak", "elm")
    )
    branch = bpy.data.objects.new("branch", None)
    bpy.context.scene.collection.objects.link(branch)
    branch.parent = oak
    crown("red", RED, branch)
    crown("blue", BLUE, elm)
    bpy.context.view_layer.update()
    trees = read_trees("parents")
    assert {name: len(tree.leaves.triangles) for name, tree in trees.items()} == {"elm_trunk": 40, "oak_trunk": 40}
    assert all(tree.trunk is not None and len(tree.trunk.triangles) == 1 for tree in trees.values())


def test_objects_group_into_trees_by_collection_without_cameras() -> None:
    red_and_blue()
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    assert list(read_trees()) == ["maple", "spruce"]


def test_groups_without_the_named_leaves_are_not_trees() -> None:
    red_and_blue()
    collected("ground", add_mesh("plain", [(9.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, 0.0, 0.0)], [(0, 1, 2)]))
    bpy.context.view_layer.update()
    assert list(read_trees(leaf_names=["red_leaves", "blue_leaf"])) == ["maple", "spruce"]
    with pytest.raises(SceneError, match="tree 'ground'"):
        read_trees()
    with pytest.raises(SceneError, match="'petals'"):
        read_trees(leaf_names=["red_leaves", "petals"])


def test_a_scene_without_trees_is_refused() -> None:
    with pytest.raises(SceneError, match="no object with faces"):
        read_trees()


# Shared atlases


def test_trees_share_the_page_of_a_level_and_show_their_own_leaves() -> None:
    red_and_blue()
    tree_set = bake(read_trees())
    assert [tree.collection.name for tree in tree_set.trees] == ["maple_2", "spruce_2"]
    assert set(tree_set.collection.children) == {tree.collection for tree in tree_set.trees}
    first, second = (tree.levels for tree in tree_set.trees)
    for number in (1, 2):
        page = page_of(first[number].object)
        assert page == page_of(second[number].object)
        assert page.name == f"trunk_LOD{number}"
    assert page_of(first[1].object) != page_of(first[2].object)
    for levels, own, other in ((first, 0, 2), (second, 2, 0)):
        for level in levels[1:]:
            seen = colors_seen(level.object)
            assert len(seen) > 50
            assert seen[:, own].min() > 0.8
            assert seen[:, other].max() < 0.1
    assert not [image for image in bpy.data.images if image.name.startswith(("maple", "spruce"))]


def test_shadow_proxies_of_all_trees_share_a_page() -> None:
    red_and_blue()
    tree_set = bake(read_trees(), effects="+shadow_proxy", viewer="anywhere")
    pages = {page_of(obj) for tree in tree_set.trees for obj in tree.collection.objects if obj.name.endswith("_shadow")}
    assert [page.name for page in pages] == ["trunk_shadow"]


def test_a_tree_alone_keeps_its_name_and_pages() -> None:
    red_and_blue()
    trees = read_trees()
    tree_set = bake({"maple_tree": trees["maple"]}, "maple_tree")
    assert tree_set.name == tree_set.collection.name == "maple_tree"
    assert [level.object.name for level in tree_set.trees[0].levels] == [f"maple_tree_LOD{i}" for i in range(3)]
    assert page_of(tree_set.trees[0].levels[1].object).name == "maple_tree_LOD1"


def test_a_texture_for_one_tree_is_made_for_all_trees() -> None:
    shiny = crown("red", RED, roughness=0.2)
    dull, shader, _ = new_material()
    dull.name = "dull_leaf"
    shader.inputs["Roughness"].default_value = 0.9
    shiny.data.materials.append(dull)
    for polygon in list(shiny.data.polygons)[::2]:
        polygon.material_index = 1
    collected("maple", shiny)
    collected("spruce", crown("blue", BLUE, roughness=0.7))
    bpy.context.view_layer.update()
    trees = read_trees()
    settings, layer = BakeSettings(**SMALL), bpy.context.view_layer
    alone = {name: prepare_tree_set({name: tree}, settings, layer)[name].effects for name, tree in trees.items()}
    assert [is_on(effects, "roughness_metallic") for effects in alone.values()] == [True, False]
    prepared = prepare_tree_set(trees, settings, layer)
    assert all(is_on(each.effects, "roughness_metallic") for each in prepared.values())
    [reason] = [effect.reason for effect in prepared["spruce"].effects if effect.name == "roughness_metallic"]
    assert "share atlas pages" in reason
    planned = plan_tree_set(trees, settings, layer).values()
    assert is_on(joint_effects([each.effects for each in planned]), "roughness_metallic")
    levels = [tree.chain.levels[0] for tree in bake(trees).trees]
    assert np.array_equal(levels[0].orm, levels[1].orm)


def test_alpha_blended_and_cut_out_trees_cannot_share_a_page() -> None:
    glass = crown("red", RED)
    shader = next(node for node in glass.data.materials[0].node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Alpha"].default_value = 0.3
    collected("maple", glass)
    collected("spruce", crown("blue", BLUE))
    bpy.context.view_layer.update()
    with pytest.raises(SceneError, match="leaves of maple are alpha blended"):
        bake(read_trees())
    bake(read_trees(), effects="-blend_order")


def test_work_can_be_cancelled() -> None:
    red_and_blue()
    prepared = prepare_tree_set(
        read_trees(), BakeSettings(effort="best", seconds=None, levels=2), bpy.context.view_layer
    )
    job = start_tree_set(prepared)
    while not job.stage:
        time.sleep(0.001)
    assert not job.done
    assert job.stage.startswith(("maple: ", "spruce: "))
    assert 0.0 <= job.fraction <= 1.0
    job.cancel()
    with pytest.raises(leafcloud.CancelledError):
        job.result()
    assert job.done


@pytest.mark.night
def test_refusals_of_the_core_name_the_tree() -> None:
    red_and_blue()
    prepared = prepare_tree_set(read_trees(), BakeSettings(**SMALL, seconds=1e-6), bpy.context.view_layer)
    with pytest.raises(leafcloud.LeafcloudError, match="tree 'maple': `seconds`"):
        start_tree_set(prepared).result()


def test_the_bytes_of_a_page_are_split_among_the_trees() -> None:
    red_and_blue()
    tree_set = bake(read_trees(), effects="+normals")
    told = sum(tree.costs.bytes["normals"] for tree in tree_set.trees)
    images = [image for image in bpy.data.images if image.name.endswith("_normal")]
    assert len(images) == 2
    assert told == pytest.approx(sum(4 * image.size[0] * image.size[1] for image in images), abs=4)


def test_names_are_cut_so_that_all_suffixes_fit() -> None:
    collected("m" * 60, crown("red", RED))
    collected("m" * 59 + "n", crown("blue", BLUE))
    bpy.context.view_layer.update()
    tree_set = bake(read_trees(), "w" * 44)
    names = [level.object.name for tree in tree_set.trees for level in tree.levels]
    assert [name.rpartition("_")[2] for name in names] == ["LOD0", "LOD1", "LOD2"] * 2
    assert len(set(names)) == 6
    assert page_of(tree_set.trees[1].levels[2].object).name == "w" * 44 + "_LOD2"


def test_a_tree_s_name_may_be_a_prefix_of_the_set_s_name() -> None:
    for tree, (name, color) in {"a": ("red", RED), "a_2": ("blue", BLUE), "a_tree_set": ("green", GREEN)}.items():
        collected(tree, crown(name, color))
    bpy.context.view_layer.update()
    tree_set = bake(read_trees(), "a_grove_all")
    assert {page_of(tree.levels[1].object).name for tree in tree_set.trees} == {"a_grove_all_LOD1"}


# Files


def test_each_alpha_blended_tree_has_its_own_draw_order(tmp_path: Path) -> None:
    """Cross impostors of different trees have equal indices, and Blender's exporter writes equal indices once."""
    for name, color in (("red", RED), ("blue", BLUE)):
        glass = crown(name, color)
        shader = next(node for node in glass.data.materials[0].node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        shader.inputs["Alpha"].default_value = 0.3
        collected(f"{name}_tree", glass)
    bpy.context.view_layer.update()
    write(bake(read_trees(), viewer="anywhere"), tmp_path, lambda stage, fraction: None, blend=False)
    nodes = read_glb(tmp_path / "trunk.glb")
    for tree in ("red_tree", "blue_tree"):
        for number in (1, 2):
            [node] = [node for name, node in nodes.items() if name.startswith(tree) and name.endswith(f"_LOD{number}")]
            [primitive] = node.primitives
            assert primitive.indices.max() == len(primitive.attributes["POSITION"]) - 1
            [order] = node.mesh_extras["leafcloud"]["blend_order"]
            assert max(order["ranges"]) <= primitive.indices.size


def test_files_have_all_trees_and_each_page_once(
    tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    red_and_blue()
    scene, out = saved(tmp_path / "trunk.blend"), tmp_path / "out"
    quick = ("--texture-size", 128, "--quality", 0.1, "--levels", 1, "--every-level")
    report = bake_files(scene, out, "--trees", "collections", "--files", "all", *quick)
    assert [tree["name"] for tree in report["trees"]] == ["maple", "spruce"]
    levels = [f"trunk_LOD{number}.glb" for number in range(3)]
    flights = [f"{tree}_flight{number}.png" for tree in ("maple", "spruce") for number in (1, 2)]
    shown = ["preview.png", "report.html", *flights]
    assert report["files"] == sorted([*shown, "report.json", "trunk.blend", "trunk.glb", *levels])
    assert {file.name for file in out.iterdir()} == set(report["files"])
    nodes = read_glb(out / "trunk.glb")
    assert set(nodes) == {f"{tree}_LOD{number}" for tree in ("maple", "spruce") for number in range(3)}
    assert set(read_glb(out / "trunk_LOD1.glb")) == {"maple_LOD1", "spruce_LOD1"}
    pages = [image["name"] for image in json_of(out / "trunk.glb")["images"] if "normal" not in image["name"]]
    assert pages == ["trunk_LOD1", "trunk_LOD2"]
    assert len(json_of(out / "trunk_LOD1.glb")["images"]) == 2
    assert not gltf_issues(out / "trunk.glb", *(out / f"trunk_LOD{number}.glb" for number in range(3)))
    assert [len(tree["levels"]) for tree in report["trees"]] == [3, 3]
    # Each tree reports its own fraction of the page. Alignment takes room on the small page of the cross impostors.
    for number, least in ((1, 0.5), (2, 0.25)):
        assert least < sum(tree["levels"][number]["atlas_occupancy"] for tree in report["trees"]) <= 1.0


def test_files_of_several_trees_may_be_given(tmp_path: Path, shrub: Path) -> None:
    red_and_blue()
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "maple.glb"), use_visible=True)
    out = tmp_path / "out"
    inputs = ("--input", shrub, tmp_path / "maple.glb", *QUICK, "--levels", 1)
    done = run(*inputs, "--out", out, "--engine", "babylon", "--effects", "normals")
    assert done.returncode == 0, done.stderr
    assert "of 2 trees" in done.stdout
    content = json_of(out / "shrub_maple_LOD1.glb")
    assert {node["name"] for node in content["nodes"]} >= {"maple_LOD1", "shrub_LOD1"}
    kinds = [image["mimeType"] for image in content["images"]]
    assert (kinds.count("image/png"), kinds.count("image/ktx2")) == (2, 2), "the trees share a page"
    pages = [material for material in content["materials"] if material.get("alphaMode") == "MASK"]
    assert [bool(material["extras"]["leafcloud"]["alphaPivots"]) for material in pages] == [True, True]


def test_options_for_one_tree_are_refused_for_several(tmp_path: Path, shrub: Path) -> None:
    red_and_blue()
    scene, out = saved(tmp_path / "trunk.blend"), tmp_path / "out"
    assert "one tree" in refusal(out, "--input", scene, "--trees", "collections", "--cost-curve", "quick")
    assert ".blend" in refusal(out, "--input", shrub, scene)
    assert "open a scene with all trees" in refusal(out, "--input", shrub, shrub, "--unlit")
