"""Does each level of the files pass the yardstick at its hand-over, in Cycles? `make bench-handovers`.

usage: make bench-handovers ARGS='[--strips FOLDER] [--bounces 8] [PLANT.glb …]'
       (default: all plants of `bench/scene.py`)

`bake.py` bakes each plant without settings. Each level's file is drawn in Cycles with its trunk, where it takes over,
beside the file of the leaves, and beside the leaves as a breeze moves them (`sway.py`: 0.025 R, at least 1.5 pixels, at
most 0.06 R). Octahedral impostors, for which plain readers draw another level, and crowns of less than 12 pixels are
left out. target/handovers keeps the bakes and a picture of each hand-over: leaves, control, level. Without plants it
writes docs/bench/handovers.md.

--strips: write strips of twelve trees, six of them the level or the control, for a reader who has seen nothing else,
and print the six. --bounces: transparent bounces of Cycles (default: 64, enough for all leaves).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from commits import measured_commit
from fidelity import run
from flat_views import bounding_sphere, rendered, visible_meshes
from looks import Pictures, looks
from pages import opaque
from scene import all_plants
from sections import table
from stage import ROOT, output_in
from strips import TREES, write_strip

import leafcloud

DOCUMENT = ROOT / "docs" / "bench" / "handovers.md"
BAKED = ROOT / "target" / "handovers"
SMALLEST = 12.0
"""Crown in pixels below which levels are not compared."""
SAMPLED, MOST_SAMPLES = 2600, 8
"""Side of pictures in samples, at most; most samples along a pixel's side."""
VIEWS = 4
MARGIN = 1.025
"""Side of a picture, divided by the diameter of the leaves' sphere."""
CONTRAST, COLOR, SMALL, CELLS_FROM = (0.75, 1.15), 0.01, 40.0, 64.0
"""The limits of the yardstick (docs/decisions/quality.md)."""

Row = dict[str, Any]

INTRODUCTION = f"""# Levels of files at their hand-overs, in Cycles

Made by `make bench-handovers` on {{commit}}: levels that a bake without settings writes, with their trunks, beside the
leaves, where they take over; {VIEWS} views, unlit, {{bounces}} transparent bounces. *Crown*: pixels across the leaves.
*Difference*, *places*: over those of the leaves in a light breeze. *Contrast*, *coverage*: over the leaves'. *Excess*:
the worst figure over its limit, and its name. A level passes if it is at most 1.

"""


@dataclass(frozen=True)
class Level:
    """A level of a baked plant. crown: pixels across the leaves where it takes over."""

    plant: str
    number: int
    method: str
    crown: float

    def file(self, number: int | None = None) -> Path:
        return BAKED / self.plant / f"{self.plant}_LOD{self.number if number is None else number}.glb"

    def pictures(self, views: int, bounces: int) -> dict[str, Pictures]:
        """Return pictures of the leaves, of the control and of this level."""
        leaves, move = str(self.file(0)), min(max(0.025, 3.0 / self.crown), 0.06)
        models = {"leaves": leaves, "control": f"{leaves}@sway{move}", "level": str(self.file())}
        with output_in(Path(os.devnull)):
            _, whole = bounding_sphere(visible_meshes(leaves))
            size = round(MARGIN * self.crown * whole / radius_of(self.plant))
            grid = max(2, min(MOST_SAMPLES, SAMPLED // size))
            found = rendered(list(models.values()), size, views, grid, shrink=False, bounces=bounces)
        return {name: found[model] for name, model in models.items()}

    def row(self, pictures: dict[str, Pictures]) -> Row:
        control, level = (looks(pictures["leaves"], pictures[name]) for name in ("control", "level"))
        own = {"difference": level["flip"] / control["flip"], "places": level["cells"] / control["cells"]}
        return {**level, **own}


def report_of(plant: str) -> Row:
    report: Row = json.loads((BAKED / plant / "report.json").read_text())
    return report


def radius_of(plant: str) -> float:
    return float(report_of(plant)["input"]["radius"])


def levels_of(plant: str) -> Iterator[Level]:
    """Yield the levels of a baked plant that are compared."""
    for level in report_of(plant)["levels"][1:]:
        crown = level["drawing"]["crown_pixels"]
        if level["method"] != "octahedral" and crown >= SMALLEST:
            yield Level(plant, level["level"], level["method"], crown)


def excess(row: Row, crown: float) -> tuple[float, str]:
    """Return the largest share of an allowance that a figure uses, and the figure."""
    least, most = CONTRAST
    contrast = max(max((1.0 - each) / (1.0 - least), (each - 1.0) / (most - 1.0)) for each in row["contrast"])
    coverage = abs(row["coverage"] - 1.0) / (0.03 if crown >= SMALL else 0.05)
    places = row["places"] if crown >= CELLS_FROM else 0.0
    used = {"difference": row["difference"], "contrast": contrast, "coverage": coverage, "places": places}
    used["color"] = row["color"] / COLOR
    by = max(used, key=lambda name: used[name])
    return used[by], by


def cells_of(level: Level, row: Row) -> list[str]:
    used, by = excess(row, level.crown)
    contrast = " ".join(f"{each:.2f}" for each in row["contrast"])
    return [
        *(level.plant, str(level.number), level.method, f"{level.crown:.0f}"),
        *(f"{row['difference']:.2f}", f"{row['places']:.2f}", contrast, f"{row['coverage']:.3f}"),
        *(f"{row['color']:.4f}", f"{used:.2f} {by}"),
    ]


def strips_of(level: Level, bounces: int, folder: Path) -> None:
    """Write strips of the control and of a level; print which trees are altered."""
    folder.mkdir(parents=True, exist_ok=True)
    views = {name: [opaque(view) for view in seen] for name, seen in level.pictures(TREES, bounces).items()}
    for name in ("control", "level"):
        path = folder / f"{level.plant}_{level.number}_{name}.png"
        print(path.stem, *write_strip(views["leaves"], views[name], path), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the levels of files with their leaves.")
    parser.add_argument("plants", nargs="*", type=Path, help="GLB files (default: all plants of bench/scene.py)")
    parser.add_argument("--strips", type=Path, metavar="FOLDER", help="only write strips of twelve trees")
    parser.add_argument("--bounces", type=int, default=64, help="transparent bounces (default: 64)")
    given = parser.parse_args()
    names = ("plant", "level", "form", "crown", "difference", "places", "contrast", "coverage", "color", "excess")
    rows, passing = [], 0
    for plant in given.plants or all_plants(BAKED):
        run(sys.executable, ROOT / "bake.py", "--input", plant, "--out", BAKED / plant.stem, "--files", "levels")
        for level in levels_of(plant.stem):
            if given.strips:
                strips_of(level, given.bounces, given.strips)
                continue
            pictures = level.pictures(VIEWS, given.bounces)
            shown = np.hstack([opaque(views[1]) for views in pictures.values()])
            leafcloud.write_png(str(BAKED / f"{plant.stem}_{level.number}.png"), shown)
            row = level.row(pictures)
            rows.append(cells_of(level, row))
            passing += excess(row, level.crown)[0] <= 1.0
            print(*rows[-1], flush=True)
    text = f"{passing} of {len(rows)} levels pass.\n\n{table(names, rows)}"
    if rows and not given.plants:
        head = INTRODUCTION.format(commit=measured_commit(), bounces=given.bounces)
        DOCUMENT.write_text(head + text, encoding="utf-8")
    elif rows:
        print(text)


if __name__ == "__main__":
    main()
