"""Measures a forest of 10,000 trees from seven distances: `make bench-forest`.

usage: make bench-forest ARGS='[TREE.glb]'      (default: the pine of ../shared/foliage)

Draws it in three ways: *forest*, as the extension plants it (levels and pruned leaves by distance, neighbors
switching apart); *plain*, the same levels without pruned leaves, all switching at one distance; *leaves*, at every
distance. Measures at each distance: the triangles of all instances; the time that Blender takes to choose instances
after a camera move; the time and memory of a small picture in Cycles. Every case runs in a process of its own. Prints
a table in Markdown; for the pine it also writes docs/bench/forest.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray
from stage import FOLIAGE, ROOT, bake_alone, light_up, look_at, render

from addon.bake.values import Baked
from addon.levels.forest import Forest, build_forest
from addon.nodes.laws import NEVER
from addon.settings.bake import BakeSettings

TREE = FOLIAGE / "pine_cards_20k.glb"
SIDE, SPACING = 100, 3.0
"""Trees along a side, and the distance between neighbors in crown radii."""
DISTANCES = np.geomspace(15.0, 5000.0, 7)
"""Distances of the camera from the center of the forest, in radii: the forest ends at 150."""
RISE = 0.1
"""Height of the camera above the crowns' centers, as a fraction of its distance."""
WAYS = ("forest", "plain", "leaves")
SIZE, SAMPLES, UPDATES = 256, 4, 15
NICE = 10

INTRODUCTION = f"""# A forest

Made by `make bench-forest`: {SIDE * SIDE:,} pines, {SPACING:.0f} R apart, R the radius of a crown,
seen from {DISTANCES[0]:.0f} R from the center, inside, to {DISTANCES[-1]:.0f} R; the forest ends at
{SIDE * SPACING / 2:.0f} R. *Forest*: as the extension plants it, baked with `--chain both`. *Plain*: the same levels,
switched at one distance, no pruned leaves. *Leaves*: all of them at any distance. No trees are culled by the view.
For this pine level 1 takes over before half of the leaves are pruned. So the forest has no pruned variant. Its trees
only switch apart, none nearer than in *plain* and up to 15 % farther away.

- *Triangles*: of all instances together, trunks included. Instances share their meshes: a rasterizer draws this many,
  but memory holds fewer.
- *Evaluation*: median and longest of {UPDATES} updates of the scene after a camera move, each until Blender has
  the new list of instances.
- *Render*: Cycles, {SIZE}², {SAMPLES} samples, including scene export and BVH build.
- Both are processor time of all threads together, because other programs share the machine. Elapsed time is shorter on
  several cores.
- *Cycles*: the peak in Cycles' statistics. *Process*: growth of the process's largest resident set during the render.
  Both in MiB, one process per case.
"""
HEADER = (
    "camera",
    "way",
    "triangles",
    "evaluation, ms",
    "longest",
    "render, s",
    "Cycles, MiB",
    "process, MiB",
)


@dataclass(frozen=True)
class Case:
    triangles: int
    evaluation: float
    longest: float
    seconds: float
    cycles: float
    process: float


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure a forest of 10,000 trees from seven distances.")
    parser.add_argument("tree", nargs="?", type=Path, default=TREE, help="a GLB file (default: the pine)")
    parser.add_argument("--case", nargs=3, metavar=("FILE", "WAY", "DISTANCE"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        file, way, distance = arguments.case
        print(json.dumps(asdict(measure(Path(file), way, float(distance)))))
        return
    lines = ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "forest.blend"
        plant(bake_alone(arguments.tree.resolve(), BakeSettings(chain="both")), file)
        for distance in DISTANCES:
            for way in WAYS:
                lines.append(row(distance, way, in_process(file, way, distance)))
                print(lines[-1], file=sys.stderr, flush=True)
    print("\n".join(lines))
    if arguments.tree == TREE:
        (ROOT / "docs" / "bench" / "forest.md").write_text(f"{INTRODUCTION}\n" + "\n".join(lines) + "\n")


def row(distance: float, way: str, case: Case) -> str:
    times = (f"{case.evaluation:.0f}", f"{case.longest:.0f}", f"{case.seconds:.1f}")
    cells = (f"{distance:.0f} R", way, f"{case.triangles:,}", *times, f"{case.cycles:.0f}", f"{case.process:.0f}")
    return f"| {' | '.join(cells)} |"


def plant(baked: Baked, file: Path) -> None:
    """Save a scene with the forest's points, one object per way, and its center and radius as custom properties."""
    radius, centre = baked.prepared.foliage.radius, baked.prepared.foliage.world_centre
    bpy.context.scene.collection.children.unlink(baked.collection)
    points = places(radius)
    for way in WAYS:
        mesh = bpy.data.meshes.new(way)
        mesh.from_pydata(points.tolist(), [], [])
        obj = bpy.data.objects.new(way, mesh)
        bpy.context.scene.collection.objects.link(obj)
        forest_of(baked, way).plant(obj, width=0.15 if way == "forest" else 0.0)
    bpy.context.scene["middle"] = (0.0, 0.0, float(centre[2]))
    bpy.context.scene["radius"] = radius
    bpy.ops.wm.save_as_mainfile(filepath=str(file))


def forest_of(baked: Baked, way: str) -> Forest:
    prunes = way == "forest"
    levels, distances = (baked.levels, baked.switch_distances) if way != "leaves" else (baked.levels[:1], (0.0,))
    return build_forest(
        levels,
        way,
        switch_distances=distances,
        centre=tuple(baked.prepared.foliage.centre.tolist()),
        prune_start=min(baked.schedule.pruning.start, NEVER) if prunes else NEVER,
        prune_half=baked.schedule.pruning.half,
        growth=baked.chain.growth,
    )


def places(radius: float) -> NDArray[np.float64]:
    """Return points (n, 3) on a grid about the origin, each moved at random by up to a third of the spacing."""
    along = (np.arange(SIDE) - (SIDE - 1) / 2.0) * SPACING * radius
    grid = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    moved = np.random.default_rng(0).uniform(-1.0, 1.0, grid.shape) * SPACING * radius / 3.0
    return np.column_stack([grid + moved, np.zeros(len(grid))])


def in_process(file: Path, way: str, distance: float) -> Case:
    command = [sys.executable, __file__, "--case", str(file), way, str(distance)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=lambda: os.nice(NICE))
    if run.returncode != 0:
        raise SystemExit(f"{way} at {distance:.0f} R failed with status {run.returncode}:\n{run.stderr[-2000:]}")
    return Case(**json.loads(run.stdout.splitlines()[-1]))


def measure(file: Path, way: str, distance: float) -> Case:
    bpy.ops.wm.open_mainfile(filepath=str(file))
    scene = bpy.context.scene
    for other in WAYS:
        if other != way:
            bpy.data.objects.remove(bpy.data.objects[other])
    camera = light_up(SIZE, SAMPLES)
    middle, away = Vector(scene["middle"]), distance * scene["radius"]
    eye = middle + Vector((away, 0.0, RISE * away))
    look_at(camera, middle, eye)
    bpy.context.view_layer.update()
    updates = [updated_in(camera, eye, number * scene["radius"] / 10.0) for number in range(1, UPDATES + 1)]
    look_at(camera, middle, eye)
    bpy.context.view_layer.update()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    picture = render()
    return Case(
        triangles=drawn_triangles(),
        evaluation=1e3 * statistics.median(updates),
        longest=1e3 * max(updates),
        seconds=picture.seconds,
        cycles=picture.cycles,
        process=picture.process - before,
    )


def updated_in(camera: bpy.types.Object, eye: Vector, aside: float) -> float:
    """Move the camera aside; return the processor time in seconds until Blender has the new list of instances."""
    camera.location = eye + Vector((0.0, aside, 0.0))
    begin = time.process_time()
    len(bpy.context.evaluated_depsgraph_get().object_instances)
    return time.process_time() - begin


def drawn_triangles() -> int:
    """Return the number of triangles of all instances."""
    counts: dict[str, int] = {}
    total = 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH":
            mesh = instance.object.data
            if mesh.name not in counts:
                counts[mesh.name] = len(mesh.loops) - 2 * len(mesh.polygons)
            total += counts[mesh.name]
    return total


if __name__ == "__main__":
    main()
