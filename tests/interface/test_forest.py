"""A forest that is planted by mouse and keys: number and spacing of its trees, and the levels that they show."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest
from blender_window import Window

_PLACES = """
graph = bpy.context.evaluated_depsgraph_get()
def is_crown(each):
    return each.is_instance and "_forest" in each.object.name and not each.object.name.endswith("_trunk")
result = [[*each.matrix_world.translation, each.object.name] for each in graph.object_instances if is_crown(each)]
"""


def trees(blender: Window) -> list[list[Any]]:
    """Return place and level of each tree that the view shows."""
    return list(blender.run(_PLACES))


@pytest.fixture(scope="module")
def ground(blender: Window) -> Window:
    """Return a window with a baked shrub and a ground of 20 × 20 m, selected."""
    blender.keys("a", "x", "Return")
    blender.settle(0.5)
    blender.search("Add Sample Tree")
    blender.search("Bake Levels")
    time.sleep(0.5)
    blender.wait(lambda: not blender.run("result = bool(bpy.context.window_manager.leafcloud.stage)"), 90, "end")
    blender.run("""
bpy.ops.mesh.primitive_plane_add(size=20.0)
bpy.ops.ed.undo_push(message="ground")
""")
    blender.move(600, 500)
    return blender


def test_as_many_trees_are_planted_as_are_wide(ground: Window) -> None:
    """Trees touch on the average: as many as squares of their width cover the ground."""
    width = ground.run("""
import numpy as np
leaves = bpy.data.objects["Shrub_LOD0"]
corners = np.array([v.co for v in leaves.data.vertices])
result = float(np.ptp(corners[:, 0]) + np.ptp(corners[:, 1])) / 2.0
""")
    ground.search("Plant Forest")
    ground.settle(1.0)
    ground.capture("1_planted")
    found = trees(ground)
    assert len(found) == pytest.approx(400.0 / width**2, rel=0.25)
    places = np.array([tree[:2] for tree in found])
    assert np.abs(places).max() <= 10.0
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    assert apart.min(axis=1).mean() > 0.3 * width


def test_levels_follow_the_view_and_the_lod_distance(ground: Window) -> None:
    ground.run("""
area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
region = next(region for region in area.regions if region.type == "WINDOW")
with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area, region=region):
    bpy.ops.view3d.view_selected()
""")

    def finest() -> int:
        return sum(tree[3] == "Shrub_forest_00" for tree in trees(ground))

    ground.settle(1.0)
    near = finest()
    ground.run('bpy.data.objects["Shrub_tree"]["LOD Distance"] = 10.0; bpy.data.objects["Shrub_tree"].update_tag()')
    ground.wait(lambda: finest() > near, 10.0, "finer levels")
    ground.run('bpy.data.objects["Shrub_tree"]["LOD Distance"] = 1.0; bpy.data.objects["Shrub_tree"].update_tag()')
    ground.zoom_out(12)
    ground.wait(lambda: finest() == 0, 10.0, "levels for the distance of the view")
    ground.capture("2_far")


def test_a_saved_forest_shows_the_same_trees(ground: Window, tmp_path_factory: pytest.TempPathFactory) -> None:
    before = sorted(trees(ground))
    path = tmp_path_factory.mktemp("saved") / "forest.blend"
    ground.run(f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    ground.wait(lambda: sorted(trees(ground)) == before, 10.0, "the view's levels after saving")
    ground.run(f"bpy.ops.wm.open_mainfile(filepath={str(path)!r})")
    ground.wait(lambda: sorted(trees(ground)) == before, 10.0, "the view's levels after opening")


def test_planting_again_leaves_one_forest(ground: Window) -> None:
    ground.search("Plant Forest")
    ground.settle(1.0)
    names = ground.run("result = [each.name for each in bpy.data.collections]")
    assert [name for name in names if re.fullmatch(r"Shrub_forest(\.\d+)?", name)] == ["Shrub_forest"]
