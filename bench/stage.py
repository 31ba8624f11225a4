"""Common parts of the tools that time Cycles: a baked tree alone in its scene, sun, sky, camera and a timed render."""

from __future__ import annotations

import os
import re
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
from mathutils import Vector

from addon.bake.pipeline import prepare
from addon.bake.tree_set import bake_tree_set
from addon.bake.values import Baked
from addon.export.blend import clear_scene
from addon.mesh.extract import extract
from addon.nodes.lod import set_manual
from addon.scene.load import load
from addon.settings.bake import BakeSettings

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
LARGEST_FILE = 10_000_000
"""Maximum bytes of a measured tree; larger ones are for tests of speed."""
DIRECTION = Vector((0.8, -0.55, 0.25)).normalized()
"""From the crown's center to the camera."""

_PEAK = re.compile(r"Mem: *[\d.]+[KMG]?, Peak: *([\d.]+)([KMG])")
_MIB = {"K": 2.0**-10, "M": 1.0, "G": 2.0**10}


@dataclass(frozen=True)
class Render:
    """The cost of a picture.

    seconds: processor time of all threads, which other load on the machine changes least.
    cycles, process: peak memory in Cycles' statistics and of the process, in MiB.
    """

    seconds: float
    cycles: float
    process: float


def measured_trees() -> list[Path]:
    """Return the files of the measured trees but the largest, by name."""
    return [tree for tree in sorted(FOLIAGE.glob("*.glb")) if tree.stat().st_size <= LARGEST_FILE]


def bake_alone(tree: Path, settings: BakeSettings) -> Baked:
    """Bake a tree in a scene that then holds its levels only."""
    load(tree)
    scene = bpy.context.scene
    prepared = prepare(extract(bpy.context.evaluated_depsgraph_get(), None, name=tree.stem), settings)
    clear_scene(scene)
    return bake_tree_set({tree.stem: prepared}, scene, tree.stem, lambda stage, fraction: None).trees[0]


def light_up(size: int, samples: int) -> bpy.types.Object:
    """Add a sun, a sky and a camera for pictures of `size`² pixels; return the camera."""
    scene = bpy.context.scene
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.6, 0.3, 0.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (sun, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("sky")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.6, 0.8, 1.0)
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", samples
    scene.cycles.seed, scene.cycles.use_animated_seed = 0, False
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.transparent_max_bounces = 1024
    return camera


def show_only(baked: Baked, number: int) -> None:
    """Show only this level and its trunk, at rest and at any distance. Leaves of a pruning chain are still pruned."""
    for level in baked.levels:
        for obj in (level.object, *([level.trunk] if level.trunk else [])):
            obj.hide_render = obj.hide_viewport = level.number != number
            # Leaves of a chain that prunes continue to follow the camera.
            if baked.prepared.settings.chain != "pruning" or obj is level.trunk:
                set_manual(obj.modifiers[0], transition=0.0, keep=1.0)


def place(baked: Baked, camera: bpy.types.Object, distance: float, field_of_view: float) -> None:
    """Put the camera at `distance` in crown radii from the crown's center. `field_of_view`: in radians."""
    centre = Vector(baked.prepared.foliage.world_centre.tolist())
    look_at(camera, centre, centre + DIRECTION * (distance * baked.prepared.foliage.radius))
    camera.data.angle = field_of_view
    bpy.context.view_layer.update()


def sampling_time(few: int, many: int) -> float:
    """Return the processor time in seconds of `many` − `few` samples per pixel, without scene export and BVH."""
    seconds = []
    for samples in (few, many):
        bpy.context.scene.cycles.samples = samples
        seconds.append(render().seconds)
    return max(seconds[1] - seconds[0], 1e-3)


def look_at(camera: bpy.types.Object, place: Vector, eye: Vector) -> None:
    """Put the camera at `eye`, looking at `place`."""
    camera.location = eye
    camera.rotation_euler = (eye - place).to_track_quat("Z", "Y").to_euler()
    camera.data.clip_end = 10.0 * (eye - place).length + 1e4


@contextmanager
def output_in(path: Path) -> Iterator[None]:
    """Redirect standard output to a file during the block: Cycles prints a line per sample."""
    sys.stdout.flush()
    kept = os.dup(1)
    with path.open("w") as file:
        os.dup2(file.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def render() -> Render:
    """Render the scene once without keeping the picture; return its cost."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "told"
        begin = time.process_time()
        with output_in(told):
            bpy.ops.render.render()
        seconds = time.process_time() - begin
        log = told.read_text(errors="replace")
    peaks = [float(number) * _MIB[unit] for number, unit in _PEAK.findall(log)]
    process = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return Render(seconds, max(peaks, default=0.0), process)
