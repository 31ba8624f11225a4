"""A GLB file in a Godot project switches its levels by itself. Needs a real Godot 4 (GODOT=command)."""

from __future__ import annotations

import itertools
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
ADDON = ROOT / "engines" / "godot" / "addons"
MEASURED = ROOT.parent / "shared" / "foliage" / "pine_cards_20k.glb"
GODOT = shlex.split(os.environ.get("GODOT", ""))

pytestmark = [
    pytest.mark.skipif(not GODOT, reason="needs the environment variable GODOT, the command of a Godot 4.6"),
    pytest.mark.long,
]

PROJECT = """config_version=5
[application]
config/name="test"
[editor_plugins]
enabled=PackedStringArray("res://addons/leafcloud/plugin.cfg")
[rendering]
renderer/rendering_method="gl_compatibility"
"""


def godot(project: Path, *arguments: str) -> str:
    """Run Godot in the project. Return its output."""
    return checked([*GODOT, "--path", str(project), *arguments])


def checked(command: list[str]) -> str:
    """Run the command. Return its output, which must have no error of a script or a shader."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    except subprocess.TimeoutExpired as error:  # A script that fails does not quit.
        raise AssertionError(f"no end after 120 s: {error.stdout!r} {error.stderr!r}") from error
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert "SCRIPT ERROR" not in said, said
    assert "SHADER ERROR" not in said, said
    return said


def run_script(project: Path, name: str) -> Path:
    """Run one of the scripts beside this file under Xvfb. Return the folder that it wrote into."""
    out = project / "out"
    out.mkdir(exist_ok=True)
    for script in HERE.glob("*.gd"):
        shutil.copy(script, project)
    display = ["xvfb-run", "--auto-servernum", "--server-args=-screen 0 1280x1280x24"]
    window = ["--rendering-driver", "opengl3", "--audio-driver", "Dummy", "--resolution", "1080x1080"]
    command = [*display, *GODOT, "--path", str(project), *window, "--script", f"res://{name}", "--", str(out)]
    checked(command)
    return out


def project_with(folder: Path, trees: list[Path], *settings: str) -> Path:
    """Bake trees for Godot, and copy the file and the add-on into a new project: nothing else."""
    baked = folder / "baked"
    command = [sys.executable, str(ROOT / "bake.py"), "--input", *map(str, trees), "--out", str(baked)]
    subprocess.run([*command, "--engine", "godot", *settings], check=True, capture_output=True, timeout=240)
    project = folder / "project"
    project.mkdir()
    (project / "project.godot").write_text(PROJECT)
    shutil.copytree(ADDON, project / "addons")
    shutil.copy(baked / f"{'_'.join(tree.stem for tree in trees)}.glb", project / "tree.glb")
    godot(project, "--headless", "--import")
    return project


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tree = MEASURED if MEASURED.is_file() else ROOT / "examples" / "shrub.glb"
    return project_with(tmp_path_factory.mktemp("godot"), [tree])


@pytest.fixture(scope="module")
def views(project: Path) -> Path:
    return run_script(project, "views.gd")


def colors(path: Path) -> np.ndarray:
    """Return the pixels (h, w, 3) in [0, 1]."""
    return np.asarray(Image.open(path).convert("RGB"), np.float64) / 255.0


def seen(picture: np.ndarray) -> np.ndarray:
    """Return where (h, w) the picture differs from the background in its corner."""
    return np.abs(picture - picture[0, 0]).max(axis=-1) > 0.02


def test_each_distance_has_its_level(views: Path) -> None:
    found: dict[str, Any] = json.loads((views / "drawn.json").read_text())
    last = found["levels"] - 1
    rows = found["drawn"]
    assert all(1 <= len(row["levels"]) <= 2 for row in rows), "one level, or two that fade"
    rows.sort(key=lambda row: row["distance"])
    firsts = [row["levels"][0] for row in rows]
    assert firsts == sorted(firsts)
    assert firsts[0] == 0
    assert rows[-1]["levels"] == [last]
    assert {number for row in rows for number in row["levels"]} == set(range(last + 1))


def test_a_level_covers_as_much_as_the_one_before_it(views: Path) -> None:
    check_hand_overs(views)


def check_hand_overs(views: Path) -> None:
    """Compare levels that cover at least 300 pixels: below, single pixels decide. There is no antialiasing."""
    compared = 0
    for before in sorted(views.glob("before_*.png")):
        pair = [colors(before), colors(before.with_name(before.name.replace("before", "after")))]
        masks = [seen(picture) for picture in pair]
        covered = [int(mask.sum()) for mask in masks]
        light = [float((picture[mask] ** 2.2).mean()) for picture, mask in zip(pair, masks, strict=True)]
        print(f"{before.stem}: coverage {covered[1] / covered[0]:.3f}, luminance {light[1] / light[0]:.3f}")
        if covered[0] < 300:
            continue
        compared += 1
        assert 0.9 < covered[1] / covered[0] < 1.1
        assert 0.94 < light[1] / light[0] < 1.06
    assert compared >= 1


def test_a_tree_whose_nodes_are_scaled_and_turned_switches_alike(tmp_path: Path) -> None:
    """Files keep the transforms of the tree's objects."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(MEASURED if MEASURED.is_file() else ROOT / "examples" / "shrub.glb"))
    for obj in [obj for obj in bpy.data.objects if obj.parent is None]:
        obj.matrix_world = Matrix.Translation((30.0, -20.0, 5.0)) @ Matrix.Rotation(1.0, 4, "Z") @ Matrix.Scale(0.05, 4)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "moved.glb"))
    project = project_with(tmp_path, [tmp_path / "moved.glb"])
    check_hand_overs(run_script(project, "views.gd"))
    found = json.loads((run_script(project, "forest.gd") / "forest.json").read_text())
    assert 400 <= found["leaves"] <= 800


def test_a_forest_draws_each_tree_once_at_its_level(project: Path) -> None:
    out = run_script(project, "forest.gd")
    found = json.loads((out / "forest.json").read_text())
    print(f"{found['trees']} trees: {found['drawn']:,} triangles in place of {found['without_levels']:,}")
    assert 400 <= found["leaves"] <= 500, "each tree once, or twice while it fades or may soon"
    assert 0 < found["drawn"] < 0.5 * found["without_levels"]
    assert seen(colors(out / "forest.png")).mean() > 0.05
    pictures = ROOT / "out" / "godot"
    pictures.mkdir(parents=True, exist_ok=True)
    shutil.copy(out / "forest.png", pictures)


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


def test_wind_and_pruning_arrive(tmp_path: Path) -> None:
    settings = ["--chain", "pruning", "--effects", "all"]
    project = project_with(tmp_path, [ROOT / "examples" / "shrub.glb"], *settings)
    found = json.loads((run_script(project, "effects.gd") / "effects.json").read_text())
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


def test_light_goes_through_leaves(tmp_path: Path) -> None:
    scene_with_translucent_leaves(tmp_path / "shrub.blend")
    project = project_with(tmp_path, [tmp_path / "shrub.blend"], "--effects", "translucency,transitions")
    found = json.loads((run_script(project, "light.gd") / "light.json").read_text())
    clouds = found["surfaces"][0]
    assert clouds["translucency"] == pytest.approx(0.5, abs=0.01)
    assert clouds["has_texture"]
    assert found["light"][0] > 1.3 * found["light"][1], "the tree stands between the sun and the camera"


def test_baked_light_keeps_its_strength(tmp_path: Path) -> None:
    scene_with_translucent_leaves(tmp_path / "shrub.blend")
    project = project_with(tmp_path, [tmp_path / "shrub.blend"], "--effects", "baked_light,transitions")
    found = json.loads((run_script(project, "light.gd") / "light.json").read_text())
    assert found["surfaces"][0]["light_strength"] > 1.5
