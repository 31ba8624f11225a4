"""Bakes plants of every kind without settings, and measures what one gets: `make bench-defaults`.

usage: make bench-defaults ARGS='[PLANT.glb …]'
       (default: ../shared/foliage up to 10 MB, and all plants of tests/support/plants.py)

FLIP, within four pixels of either silhouette, from 8 views with the project's own renderer, of each level against the
leaves: at the size where the level takes over, at 256² and at 64². Writes docs/bench/defaults.md and defaults.png if no
plant is named.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import matplotlib
import numpy as np
from commits import measured_commit
from fidelity import Pictures, Shown, flip, lines_of, rendered, smaller
from matplotlib import pyplot
from plants import PLANTS, write
from stage import ROOT, bake_alone, measured_trees

import leafcloud
from addon.bake.values import Baked
from addon.plan.camera_visibility import pixels_of
from addon.plan.lod_range import shows_trunk
from addon.settings.bake import BakeSettings

matplotlib.use("Agg")  # Without a display.

SAMPLES = 8
"""Samples along a pixel's side."""
SIZE = 256
LEAST, MOST = 8, 512
"""Limits of the size where a level takes over, for its pictures."""
SUN = (0.7, -0.4, 0.6)
"""Direction to the sun of lit pictures: another one than that by which levels are judged."""
SHOWN = 3
"""The view in the picture: from 20° above the ground."""
BESIDE = 2
"""Plants in a row of the picture."""
DOCUMENT = ROOT / "docs" / "bench" / "defaults.md"

INTRODUCTION = """# Plants of every kind, baked without settings

Made by `make bench-defaults` on {commit}: the measured trees, and the plants of `tests/support/plants.py`. FLIP is that
of each level against the leaves, for impostors with the trunk, within four pixels of either silhouette, from 8 views,
flat-lit.

- *crown*: pixels across the leaves' sphere where the level takes over. *there*: FLIP at this size (at most {most}²).
  *lit*: the same under a sun and a sky, with shadows.
- *error*: the image error in `report.json`, FLIP at 128². *fragments*: over the leaves', where the level takes over.
- *distance*: where the level takes over, in R. *seconds*: of the whole bake.

![Leaves and levels at {size}²](defaults.png)
"""


@dataclass(frozen=True)
class Row:
    """A level of a plant."""

    plant: str
    level: int
    method: str
    billboards: int
    triangles: int
    texels: int
    crown: float
    there: float
    lit: float
    large: float
    small: float
    error: float
    coverage: float
    fragments: float
    distance: float
    seconds: float
    over_cross: float
    """FLIP at 64² of an octahedral impostor over that of the cross impostor; 0 for other levels."""


@dataclass(frozen=True)
class Goal:
    """A target: the figures of level 1 or of later levels, and the limit."""

    name: str
    limit: float
    value: Callable[[Row], float]
    later: bool = False
    judge: Callable[[Iterable[float]], float] = max


GOALS = (
    Goal("FLIP of level 1 where it takes over, flat-lit: most", 0.06, lambda row: row.there),
    Goal("FLIP of level 1 where it takes over, under a sun: most", 0.06, lambda row: row.lit),
    Goal("FLIP of later levels where they take over, flat-lit: most", 0.08, lambda row: row.there, later=True),
    Goal("FLIP of later levels where they take over, under a sun: most", 0.08, lambda row: row.lit, later=True),
    Goal(
        "octahedral impostors: FLIP at 64², over the cross impostor's: most",
        0.5,
        lambda row: row.over_cross,
        later=True,
    ),
    Goal("image error of level 1: mean", 0.07, lambda row: row.error, judge=mean),
    Goal("image error of level 1: most", 0.10, lambda row: row.error),
)


def measure(plant: Path) -> tuple[list[Row], list[Pictures]]:
    """Bake a plant; return a row for each level, and the pictures of the leaves and of each level at `SIZE`²."""
    begin = time.perf_counter()
    baked = bake_alone(plant.resolve(), BakeSettings())
    seconds = time.perf_counter() - begin
    prepared, rows = baked.prepared, []
    pictures = [rendered(prepared.foliage, [prepared.foliage], SIZE, SAMPLES)]
    for number, level in enumerate(baked.chain.levels, start=1):
        trunk = [prepared.trunk] if prepared.trunk is not None and shows_trunk(level) else []
        base = [prepared.foliage, *trunk]
        compared = Compared(prepared.foliage, base, level)
        pictures.append(compared.pictures(SIZE)[1])
        rows.append(row_of(plant.stem, baked, number, compared, seconds))
    return rows, pictures


@dataclass(frozen=True)
class Compared:
    """A level and its base for comparison: the leaves, and for an impostor, which shows the trunk, also the trunk."""

    leaves: leafcloud.Foliage
    base: Sequence[leafcloud.Foliage]
    level: leafcloud.AnyLevel

    @property
    def shown(self) -> Shown:
        return self.level if isinstance(self.level, leafcloud.OctahedralLevel) else [self.level.foliage()]

    def pictures(self, size: int, sun: tuple[float, float, float] | None = None) -> tuple[Pictures, Pictures]:
        """Return pictures of the base and of the level."""
        base, shown = (rendered(self.leaves, each, size, SAMPLES, sun) for each in (self.base, self.shown))
        return base, shown

    @property
    def over_cross(self) -> float:
        """FLIP at 64² of an octahedral impostor over that of the cross impostor; 0 for other levels."""
        if not isinstance(self.level, leafcloud.OctahedralLevel):
            return 0.0
        cross = Compared(self.leaves, self.base, self.level.cross)
        own, its = (flip(*(smaller(each, 4) for each in of.pictures(SIZE))) for of in (self, cross))
        return own / its


def row_of(plant: str, baked: Baked, number: int, compared: Compared, seconds: float) -> Row:
    leaves, level = compared.leaves, compared.level
    scale = pixels_of(1.0, baked.switch_distances[number], baked.view)
    crown = 2.0 * leaves.radius * scale
    pictures = compared.pictures(SIZE)
    there = round(min(max(crown, LEAST), MOST))
    return Row(
        plant=plant,
        level=number,
        method=level.method,
        billboards=len(level.plane_ids) if isinstance(level, leafcloud.Level) else 0,
        triangles=level.triangles + baked.levels[number].trunk_triangles,
        texels=texels_of(level),
        crown=crown,
        there=flip(*compared.pictures(there)),
        lit=flip(*compared.pictures(there, SUN)),
        large=flip(*pictures),
        small=flip(*(smaller(each, 4) for each in pictures)),
        error=level.image_error,
        coverage=level.coverage,
        fragments=fragments_of(compared.shown, scale) / fragments_of([leaves], scale),
        distance=baked.switch_distances[number] / leaves.radius,
        seconds=seconds,
        over_cross=compared.over_cross,
    )


def fragments_of(shown: Shown, scale: float) -> float:
    if isinstance(shown, leafcloud.OctahedralLevel):
        return shown.drawing_cost(scale)["fragments"]
    return leafcloud.drawing_cost(shown, scale)["fragments"]


def texels_of(level: leafcloud.AnyLevel) -> int:
    """Return the texels of the level's page."""
    if isinstance(level, leafcloud.OctahedralLevel):
        return level.texels
    return math.prod(level.base_color.shape[:2]) if isinstance(level, leafcloud.Level) else 0


def goal_table(rows: Sequence[Row]) -> str:
    body = []
    for goal in GOALS:
        values = [goal.value(row) for row in rows if (row.level > 1) == goal.later]
        if values:
            found = goal.judge(values)
            body.append([goal.name, f"≤ {goal.limit:g}", f"{found:.3f}", "met" if found <= goal.limit else "missed"])
    return lines_of(["target", "limit", "found", ""], body)


def table(rows: Sequence[Row]) -> str:
    head = [
        "plant",
        "level",
        "billboards",
        "triangles",
        "texels",
        "crown",
        "there",
        "lit",
        "256²",
        "64²",
        "error",
        "coverage",
    ]
    body = [
        [
            row.plant,
            row.method if row.method in ("cross", "octahedral") else str(row.level),
            f"{row.billboards:,}",
            f"{row.triangles:,}",
            f"{row.texels:,}",
            f"{row.crown:.0f}",
            *(f"{error:.3f}" for error in (row.there, row.lit, row.large, row.small, row.error, row.coverage)),
            f"{row.fragments:.2f}",
            f"{row.distance:.1f}",
            f"{row.seconds:.1f}",
        ]
        for row in rows
    ]
    return lines_of([*head, "fragments", "distance", "seconds"], body)


def contact_sheet(pictures: dict[str, list[Pictures]], path: Path) -> None:
    """Draw the leaves and the levels of each plant."""
    rows, columns = math.ceil(len(pictures) / BESIDE), BESIDE * (1 + max(map(len, pictures.values())))
    figure, axes = pyplot.subplots(rows, columns, figsize=(1.4 * columns, 1.3 * rows), squeeze=False)
    for each in axes.ravel():
        each.set(xticks=[], yticks=[], frame_on=False)
    for row, (plant, levels) in zip(axes.reshape(BESIDE * rows, -1), pictures.items(), strict=False):
        row[0].set_ylabel(plant, fontsize=7)
        for cell, level in zip(row, levels, strict=False):
            light, alpha = level[SHOWN][..., :3], level[SHOWN][..., 3:]
            cell.imshow(np.clip(np.maximum(light + 0.7 * (1.0 - alpha), 0.0) ** (1.0 / 2.2), 0.0, 1.0))
    # The last column of each plant is empty, for the next plant's name.
    figure.subplots_adjust(0.04, 0.0, 1.0, 1.0, 0.02, 0.02)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description="Bake plants of every kind without settings, and measure the levels.")
    parser.add_argument("plants", nargs="*", type=Path, help="GLB files (default: foliage, and plants.py's)")
    options = parser.parse_args()
    rows: list[Row] = []
    pictures: dict[str, list[Pictures]] = {}
    for plant in options.plants or [*measured_trees(), *(write(name, ROOT / "target" / "plants") for name in PLANTS)]:
        found, pictures[plant.stem] = measure(plant)
        rows += found
        print(table(found), file=sys.stderr, flush=True)
    introduction = INTRODUCTION.format(commit=measured_commit(), most=MOST, size=SIZE)
    text = "\n".join([introduction, goal_table(rows), "", table(rows)]) + "\n"
    print(text)
    if not options.plants:
        DOCUMENT.write_text(text, encoding="utf-8")
        contact_sheet(pictures, DOCUMENT.with_suffix(".png"))


if __name__ == "__main__":
    main()
