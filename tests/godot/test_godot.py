"""A GLB file in a Godot project becomes trees and forests, with all that the bake wrote."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import QUICK
from godot_project import NEEDS_GODOT, RENDERERS, ROOT, TREE, colors, godot, project_with, run_script, seen

from addon.export.forest_file import write_forest

pytestmark = NEEDS_GODOT


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return project_with(tmp_path_factory.mktemp("godot"), [TREE])


@pytest.fixture(scope="module")
def blown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = ["--chain", "pruning", "--effects", "all"]
    return project_with(tmp_path_factory.mktemp("godot"), [ROOT / "examples" / "shrub.glb"], *settings)


@pytest.fixture(scope="module")
def translucent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("godot")
    scene_with_translucent_leaves(folder / "shrub.blend")
    return project_with(folder, [folder / "shrub.blend"], "--effects", "translucency,transitions")


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_forest_draws_each_tree_once_at_its_level(project: Path, renderer: str) -> None:
    out = run_script(project, "forest.gd", renderer)
    found = json.loads((out / "forest.json").read_text())
    print(f"{found['trees']} trees: {found['drawn']:,} triangles in place of {found['without_levels']:,}")
    assert 400 <= found["leaves"] <= 500, "each tree once, or twice while it fades or may soon"
    assert 0 < found["drawn"] < 0.5 * found["without_levels"]
    assert seen(colors(out / "forest.png")).mean() > 0.05
    pictures = ROOT / "out" / "godot"
    pictures.mkdir(parents=True, exist_ok=True)
    shutil.copy(
        out / "forest.png", pictures / ("forest.png" if renderer == "gl_compatibility" else f"forest_{renderer}.png")
    )


def test_an_exported_forest_is_a_forest(tmp_path: Path) -> None:
    """Places in Blender's axes: Z is up, which is Y in Godot."""
    project = project_with(tmp_path, [ROOT / "examples" / "shrub.glb"], *QUICK)
    places = np.array([np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    places[1, :3, 3] = 5.0, 7.0, 1.0
    write_forest(project / "tree.glb", project / "forest.glb", places)
    godot(project, "--headless", "--import")
    imported, read = json.loads((run_script(project, "planted.gd") / "planted.json").read_text())
    assert imported == read
    assert imported["levels"] >= 2
    assert np.allclose(imported["places"], [[0.0, 0.0, 0.0, 1.0], [5.0, 1.0, -7.0, 2.0]], atol=1e-5)


def test_each_tree_of_a_file_has_its_own_ranges(tmp_path: Path) -> None:
    other = tmp_path / "bush.glb"
    shutil.copy(ROOT / "examples" / "shrub.glb", other)
    project = project_with(tmp_path, [ROOT / "examples" / "shrub.glb", other], "--epsilon", "0.1")
    trees = json.loads((run_script(project, "trees.gd") / "trees.json").read_text())
    assert sorted(tree["name"] for tree in trees) == ["bush", "shrub"]
    for tree in trees:
        assert len(tree["ranges"]) >= 2
        assert tree["ranges"][0][0] == 0.0
        assert tree["ranges"][-1][1] == 0.0, "the last level has no end"
        for (begin, end), (following, _) in itertools.pairwise(tree["ranges"]):
            assert begin < following < end, "a level begins where the one before it fades"


@pytest.mark.parametrize("renderer", RENDERERS)
def test_wind_and_pruning_arrive(blown: Path, renderer: str) -> None:
    found = json.loads((run_script(blown, "effects.gd", renderer) / "effects.json").read_text())
    assert found["moved"] > 0.005, "the wind moves leaves between two frames"
    assert 0.2 < found["kept"] < 0.7, "a quarter of the leaves covers less, but more than the trunk alone"
    assert found["wind_strength"] > 0.0


def test_a_running_game_reads_the_same_tree(project: Path) -> None:
    out = run_script(project, "loaded.gd")
    found = json.loads((out / "loaded.json").read_text())
    assert found["levels"][0] == found["levels"][1] >= 3
    assert found["mips"] == [True, True]
    for imported in sorted(out.glob("imported_*.png")):
        pair = [colors(imported), colors(imported.with_name(imported.name.replace("imported", "loaded")))]
        assert seen(pair[0]).sum() > 50
        assert np.abs(pair[0] - pair[1]).max(axis=-1)[seen(pair[0]) | seen(pair[1])].mean() < 0.02


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_drawn_share_is_alpha_at_all_mip_levels(project: Path, renderer: str) -> None:
    """A quarter of the texture is opaque, in squares of four texels. Multisampling changes nothing."""
    found = json.loads((run_script(project, "shares.gd", renderer) / "shares.json").read_text())
    print(renderer, found["shares"])
    assert found["shares"] == [pytest.approx([0.25] * 5, abs=0.02)] * 2


def scene_with_translucent_leaves(path: Path) -> None:
    """Save the shrub with leaves that let half of the light through, and a sun of strength 4."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(ROOT / "examples" / "shrub.glb"))
    for material in bpy.data.materials:
        tree = material.node_tree
        surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        through, mix = tree.nodes.new("ShaderNodeBsdfTranslucent"), tree.nodes.new("ShaderNodeMixShader")
        through.inputs["Color"].default_value = (0.6, 0.8, 0.1, 1.0)
        for source, target in zip((surface.outputs[0], through.outputs[0]), mix.inputs[1:], strict=True):
            tree.links.new(source, target)
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 40.0
    bpy.context.scene.collection.objects.link(sun)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_light_goes_through_leaves(translucent: Path, renderer: str) -> None:
    found = json.loads((run_script(translucent, "light.gd", renderer) / "light.json").read_text())
    clouds = found["surfaces"][0]
    assert clouds["translucency"] == pytest.approx(0.5, abs=0.01)
    assert clouds["has_texture"]
    assert found["light"][0] > 1.3 * found["light"][1], "the tree stands between the sun and the camera"


def test_baked_light_keeps_its_strength(tmp_path: Path) -> None:
    scene_with_translucent_leaves(tmp_path / "shrub.blend")
    project = project_with(tmp_path, [tmp_path / "shrub.blend"], "--effects", "baked_light,transitions")
    found = json.loads((run_script(project, "light.gd") / "light.json").read_text())
    assert found["surfaces"][0]["light_strength"] > 1.5
