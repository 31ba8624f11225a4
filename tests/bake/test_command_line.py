"""Inputs and output of the command line: file types, the plan, the help."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import pytest
from command_line import QUICK, bake_apart, run, run_apart, saved
from glb import read_glb
from night import rest_at_night

from addon.settings.effects import EFFECTS


def test_an_obj_file_bakes(shrub: Path, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    source = tmp_path / "bush.obj"
    bpy.ops.wm.obj_export(filepath=str(source), path_mode="COPY", export_triangulated_mesh=True)
    out = tmp_path / "out"
    report = bake_apart(source, out, *QUICK, "--levels", 1, "--last", "cross")
    assert report["input"]["leaves"] == 672
    assert [level["method"] for level in report["levels"]] == ["leaves", "stochastic", "cross"]
    assert len(read_glb(out / "bush.glb")["bush_LOD0"].trunk) == 1
    assert gltf_issues(*out.glob("*.glb")) == []


def test_a_blend_file_bakes_with_modifiers_and_camera(shrub: Path, tmp_path: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    leaves = bpy.data.objects["leaves"]
    leaves.modifiers.new("two", "ARRAY").count = 2
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    camera.data.angle = math.radians(20.0)
    source = tmp_path / "garden.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(source))
    wide = bake_apart(shrub, tmp_path / "wide", *QUICK, "--levels", 1)
    report = bake_apart(source, tmp_path / "out", *QUICK, "--levels", 1, "--leaves", "leaves", "--no-cross")
    assert report["input"]["leaves"] == 2 * 672
    assert len(report["levels"]) == 2
    relative = [one["levels"][1]["switch_distance"] / one["input"]["radius"] for one in (wide, report)]
    assert relative[1] > 1.5 * relative[0]  # A narrow field of view shows errors from farther away.
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "garden.blend"))
    assert {obj.name for obj in bpy.data.objects} == {
        "camera", "garden_tree", "garden_LOD0", "garden_LOD0_trunk", "garden_LOD1", "garden_LOD1_trunk"
    }  # fmt: skip
    assert bpy.context.scene.camera.name == "camera"


def test_the_plan_is_printed_and_nothing_is_written(shrub: Path, tmp_path: Path) -> None:
    table = run_apart("--input", shrub, "--plan-only", "--out", tmp_path / "out")
    assert table.returncode == 0, table.stderr
    states = dict(line.split()[:2] for line in table.stdout.splitlines()[1:])
    on = {"transitions": "on", "trunk_levels": "on", "far_levels": "on", "normals": "on", "filtering": "on"}
    assert states == dict.fromkeys(EFFECTS, "off") | on | {"back_sides": "auto"}
    plan = run("--input", shrub, "--plan-only", "--json", "--effects", "pruning")
    given = {effect["name"]: effect["on"] for effect in json.loads(plan.stdout)}
    assert given == dict.fromkeys(EFFECTS, False) | {"pruning": True, "far_levels": True}
    assert not (tmp_path / "out").exists()


def test_help_lists_the_flags_and_their_defaults() -> None:
    shown = run_apart("--help")
    assert shown.returncode == 0
    text = " ".join(shown.stdout.split())
    for name in ("input", "leaves", "out", "no-cross", "plan-only", "json"):
        assert f"--{name}" in text
    for name, default in [("quality", 0.5), ("candidates", 600), ("levels", 3), ("seed", 0)]:
        assert f"--{name}" in text
        assert f"(default: {default})" in text


def linked_leaves(shrub: Path, folder: Path) -> tuple[bpy.types.Object, Path]:
    """Link the shrub's leaves into an empty file. Return the leaves and the path of their library."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    library = saved(folder / "library.blend")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["leaves"]
    return bpy.data.objects["leaves"], library


def test_a_bake_copies_leaves_linked_from_a_library(shrub: Path, tmp_path: Path) -> None:
    leaves, library = linked_leaves(shrub, tmp_path)
    bpy.context.scene.collection.objects.link(leaves)
    bake_apart(saved(tmp_path / "scene.blend"), tmp_path / "out", *QUICK, "--levels", 1)
    library.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "scene.blend"))
    assert not bpy.data.libraries
    material = bpy.data.objects["scene_LOD0"].active_material
    texture = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    assert texture.image.packed_file is not None


def with_a_driver_that_fails(shrub: Path, folder: Path) -> Path:
    """Save the shrub with a driver that fails: Blender does not evaluate its expression, because scripts are off."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    driver = bpy.data.objects["leaves"].driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "bpy.context.scene.frame_current * 0.0"
    return saved(folder / "scene.blend")


def with_an_override(shrub: Path, folder: Path) -> Path:
    linked, _ = linked_leaves(shrub, folder)
    leaves = linked.override_create()
    bpy.context.scene.collection.objects.link(leaves)
    leaves.location.x = 1.0
    return saved(folder / "scene.blend")


def with_a_driver_in_a_library(shrub: Path, folder: Path) -> Path:
    library = with_a_driver_that_fails(shrub, folder).rename(folder / "library.blend")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["leaves"]
    bpy.context.scene.collection.objects.link(bpy.data.objects["leaves"])
    return saved(folder / "scene.blend")


def with_a_script(shrub: Path, folder: Path) -> Path:
    """Save the shrub with a script that Blender would run if scripts were on."""
    text = bpy.data.texts.new("script.py")
    text.write("import bpy\nbpy.app.handlers.depsgraph_update_post.append(lambda *_: None)\n")
    text.use_module = True
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    return saved(folder / "scene.blend")


@pytest.mark.parametrize(
    "scene", rest_at_night([with_a_driver_that_fails, with_an_override, with_a_driver_in_a_library, with_a_script])
)
def test_a_bake_ends_and_leaves_no_temporary_files(
    scene: Callable[[Path, Path], Path], shrub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = scene(shrub, tmp_path)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    bake_apart(source, tmp_path / "out", *QUICK, "--levels", 1)
    assert not list(temporary.iterdir())
