"""Is a tree the same in every renderer, past all its hand-overs? `make bench-renderers`.

usage: make bench-renderers ARGS='[--renderers cycles8,cycles64,eevee] [PLANT.glb …]'

`bake.py` bakes each plant without settings. The written .blend is opened, with a sun in front of the tree or behind it
and a sky, and the camera moves away past each hand-over. Each picture is compared with that of the leaves alone from
the same place: the crown's mean light by channel, coverage, and contrast. Cycles takes random samples without filtering,
so its pictures are small; those of EEVEE and Workbench have the pixels of a picture of 1080 rows.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from fidelity import run
from looks import encoded, contrast
from mathutils import Vector
from numpy.typing import NDArray
from scene import all_plants
from sections import table
from stage import ROOT, look_at, output_in

from addon.nodes.lod import GROUP_NAME, set_manual

BAKED = ROOT / "target" / "renderers"
DIRECTION = Vector((0.8, -0.55, 0.25)).normalized()
SUNS = {"front": (0.6, 0.3, 0.0), "behind": (-1.0, 0.0, 0.97)}
STEPS = (0.9, 0.97, 0.995, 1.02, 1.045, 1.07, 1.12, 1.2)
ROWS, FIELD_OF_VIEW = 1080.0, np.radians(50.0)
MARGIN = 1.15
TRACED = 160

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Renderer:
    engine: str
    samples: int
    bounces: int = 8


RENDERERS = {
    "cycles8": Renderer("CYCLES", 16, 8),
    "cycles64": Renderer("CYCLES", 16, 64),
    "eevee": Renderer("BLENDER_EEVEE_NEXT", 4),
    "workbench": Renderer("BLENDER_WORKBENCH", 8),
}


def light_up(turn: tuple[float, float, float]) -> bpy.types.Object:
    scene = bpy.context.scene
    for obj in [obj for obj in scene.objects if obj.type in ("LIGHT", "CAMERA")]:
        bpy.data.objects.remove(obj)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, turn
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (sun, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.6, 0.8, 1.0)
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGBA", "16", "NONE"
    return camera


def set_renderer(renderer: Renderer) -> None:
    scene = bpy.context.scene
    scene.render.engine = renderer.engine
    if renderer.engine == "CYCLES":
        scene.cycles.device, scene.cycles.samples = "CPU", renderer.samples
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        scene.cycles.transparent_max_bounces = renderer.bounces
    elif renderer.engine == "BLENDER_WORKBENCH":
        scene.display.shading.light, scene.display.shading.color_type = "FLAT", "TEXTURE"
    else:
        scene.eevee.taa_render_samples = renderer.samples


def leaves_alone() -> None:
    """Show the leaves and their trunk at any distance."""
    for obj in bpy.context.scene.objects:
        if obj.type != "MESH":
            continue
        obj.hide_render = "_LOD0" not in obj.name
        if not obj.hide_render:
            for modifier in obj.modifiers:
                if modifier.type == "NODES" and modifier.node_group.name.startswith(GROUP_NAME):
                    set_manual(modifier, transition=0.0, keep=1.0)


def pictured(renderer: Renderer, camera: bpy.types.Object, centre: Vector, radius: float, away: float) -> Picture:
    scene = bpy.context.scene
    crown = radius / (np.tan(FIELD_OF_VIEW / 2.0) * away) * ROWS
    side = TRACED if renderer.engine == "CYCLES" else max(16, round(crown * MARGIN))
    scene.render.resolution_x = scene.render.resolution_y = side
    camera.data.angle = 2.0 * np.arctan(radius * MARGIN / away)
    look_at(camera, centre, centre + DIRECTION * away)
    bpy.context.view_layer.update()
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "view.exr")
        scene.render.filepath = path
        with output_in(Path(os.devnull)):
            bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(path)
        light = np.empty(side * side * 4, np.float32)
        image.pixels.foreach_get(light)
        bpy.data.images.remove(image)
    return light.reshape(side, side, 4)[::-1]


def figures(picture: Picture) -> NDArray[np.float64]:
    """Return the crown's mean light by channel, and its coverage as a share of the picture."""
    alpha = float(picture[..., 3].sum())
    return np.array([*(picture[..., :3].sum((0, 1)) / max(alpha, 1e-9)), alpha / picture[..., 3].size], np.float64)


def flight(report: dict, only: int | None) -> Iterator[tuple[str, float]]:
    for level in report["levels"][1:]:
        if only is None or level["level"] == only:
            for step in STEPS:
                yield f"{level['level'] - 1}→{level['level']}", step * level["switch_distance"]


def opened(plant: str, sun: str) -> bpy.types.Object:
    bpy.ops.wm.open_mainfile(filepath=str(BAKED / plant / f"{plant}.blend"))
    return light_up(SUNS[sun])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plants", nargs="*", type=Path)
    parser.add_argument("--renderers", default="cycles8,cycles64,eevee")
    parser.add_argument("--suns", default="front,behind")
    parser.add_argument("--level", type=int)
    parser.add_argument("--kept", action="store_true")
    given = parser.parse_args()
    for plant in given.plants or all_plants(BAKED):
        name = plant.stem
        if not given.kept or not (BAKED / name).exists():
            run(sys.executable, ROOT / "bake.py", "--input", plant, "--out", BAKED / name)
        report = json.loads((BAKED / name / "report.json").read_text())
        for sun in given.suns.split(","):
            for called in given.renderers.split(","):
                renderer, found = RENDERERS[called], {}
                for leaves in (False, True):
                    camera = opened(name, sun)
                    set_renderer(renderer)
                    root = next(obj for obj in bpy.context.scene.objects if obj.name == f"{name}_LOD0")
                    extras = root["leafcloud"]
                    x, y, z = extras["centre"]
                    centre = root.matrix_world @ Vector((x, -z, y))
                    radius = extras["radius"] * root.matrix_world.median_scale
                    if leaves:
                        leaves_alone()
                    for hand_over, away in flight(report, given.level):
                        found[leaves, hand_over, away] = pictured(renderer, camera, centre, radius, away)
                for hand_over, away in flight(report, given.level):
                    a, b = found[True, hand_over, away], found[False, hand_over, away]
                    ratio = figures(b) / figures(a)
                    print(name, sun, called, hand_over, f"{away / radius:6.1f} R", " ".join(f"{each:.3f}" for each in ratio), "leaves", " ".join(f"{each:.3f}" for each in figures(a)), flush=True)


if __name__ == "__main__":
    main()
