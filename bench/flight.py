"""Measures popping while a camera flies away from a tree, past all its levels: `make bench-flight`.

usage: make bench-flight ARGS='[--frames N] [TREE.glb …]'      (default: pine and oak of ../shared/foliage)

Cycles, 256², 8 samples of one seed, a sun and a sky; from 1 to 60 radii, each frame farther by the same factor. Flies
three times: as baked; with the same levels switched without transitions; with the leaves alone, as a control. A pop
is a change between frames that is larger than the changes around it. It is measured as the largest FLIP between
neighboring frames near a switch, divided by the median of the frames around them. Prints a table in Markdown. A
complete flight also goes into docs/bench/flight.json, with the measured commit; docs/bench/flight.md shows it, and
docs/flight_TREE.png a strip of frames and the curve.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import flip_evaluator
import matplotlib
import matplotlib.pyplot as pyplot
import numpy as np
from commits import measured_commit
from mathutils import Vector
from numpy.typing import NDArray
from stage import ROOT

from addon.bake.pipeline import prepare
from addon.bake.tree_set import bake_tree_set
from addon.bake.values import Baked
from addon.export.blend import clear_scene
from addon.mesh.extract import extract
from addon.nodes.lod import GROUP_NAME
from addon.scene.load import load
from addon.settings.bake import BakeSettings
from addon.versions import get_modifier_input, set_modifier_input

matplotlib.use("Agg")  # Without a display.

FOLIAGE = ROOT.parent / "shared" / "foliage"
TREES = ("pine_cards_20k", "oak_cards_11k")
SIZE, SAMPLES, FRAMES = 256, 8, 240
NEAREST, FARTHEST = 1.0, 60.0
"""Distances from the crown's center in crown radii."""
DIRECTION = Vector((0.8, -0.55, 0.25)).normalized()
AT_SWITCH, AROUND = 3, 12
"""Frames on either side of a switch that belong to it, and that are compared with it."""
NEVER = 1e9
STRIP = 8

Frames = list[NDArray[np.float32]]
"""Pictures (SIZE, SIZE, 3), sRGB in [0, 1]."""

MEASURED = ROOT / "docs" / "bench" / "flight.json"
HEAD = ["| | switch | at | transitions | plain | leaves |", "|---|---|---|---|---|---|"]

INTRODUCTION = f"""# A flight past the levels

Made by `make bench-flight`: {FRAMES} frames from {NEAREST:.0f} to {FARTHEST:.0f} radii, {SIZE}²,
{SAMPLES} samples. For each switch the largest FLIP between neighboring frames, divided by the median of the frames
around it: with transitions, with the same levels switched without them (plain), and for the leaves alone at the same
frames.
"""


@dataclass(frozen=True)
class Flight:
    """FLIP between each frame and the next, and a few of the frames."""

    changes: NDArray[np.float64]
    strip: Frames


def stage(tree: Path, settings: BakeSettings) -> tuple[Baked, bpy.types.Object]:
    """Bake the tree's levels for the flight's camera, and add a sun and a sky; return the bake and the camera."""
    load(tree)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    read = extract(bpy.context.evaluated_depsgraph_get(), None, name=tree.stem)
    prepared = prepare(read, settings)
    clear_scene(scene)
    baked = bake_tree_set({tree.stem: prepared}, scene, tree.stem, lambda stage, fraction: None).trees[0]
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.6, 0.3, 0.0)
    scene.collection.objects.link(sun)
    scene.world = bpy.data.worlds.new("sky")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.6, 0.8, 1.0)
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", SAMPLES
    scene.cycles.seed, scene.cycles.use_animated_seed = 0, False
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.transparent_max_bounces = 1024
    scene.view_settings.view_transform = "Standard"
    return baked, camera


def distances(count: int) -> NDArray[np.float64]:
    """Return the distance of each frame in crown radii."""
    return np.geomspace(NEAREST, FARTHEST, count)


@contextmanager
def quiet() -> Iterator[None]:
    """Discard standard output during the block: Cycles prints a line per sample."""
    kept = os.dup(1)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def fly(baked: Baked, camera: bpy.types.Object, frames: Sequence[int], count: int) -> dict[int, NDArray[np.float32]]:
    """Render these frames of a flight of `count`; return the pictures by frame."""
    foliage = baked.prepared.foliage
    pictures = {}
    with tempfile.TemporaryDirectory() as folder:
        for frame in frames:
            far = DIRECTION * (distances(count)[frame] * foliage.radius)
            camera.location = Vector(foliage.world_centre.tolist()) + far
            camera.rotation_euler = DIRECTION.to_track_quat("Z", "Y").to_euler()
            camera.data.clip_end = 200.0 * foliage.radius
            bpy.context.scene.render.filepath = str(Path(folder) / "frame.png")
            with quiet():
                bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(bpy.context.scene.render.filepath)
            pixels = np.empty(SIZE * SIZE * 4, np.float32)
            image.pixels.foreach_get(pixels)
            bpy.data.images.remove(image)
            pictures[frame] = np.ascontiguousarray(pixels.reshape(SIZE, SIZE, 4)[::-1, :, :3])
    return pictures


def with_transitions(baked: Baked) -> None:
    """Change nothing: the levels as baked."""


def switched_plainly(baked: Baked) -> None:
    """Switch the same levels at the same distances, without morphing or fading."""
    appearing = [lod_input(level.object, "Appear") for level in baked.levels]
    for level, vanish in zip(baked.levels, [*appearing[1:], NEVER], strict=True):
        plain = {"Start": NEVER, "End": NEVER, "Fade In End": 0.0, "Fade Out Start": NEVER, "Vanish": vanish}
        for obj in (level.object, *([level.trunk] if level.trunk else [])):
            for name, value in plain.items():
                set_modifier_input(obj.modifiers[GROUP_NAME], name, value)


def lod_input(obj: bpy.types.Object, name: str) -> float:
    return float(get_modifier_input(obj.modifiers[GROUP_NAME], name))


def leaves_alone(baked: Baked) -> None:
    """Show LOD 0 at any distance."""
    for level in baked.levels:
        for obj in (level.object, *([level.trunk] if level.trunk else [])):
            obj.modifiers.clear()
            obj.hide_render = level.number > 0


WAYS: dict[str, Callable[[Baked], None]] = {
    "transitions": with_transitions,
    "plain": switched_plainly,
    "leaves": leaves_alone,
}


def changes(pictures: dict[int, NDArray[np.float32]], count: int) -> NDArray[np.float64]:
    """Return (count − 1,) the mean FLIP between each frame and the next; NaN if one is missing."""

    def change(frame: int) -> float:
        if frame not in pictures or frame + 1 not in pictures:
            return float("nan")
        error = flip_evaluator.evaluate(pictures[frame], pictures[frame + 1], "LDR", applyMagma=False)[0]
        return float(np.mean(error))

    return np.array([change(frame) for frame in range(count - 1)])


def switches(baked: Baked, count: int) -> list[int]:
    """Return the last frame before each switch, for the switches within the flight."""
    takes_over = np.array(baked.switch_distances[1:]) / baked.prepared.foliage.radius
    found = np.searchsorted(distances(count), takes_over) - 1
    return [int(frame) for frame in found if AROUND < frame < count - 1 - AROUND]


def pop(changes: NDArray[np.float64], switch: int) -> float:
    """Return the largest change at the switch, divided by the median of the changes around it."""
    at = changes[switch - AT_SWITCH : switch + AT_SWITCH + 1]
    around = np.concatenate(
        [changes[switch - AROUND : switch - AT_SWITCH], changes[switch + AT_SWITCH + 1 : switch + AROUND + 1]]
    )
    return float(np.nanmax(at) / np.nanmedian(around))


def measure(tree: Path, count: int, *, whole: bool) -> tuple[list[list[str]], dict[str, Flight], list[int]]:
    """Fly past a tree; return the table's rows, the flights by way, and the frames of the switches.

    Without `whole` only the frames around the switches are rendered.
    """
    baked, camera = stage(tree, BakeSettings())
    found = switches(baked, count)
    near = {frame + i for frame in found for i in range(-AROUND, AROUND + 2)}
    frames = range(count) if whole else sorted(near)
    flights = {}
    for name, prepare_levels in WAYS.items():
        prepare_levels(baked)
        pictures = fly(baked, camera, frames, count)
        shown = [pictures[frame] for frame in np.linspace(0, count - 1, STRIP).astype(int) if frame in pictures]
        flights[name] = Flight(changes(pictures, count), shown)
        pops = ", ".join(f"{pop(flights[name].changes, frame):.2f}" for frame in found)
        print(f"{tree.stem}, {name}: {pops}", file=sys.stderr, flush=True)
    rows = []
    for number, frame in enumerate(found, start=1):
        ratios = [f"{pop(flights[name].changes, frame):.2f}" for name in WAYS]
        rows.append([tree.stem, f"{number - 1} → {number}", f"{distances(count)[frame]:.1f} R", *ratios])
    return rows, flights, found


def picture(flights: dict[str, Flight], found: Sequence[int], path: Path) -> None:
    """Write a chart: the strip of frames above the curves."""
    figure, (strip, curve) = pyplot.subplots(2, 1, figsize=(9, 4.5), height_ratios=[1, 2.2])
    strip.imshow(np.concatenate(flights["transitions"].strip, axis=1).clip(0.0, 1.0))
    strip.axis("off")
    for name, flight in flights.items():
        curve.plot(distances(len(flight.changes) + 1)[:-1], flight.changes, label=name, linewidth=1.0)
    for frame in found:
        curve.axvline(distances(len(flights["leaves"].changes) + 1)[frame], color="0.8", zorder=0)
    curve.set_xscale("log")
    curve.set(xlabel="distance in radii", ylabel="FLIP to the next frame")
    curve.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def lines_of(rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in rows]


def keep(tree: Path, rows: list[list[str]]) -> None:
    """Add a complete flight to the files of results."""
    measured = json.loads(MEASURED.read_text()) if MEASURED.is_file() else {}
    measured[tree.stem] = {"commit": measured_commit(), "rows": rows}
    MEASURED.write_text(json.dumps(measured, indent=1, sort_keys=True) + "\n")
    lines = [line for name in sorted(measured) for line in lines_of(measured[name]["rows"])]
    pictures = [f"![{name}](../flight_{name}.png)" for name in sorted(measured)]
    MEASURED.with_suffix(".md").write_text("\n".join([INTRODUCTION, *HEAD, *lines, "", *pictures, ""]))


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure popping on a flight past all levels of a tree.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: pine and oak of ../shared/foliage)")
    parser.add_argument("--frames", type=int, default=FRAMES, help="frames of a flight (default: %(default)s)")
    parser.add_argument("--switches", action="store_true", help="render only the frames around the switches")
    arguments = parser.parse_args()
    trees = arguments.trees or [FOLIAGE / f"{name}.glb" for name in TREES]
    lines = []
    for tree in trees:
        rows, flights, found = measure(tree.resolve(), arguments.frames, whole=not arguments.switches)
        lines += lines_of(rows)
        print("\n".join(lines_of(rows)), file=sys.stderr, flush=True)
        if not arguments.switches and arguments.frames == FRAMES:
            picture(flights, found, ROOT / "docs" / f"flight_{tree.stem}.png")
            keep(tree, rows)
    print("\n".join([*HEAD, *lines]))


if __name__ == "__main__":
    main()
