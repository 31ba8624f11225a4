"""Compares the cost of drawing the levels with the cost of drawing the leaves: `make bench-drawing`.

usage: make bench-drawing ARGS='[--no-cycles] [--no-three] [TREE.glb …]'
       (default: all of ../shared/foliage up to 10 MB)

Bakes each tree with default settings for three.js. Counts fragments with `leafcloud.drawing_cost`, for each level at
the distance where it takes over and at crowns of 400, 200, 100 and 50 pixels. Times Cycles and three.js (in Chromium
without a graphics card) on the clouds and the leaves with their trunks, at the same distances, and measures the
coverage of the clouds in three.js. Prints tables in Markdown; for all trees and all parts it also writes
docs/bench/drawing.md.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import bpy
import numpy as np
from browser import ask
from commits import measured_commit
from stage import ROOT, bake_alone, light_up, measured_trees, place, sampling_time, show_only

import leafcloud
from addon.bake.drawing import level_trunks
from addon.bake.values import Baked, TreeSet
from addon.export.files import write
from addon.plan.camera_visibility import pixels_of
from addon.settings.bake import BakeSettings

WRITTEN = ROOT / "target" / "drawing"
HEIGHTS = (400, 200, 100, 50)
"""Heights of a crown in pixels."""

FEW, MANY, SIZE = 2, 10, 400
"""Samples of two renders of a picture of `SIZE`² pixels. Smaller pictures have more samples, as many in all."""
ROUNDS, PATIENCE = 9, 900.0
"""Pictures in three.js, and seconds to wait for them."""
SMALL = 16
"""The picture's side over that of the small picture for the coverage."""
WHOLE = 1024
"""The picture's side for the coverage of the leaves."""

INTRODUCTION = """# What a level costs to draw

Made by `make bench-drawing` on {commit}, with default settings for three.js. Each level is compared with the leaves at
the same distance.

- *Fragments*: counted in quads of 2 × 2 pixels from six sides, backs culled, without an early depth test
  (`rust/core/src/metrics/drawing.rs`). *Crown*: its height in pixels where the level takes over.
- *Before*: fragments over those of the level before, at the same distance.
- *With trunk*: fragments and triangles of leaves and trunk. *Triangles*: with the trunk, and over the tree's.
- *Area*: of all drawn sides, over the leaves'. *Layers*: triangles over a covered pixel.
"""

SPEEDS = f"""
## Speed

Leaves → level, both with their trunks, in a picture that the crown's sphere fills with as many pixels as where the
level takes over. *×*: speed relative to the leaves.

- *Cycles*: a sun and a sky, 1024 transparent bounces, on the processor. Samples per second of processor time, all
  threads together, without scene export and BVH.
- *three.js*: milliseconds per picture, as the viewer draws it, in Chromium *without a graphics card* (SwiftShader
  renders in software, where pixels cost more than on a card, and triangles less). Shortest of {ROUNDS} pictures; leaves
  and level take turns.
- *Coverage*: alpha of the level with its trunk in three.js, with the mip levels of its KTX2, over that of the leaves
  and their trunk at 1024²: at this size, and at a sixteenth of it.
"""


Impostor = leafcloud.OctahedralLevel
"""The cross impostor is measured in its place (`last` of the settings)."""


@dataclass(frozen=True)
class Row:
    """A level and the leaves, compared where the level takes over. All figures but counts are over the leaves'.

    crown: height of the crown in pixels there. before: fragments over those of the level before. with_trunk: fragments
    with trunks. at: fragments at each of `HEIGHTS`. layers: those of the leaves and of the level.
    """

    tree: str
    cards: bool
    level: int
    is_cross: bool
    triangles: int
    triangles_share: float
    crown: float
    fragments: float
    before: float
    with_trunk: float
    area: float
    layers: tuple[float, float]
    at: tuple[float, ...]
    coverage: float


@dataclass(frozen=True)
class Speed:
    """A cloud and the leaves, timed where the cloud takes over; (leaves, cloud) for each figure; None if not measured.

    size: side of the picture in pixels. cycles: samples per second. three: milliseconds per picture. coverage: over the
    leaves' at this size, and at 1/16 of it.
    """

    tree: str
    level: int
    size: int
    cycles: tuple[float, float] | None
    three: tuple[float, float] | None
    coverage: tuple[float, float] | None


@dataclass(frozen=True)
class Request:
    """One request to bench/three/coverage.js, which explains the fields."""

    url: str
    sizes: tuple[tuple[int, int], ...]
    ktx2: bool = False
    mips: bool = True


@dataclass(frozen=True)
class Goal:
    """A target of the issue: the figures that it limits, and the limit."""

    name: str
    limit: float
    values: Callable[[Sequence[Row], Sequence[Speed]], list[float]]
    judge: Callable[[Sequence[float]], float] = max
    at_least: bool = False


def of_level(number: int, value: Callable[[Row], float], *, cards: bool | None = None) -> Callable[..., list[float]]:
    """Return a function from rows to the values of a level, of trees with cards, with modelled leaves, or of all."""

    def values(rows: Sequence[Row], speeds: Sequence[Speed]) -> list[float]:
        of_kind = (row for row in rows if row.level == number and not row.is_cross and cards in (None, row.cards))
        return [value(row) for row in of_kind]

    return values


def timed(value: Callable[[Speed], Sequence[float]]) -> Callable[..., list[float]]:
    """Return a function from rows and speeds to figures of level 1; `value` returns none if they were not measured."""

    def values(rows: Sequence[Row], speeds: Sequence[Speed]) -> list[float]:
        return [figure for speed in speeds if speed.level == 1 for figure in value(speed)]

    return values


def times_faster(samples: tuple[float, float] | None) -> list[float]:
    """Return the level's speed over the leaves', from (leaves, level) in pieces of work per second."""
    return [] if samples is None else [samples[1] / samples[0]]


def times_shorter(milliseconds: tuple[float, float] | None) -> list[float]:
    return [] if milliseconds is None else [milliseconds[0] / milliseconds[1]]


GOALS = (
    Goal("fragments of level 1, cards: mean", 0.55, of_level(1, lambda row: row.fragments, cards=True), mean),
    Goal("fragments of level 1, cards: most", 0.8, of_level(1, lambda row: row.fragments, cards=True)),
    Goal("fragments of level 1, modelled leaves: most", 1.1, of_level(1, lambda row: row.fragments, cards=False)),
    Goal("triangles of level 1, modelled leaves: most", 0.1, of_level(1, lambda row: row.triangles_share, cards=False)),
    Goal("fragments of level 2 over level 1: most", 0.6, of_level(2, lambda row: row.before)),
    Goal("triangles of level 1 with trunk over the tree's: most", 0.15, of_level(1, lambda row: row.triangles_share)),
    Goal("triangles of level 1 with trunk: most", 3000, of_level(1, lambda row: row.triangles)),
    Goal("coverage of level 1: least", 0.985, of_level(1, lambda row: row.coverage), min, True),
    Goal("coverage of level 1: most", 1.015, of_level(1, lambda row: row.coverage)),
    Goal("coverage in three.js at 1/16: least", 0.985, timed(lambda speed: (speed.coverage or ())[1:]), min, True),
    Goal("coverage in three.js at 1/16: most", 1.015, timed(lambda speed: (speed.coverage or ())[1:])),
    Goal("Cycles, level 1, ×: mean", 1.5, timed(lambda speed: times_faster(speed.cycles)), mean, True),
    Goal("Cycles, level 1, ×: least", 1.0, timed(lambda speed: times_faster(speed.cycles)), min, True),
    Goal("three.js, level 1, ×: mean", 1.5, timed(lambda speed: times_shorter(speed.three)), mean, True),
    Goal("three.js, level 1, ×: least", 1.0, timed(lambda speed: times_shorter(speed.three)), min, True),
)


def fragment_rows(tree: Path, baked: Baked) -> list[Row]:
    """Return a row for each level."""
    leaves, trunks = baked.prepared.foliage, level_trunks(baked)
    drawn = [leaves, *(level.foliage() for level in baked.chain.levels if not isinstance(level, Impostor))]
    whole = [[part] if trunk is None else [part, trunk] for part, trunk in zip(drawn, trunks, strict=True)]
    height = crown_height(baked)

    def row(number: int, level: leafcloud.AnyLevel) -> Row:
        scale = pixels_of(1.0, baked.switch_distances[number], baked.view)
        own, all_leaves = (leafcloud.drawing_cost([part], scale) for part in (drawn[number], leaves))
        own_whole, whole_tree = (leafcloud.drawing_cost(parts, scale) for parts in (whole[number], whole[0]))
        before = leafcloud.drawing_cost([drawn[number - 1]], scale)
        return Row(
            tree=tree.stem,
            cards=has_cards(tree),
            level=number,
            is_cross=level.method == "cross",
            triangles=own_whole["triangles"],
            triangles_share=own_whole["triangles"] / whole_tree["triangles"],
            crown=height * scale,
            fragments=own["fragments"] / all_leaves["fragments"],
            before=own["fragments"] / before["fragments"],
            with_trunk=own_whole["fragments"] / whole_tree["fragments"],
            area=own["area"] / all_leaves["area"],
            layers=(all_leaves["layers"], own["layers"]),
            at=tuple(over_leaves(drawn[number], leaves, pixels / height) for pixels in HEIGHTS),
            coverage=level.coverage,
        )

    return [row(number, level) for number, level in enumerate(baked.chain.levels, start=1)]


def speeds_of(tree: Path, baked: Baked, *, cycles: bool, three: bool) -> list[Speed]:
    """Time each cloud and the leaves where the cloud takes over."""
    numbers = [number for number, level in enumerate(baked.chain.levels, start=1) if level.method != "cross"]
    pictures = {number: Picture.of(baked, number) for number in numbers}
    shown = in_three(baked, pictures) if three else {}
    camera = light_up(SIZE, MANY) if cycles else None
    return [
        Speed(
            tree.stem,
            number,
            picture.size,
            None
            if camera is None
            else (in_cycles(baked, camera, 0, picture), in_cycles(baked, camera, number, picture)),
            *shown.get(number, (None, None)),
        )
        for number, picture in pictures.items()
    ]


@dataclass(frozen=True)
class Picture:
    """A picture that the crown's sphere fills as it appears where a level takes over.

    size: side in pixels. distance: of the camera in crown radii. field_of_view: in radians.
    """

    size: int
    distance: float
    field_of_view: float

    @staticmethod
    def of(baked: Baked, number: int) -> Picture:
        view, radius = baked.view, baked.prepared.foliage.radius
        away = baked.switch_distances[number]
        size = max(round(pixels_of(2.0 * radius, away, view)), SMALL)
        angle = 2.0 * math.atan(math.tan(view.field_of_view / 2.0) * size / view.resolution)
        return Picture(size, away / radius, angle)


def in_cycles(baked: Baked, camera: bpy.types.Object, number: int, picture: Picture) -> float:
    """Return the samples per second of a level with its trunk."""
    show_only(baked, number)
    place(baked, camera, picture.distance, picture.field_of_view)
    render_settings = bpy.context.scene.render
    render_settings.resolution_x = render_settings.resolution_y = picture.size
    more = max(round((SIZE / picture.size) ** 2), 1)
    few, many = FEW * more, MANY * more
    return picture.size**2 * (many - few) / sampling_time(few, many)


def in_three(
    baked: Baked, pictures: Mapping[int, Picture]
) -> dict[int, tuple[tuple[float, float], tuple[float, float]]]:
    """Return for each level the milliseconds of leaves and level in three.js, and the level's coverage."""
    name, folder = baked.collection.name, WRITTEN / baked.collection.name
    write(TreeSet.of(baked), folder, lambda stage, fraction: None, blend=False)
    base = f"/{folder.relative_to(ROOT).as_posix()}/{name}"
    found = {}
    for number, picture in pictures.items():
        question = {"tree": f"{base}.glb", "size": picture.size, "distance": picture.distance, "rounds": ROUNDS}
        question |= {"fieldOfView": math.degrees(picture.field_of_view), "cases": [0, number]}
        leaves, level = map(min, ask("bench/three/speed.html", question, patience=PATIENCE)["times"])
        sizes = ((picture.size, 2), (picture.size // SMALL, 8))
        # Mip levels would thin out the leaves' own textures.
        of_leaves = Request(f"{base}_LOD0.glb", ((WHOLE, 1),), mips=False)
        [whole], [own, small] = coverages(of_leaves, Request(f"{base}_LOD{number}.glb", sizes, ktx2=True))
        found[number] = ((leaves, level), (own / whole, small / whole))
    return found


def coverages(*requests: Request) -> list[list[float]]:
    """Return the coverage of each model in three.js at each of its sizes, the mean over the page's views."""
    answer = ask("bench/three/coverage.html", [vars(request) for request in requests], patience=PATIENCE)
    return [[mean(views) for views in sizes] for sizes in answer["coverages"]]


def over_leaves(level: leafcloud.Foliage, leaves: leafcloud.Foliage, scale: float) -> float:
    """Return the fragments of a level over those of the leaves."""
    own, all_leaves = (leafcloud.drawing_cost([part], scale)["fragments"] for part in (level, leaves))
    return own / all_leaves


def crown_height(baked: Baked) -> float:
    """Return the height of the leaves in world units."""
    tree = baked.prepared.tree
    used = tree.leaves.positions[np.unique(tree.leaves.triangles)]
    return float(np.ptp(used @ tree.matrix[2, :3]))


def has_cards(tree: Path) -> bool:
    """Return whether the leaves are cards: the file has a material with a texture and with alpha."""
    data = tree.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    materials = json.loads(data[20 : 20 + length]).get("materials", [])
    textured = [each for each in materials if "baseColorTexture" in each.get("pbrMetallicRoughness", {})]
    return any(each.get("alphaMode", "OPAQUE") != "OPAQUE" for each in textured)


def fragment_table(rows: Sequence[Row]) -> list[str]:
    heights = ", ".join(map(str, HEIGHTS))
    header = ("tree", "leaves", "level", "triangles", "×", "crown", "fragments", "before", "with trunk")
    lines = table_head(*header, f"fragments at {heights} px", "area", "layers", "coverage")
    for row in rows:
        at = ", ".join(f"{share:.2f}" for share in row.at)
        cells = (
            row.tree,
            "cards" if row.cards else "modelled",
            "cross" if row.is_cross else str(row.level),
            f"{row.triangles:,}",
            f"{row.triangles_share:.2f}",
            f"{row.crown:.0f}",
            *(f"{share:.2f}" for share in (row.fragments, row.before, row.with_trunk)),
            at,
            f"{row.area:.2f}",
            " → ".join(f"{layers:.1f}" for layers in row.layers),
            f"{row.coverage:.3f}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def speed_table(speeds: Sequence[Speed]) -> list[str]:
    def pair(values: tuple[float, float] | None, times: list[float], digits: int) -> str:
        if values is None:
            return "– | –"
        return f"{values[0]:,.{digits}f} → {values[1]:,.{digits}f} | {times[0]:.2f}"

    lines = table_head("tree", "level", "picture", "Cycles", "×", "three.js, ms", "×", "coverage, at 1/16")
    for each in speeds:
        cycles, three = (
            pair(each.cycles, times_faster(each.cycles), 0),
            pair(each.three, times_shorter(each.three), 1),
        )
        coverage = "–" if each.coverage is None else ", ".join(f"{share:.3f}" for share in each.coverage)
        lines.append(f"| {each.tree} | {each.level} | {each.size}² | {cycles} | {three} | {coverage} |")
    return lines


def goal_table(rows: Sequence[Row], speeds: Sequence[Speed]) -> list[str]:
    lines = table_head("target", "limit", "found", "")
    for goal in GOALS:
        if values := goal.values(rows, speeds):
            found = goal.judge(values)
            met = found >= goal.limit if goal.at_least else found <= goal.limit
            sign = "≥" if goal.at_least else "≤"
            lines.append(f"| {goal.name} | {sign} {goal.limit:g} | {found:.4g} | {'met' if met else 'missed'} |")
    return lines


def table_head(*names: str) -> list[str]:
    return ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the cost of drawing the levels with that of the leaves.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: all of ../shared/foliage up to 10 MB)")
    parser.add_argument("--no-cycles", action="store_true", help="do not time Cycles")
    parser.add_argument("--no-three", action="store_true", help="do not time three.js")
    options = parser.parse_args()
    parts = {"cycles": not options.no_cycles, "three": not options.no_three}
    rows: list[Row] = []
    speeds: list[Speed] = []
    for tree in options.trees or measured_trees():
        baked = bake_alone(tree.resolve(), BakeSettings(engine="three", last="cross", files="levels"))
        rows += fragment_rows(tree, baked)
        speeds += speeds_of(tree, baked, **parts)
        print(fragment_table(rows)[-1], speed_table(speeds)[-1], sep="\n", file=sys.stderr, flush=True)
    introduction = INTRODUCTION.format(commit=measured_commit())
    text = "\n".join([introduction, *goal_table(rows, speeds), "", *fragment_table(rows)]) + "\n"
    text += "\n".join([SPEEDS, *speed_table(speeds)]) + "\n" if any(parts.values()) else ""
    print(text)
    if not options.trees and all(parts.values()):
        (ROOT / "docs" / "bench" / "drawing.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
