"""Hand-overs of a written .blend in Cycles, under a sun and a sky: the crown keeps its light and its coverage."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from bakes import folder_of, report_of
from mathutils import Vector
from numpy.typing import NDArray
from renders import render_from

from addon.mesh.baked_levels import EXTRAS
from addon.scene.rendering import BOUNCES

SIDE, SAMPLES, NOISE = 64, 64, 0.02


@pytest.fixture
def camera() -> bpy.types.Object:
    """The baked shrub with a sun, a sky and a camera."""
    bpy.ops.wm.open_mainfile(filepath=str(folder_of("sharp") / "shrub.blend"))
    scene = bpy.context.scene
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.6, 0.3, 0.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (sun, camera):
        scene.collection.objects.link(obj)
    scene.world = bpy.data.worlds.new("sky")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.6, 0.8, 1.0)
    return camera


def seen(camera: bpy.types.Object, distance: float, folder: Path) -> NDArray[np.float64]:
    """Return the crown's mean light by channel, and its coverage, from a distance. The crown fills the picture."""
    leaves = bpy.data.objects["shrub_LOD0"]
    x, y, z = leaves[EXTRAS]["centre"]
    centre, radius = leaves.matrix_world @ Vector((x, -z, y)), leaves[EXTRAS]["radius"]
    toward = Vector((0.8, -0.55, 0.25)).normalized()
    camera.location, camera.rotation_euler = centre + distance * toward, toward.to_track_quat("Z", "Y").to_euler()
    camera.data.angle, camera.data.clip_end = 2.0 * np.arctan(1.1 * radius / distance), 2.0 * distance
    light = render_from(folder, camera, size=(SIDE, SIDE), samples=SAMPLES).astype(np.float64)
    covered = light[..., 3].sum()
    return np.array([*(light[..., :3].sum((0, 1)) / covered), covered / SIDE**2])


def test_the_blend_has_enough_bounces(camera: bpy.types.Object) -> None:
    assert bpy.context.scene.cycles.transparent_max_bounces == BOUNCES > 8


@pytest.mark.parametrize("level", [1, 2])
def test_the_middle_of_a_hand_over_lies_between_both_levels(
    level: int, camera: bpy.types.Object, tmp_path: Path
) -> None:
    """Two levels in one place would shade each other: an oak was a fifth darker there."""
    distance = report_of("sharp")["levels"][level]["switch_distance"]
    before, middle, after = (seen(camera, share * distance, tmp_path) for share in (0.99, 1.038, 1.09))
    assert (middle > np.minimum(before, after) * (1.0 - NOISE)).all(), (before, middle, after)
    assert (middle < np.maximum(before, after) * (1.0 + NOISE)).all(), (before, middle, after)
