"""The bake operator in a scene: its results and its errors. An error changes nothing in the scene."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest

import leafcloud
from addon.settings.bake import BakeSettings
from addon.settings.choices import CHAINS
from addon.settings.effects import EFFECTS
from addon.ui import job_operator
from addon.ui.properties import bake_settings, leaf_names

pytestmark = [pytest.mark.usefixtures("registered"), pytest.mark.version]

KINDS = ("objects", "meshes", "materials", "images", "collections", "node_groups")


def counts() -> dict[str, int]:
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def refused(words: str) -> None:
    """Run the operator. It has to raise a one-line error with these words and change nothing."""
    before, visible = counts(), [obj.visible_get() for obj in bpy.context.scene.objects]
    with pytest.raises(RuntimeError, match=words) as refusal:
        bpy.ops.leafcloud.bake()
    assert len(str(refusal.value).strip().splitlines()) == 1
    assert counts() == before
    assert [obj.visible_get() for obj in bpy.context.scene.objects] == visible


def test_the_sidebar_starts_with_the_defaults_of_the_command_line() -> None:
    assert bake_settings(bpy.context.scene.leafcloud) == BakeSettings()
    assert leaf_names(bpy.context.scene.leafcloud) is None


def test_the_engine_counts_only_where_files_are_written() -> None:
    """The panel hides it without a folder."""
    settings = bpy.context.scene.leafcloud
    settings.engine = "godot"
    assert bake_settings(settings).engine == "generic"
    settings.directory = "//levels"
    assert bake_settings(settings).engine == "godot"


def test_a_cost_curve_needs_a_chain_with_clouds(selected_shrub: list[bpy.types.Object]) -> None:
    bpy.context.scene.leafcloud.chain = "pruning"
    with pytest.raises(RuntimeError, match="measures clouds, and Chain: Pruning has none: choose another"):
        bpy.ops.leafcloud.curve()


def test_effects_and_leaves_can_be_chosen() -> None:
    settings = bpy.context.scene.leafcloud
    settings.leaves = "needles, twig cards ,"
    assert leaf_names(settings) == ["needles", "twig cards"]
    settings.effect_pruning, settings.effect_normals = "OFF", "ON"
    assert bake_settings(settings).effects == "auto,+normals,-pruning"
    settings.effect_pruning = settings.effect_normals = "AUTO"
    assert bake_settings(settings).effects == "auto"


def test_the_plan_is_shown_without_baking(selected_shrub: list[bpy.types.Object]) -> None:
    before = counts()
    assert bpy.ops.leafcloud.plan() == {"FINISHED"}
    rows = {row.name: row for row in bpy.context.window_manager.leafcloud.plan}
    assert tuple(rows) == EFFECTS
    assert (rows["normals"].state, rows["back_sides"].state, rows["roughness_metallic"].state) == ("ON", "AUTO", "OFF")
    assert rows["roughness_metallic"].cost == ""
    assert rows["normals"].cost.endswith(" MB")
    assert counts() == before
    bpy.context.scene.leafcloud.leaves = "petals"
    with pytest.raises(RuntimeError, match="petals"):
        bpy.ops.leafcloud.plan()


def test_every_chain_can_be_chosen() -> None:
    settings = bpy.context.scene.leafcloud
    for chain in CHAINS:
        settings.chain = chain
        assert bake_settings(settings).chain == chain


def test_a_bake_adds_levels_and_hides_the_selected_objects(selected_shrub: list[bpy.types.Object]) -> None:
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    collection = bpy.context.scene.collection.children["leaves"]
    names = {obj.name for obj in collection.objects}
    last = len([name for name in names if not name.endswith("_trunk")]) - 2
    assert last >= 2
    assert names == {"leaves_tree", f"leaves_LOD{last}"} | {
        f"leaves_LOD{number}{part}" for number in range(last) for part in ("", "_trunk")
    }, "the impostor shows the trunk"
    assert not any(obj.visible_get() for obj in selected_shrub)
    assert all(obj.hide_render for obj in selected_shrub)
    assert bpy.context.window_manager.leafcloud.stage == ""


def test_a_bake_with_a_folder_writes_files(selected_shrub: list[bpy.types.Object], tmp_path: Path) -> None:
    bpy.context.scene.leafcloud.directory = str(tmp_path)
    bpy.ops.leafcloud.bake()
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert sorted(file.name for file in tmp_path.iterdir()) == report["files"]
    assert len(report["levels"]) >= 3
    assert report["files"] == ["leaves.glb", "preview.png", "report.html", "report.json"]
    assert "Flights" not in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not [name for name, _ in bpy.data.objects["leaves_LOD0"].data.attributes.items() if name.startswith("_")]


def test_an_empty_selection_is_refused(selected_shrub: list[bpy.types.Object]) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    assert not bpy.ops.leafcloud.bake.poll()
    refused("Nothing is selected")


def test_unknown_leaf_names_are_refused(selected_shrub: list[bpy.types.Object]) -> None:
    bpy.context.scene.leafcloud.leaves = "petals"
    refused("petals")


def test_a_mesh_without_faces_is_refused() -> None:
    bare = bpy.data.objects.new("leaves", bpy.data.meshes.new("leaves"))
    bpy.context.scene.collection.objects.link(bare)
    bare.select_set(True)
    refused("no faces")


def test_a_folder_that_cannot_be_written_to_is_refused(selected_shrub: list[bpy.types.Object], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    bpy.context.scene.leafcloud.directory = str(tmp_path / "file")
    refused("file")


def test_cancel_running_ends_a_bake(selected_shrub: list[bpy.types.Object]) -> None:
    corners = [(0.0, 0.0, float(z)) for z in range(3000)]
    triangles = [(0, i, i + 1) for i in range(1, 2999)]
    corners = [(x + 0.01 * i % 1.0, 0.1 * i, z) for i, (x, _, z) in enumerate(corners)]
    job = leafcloud.start_chain(leafcloud.Foliage(corners, triangles))
    job_operator.running.append(job)
    assert not bpy.ops.leafcloud.bake.poll()
    job_operator.cancel_running()
    assert job.done
    assert bpy.ops.leafcloud.bake.poll()
