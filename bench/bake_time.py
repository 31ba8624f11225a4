"""Times bakes by the button of the interface, step by step: `make bench-bake-time`.

usage: make bench-bake-time ARGS='[TREE.glb …]'      (default: the measured trees)

For each tree and each quality: seconds on the main thread before the job, of the job, of each of its stages, and on the
main thread after it; of the longest step after it; from a cancel to the end of the job. Prints a table in Markdown; for
the measured trees it also writes docs/bench/bake_time.md.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy
from commits import measured_commit
from stage import ROOT, measured_trees

import addon
from addon.bake.pipeline import layer_of
from addon.bake.tree_set import finish_tree_set, prepare_tree_set, start_tree_set
from addon.bake.values import Prepared
from addon.ui.properties import bake_settings, with_labels
from addon.ui.selection import selected_trees

QUALITIES = {"Fast": 0.0, "default": 0.5}
SHOWN = ("simplify", "fit", "measure", "pack", "tune", "bake")
"""Stages with a column of their own."""

INTRODUCTION = """# Time of a bake

Made by `make bench-bake-time` at {commit} on {cores} cores, after the import of each tree, without a window. Seconds.

- *before*, *after*: on the main thread, before and after the core's job; *longest*: the longest of the steps after
  it, between which the interface draws.
- *job*: of the core and of judging its levels; then those of its stages.
- *pause*: the longest time from a cancel to the end of the job, of {cancels} cancels spread over the job.
"""
CANCELS = 6


@dataclass(frozen=True)
class Timed:
    """Seconds of one bake: before the job, of its stages by name, of the steps after it."""

    before: float
    stages: dict[str, float]
    after: list[float]

    @property
    def job(self) -> float:
        return sum(self.stages.values())

    @property
    def total(self) -> float:
        return self.before + self.job + sum(self.after)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("trees", nargs="*", type=Path, metavar="TREE.glb")
    given = parser.parse_args().trees
    trees = given or measured_trees()
    addon.register()
    headings = ("tree", "quality", "total", "before", "job", *SHOWN, "after", "longest", "pause")
    rows = [headings, tuple("---" for _ in headings)]
    for tree in trees:
        for name, quality in QUALITIES.items():
            timed, pause = bake(tree, quality), longest_pause(tree, quality)
            stages = (timed.stages.get(stage, 0.0) for stage in SHOWN)
            figures = (timed.total, timed.before, timed.job, *stages, sum(timed.after), max(timed.after), pause)
            rows.append((tree.stem, name, *(f"{figure:.2f}" for figure in figures)))
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    print(table)
    if not given:
        cores = len(os.sched_getaffinity(0))
        text = INTRODUCTION.format(commit=measured_commit(), cores=cores, cancels=CANCELS)
        (ROOT / "docs" / "bench" / "bake_time.md").write_text(f"{text}\n{table}\n", encoding="utf-8")


def bake(tree: Path, quality: float) -> Timed:
    """Bake a tree as the button does, and time it."""
    begin = open_tree(tree, quality)
    prepared = prepare()
    before = time.perf_counter() - begin
    stages: dict[str, float] = {}
    job, last = start_tree_set(prepared), time.perf_counter()
    while not job.done:
        stage = job.stage or "start"
        time.sleep(0.005)
        now = time.perf_counter()
        stages[stage], last = stages.get(stage, 0.0) + now - last, now
    steps = finish_tree_set(prepared, job.result(), "tree", bpy.context.scene)
    return Timed(before, stages, list(_times(steps)))


def longest_pause(tree: Path, quality: float) -> float:
    """Cancel bakes at moments that are spread over the whole job. Return the longest time until a job has ended."""
    whole = bake(tree, quality).job
    open_tree(tree, quality)
    prepared, pauses = prepare(), []
    for number in range(CANCELS):
        job = start_tree_set(prepared)
        time.sleep(whole * (number + 0.5) / CANCELS)
        cancelled = time.perf_counter()
        job.cancel()
        while not job.done:
            time.sleep(0.002)
        pauses.append(time.perf_counter() - cancelled)
    return max(pauses)


def open_tree(tree: Path, quality: float) -> float:
    """Import a tree alone and select it. Return the time on the clock of `time.perf_counter` after it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tree))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.scene.leafcloud.quality = quality
    return time.perf_counter()


def prepare() -> dict[str, Prepared]:
    """Read the selected tree as the button does."""
    wanted = bake_settings(bpy.context.scene.leafcloud)
    with selected_trees(bpy.context) as trees:
        return dict(prepare_tree_set(trees, wanted, layer_of(bpy.context.scene), with_labels))


def _times(steps: Iterable[object]) -> list[float]:
    """Return the seconds of each step of a generator."""
    times, last = [], time.perf_counter()
    for _ in steps:
        now = time.perf_counter()
        times.append(now - last)
        last = now
    return [*times, time.perf_counter() - last]


if __name__ == "__main__":
    main()
