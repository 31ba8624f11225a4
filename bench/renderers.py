"""Is a tree the same in every renderer, past all its hand-overs? `make bench-renderers`.

usage: make bench-renderers ARGS='[--renderers NAME,…] [--steps] [PLANT.glb …]'
       (default: the trees of ../shared/foliage up to 10 MB, two shrubs with bent normals, and tufts of large cards)

`bake.py` bakes each plant without settings. The written .blend is opened, with a sky and a sun in front of the tree or
behind it, and the camera moves away past each hand-over. From each place two pictures are drawn: the tree as baked, and
its leaves alone. Cycles takes random samples without filtering, so its pictures are small. Those of the other renderers
have the pixels of a picture of 1,080 rows and 50°, and show the middle of larger crowns. Without plants it writes
docs/bench/renderers.md. --steps: print each picture's figures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from commits import measured_commit
from fidelity import run
from mathutils import Vector
from numpy.typing import NDArray
from plants import UP, Plant, add_card, direction, random_of, save
from sections import table
from stage import DIRECTION, ROOT, light_up, look_at, measured_trees, output_in

from addon.mesh.baked_levels import EXTRAS
from addon.nodes.lod import GROUP_NAME, set_manual
from addon.versions import eevee_engine

DOCUMENT = ROOT / "docs" / "bench" / "renderers.md"
BAKED = ROOT / "target" / "renderers"
INPUTS = ROOT.parent / "shared" / "inputs"
STEPS, FEWER_STEPS = (0.9, 0.97, 0.995, 1.02, 1.045, 1.07, 1.12, 1.2), (0.9, 0.995, 1.045, 1.2)
"""Distances of the pictures, over that of a hand-over: in Cycles, and in renderers that need seconds for each."""
ROWS, FIELD_OF_VIEW = 1080.0, np.radians(50.0)
MARGIN = 1.15
"""Side of a picture over the diameter of the leaves' sphere."""
TRACED, LARGEST = 160, 192
"""Side of Cycles' pictures, and the largest side of others, in pixels."""
SUNS = {"front": (0.6, 0.3, 0.0), "behind": (-1.0, 0.0, 0.97)}
"""Rotations of the sun."""


@dataclass(frozen=True)
class Renderer:
    """A renderer and its settings. suns: those that it is measured under."""

    engine: str
    samples: int
    bounces: int | None = None
    suns: tuple[str, ...] = ("front",)

    @property
    def steps(self) -> tuple[float, ...]:
        return STEPS if self.engine == "CYCLES" else FEWER_STEPS


RENDERERS = {
    "Cycles": Renderer("CYCLES", 16, suns=("front", "behind")),
    "Cycles, 8 bounces": Renderer("CYCLES", 16, 8),
    "EEVEE": Renderer(eevee_engine(), 4),
    "Workbench": Renderer("BLENDER_WORKBENCH", 8),
}

INTRODUCTION = """# Trees in Blender's renderers

Made by `make bench-renderers` on {commit}: the .blend that a bake without settings writes, past each hand-over, over
its leaves alone from the same place. *Cycles* has the transparent bounces of that .blend, 64; *8 bounces* are Blender's
default. *Sun*: in front of the tree, or behind it. *Before*, *after*: mean light of the crown, red, green and blue, at
0.9 and 1.2 × the distance of the hand-over. *Step*: largest change of a color, and of the coverage, between two of
eight pictures, of four in EEVEE and Workbench, beyond the leaves' own. These two are not measured beside octahedral
impostors: without a graphics card EEVEE compiles their shader for minutes.

"""


def set_up(renderer: Renderer, sun: str) -> bpy.types.Object:
    """Light the open scene for a renderer; return the camera."""
    scene = bpy.context.scene
    bounces = scene.cycles.transparent_max_bounces
    for obj in [obj for obj in scene.objects if obj.type in ("LIGHT", "CAMERA")]:
        bpy.data.objects.remove(obj)
    camera = light_up(TRACED, renderer.samples)
    light = scene.objects["sun"]
    light.rotation_euler = SUNS[sun]
    scene.render.engine, scene.render.film_transparent = renderer.engine, True
    scene.cycles.transparent_max_bounces = renderer.bounces or bounces
    scene.eevee.taa_render_samples = renderer.samples
    scene.display.shading.light, scene.display.shading.color_type = "FLAT", "TEXTURE"
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGBA", "16", "NONE"
    return camera


def leaves_alone() -> None:
    """Show the leaves and their trunk at any distance."""
    for obj in (obj for obj in bpy.context.scene.objects if obj.type == "MESH"):
        obj.hide_render = "_LOD0" not in obj.name
        for modifier in obj.modifiers:
            if modifier.type == "NODES" and modifier.node_group.name.startswith(GROUP_NAME):
                set_manual(modifier, transition=0.0, keep=1.0)


def picture(renderer: Renderer, camera: bpy.types.Object, centre: Vector, reach: float) -> NDArray[np.float32]:
    """Return a picture of the crown, linear and premultiplied. reach: radius of the crown over its distance."""
    render = bpy.context.scene.render
    whole = round(MARGIN * ROWS * reach / np.tan(FIELD_OF_VIEW / 2.0))
    side = TRACED if renderer.engine == "CYCLES" else min(max(whole, 16), LARGEST)
    shown = 1.0 if renderer.engine == "CYCLES" else side / max(whole, 16)
    render.resolution_x = render.resolution_y = side
    camera.data.angle = 2.0 * np.arctan(MARGIN * reach * shown)
    with tempfile.TemporaryDirectory() as folder:
        render.filepath = str(Path(folder) / "view.exr")
        with output_in(Path(os.devnull)):
            bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath)
        light = np.empty(side * side * 4, np.float32)
        image.pixels.foreach_get(light)
        bpy.data.images.remove(image)
    return light.reshape(side, side, 4)


def figures(light: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the crown's mean light by channel, and its coverage as a share of the picture."""
    covered = float(light[..., 3].sum())
    return np.array([*(light[..., :3].sum((0, 1)) / max(covered, 1e-9)), covered / light[..., 3].size], np.float64)


def flown(plant: str, renderer: Renderer, sun: str, *, alone: bool) -> dict[float, NDArray[np.float64]]:
    """Return the figures at each distance of the flight. alone: of the leaves without other levels."""
    bpy.ops.wm.open_mainfile(filepath=str(BAKED / plant / f"{plant}.blend"))
    camera = set_up(renderer, sun)
    leaves = bpy.data.objects[f"{plant}_LOD0"]
    x, y, z = leaves[EXTRAS]["centre"]
    centre, radius = (
        leaves.matrix_world @ Vector((x, -z, y)),
        leaves[EXTRAS]["radius"] * leaves.matrix_world.median_scale,
    )
    if alone:
        leaves_alone()
    found = {}
    for away in (step * distance for distance in hand_overs(plant, renderer).values() for step in renderer.steps):
        look_at(camera, centre, centre + DIRECTION * away)
        bpy.context.view_layer.update()
        found[away] = figures(picture(renderer, camera, centre, radius / away))
    return found


def hand_overs(plant: str, renderer: Renderer) -> dict[int, float]:
    """Return the distance from which each level is drawn. EEVEE compiles octahedral impostors for minutes."""
    report: dict[str, Any] = json.loads((BAKED / plant / "report.json").read_text())
    found = (level for level in report["levels"][1:] if renderer.engine == "CYCLES" or level["method"] != "octahedral")
    return {level["level"]: level["switch_distance"] for level in found}


def rows_of(plant: str, name: str, *, tells_steps: bool) -> Iterator[list[str]]:
    """Yield a row for each sun and hand-over."""
    for sun in RENDERERS[name].suns:
        tree, leaves = (flown(plant, RENDERERS[name], sun, alone=alone) for alone in (False, True))
        for number, distance in hand_overs(plant, RENDERERS[name]).items():
            steps = RENDERERS[name].steps
            ratios = [tree[step * distance] / leaves[step * distance] for step in steps]
            if tells_steps:
                for step, ratio in zip(steps, ratios, strict=True):
                    print(plant, name, sun, number, f"{step:.3f}", ratio.round(3), leaves[step * distance].round(3))
            most = np.max([np.abs(after / before - 1.0) for before, after in pairwise(ratios)], axis=0)
            before, after = (" ".join(f"{each:.2f}" for each in ratio[:3]) for ratio in (ratios[0], ratios[-1]))
            yield [
                *(plant, name, sun, f"{number - 1} → {number}", before, after),
                *(f"{100.0 * most[:3].max():.1f} %", f"{100.0 * most[3]:.1f} %"),
            ]


def tufts(folder: Path) -> Path:
    """Write a crown of 50 tufts of five large cards, whose normals all point upward; return the file."""
    random, plant = random_of("tufts", 1), Plant((0.22, 0.4, 0.14), cards=True, upward=True)
    for _ in range(50):
        outward = direction(random)
        place = outward * 3.0 * random.uniform() ** 0.33 + 5.0 * UP
        for _ in range(5):
            along = outward + 0.5 * random.normal(size=3)
            add_card(plant.leaves, place + 0.1 * random.normal(size=3), along, direction(random), 2.0, 1.2)
    return save(plant, "tufts", folder)


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare baked trees with their leaves in Blender's renderers.")
    parser.add_argument("plants", nargs="*", type=Path, help="GLB files")
    parser.add_argument(
        "--renderers", default=";".join(RENDERERS), help="names, separated by semicolons (default: all)"
    )
    parser.add_argument("--steps", action="store_true", help="print each picture's figures")
    given = parser.parse_args()
    names = ("plant", "renderer", "sun", "hand-over", "before", "after", "step, color", "step, coverage")
    shrubs = [INPUTS / "up_normals.glb", INPUTS / "bent_normals.glb"]
    rows = []
    for plant in given.plants or [tufts(BAKED), *shrubs, *measured_trees()]:
        run(sys.executable, ROOT / "bake.py", "--input", plant, "--out", BAKED / plant.stem)
        for name in given.renderers.split(";"):
            for row in rows_of(plant.stem, name, tells_steps=given.steps):
                rows.append(row)
                print(*row, flush=True)
        if not given.plants:
            text = INTRODUCTION.format(commit=measured_commit()) + table(names, rows)
            DOCUMENT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
