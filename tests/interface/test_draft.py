"""The draft in a window: it is shown before the levels, a changed setting begins the bake anew, Escape removes it."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from blender_window import Window

ROOT = Path(__file__).resolve().parents[2]
BAKE = (134, 150)
"""Place of the button *Bake Levels* in the sidebar."""
BUSY = "result = bool(bpy.context.window_manager.leafcloud.stage)"
DRAFTS = "result = [each.name for each in bpy.data.collections if 'leafcloud_draft' in each]"
SCENE = """
result = sorted((obj.name, obj.visible_get(), obj.select_get()) for obj in bpy.context.scene.objects)
"""


@pytest.fixture(scope="module")
def tree(blender: Window) -> Window:
    blender.keys("a", "x", "Return")
    blender.settle(1.0)
    blender.run("bpy.ops.leafcloud.sample()")
    blender.move(600, 500)
    blender.keys("KP_Decimal")
    blender.settle(1.0)
    return blender


def drafts(blender: Window) -> list[str]:
    return list(blender.run(DRAFTS))


def begin(blender: Window) -> None:
    """Click the button, and wait for the draft."""
    blender.click_in_sidebar(*BAKE)
    blender.wait(lambda: drafts(blender), 30.0, "draft")


def test_escape_removes_the_draft(tree: Window) -> None:
    before = tree.run(SCENE)
    begin(tree)
    tree.settle(0.5)
    tree.capture("draft")
    sources = {name for name, *_ in before}
    shown = {name for name, is_visible, _ in tree.run(SCENE) if is_visible}
    assert shown
    assert not shown & sources
    tree.keys("Escape")
    tree.wait(lambda: not tree.run(BUSY), 20.0, "end of the bake")
    assert drafts(tree) == []
    assert tree.run(SCENE) == before


def test_a_changed_setting_begins_the_bake_anew(tree: Window) -> None:
    begin(tree)
    tree.run("bpy.context.scene.leafcloud.quality = 0.9")
    tree.wait(lambda: not drafts(tree), 30.0, "end of the first draft")
    tree.wait(lambda: drafts(tree), 30.0, "second draft")
    assert tree.run(BUSY)
    tree.wait(lambda: not tree.run(BUSY), 120.0, "end of the bake")
    assert drafts(tree) == []
    names = {name for name, *_ in tree.run(SCENE)}
    assert {"Shrub_LOD0", "Shrub_LOD1"} <= names
    assert not [name for name in names if "draft" in name]
    time.sleep(0.5)
    tree.capture("levels")
