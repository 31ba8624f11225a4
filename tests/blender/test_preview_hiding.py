"""A running preview hides its levels in the 3D views, but not in files, undo steps and renders."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import pytest
from lod_scenes import FOUR, add_camera, build, place
from node_trees import new_material
from renders import render
from scenes import add_mesh

import addon
from addon.nodes.laws import NEVER
from addon.nodes.lod import LodSettings, add_lod_modifier
from addon.ui.viewport import is_previewed, start_preview, stop_preview
from addon.viewport.hiding import KEY, hide

pytestmark = pytest.mark.usefixtures("registered")


@contextmanager
def without_addon() -> Iterator[None]:
    """Unregister the extension in the `with` block."""
    addon.unregister()
    try:
        yield
    finally:
        addon.register()


@pytest.fixture
def levels() -> list[str]:
    """Return the names of two visible levels. The scene also has a level hidden by the artist, and another object."""
    for name in ("first", "second", "put aside"):
        add_lod_modifier(place(build(FOUR), name), LodSettings(NEVER, NEVER))
    place(build(FOUR), "ground")
    bpy.data.objects["put aside"].hide_set(True)
    return ["first", "second"]


drawn: list[list[str]] = []
"""For each request to draw, the names of the levels."""


def drawer(levels: list[bpy.types.Object]) -> dict[str, Callable[[], None]]:
    drawn.append([obj.name for obj in levels])
    return {"POST_VIEW": lambda: None, "POST_PIXEL": lambda: None}


def preview(names: list[str]) -> None:
    """Start the preview like the operator, but do not draw."""
    drawn.clear()
    start_preview(bpy.context.view_layer, drawer)
    assert drawn == [names]


def visible() -> list[str]:
    return sorted(obj.name for obj in bpy.context.scene.objects if obj.visible_get())


ALL, OTHERS = ["first", "ground", "second"], ["ground"]


def test_stopping_the_preview_shows_its_levels(levels: list[str]) -> None:
    preview(levels)
    assert (is_previewed(), visible()) == (True, OTHERS)
    stop_preview()
    assert (is_previewed(), visible()) == (False, ALL)
    assert KEY not in bpy.context.view_layer


def test_stopping_selects_the_levels_that_were_selected(levels: list[str]) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    bpy.data.objects["second"].select_set(True)
    preview(levels)
    assert bpy.context.selected_objects == []
    stop_preview()
    assert [obj.name for obj in bpy.context.selected_objects] == ["second"]


def test_a_file_saved_during_the_preview_has_visible_levels(levels: list[str], tmp_path: Path) -> None:
    preview(levels)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    assert (is_previewed(), visible()) == (True, OTHERS), "the preview goes on"
    with without_addon():
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tree.blend"))
        assert visible() == ALL
        assert KEY not in bpy.context.view_layer


def test_a_failed_save_leaves_the_preview_on(levels: list[str], tmp_path: Path) -> None:
    preview(levels)
    with pytest.raises(RuntimeError, match="Cannot open file"):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "missing" / "tree.blend"))
    assert (is_previewed(), visible()) == (True, OTHERS)
    stop_preview()
    assert visible() == ALL


def test_an_opened_auto_save_shows_its_levels(levels: list[str], tmp_path: Path) -> None:
    """For an auto-save Blender writes the latest undo step unchanged and calls no handler."""
    with without_addon():
        hide(bpy.context.view_layer, [bpy.data.objects[name] for name in levels])
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "auto.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "auto.blend"))
    assert visible() == ALL
    assert KEY not in bpy.context.view_layer


def test_opening_another_file_stops_the_preview(levels: list[str], tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    preview(levels)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tree.blend"))
    assert (is_previewed(), visible()) == (False, ALL)


def step(message: str) -> None:
    """Change the scene and push an undo step, as Blender does after an operator."""
    bpy.data.objects["ground"].location.x += 1.0
    bpy.ops.ed.undo_push(message=message)


def test_undo_and_redo_leave_the_preview_on(levels: list[str]) -> None:
    step("before")
    preview(levels)
    step("during")
    for turn in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        turn()
        assert (is_previewed(), visible()) == (True, OTHERS)
        assert drawn[-1] == levels
    stop_preview()
    assert visible() == ALL


def test_undo_after_the_preview_shows_the_levels(levels: list[str]) -> None:
    step("before")
    preview(levels)
    step("during")
    stop_preview()
    step("afterwards")
    for turn in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.redo):
        turn()
        assert (is_previewed(), visible()) == (False, ALL)


def test_undoing_the_bake_stops_the_preview() -> None:
    place(build(FOUR), "ground")
    bpy.ops.ed.undo_push(message="before")
    add_lod_modifier(place(build(FOUR), "level"), LodSettings(NEVER, NEVER))
    bpy.ops.ed.undo_push(message="bake")
    preview(["level"])
    bpy.ops.ed.undo()
    assert (is_previewed(), visible()) == (False, ["ground"])
    bpy.ops.ed.redo()
    assert visible() == ["ground", "level"]


def delete(obj: bpy.types.Object) -> None:
    bpy.data.objects.remove(obj)


def unlink(obj: bpy.types.Object) -> None:
    bpy.context.scene.collection.objects.unlink(obj)


def test_the_preview_does_not_start_without_a_visible_level(levels: list[str]) -> None:
    for name in levels:
        bpy.data.objects[name].hide_set(True)
    start_preview(bpy.context.view_layer, drawer)
    assert (is_previewed(), visible()) == (False, OTHERS)


@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize("lose", [delete, unlink])
def test_a_level_may_be_removed_during_the_preview(
    lose: Callable[[bpy.types.Object], None], saved: bool, levels: list[str], tmp_path: Path
) -> None:
    """The level is deleted or unlinked. Then the preview stops, with or without a save before."""
    preview(levels)
    lose(bpy.data.objects["first"])
    if saved:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
        assert (drawn[-1], visible()) == (["second"], OTHERS)
    stop_preview()
    assert visible() == ["ground", "second"]


def test_renders_show_the_levels_during_the_preview(tmp_path: Path) -> None:
    material, principled, _ = new_material()
    principled.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    principled.inputs["Emission Strength"].default_value = 1.0
    corners = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
    add_lod_modifier(add_mesh("level", corners, [(0, 1, 2, 3)], materials=[material]), LodSettings(NEVER, NEVER))
    add_camera((0.0, 0.0, 2.0))
    preview(["level"])
    picture = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(4, 4), samples=1)
    np.testing.assert_allclose(picture[..., 3], 1.0, atol=1e-3)
