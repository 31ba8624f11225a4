"""Times Cycles and three.js on the leaves and on the levels, near and far: `make bench-speed`.

usage: python bench/speed.py [TREE.glb …]      (default: pine and oak of ../shared/foliage)

Near: Cycles' samples per second and three.js's time per picture, for the leaves, levels 1 and 2, and a tenth of the
leaves, all from 3 radii. Far, for the first tree: the drawn triangles and Cycles' time per picture, for the leaves,
levels 1 and 2, and the pruned leaves, from the distance where the crown fills the picture to 64 times that. Prints
tables in Markdown; for the default trees it also writes docs/bench/speed.md and the chart docs/speed.png.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import matplotlib
import matplotlib.pyplot as pyplot
import numpy as np
from browser import ask
from mathutils import Vector
from matplotlib.ticker import FuncFormatter
from stage import FOLIAGE, ROOT, bake_alone, light_up, look_at, render

from addon.bake.values import Baked, TreeSet
from addon.export.files import write
from addon.nodes.lod import set_manual
from addon.settings.bake import BakeSettings

matplotlib.use("Agg")  # Without a display.

TREES = tuple(FOLIAGE / f"{name}.glb" for name in ("pine_cards_20k", "oak_cards_11k"))
SIZE, NEAR, DIRECTION = 256, 3.0, Vector((0.8, -0.55, 0.25)).normalized()
FEW, MANY = 2, 10
"""Samples of two renders. The time difference excludes scene export and BVH build."""
PRUNED = 0.1
"""Fraction of the leaves drawn in the near measurement of the pruned tree."""
PICTURE, ROUNDS, PATIENCE = 512, 9, 900.0
FAR = 2.0 ** np.arange(7.0)
"""Z/Z₀."""
FILLS = 1.0 / math.sin(math.radians(25.0))
"""Z₀ in crown radii: the distance where the crown's sphere touches the picture's edges, for a field of view of 50°."""
SUBJECTS = ("leaves", "level 1", "level 2", "leaves, pruned")

INTRODUCTION = f"""# Rendering a cloud instead of its leaves

Made by `make bench-speed`. Each level with its trunk, from {NEAR:.0f} R; *pruned*: λ = {PRUNED}.

- *Cycles*: {SIZE}², a sun and a sky, 1024 transparent bounces, on the processor. Samples of a pixel per second of
  processor time, all threads together: the difference between {MANY} and {FEW} samples, without scene export and BVH.
- *three.js*: {PICTURE}², as the viewer draws it, in Chromium *without a graphics card* (SwiftShader renders in
  software, where pixels cost more than on a card, and triangles less). Shortest of {ROUNDS} pictures; the subjects
  take turns.
- *×*: speed relative to the leaves. *Area*: total area of cards or billboards relative to the leaves, including
  transparent parts: every ray and pixel there needs an alpha test.
"""
AT_DISTANCES = """
## Against distance

The pine. Z₀ is the distance where its crown fills the picture; the leaves are pruned as in `--chain pruning`.
Seconds of processor time per picture, without scene export and BVH.

![Triangles and render time against distance](../speed.png)
"""


@dataclass(frozen=True)
class Near:
    """One subject near the camera: triangles, area without the trunk, Cycles' samples per second, three.js's ms."""

    triangles: int
    area: float
    samples: float
    frame: float


@dataclass(frozen=True)
class Far:
    """One subject at one distance: triangles, Cycles' seconds."""

    triangles: int
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the leaves and the levels in Cycles and three.js.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: pine and oak of ../shared/foliage)")
    trees = parser.parse_args().trees or list(TREES)
    near = ["| | | triangles | area | Cycles, samples/s | × | three.js, ms | × |", "|---|---|---|---|---|---|---|---|"]
    far: list[list[Far]] = []
    for tree in trees:
        found, curves = measure(tree.resolve(), with_distances=tree == trees[0])
        near += near_rows(tree.stem, found)
        far = far or curves
        print("\n".join(near[-len(SUBJECTS) :]), file=sys.stderr, flush=True)
    text = "\n".join([INTRODUCTION, *near, AT_DISTANCES, *far_rows(far)]) + "\n"
    print(text)
    if trees == list(TREES):
        chart(far, ROOT / "docs" / "speed.png")
        (ROOT / "docs" / "bench" / "speed.md").write_text(text)


def measure(tree: Path, *, with_distances: bool) -> tuple[list[Near], list[list[Far]]]:
    """Bake a tree; return the near figures of each subject, and its curve over the distances, if requested."""
    baked = bake_alone(tree, BakeSettings(effects="+pruning"))
    frames = in_browser(baked)
    camera = light_up(SIZE, MANY)
    curves = [curve(baked, camera, number) for number in range(3)] if with_distances else []
    cycles = [near_in_cycles(baked, camera, number, 1.0) for number in range(3)]
    pruned = bake_alone(tree, BakeSettings(chain="pruning"))
    camera = light_up(SIZE, MANY)
    curves += [curve(pruned, camera, 0)] if with_distances else []
    cycles.append(near_in_cycles(pruned, camera, 0, PRUNED))
    return [Near(*figures, frame) for figures, frame in zip(cycles, frames, strict=True)], curves


def in_browser(baked: Baked) -> list[float]:
    """Return the least milliseconds per picture in three.js for each subject."""
    cases = [{"level": number, "keep": 1.0} for number in range(3)] + [{"level": 0, "keep": PRUNED}]
    with tempfile.TemporaryDirectory() as folder:
        write(TreeSet.of(baked), Path(folder), lambda stage, fraction: None, blend=False)
        question = {"tree": f"/files/{baked.collection.name}.glb", "size": PICTURE, "distance": NEAR}
        question |= {"rounds": ROUNDS, "cases": cases}
        answer = ask("bench/three/speed.html", question, patience=PATIENCE, files=Path(folder))
    return [min(times) for times in answer["times"]]


def near_in_cycles(baked: Baked, camera: bpy.types.Object, number: int, keep: float) -> tuple[int, float, float]:
    """Return triangles, area and samples per second of a level at rest, with the fraction `keep` of its leaves."""
    show_only(baked, number)
    set_manual(baked.levels[number].object.modifiers[0], transition=0.0, keep=keep)
    place(baked, camera, NEAR)
    evaluated = baked.levels[number].object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    area = sum(face.area for face in evaluated.data.polygons)
    return shown_triangles(), area, SIZE**2 * (MANY - FEW) / sampling_time()


def curve(baked: Baked, camera: bpy.types.Object, number: int) -> list[Far]:
    show_only(baked, number)
    result = []
    for distance in FAR:
        place(baked, camera, distance * FILLS)
        result.append(Far(shown_triangles(), sampling_time()))
    return result


def show_only(baked: Baked, number: int) -> None:
    """Show only this level and its trunk, at rest and at any distance. Leaves of a pruning chain are still pruned."""
    for level in baked.levels:
        for obj in (level.object, *([level.trunk] if level.trunk else [])):
            obj.hide_render = obj.hide_viewport = level.number != number
            # Leaves of a chain that prunes continue to follow the camera.
            if baked.prepared.settings.chain != "pruning" or obj is level.trunk:
                set_manual(obj.modifiers[0], transition=0.0, keep=1.0)


def place(baked: Baked, camera: bpy.types.Object, distance: float) -> None:
    """Put the camera at `distance` in crown radii from the crown's center."""
    centre = Vector(baked.prepared.foliage.world_centre.tolist())
    look_at(camera, centre, centre + DIRECTION * (distance * baked.prepared.foliage.radius))
    camera.data.angle = math.radians(50.0)
    bpy.context.view_layer.update()


def sampling_time() -> float:
    """Return the processor time in seconds of `MANY` − `FEW` samples per pixel."""
    seconds = []
    for samples in (FEW, MANY):
        bpy.context.scene.cycles.samples = samples
        seconds.append(render().seconds)
    return max(seconds[1] - seconds[0], 1e-3)


def shown_triangles() -> int:
    graph = bpy.context.evaluated_depsgraph_get()
    meshes = [each.object.data for each in graph.object_instances if each.object.type == "MESH"]
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def near_rows(name: str, found: Sequence[Near]) -> list[str]:
    leaves = found[0]
    rows = []
    for subject, each in zip(SUBJECTS, found, strict=True):
        faster = (each.samples / leaves.samples, leaves.frame / each.frame)
        cycles, three = f"{each.samples:,.0f} | {faster[0]:.2f}", f"{each.frame:.1f} | {faster[1]:.2f}"
        rows.append(f"| {name} | {subject} | {each.triangles:,} | {each.area / leaves.area:.2f} | {cycles} | {three} |")
    return rows


def far_rows(curves: Sequence[Sequence[Far]]) -> list[str]:
    columns = [f"{subject}: {what}" for subject in SUBJECTS for what in ("triangles", "s")]
    lines = ["| Z/Z₀ | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for i, distance in enumerate(FAR):
        cells = [text for each in curves for text in (f"{each[i].triangles:,}", f"{each[i].seconds:.2f}")]
        lines.append(f"| {distance:.0f} | " + " | ".join(cells) + " |")
    return lines


def chart(curves: Sequence[Sequence[Far]], path: Path) -> None:
    figure, (triangles, seconds) = pyplot.subplots(1, 2, figsize=(10, 4.2))
    for subject, each, marker in zip(SUBJECTS, curves, "osD^", strict=True):
        style = {"label": subject, "marker": marker, "markersize": 4.5, "linewidth": 1.3}
        triangles.plot(FAR, [point.triangles for point in each], **style)
        seconds.plot(FAR, [point.seconds for point in each], **style)
    triangles.set(ylabel="triangles drawn", yscale="log", ylim=(1e3, 1e5), title="Triangles")
    seconds.set(ylabel="processor seconds a picture", yscale="log", title=f"Cycles, {SIZE}², {MANY - FEW} samples")
    for axes in (triangles, seconds):
        axes.set_xscale("log", base=2)
        axes.set_xticks(FAR, [f"{distance:.0f}" for distance in FAR])
        axes.set_xlabel("distance Z/Z₀ (the crown fills the picture at 1)")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
    seconds.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    main()
