"""A first session with the extension, by mouse and keys: the tests are its steps, in order."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blender_window import Window
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
BAKE = (134, 150)
"""Place of the button *Bake Levels* in the sidebar."""
SHOW_AUTO, SHOW_1 = (39, 403), (133, 403)
"""Places of the buttons *Auto* and *1* in the panel *Baked Tree*."""

_STATE = """
def drawn(obj):
    graph = bpy.context.evaluated_depsgraph_get()
    shown = obj.evaluated_get(graph)
    mesh = shown.to_mesh()
    count = len(mesh.loops) - 2 * len(mesh.polygons)
    shown.to_mesh_clear()
    return count
"""


def objects(blender: Window) -> dict[str, Any]:
    """Return the place of each visible object in the scene, by name."""
    return dict(
        blender.run("""
bpy.context.view_layer.update()
result = {obj.name: list(obj.matrix_world.translation) for obj in bpy.context.scene.objects if obj.visible_get()}
""")
    )


def blocks(blender: Window) -> dict[str, list[str]]:
    """Return the names of all data-blocks by kind."""
    return dict(
        blender.run("""
kinds = ("objects", "meshes", "materials", "images", "collections", "node_groups")
result = {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in kinds}
""")
    )


def wait_for_the_end(blender: Window, seconds: float = 60.0) -> None:
    """Wait until a bake has begun, if it has not yet, and until it has ended."""
    time.sleep(0.5)
    blender.wait(
        lambda: not blender.run("result = bool(bpy.context.window_manager.leafcloud.stage)"), seconds, "end of the bake"
    )


def colors(picture: Path) -> np.ndarray:
    """Return the pixels (h, w, 3) of the 3D view without its toolbar and sidebar, in [0, 1]."""
    with Image.open(picture) as opened:
        return np.asarray(opened.convert("RGB"), float)[150:880, 150:980] / 255.0


def greens(picture: Path) -> int:
    red, green, blue = np.moveaxis(colors(picture), 2, 0)
    return int(((green > 1.15 * red) & (green > 1.15 * blue) & (green > 0.15)).sum())


def test_a_click_bakes_the_selected_tree(blender: Window) -> None:
    blender.keys("a", "x", "Return")
    blender.settle(1.0)
    blender.capture("1_start")
    blender.search("Add Sample Tree")
    blender.move(600, 500)
    blender.keys("KP_Decimal")
    blender.settle(1.0)
    blender.capture("2_sample")
    before = blocks(blender)
    assert before["objects"] == ["Shrub", "branches"]
    blender.click_in_sidebar(*BAKE)
    blender.capture("3_baking")
    wait_for_the_end(blender)
    blender.move(600, 500)
    blender.keys("KP_Decimal")
    blender.settle(1.0)
    blender.capture("4_baked")
    seen = objects(blender)
    assert {"Shrub_tree", "Shrub_LOD0", "Shrub_LOD1"} <= seen.keys()
    assert not {"Shrub", "branches"} & seen.keys(), "the sources are hidden"
    assert blender.run("result = bpy.context.view_layer.objects.active.name") == "Shrub_tree"


def test_a_click_shows_one_level_at_all_distances(blender: Window) -> None:
    blender.click_in_sidebar(*SHOW_1)
    blender.move(600, 500)
    blender.settle(1.0)
    blender.capture("5_level_1")
    seen = objects(blender)
    assert "Shrub_LOD1" in seen
    assert "Shrub_LOD0" not in seen
    blender.click_in_sidebar(*SHOW_AUTO)
    assert {"Shrub_LOD0", "Shrub_LOD1"} <= objects(blender).keys()


def test_escape_leaves_everything_as_it_was(blender: Window) -> None:
    blender.run("bpy.context.scene.leafcloud.effort = 'best'")
    before = blocks(blender), objects(blender)
    blender.click_in_sidebar(*BAKE)
    blender.keys("Escape")
    wait_for_the_end(blender)
    assert (blocks(blender), objects(blender)) == before
    blender.run("bpy.context.scene.leafcloud.effort = 'default'")


def shown_levels(blender: Window) -> list[int]:
    """Return the numbers of the levels that 3D views draw."""
    return list(
        blender.run(
            _STATE
            + """
levels = [obj for obj in bpy.data.collections["Shrub"].all_objects if obj.type == "MESH" and obj.visible_get()]
result = sorted({int(obj.name.split("_LOD")[1][0]) for obj in levels if drawn(obj)})
"""
        )
    )


def test_levels_follow_the_view(blender: Window) -> None:
    blender.move(600, 500)
    blender.keys("z")  # The pie of shadings: material preview shows the leaves' own color.
    blender.keys("2")
    blender.wait(
        lambda: greens(blender.capture("6_material")) > 5_000, 60.0, "leaves: EEVEE compiles its shaders first"
    )
    assert shown_levels(blender) == [0]
    blender.search("Label Levels")
    blender.move(600, 500)
    blender.settle(0.5)
    blender.capture("7_labels")
    blender.zoom_out(18)
    blender.wait(lambda: 0 not in shown_levels(blender), 10.0, "level for the distance of the view")
    blender.settle(1.0)
    assert greens(blender.capture("8_far")) > 0
    blender.search("Label Levels")
    blender.move(600, 500)
    blender.keys("KP_Decimal")
    blender.wait(lambda: shown_levels(blender) == [0], 10.0, "leaves")


def test_a_level_is_shown_at_its_size(blender: Window) -> None:
    """Level 2 fills as much of the view's height as of the camera's picture where it takes over."""
    blender.run("""
area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
region = next(region for region in area.regions if region.type == "WINDOW")
area.spaces.active.overlay.show_overlays = False  # One axis is green.
with bpy.context.temp_override(area=area, region=region):
    bpy.ops.leafcloud.frame_level(level=2)
""")
    blender.settle(1.0)
    picture = blender.capture("8_at_its_size")
    assert shown_levels(blender) == [2]
    red, green, blue = np.moveaxis(colors(picture), 2, 0)
    rows = np.flatnonzero(((green > 1.15 * red) & (green > 1.15 * blue) & (green > 0.15)).any(axis=1))
    share = blender.run("""
import json, math
tree = bpy.data.collections["Shrub"]
distance = json.loads(tree["leafcloud_results"])[2]["distance"]
radius = tree.all_objects["Shrub_LOD0"]["leafcloud"]["radius"]
result = radius / (distance * math.tan(math.radians(25.0)))
""")
    height = len(colors(picture)) / 0.87  # The captured part of the view.
    blender.run("""
area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
area.spaces.active.overlay.show_overlays = True
""")
    assert 0.3 * share < np.ptp(rows) / height < 1.1 * share
    blender.click_in_sidebar(*SHOW_AUTO)
    blender.move(600, 500)
    blender.keys("KP_Decimal")
    blender.settle(1.0)


def test_a_copy_stands_beside_the_tree(blender: Window) -> None:
    blender.search("Place a Copy")
    blender.settle(0.5)
    blender.capture("8_copy")
    assert blender.run("result = bpy.context.object.name") == "Shrub copy"
    away = objects(blender)
    width = away["Shrub copy"][0] - away["Shrub_tree"][0]
    assert 1.0 < width < 4.0
    blender.keys("ctrl+z")
    blender.settle(0.5)
    assert "Shrub copy" not in objects(blender)


def test_the_camera_decides_in_a_view_through_it(blender: Window) -> None:
    blender.run("""
camera = bpy.data.objects.new("far", bpy.data.cameras.new("far"))
bpy.context.scene.collection.objects.link(camera)
bpy.context.scene.camera = camera
camera.location = (500.0, 0.0, 0.5)
""")
    blender.settle(1.0)
    assert shown_levels(blender) == [0], "the camera is far, the view is near"
    blender.keys("KP_0")
    blender.wait(lambda: 0 not in shown_levels(blender), 10.0, "level for the distance of the camera")
    blender.keys("KP_0")
    blender.wait(lambda: shown_levels(blender) == [0], 10.0, "leaves")
    blender.run("bpy.data.objects.remove(bpy.data.objects['far'])")


def test_the_tree_moves_as_one(blender: Window) -> None:
    before = objects(blender)
    blender.move(600, 500)
    blender.keys("g", "x", "3", "Return")
    after = objects(blender)
    assert after.keys() == before.keys()
    for name, place in before.items():
        assert after[name] == pytest.approx([place[0] + 3.0, *place[1:]], abs=1e-5)


def test_an_instance_of_the_collection_shows_its_own_level(blender: Window) -> None:
    """The camera stands far from the original and near to the instance. The view looks through it."""
    blender.run("""
camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
bpy.context.scene.collection.objects.link(camera)
bpy.context.scene.camera = camera
camera.location = (503.0, 0.0, 0.5)
bpy.ops.object.collection_instance_add(collection="Shrub", location=(500.0, 0.0, 0.0))
bpy.context.object.name = "near"
bpy.ops.ed.undo_push(message="Add an instance")
""")
    blender.move(600, 500)
    blender.keys("KP_0")
    blender.wait(
        lambda: blender.run("result = bpy.data.objects['near'].type == 'MESH'"), 5.0, "placed tree for the instance"
    )
    blender.capture("9_instance")
    near, far = blender.run(
        _STATE
        + """
result = [drawn(bpy.data.objects["near"]), sum(drawn(each) for each in bpy.data.collections["Shrub"].all_objects
          if each.type == "MESH")]
"""
    )
    assert near > 10 * far > 0


def test_undo_and_redo_are_exact(blender: Window) -> None:
    after = blocks(blender), objects(blender)
    blender.move(600, 500)
    kind = "result = bpy.data.objects['near'].type if 'near' in bpy.data.objects else ''"
    blender.keys("ctrl+z")
    blender.settle(1.0)
    assert blender.run(kind) == "EMPTY", "an instance that an artist wants back stays"
    blender.keys("ctrl+z")
    blender.settle(1.0)
    assert blender.run(kind) == ""
    for _ in range(2):
        blender.keys("ctrl+shift+z")
    blender.settle(1.0)
    again = blocks(blender), objects(blender)
    assert again[1] == after[1]
    for kind, names in after[0].items():
        assert again[0][kind] == names, kind


def test_a_saved_file_opens_with_its_levels_also_without_the_extension(blender: Window, tmp_path: Path) -> None:
    path = tmp_path / "tree.blend"
    before = objects(blender)
    counts = blender.run(_STATE + "result = drawn(bpy.data.objects['near'])")
    blender.run(f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    blender.run(f"""
import addon_utils
name = next(each for each in bpy.context.preferences.addons.keys() if each.endswith(".leafcloud"))
addon_utils.disable(name)
bpy.ops.wm.open_mainfile(filepath={str(path)!r})
""")
    assert not blender.run("result = hasattr(bpy.types.Scene, 'leafcloud')")
    assert objects(blender) == before
    assert blender.run(_STATE + "result = drawn(bpy.data.objects['near'])") == counts
    blender.run("""
import addon_utils
addon_utils.enable("bl_ext.user_default.leafcloud", default_set=True)
""")


def test_a_new_bake_replaces_the_levels(blender: Window) -> None:
    blender.run("""
for obj in bpy.context.scene.objects:
    obj.select_set(obj.name == "Shrub_tree")
bpy.context.view_layer.objects.active = bpy.data.objects["Shrub_tree"]
""")
    before = blocks(blender)
    blender.move(600, 500)
    blender.search("Bake Levels")
    wait_for_the_end(blender)
    blender.capture("10_baked_again")
    again = blocks(blender)
    assert again["objects"] == before["objects"]
    assert again["collections"] == before["collections"]


def test_a_removal_shows_the_sources(blender: Window) -> None:
    blender.move(600, 500)
    blender.search("Remove Levels")
    blender.settle(1.0)
    blender.capture("11_removed")
    seen = objects(blender)
    assert {"Shrub", "branches"} <= seen.keys()
    assert not [name for name in seen if "_LOD" in name]
