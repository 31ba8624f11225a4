"""A first bake of an imported tree in Blender's default scene, with its cube, lamp and still camera."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest
from command_line import run, saved

from addon.ui.panels import LEAFCLOUD_PT_bake

pytestmark = pytest.mark.usefixtures("registered")

LEVELS = ["leaves_LOD0", "leaves_LOD1", "leaves_LOD2", "leaves_LOD3"]
"""Levels of a bake with default settings: the leaves, two billboard levels, the cross impostor."""


@pytest.fixture
def camera(shrub: Path) -> bpy.types.Object:
    """Open Blender's default scene and import the shrub. Return the scene's camera."""
    bpy.ops.wm.read_factory_settings()
    assert {obj.type for obj in bpy.context.scene.objects} == {"MESH", "LIGHT", "CAMERA"}
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    return bpy.context.scene.camera


def drawn() -> set[str]:
    """Return the levels that have visible polygons after evaluation for the scene's camera."""
    graph = bpy.context.evaluated_depsgraph_get()
    levels = [bpy.data.objects[name] for name in LEVELS if name in bpy.data.objects]
    return {obj.name for obj in levels if obj.visible_get() and len(obj.evaluated_get(graph).data.polygons)}


def test_all_levels_are_made_and_follow_the_camera(camera: bpy.types.Object) -> None:
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.every_level, settings.quality, settings.levels = 128, True, 0.1, 2
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert [name for name in LEVELS if name in bpy.data.objects] == LEVELS
    assert all(bpy.data.objects[name].visible_get() for name in LEVELS)
    assert not any(bpy.data.objects[name].hide_render for name in LEVELS)
    distances = [bpy.data.objects[name]["leafcloud"]["switch_distance"] for name in LEVELS]
    seen = []
    for distance, following in zip(distances, [*distances[1:], 4.0 * distances[-1]], strict=True):
        camera.location = (0.0, -(0.3 * distance + 0.7 * following), 0.0)
        bpy.context.view_layer.update()
        seen.append(drawn())
    assert seen == [{name} for name in LEVELS]


def test_the_sidebar_offers_only_this_view_and_then_all_levels(camera: bpy.types.Object) -> None:
    status, settings = bpy.context.window_manager.leafcloud, bpy.context.scene.leafcloud
    settings.texture_size, settings.epsilon, settings.every_level = 64, 0.2, True
    settings.quality, settings.levels = 0.1, 2
    bpy.ops.leafcloud.bake()
    assert (status.note, status.viewer) == ("The camera stands still, so all levels are made", "camera")
    bpy.ops.leafcloud.bake(viewer=status.viewer)
    assert settings.viewer == "camera"
    assert [name for name in LEVELS if name in bpy.data.objects] == LEVELS[:2]
    assert drawn() == {"leaves_LOD0"}
    assert status.viewer == "anywhere"
    assert status.note.startswith("Level 2 and the cross impostor are left out: the camera stays ")
    assert status.note.endswith("only level 1 is made")
    bpy.ops.leafcloud.bake(viewer=status.viewer)
    assert [name for name in LEVELS if name in bpy.data.objects] == LEVELS
    assert (settings.viewer, status.note) == ("anywhere", "")


def test_the_main_panel_explains_the_levels_and_offers_the_other_choice(camera: bpy.types.Object) -> None:
    def drawn() -> tuple[str, list[str]]:
        """Return the text of the box, and the labels of its buttons."""
        layout = MagicMock()
        context = SimpleNamespace(
            scene=bpy.context.scene,
            selected_objects=bpy.context.selected_objects,
            view_layer=bpy.context.view_layer,
            window_manager=bpy.context.window_manager,
            preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
            region=SimpleNamespace(width=260),
        )
        LEAFCLOUD_PT_bake.draw(SimpleNamespace(layout=layout), context)
        box = layout.box.return_value
        lines = [call.kwargs["text"] for call in box.column.return_value.label.call_args_list]
        return " ".join(lines), [call.kwargs["text"] for call in box.operator.call_args_list]

    settings = bpy.context.scene.leafcloud
    settings.levels = 2
    assert drawn() == ("", [])
    bpy.ops.leafcloud.plan()
    assert drawn() == ("The camera stands still, so all levels are made", ["Only for This View"])
    settings.viewer = "camera"
    assert drawn() == ("", []), "the viewer that the button would choose is chosen"
    bpy.ops.leafcloud.plan()
    text, buttons = drawn()
    assert text.startswith("Level 2 and the cross impostor are left out: the camera stays ")
    assert buttons == ["Make All Levels"]


def test_the_plan_uses_the_lights_of_the_scene(camera: bpy.types.Object) -> None:
    """The plan ignores the still camera, but it uses the lights of the same scene."""
    bpy.ops.leafcloud.plan()
    rows = bpy.context.window_manager.leafcloud.plan
    assert rows["normals"].reason.startswith("Blender lights the tree as it renders")
    assert rows["far_levels"].reason.startswith("the camera stands still, and the viewer may be anywhere")


@pytest.mark.night
def test_the_command_line_notes_the_camera_s_effect_in_one_line(camera: bpy.types.Object, tmp_path: Path) -> None:
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    source = saved(tmp_path / "garden.blend")
    quick = ("--input", source, "--texture-size", 64, "--epsilon", 0.2, "--quality", 0.1)
    still = run(*quick, "--out", tmp_path / "still")
    assert still.returncode == 0, still.stderr
    notes = [line for line in still.stderr.splitlines() if ": note: " in line]
    assert notes == [
        "bake.py: note: the camera stands still, so all levels are made; --viewer camera makes only the levels for "
        "this view"
    ]
    view = run(*quick, "--out", tmp_path / "view", "--viewer", "camera")
    [note] = [line for line in view.stderr.splitlines() if ": note: " in line]
    assert note.startswith("bake.py: note: level 2 and the cross impostor are left out: the camera stays ")
    assert note.endswith("; --viewer anywhere makes all levels")
    plan = run(*quick, "--plan-only", "--viewer", "camera")
    assert plan.stderr.splitlines() == [note]
