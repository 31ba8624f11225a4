"""Times Cycles on the leaves and on the levels against distance: `make bench-speed`.

usage: make bench-speed ARGS='[TREE.glb]'      (default: the pine of ../shared/foliage)

The drawn triangles and Cycles' time per picture, for the leaves, levels 1 and 2, and the pruned leaves, from the
distance where the crown fills the picture to 64 times that; and a stand of 500 trees, with leaves alone and with levels
by distance. Prints tables in Markdown; for the default tree it also writes docs/bench/speed.md and the chart
docs/speed.png. `drawing.py` compares each level with the leaves where the level takes over.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import matplotlib
import matplotlib.pyplot as pyplot
import numpy as np
from mathutils import Vector
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray
from stage import FOLIAGE, ROOT, bake_alone, light_up, look_at, place, sampling_time, show_only

from addon.bake.values import Baked
from addon.levels.forest import Forest, build_forest
from addon.settings.bake import BakeSettings

matplotlib.use("Agg")  # Without a display.

TREE = FOLIAGE / "pine_cards_20k.glb"
SIZE, FIELD_OF_VIEW = 256, math.radians(50.0)
FEW, MANY = 2, 10
"""Samples of two renders. The time difference excludes scene export and BVH build."""
FAR = 2.0 ** np.arange(7.0)
"""Z/Z₀."""
FILLS = 1.0 / math.sin(FIELD_OF_VIEW / 2.0)
"""Z₀ in crown radii: the distance where the crown's sphere touches the picture's edges."""
STAND, NEAREST = (25, 20), 4.3
"""Trees of a stand along its width and its depth, two crown radii apart, and the distance to the first, in radii."""
SUBJECTS = ("leaves", "level 1", "level 2", "leaves, pruned")

INTRODUCTION = f"""# Rendering a cloud instead of its leaves, against distance

Made by `make bench-speed` with the pine, each level with its trunk. Z₀ is the distance where the crown fills the
picture; the leaves are pruned as in `--chain pruning`. Cycles: {SIZE}², a sun and a sky, 1024 transparent bounces, on
the processor. Seconds of processor time per picture, all threads together: the difference between {MANY} and {FEW}
samples, without scene export and BVH.

![Triangles and render time against distance](../speed.png)
"""


@dataclass(frozen=True)
class Far:
    """One subject at one distance: triangles, Cycles' seconds."""

    triangles: int
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the leaves and the levels in Cycles against distance.")
    parser.add_argument("tree", nargs="?", type=Path, default=TREE, help="GLB file (default: the measured pine)")
    tree = parser.parse_args().tree
    curves = measure(tree.resolve())
    text = "\n".join([INTRODUCTION, *far_rows(curves), *stand_rows(tree.resolve())]) + "\n"
    print(text)
    if tree == TREE:
        chart(curves, ROOT / "docs" / "speed.png")
        (ROOT / "docs" / "bench" / "speed.md").write_text(text, encoding="utf-8")


def measure(tree: Path) -> list[list[Far]]:
    """Return the curve of each subject over the distances."""
    baked = bake_alone(tree, BakeSettings(every_level=True))
    camera = light_up(SIZE, MANY)
    curves = [curve(baked, camera, number) for number in range(3)]
    pruned = bake_alone(tree, BakeSettings(chain="pruning"))
    return [*curves, curve(pruned, light_up(SIZE, MANY), 0)]


def curve(baked: Baked, camera: bpy.types.Object, number: int) -> list[Far]:
    show_only(baked, number)
    result = []
    for distance in FAR:
        place(baked, camera, distance * FILLS, FIELD_OF_VIEW)
        result.append(Far(shown_triangles(), sampling_time(FEW, MANY)))
    return result


def shown_triangles() -> int:
    graph = bpy.context.evaluated_depsgraph_get()
    meshes = [each.object.data for each in graph.object_instances if each.object.type == "MESH"]
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def far_rows(curves: Sequence[Sequence[Far]]) -> list[str]:
    columns = [f"{subject}: {what}" for subject in SUBJECTS for what in ("triangles", "s")]
    lines = ["| Z/Z₀ | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for i, distance in enumerate(FAR):
        cells = [text for each in curves for text in (f"{each[i].triangles:,}", f"{each[i].seconds:.2f}")]
        lines.append(f"| {distance:.0f} | " + " | ".join(cells) + " |")
    return lines


def stand_rows(tree: Path) -> list[str]:
    """Return a table of seconds a picture of a stand, by the number of transparent bounces."""
    baked = bake_alone(tree, BakeSettings())
    camera, radius = light_up(SIZE, MANY), baked.prepared.foliage.radius
    bpy.context.scene.collection.children.unlink(baked.collection)
    across, away = np.meshgrid(np.arange(STAND[0]) - STAND[0] / 2.0, np.arange(STAND[1]))
    points = 2.0 * radius * np.stack([across, away + NEAREST / 2.0, 0.0 * away], axis=-1).reshape(-1, 3)
    height, centre = baked.prepared.foliage.world_centre[2], tuple(baked.prepared.foliage.centre.tolist())
    camera.data.angle = FIELD_OF_VIEW
    look_at(camera, Vector((0.0, radius, height)), Vector((0.0, 0.0, height)))
    lines = ["", f"{STAND[0] * STAND[1]} trees, from {NEAREST} R on:", ""]
    lines += ["| transparent bounces | leaves: s | levels: s | times as fast |", "|---|---|---|---|"]
    for bounces in (8, 64):
        bpy.context.scene.cycles.transparent_max_bounces = bounces
        leaves, levels = (
            stand_time(build_forest(shown, "stand", switch_distances=distances, centre=centre), points)
            for shown, distances in ((baked.levels[:1], (0.0,)), (baked.levels, baked.switch_distances))
        )
        lines.append(f"| {bounces} | {leaves:.2f} | {levels:.2f} | {leaves / levels:.2f} |")
    return lines


def stand_time(forest: Forest, points: NDArray[np.float64]) -> float:
    mesh = bpy.data.meshes.new("stand")
    mesh.from_pydata(points.tolist(), [], [])
    obj = bpy.data.objects.new("stand", mesh)
    bpy.context.scene.collection.objects.link(obj)
    forest.plant(obj, width=0.0)
    seconds = sampling_time(FEW, MANY)
    bpy.data.objects.remove(obj)
    return seconds


def chart(curves: Sequence[Sequence[Far]], path: Path) -> None:
    figure, (triangles, seconds) = pyplot.subplots(1, 2, figsize=(10, 4.2))
    for subject, each, marker in zip(SUBJECTS, curves, "osD^", strict=True):
        style = {"label": subject, "marker": marker, "markersize": 4.5, "linewidth": 1.3}
        triangles.plot(FAR, [point.triangles for point in each], **style)
        seconds.plot(FAR, [point.seconds for point in each], **style)
    triangles.set(ylabel="triangles drawn", yscale="log", ylim=(1e2, 1e5), title="Triangles")
    seconds.set(ylabel="processor seconds a picture", yscale="log", title=f"Cycles, {SIZE}², {MANY - FEW} samples")
    plain = FuncFormatter(lambda value, _: f"{value:,g}")
    seconds.yaxis.set_minor_formatter(plain)
    for axes in (triangles, seconds):
        axes.set_xscale("log", base=2)
        axes.set_xticks(FAR, [f"{distance:.0f}" for distance in FAR])
        axes.set_xlabel("distance Z/Z₀ (the crown fills the picture at 1)")
        axes.yaxis.set_major_formatter(plain)
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
    seconds.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    main()
