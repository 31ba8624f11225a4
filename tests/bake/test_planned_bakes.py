"""Bakes for a camera of the scene: the levels that the bake makes and shows, and the costs in the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import bpy
from command_line import run, saved
from plan_scenes import add_camera, add_crown, copies
from scenes import bake, read

from addon.bake.values import Baked
from addon.export.gpu_load import GpuLoad
from addon.export.report import report
from addon.settings.bake import BakeSettings

QUICK = BakeSettings(pixels=8.0, texture_size=64, viewer="camera")


def baked(*, radii: float, trees: int = 1, settings: BakeSettings = QUICK) -> Baked:
    crown = add_crown()
    add_camera(radii, crown)
    copies(crown, trees, 4.0)
    bpy.context.view_layer.update()
    return bake(read([crown]), settings)


def shown(result: Baked) -> list[int]:
    return [level.number for level in result.levels if not level.object.hide_render]


def test_a_still_camera_close_by_gets_plain_leaves() -> None:
    result = baked(radii=3.2)
    assert [level.number for level in result.levels] == [0, 1]
    assert shown(result) == [0]
    leaves = result.levels[0].object
    assert not leaves.modifiers
    assert not leaves.vertex_groups
    assert leaves.data.shape_keys is None
    assert not bpy.data.node_groups
    assert result.chain.levels[0].normal is None


def test_a_still_camera_far_away_gets_the_level_for_its_distance() -> None:
    result = baked(radii=12.0)
    [level] = [one for one in result.levels if one.number in shown(result)]
    away = 12.0 * result.prepared.foliage.radius
    assert [one.number for one in result.levels if result.switch_distances[one.number] <= away][-1] == level.number
    assert not any(one.object.modifiers for one in result.levels)


def test_trees_at_many_distances_switch_by_the_camera() -> None:
    result = baked(radii=3.0, trees=10, settings=replace(QUICK, texture_size=512))
    assert all(level.object.modifiers for level in result.levels)
    assert shown(result) == [level.number for level in result.levels]
    assert result.levels[0].object.data.shape_keys is None


def test_the_report_has_estimated_and_actual_costs() -> None:
    result = baked(radii=12.0)
    effects = {
        effect["name"]: effect for effect in report(result, [0.0] * len(result.levels), [], GpuLoad())["effects"]
    }
    normals = effects["normals"]
    assert normals["bytes"] == normals["estimate"]["bytes"] == 4 * 64 * 64
    assert normals["seconds"] > 0.0
    assert normals["estimate"]["seconds"] > 0.0
    assert effects["transitions"]["estimate"] == {"seconds": 0.0, "bytes": 0}


def test_the_command_line_plans_for_the_camera_of_a_blend_file(tmp_path: Path) -> None:
    crown = add_crown()
    add_camera(3.2, crown)
    source = saved(tmp_path / "garden.blend")
    for flags, transitions in [(("--viewer", "camera"), False), ((), True), (("--engine", "godot"), True)]:
        plan = run("--input", source, "--plan-only", "--json", *flags)
        assert plan.returncode == 0, plan.stderr
        effects = {effect["name"]: effect for effect in json.loads(plan.stdout)}
        assert effects["transitions"]["on"] is transitions, flags
        assert set(effects["transitions"]) == {"name", "on", "reason", "seconds", "bytes"}
