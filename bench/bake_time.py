"""Times bakes as whole processes, and by the button of the interface, step by step: `make bench-bake-time`.

usage: make bench-bake-time ARGS='[--repeats COUNT] [TREE.glb …]'      (default: the measured trees)

First `bake.py`: seconds and memory of processes, beside the literal Algorithm 1 as the clock of the machine. Then the
button: for each tree and each quality, seconds on the main thread before the job, of the job, of each of its stages,
and on the main thread after it; of the longest step after it; from a cancel to the end of the job. Prints tables in
Markdown; for the measured trees it also writes docs/bench/bake_time.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from commits import measured_commit
from stage import FOLIAGE, ROOT, measured_trees

import addon
from addon.bake.pipeline import layer_of
from addon.bake.tree_set import finish_tree_set, prepare_tree_set, start_tree_set
from addon.bake.values import Prepared
from addon.steps import all_steps
from addon.ui.draft import prepared_draft
from addon.ui.properties import bake_settings, with_labels
from addon.ui.selection import selected_trees

QUALITIES = {"Fast": 0.0, "default": 0.5}
SHOWN = ("simplify", "fit", "measure", "pack", "tune", "bake")
"""Stages with a column of their own."""

WAYS = {"generic": (), "three": ("--engine", "three"), "godot": ("--engine", "godot"), "rough": ("--quality", "0.2")}
"""Flags of the timed processes."""

INTRODUCTION = """# Time of a bake

Made by `make bench-bake-time` at {commit} on {cores} cores.

## The command line

Seconds of a whole process of `bake.py`, and its greatest memory in MB: medians of {repeats}. *Told*: the least share of
them that the stages in the report add up to. *Clock*: seconds of
[Algorithm 1](../accuracy.md#the-papers-points), done literally on one thread for the leaves of an ash, beside each
tree: machines differ, and so do their hours.

{processes}

## The button

After the import of each tree, without a window. Seconds.

- *draft*: from the button to the draft; *nan* for a tree without one.
- *before*, *after*: on the main thread, before and after the core's job; *longest*: the longest of the steps after
  it, between which the interface draws.
- *job*: of the core and of judging its levels; then those of its stages.
- *pause*: the longest time from a cancel to the end of the job, of {cancels} cancels spread over the job.
"""
CANCELS = 6


@dataclass(frozen=True)
class Timed:
    """Seconds of one bake: to the draft, before the job, of its stages by name, of the steps after it."""

    draft: float
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
    parser.add_argument("--repeats", type=int, default=5, metavar="COUNT")
    arguments = parser.parse_args()
    given = arguments.trees
    trees = given or measured_trees()
    addon.register()
    processes = process_table(trees if given else [*trees, FOLIAGE / "maple_1m.glb"], arguments.repeats)
    print(processes)
    headings = ("tree", "quality", "draft", "total", "before", "job", *SHOWN, "after", "longest", "pause")
    rows = [headings, tuple("---" for _ in headings)]
    for tree in trees:
        for name, quality in QUALITIES.items():
            timed, pause = bake(tree, quality), longest_pause(tree, quality)
            stages = (timed.stages.get(stage, 0.0) for stage in SHOWN)
            figures = (
                timed.draft,
                timed.total,
                timed.before,
                timed.job,
                *stages,
                sum(timed.after),
                max(timed.after),
                pause,
            )
            rows.append((tree.stem, name, *(f"{figure:.2f}" for figure in figures)))
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    print(table)
    if not given:
        cores = len(os.sched_getaffinity(0))
        text = INTRODUCTION.format(
            commit=measured_commit(), cores=cores, cancels=CANCELS, repeats=arguments.repeats, processes=processes
        )
        (ROOT / "docs" / "bench" / "bake_time.md").write_text(f"{text}\n{table}\n", encoding="utf-8")


def process_table(trees: Iterable[Path], repeats: int) -> str:
    """Return a table of the processes' seconds, of their share that the report tells, and of their memory."""
    rows: list[tuple[str, ...]] = [("tree", "clock", *WAYS, "told", "MB"), ("---",) * (len(WAYS) + 4)]
    with tempfile.TemporaryDirectory() as folder:
        clock = Clock(Path(folder))
        for tree in trees:
            ticks, found = [], []
            for _ in range(repeats):
                ticks.append(clock.tick())
                found.append([process(tree, Path(folder) / "out", flags) for flags in WAYS.values()])
            seconds = np.median([[second for second, *_ in each] for each in found], axis=0)
            told = min(of_stages / second for each in found for second, of_stages, _ in each)
            memory = max(peak for each in found for *_, peak in each)
            cells = (statistics.median(ticks), *seconds.tolist())
            rows.append((tree.stem, *(f"{cell:.1f}" for cell in cells), f"{told:.1%}", f"{memory:.0f}"))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def process(tree: Path, out: Path, flags: Iterable[str]) -> tuple[float, float, float]:
    """Bake a tree by the command line. Return its seconds, those in its report, and the greatest memory in MB."""
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out), *flags]
    begin = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as bake:
        peak = 0.0
        while bake.poll() is None:
            time.sleep(0.02)
            peak = max(peak, _resident(bake.pid))
    seconds = time.perf_counter() - begin
    assert bake.returncode == 0, f"a bake of {tree.name} failed"
    told = json.loads((out / "report.json").read_text(encoding="utf-8"))["seconds"]
    return seconds, sum(told.values()), peak


def _resident(process: int) -> float:
    """Return the memory in MB of the greatest process among a process and its children."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split()
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    except OSError:  # It has ended.
        return 0.0
    own = next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")), 0)
    return max([own * 1024e-6, *(_resident(int(child)) for child in children)])


class Clock:
    """The literal Algorithm 1 of ../shared/measure, compiled: its seconds tell how fast the machine is at the time."""

    def __init__(self, folder: Path) -> None:
        self.program, self.soup = folder / "alg1", folder / "soup"
        source = ROOT.parent / "shared" / "measure" / "alg1.rs"
        subprocess.run(["rustc", "-O", "-C", "target-cpu=native", "-o", self.program, source], check=True)
        open_tree(FOLIAGE / "bush_ash_5k.glb", 0.5)
        leaves = bpy.data.objects["leaves"]
        leaves.data.calc_loop_triangles()
        points = np.array([tuple(vertex.co) for vertex in leaves.data.vertices], np.float32)
        points[[each.vertices[:] for each in leaves.data.loop_triangles]].tofile(self.soup)

    def tick(self) -> float:
        """Return the seconds of a run."""
        begin = time.perf_counter()
        subprocess.run([self.program, self.soup, "0.04", "600", "1"], check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter() - begin


def bake(tree: Path, quality: float) -> Timed:
    """Bake a tree as the button does, and time it."""
    draft = draft_time(tree, quality)
    begin = open_tree(tree, quality)
    prepared, _ = prepare()
    before = time.perf_counter() - begin
    stages: dict[str, float] = {}
    job, last = start_tree_set(prepared), time.perf_counter()
    while not job.done:
        stage = job.stage or "start"
        time.sleep(0.005)
        now = time.perf_counter()
        stages[stage], last = stages.get(stage, 0.0) + now - last, now
    steps = finish_tree_set(prepared, job.result(), "tree", bpy.context.scene)
    return Timed(draft, before, stages, list(_times(steps)))


def draft_time(tree: Path, quality: float) -> float:
    """Return the seconds from the button to the draft."""
    begin = open_tree(tree, quality)
    prepared, drafted = prepare()
    job = start_tree_set(prepared, drafted)
    while job.drafts is None:
        time.sleep(0.002)
    if job.drafts:
        all_steps(finish_tree_set(drafted, job.drafts, "draft", bpy.context.scene))
    seconds = time.perf_counter() - begin if job.drafts else math.nan
    job.cancel()
    while not job.done:
        time.sleep(0.002)
    return seconds


def longest_pause(tree: Path, quality: float) -> float:
    """Cancel bakes at moments that are spread over the whole job. Return the longest time until a job has ended."""
    whole = bake(tree, quality).job
    open_tree(tree, quality)
    (prepared, _), pauses = prepare(), []
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


def prepare() -> tuple[dict[str, Prepared], dict[str, Prepared]]:
    """Read the selected tree as the button does, for the levels and for the draft."""
    wanted, layer = bake_settings(bpy.context.scene.leafcloud), layer_of(bpy.context.scene)
    with selected_trees(bpy.context) as trees:
        return (
            prepare_tree_set(trees, wanted, layer, with_labels),
            prepared_draft(trees, wanted),
        )


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
