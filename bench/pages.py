"""Compares level 1 of the files with the leaves, with the page that the files hold: `make bench-pages`.

usage: make bench-pages ARGS='[--label NAME] [--engines] [--strips FOLDER] [TREE.glb …]'
       (default: foliage of up to 200,000 triangles)

Each tree is baked for three hand-overs. Level 1 is drawn at its hand-over in Cycles, beside the leaves, the leaves as
a breeze moves them (`sway.py`), and the leaves at the end of their morph; then by the project's own renderer, as an
engine reads the PNG (`read_pages.py`). Bytes are those of the files, seconds those of the bake.

--engines: only draw both levels in three.js, with and without multisampling. --strips: only write strips of twelve
trees, six of them level 1 or the control, for a reader who has seen nothing else, and print the six. target/pages has a
picture of each hand-over: leaves, control, level 1, leaves at the end of their morph.

A tree takes some minutes. Its results go into docs/bench/pages.json immediately, under the label and with the measured
commit; docs/bench/pages.md shows all labels beside one another.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import numpy as np
from commits import measured_commit
from engine_views import hand_overs, levels_of, sphere_of
from fidelity import FOLIAGE, ROOT, TREE_LIMIT, premultiplied, run, triangles
from flat_views import bounding_sphere, directions, rendered, visible_meshes
from looks import Pictures, encoded, looks, over_sky
from read_pages import Surface, image_bytes, surfaces_of
from sections import table
from stage import output_in
from strips import TREES, write_strip

import leafcloud
from engines import View, coverage, drawn

MEASURED = ROOT / "docs" / "bench" / "pages.json"
BAKED = ROOT / "target" / "pages"
EPSILON = 0.04
GRIDS = {540: 2, 216: 6, 54: 8}
"""Crown's diameter in pixels at the hand-over, and samples along a pixel's side in Cycles."""
GOAL = 216
"""The hand-over of the goals."""
MARGIN = 1.025
"""Side of a picture, divided by the diameter of the leaves' sphere."""
VIEWS = 4
PARTS = (1, 2, 4)
"""The hand-over, and how many times as far pages are read."""
SAMPLES = 8, 4
"""Samples along a pixel's side: of the leaves without mip levels, and of the places where coverage is read."""
STAGES = ("fit", "pack", "bake", "look", "refine", "write")

Row = dict[str, Any]

INTRODUCTION = f"""# Pages in files

Made by `make bench-pages`: level 1 at ε = {EPSILON} R against the leaves, as a reader without extensions draws the GLB
file, {VIEWS} views, unlit. *Crown*: pixels across the leaves' sphere where the level takes over.

## Goals

Level 1 over the control at {GOAL} pixels: mean ≤ 0.75, on every tree ≤ 0.9. Contrast 0.75 to 1.15. Jump ≤ 0.5. Coverage
as read at the hand-over 0.97 to 1.03, at half and a quarter of it 0.93 to 1.07.
"""
CYCLES = """\
## In Cycles

The whole tree. *Control*: FLIP between the leaves and the leaves moved by a light breeze, 0.025 R. *Level 1*: its FLIP
over the control's. *Jump*: FLIP between the leaves at the end of their morph and level 1, over the control's.
*Contrast*: of the finest three octaves inside the crown, over the leaves'. *Cells*: error of the covered share of
16 × 16 cells. *Color*: largest difference of a channel's mean code.
"""
READ = """\
## As engines read the PNG

Without the trunk, by the project's own renderer: one sample a pixel, box-filtered mip levels, at the hand-over, half
and a quarter of its size. The base are leaves with 8 × 8 samples a pixel and without mip levels. Coverage is the mean
of 4 × 4 places of the sample.
"""
FILES = """\
## Bytes

*Memory*: of the base color with its mip levels; *KTX2*: the same in the file for three.js. *Level*, *tree*: GLB files
of level 1 and of all levels, every texture included.
"""
SECONDS = """\
## Seconds

Seconds of level 1 by stage, as the report has them, and of the processor for the whole `bake.py`; the second of two
numbers is `--engine three`.
"""
ENGINES = f"""\
## In three.js

Coverage of level 1 over level 0 from the same places, by the package with KTX2: at the hand-over at {GOAL} pixels, half
and a quarter of its size.
"""


def bake(tree: Path, crown: int, engine: str, label: str) -> Path:
    """Bake level 1 for a hand-over; return the file of all levels. The folder keeps the processor's seconds."""
    out = BAKED / label / f"{tree.stem}_{crown}_{engine}"
    # The error bound appears so many pixels large where the crown's diameter, 2 R, has `crown`.
    pixels = EPSILON * crown / 2.0
    level = ("--epsilon", EPSILON, "--pixels", pixels, "--levels", 1, "--no-cross", "--every-level")
    before = processor_seconds()
    run(
        sys.executable, ROOT / "bake.py", "--input", tree, "--out", out, "--engine", engine, *level, "--files", "levels"
    )
    (out / "seconds").write_text(str(processor_seconds() - before))
    taken_over = level_1(out)["drawing"]["crown_pixels"]
    if abs(taken_over / crown - 1.0) > 0.01:
        raise SystemExit(f"{tree.stem}: level 1 takes over at {taken_over:.0f} pixels instead of {crown}")
    return out / f"{tree.stem}.glb"


def processor_seconds() -> float:
    """Return the processor time of all finished child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def level_1(folder: Path) -> Row:
    row: Row = json.loads((folder / "report.json").read_text())["levels"][1]
    return row


def radius_of(file: Path) -> float:
    return sphere_of(levels_of(file)[0])[1]


def models_of(file: Path) -> dict[str, str]:
    """Return the models that Cycles draws, by name."""
    leaves, level = (str(file.with_name(f"{file.stem}_LOD{number}.glb")) for number in (0, 1))
    return {"leaves": leaves, "control": f"{leaves}@sway", "level": level, "morphed": f"{leaves}@1"}


def in_cycles(models: dict[str, str], crown: int, radius: float, views: int) -> dict[str, Pictures]:
    """Render models in pictures where the leaves' sphere of this radius has the diameter `crown`."""
    with output_in(Path(os.devnull)):
        _, whole = bounding_sphere(visible_meshes(models["leaves"]))
        size = round(MARGIN * crown * whole / radius)
        found = rendered(list(models.values()), size, views, GRIDS[crown], shrink=False)
    return {name: found[model] for name, model in models.items()}


def cycles_row(pictures: dict[str, Pictures]) -> Row:
    leaves = pictures["leaves"]
    control = looks(leaves, pictures["control"])["flip"]
    level, jump = looks(leaves, pictures["level"]), looks(pictures["level"], pictures["morphed"])
    return {**level, "control": control, "level": level["flip"] / control, "jump": jump["flip"] / control}


def read_row(file: Path, crown: int) -> Row:
    """Compare the level with the leaves as an engine reads them, at parts of the hand-over's size."""
    centre, radius = sphere_of(levels_of(file)[0])
    frame: dict[str, Any] = {"centre": (centre[0], -centre[2], centre[1]), "radius": MARGIN * radius, "filtered": False}
    leaves, level = (surfaces_of(file, f"{file.stem}_LOD{number}") for number in (0, 1))

    def pictures(surfaces: list[Surface], size: int, samples: int, *, mips: bool = True) -> Pictures:
        pixel = 2.0 * MARGIN * radius / size if mips else 1e-9
        eyes = [tuple(direction) for direction in directions(VIEWS)]
        seen = [[part for each in surfaces for part in each.read(eye, pixel)] for eye in eyes]
        views = zip(seen, eyes, strict=True)
        return premultiplied([leafcloud.render(parts, eye, size, samples=samples, **frame) for parts, eye in views])

    row: Row = {"coverage": [], "flip": [], "leaves": []}
    for part in PARTS:
        size = round(MARGIN * crown / part)
        base = pictures(leaves, size, SAMPLES[0], mips=False)
        row["coverage"].append(looks(base, pictures(level, size, SAMPLES[1]))["coverage"])
        row["flip"].append(looks(base, pictures(level, size, 1))["flip"])
        row["leaves"].append(looks(base, pictures(leaves, size, 1))["flip"])
    return row


def file_row(plain: Path, three: Path | None) -> Row:
    """Return sides, cutoff and bytes of the page of level 1, and the bytes of the files."""
    material = levels_of(plain)[1].primitives[0].material
    png = image_bytes(plain, material)
    assert png is not None
    sides = struct.unpack_from(">II", png, 16)
    row: Row = {
        "sides": sides,
        "cutoff": material.get("alphaCutoff", 0.5),
        "png": len(png),
        "memory": gpu_bytes(sides, 4),
        "level": plain.with_name(f"{plain.stem}_LOD1.glb").stat().st_size,
        "tree": plain.stat().st_size,
    }
    if three is not None:
        ktx2 = image_bytes(three, levels_of(three)[1].primitives[0].material, "KHR_texture_basisu")
        assert ktx2 is not None
        row["ktx2"] = gpu_bytes(struct.unpack_from("<II", ktx2, 20), 1)
    return row


def gpu_bytes(sides: Sequence[int], texel: int) -> float:
    """Return the bytes of a texture with its mip levels."""
    return 4.0 / 3.0 * texel * sides[0] * sides[1]


def seconds_row(folder: Path) -> Row:
    return {**level_1(folder)["seconds"], "processor": float((folder / "seconds").read_text())}


def three_row(file: Path, *, multisampled: bool) -> list[float]:
    """Return the coverage of level 1 over that of level 0 in three.js, at parts of the hand-over's size."""
    levels = levels_of(file)
    found = []
    for part in PARTS:
        view = View.of(part * hand_overs(levels)[0], levels[0]).in_more_turns(levels[0])
        before, after = (drawn("three", file, view, samples=multisampled, level=number) for number in (0, 1))
        found.append(coverage(after) / coverage(before))
    return found


def measure_in_three(tree: Path, label: str) -> Row:
    file = bake(tree, GOAL, "three", label)
    return {"three": [three_row(file, multisampled=smooth) for smooth in (False, True)]}


def measure(tree: Path, label: str) -> Row:
    return {"crowns": {str(crown): hand_over_row(tree, crown, label) for crown in GRIDS}}


def hand_over_row(tree: Path, crown: int, label: str) -> Row:
    plain = bake(tree, crown, "generic", label)
    three = bake(tree, crown, "three", label) if crown == GOAL else None
    pictures = in_cycles(models_of(plain), crown, radius_of(plain), VIEWS)
    show(pictures, plain.parent.with_suffix(".png"))
    return {
        "cycles": cycles_row(pictures),
        "read": read_row(plain, crown),
        "files": file_row(plain, three),
        "seconds": {file.parent.name.rpartition("_")[2]: seconds_row(file.parent) for file in (plain, three) if file},
    }


def show(pictures: dict[str, Pictures], path: Path) -> None:
    """Write the second view of each model, side by side."""
    leafcloud.write_png(str(path), np.hstack([opaque(views[1]) for views in pictures.values()]))


def opaque(picture: Pictures) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return a picture on the sky as codes."""
    codes = np.rint(255.0 * over_sky(encoded(picture))).astype(np.uint8)
    return np.dstack([codes, np.full(codes.shape[:2], 255, np.uint8)])


def write_strips(tree: Path, label: str, folder: Path) -> None:
    """Write a strip of leaves and level 1 and one of leaves and control, at GOAL pixels; print the altered places."""
    file = bake(tree, GOAL, "generic", label)
    models = models_of(file)
    del models["morphed"]
    pictures = in_cycles(models, GOAL, radius_of(file), TREES)
    folder.mkdir(parents=True, exist_ok=True)
    views = {name: [opaque(view) for view in seen] for name, seen in pictures.items()}
    for name in ("control", "level"):
        print(tree.stem, name, *write_strip(views["leaves"], views[name], folder / f"{tree.stem}_{name}.png"))


def cells_of(*values: float | Sequence[float], places: int = 2) -> list[str]:
    """Return a cell for each value; several numbers share a cell."""
    lists = ([value] if isinstance(value, (int, float)) else value for value in values)
    return [", ".join(f"{each:,.{places}f}" for each in value) for value in lists]


def cycles_cells(row: Row) -> list[str]:
    cycles = row["cycles"]
    rest = cells_of(*(cycles[name] for name in ("level", "jump", "coverage", "contrast")))
    return [*cells_of(cycles["control"], places=3), *rest, *cells_of(cycles["cells"], cycles["color"], places=3)]


def read_cells(row: Row) -> list[str]:
    read = row["read"]
    return [*cells_of(read["coverage"]), *cells_of(read["flip"], read["leaves"], places=3)]


def file_cells(row: Row) -> list[str]:
    files = row["files"]
    kilobytes = [[files[name] / 1e3] if name in files else [] for name in ("png", "memory", "ktx2", "level", "tree")]
    return [" × ".join(map(str, files["sides"])), *cells_of(files["cutoff"]), *cells_of(*kilobytes, places=0)]


def seconds_cells(row: Row) -> list[str]:
    seconds = row["seconds"].values()
    return cells_of(*([each[name] for each in seconds] for name in (*STAGES, "processor")), places=1)


SECTIONS: tuple[tuple[str, tuple[str, ...], Callable[[Row], list[str]]], ...] = (
    (CYCLES, ("control", "level 1", "jump", "coverage", "contrast", "cells", "color"), cycles_cells),
    (READ, ("coverage", "FLIP", "FLIP of the leaves"), read_cells),
    (FILES, ("page", "cutoff", "PNG, kB", "memory, kB", "KTX2, kB", "level, kB", "tree, kB"), file_cells),
    (SECONDS, (*STAGES, "processor"), seconds_cells),
)


def document(rows: Sequence[Row]) -> str:
    """Return the document: each tree and hand-over in a row for each label."""
    by_tree = sorted(rows, key=lambda row: row["tree"])
    flat = [(row, crown) for row in by_tree for crown in row.get("crowns", ())]
    flat.sort(key=lambda each: (each[0]["tree"], -int(each[1])))
    parts = [INTRODUCTION, table(("label", "commits", "level 1", "jump"), list(goal_rows(rows)))]
    for text, names, cells in SECTIONS:
        body = [[row["tree"], crown, row["label"], *cells(row["crowns"][crown])] for row, crown in flat]
        parts += [text, table(("tree", "crown", "label", *names), body)]
    three = [[row["tree"], row["label"], *cells_of(*row["three"])] for row in by_tree if "three" in row]
    if three:
        parts += [ENGINES, table(("tree", "label", "one sample a pixel", "multisampling"), three)]
    return "\n".join(parts)


def goal_rows(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Yield for each label the mean and the largest of level 1 and of the jump at GOAL pixels."""
    baked = [row for row in rows if "crowns" in row]
    for label in dict.fromkeys(row["label"] for row in baked):
        own = [row for row in baked if row["label"] == label]
        found = [row["crowns"][str(GOAL)]["cycles"] for row in own]
        figures = ([each[name] for each in found] for name in ("level", "jump"))
        commits = ", ".join(dict.fromkeys(row["commit"] for row in own))
        yield [label, commits, *(f"mean {mean(each):.2f}, most {max(each):.2f}" for each in figures)]


def keep(row: Row) -> str:
    """Keep a tree's results, in place of the same ones under the same label; return the document."""
    kept = json.loads(MEASURED.read_text()) if MEASURED.is_file() else []
    found = {(each["tree"], each["label"]): each for each in kept}
    key = (row["tree"], row["label"])
    found[key] = {**found.get(key, {}), **row}
    rows = list(found.values())
    MEASURED.write_text(json.dumps(rows, indent=1) + "\n")
    text = document(rows)
    MEASURED.with_suffix(".md").write_text(text, encoding="utf-8")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare level 1 of the files with the leaves.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: foliage of up to 200,000 triangles)")
    parser.add_argument("--label", default="after", help="name of the measured code in the document (default: after)")
    parser.add_argument("--engines", action="store_true", help="only measure in three.js")
    parser.add_argument("--strips", type=Path, metavar="FOLDER", help="only write strips of twelve trees")
    arguments = parser.parse_args()
    trees = arguments.trees or [tree for tree in sorted(FOLIAGE.glob("*.glb")) if triangles(tree) <= TREE_LIMIT]
    for tree in map(Path.resolve, trees):
        if arguments.strips:
            write_strips(tree, arguments.label, arguments.strips)
            continue
        found = (measure_in_three if arguments.engines else measure)(tree, arguments.label)
        print(keep({"tree": tree.stem, "label": arguments.label, "commit": measured_commit(), **found}))


if __name__ == "__main__":
    main()
