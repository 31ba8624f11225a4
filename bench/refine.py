"""Compares level 1 with its leaves before and after refinement: `make bench-refine`.

usage: python bench/refine.py [TREE.glb …]   (default: foliage of up to 200,000 triangles)

As in bench/fidelity.py, level 1 has at most the billboards of the published method and the same number of texels, and
the metrics render leaves and level from the same 8 views, which no step of a refinement and no test of it uses. Level
1 is built with `refine` `off`, `short` and `long`, and with `long` and a quarter of the texels. A tree takes some
minutes. Each tree's results go into docs/bench/refine.json immediately, with the measured commit; docs/bench/refine.md
shows them.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from commits import measured_commit
from fidelity import (
    FOLIAGE,
    KEPT,
    LEVELS,
    ROOT,
    TREE_LIMIT,
    Pictures,
    coverage,
    flip,
    judged,
    lines_of,
    make_alternatives,
    rendered,
    smaller,
    triangles,
)
from numpy.typing import NDArray

import leafcloud

MEASURED = ROOT / "docs" / "bench" / "refine.json"
SIZES = (256, 128, 64, 32)
BAKES: dict[str, tuple[leafcloud.Refine, int]] = {
    "off": ("off", LEVELS["level 1"]),
    "short": ("short", LEVELS["level 1"]),
    "long": ("long", LEVELS["level 1"]),
    "long, a quarter": ("long", LEVELS["a quarter"]),
}
"""Effort of the refinement, and width of the atlas page in texels."""

PICTURED, VIEW = "pine_cards_20k", 4
"""Tree of the picture beside the document, and its view."""

INTRODUCTION = """# Refinement

Made by `make bench-refine`: level 1 against the leaves, with `refine` `off`, `short` and `long`, and with `long` on an
atlas page of a quarter of the texels. Billboards and texels are those of the published method (*literal*), as in
[fidelity.md](fidelity.md). Textures are those of the .blend file; [files for
engines](../decisions/engine_textures.md) halve and filter them again. FLIP is the mean over 8 views that no
refinement uses, rendered by the metrics with 16 × 16 samples in each pixel. *seconds*: the
refinement alone, on as many cores as the machine has.

![leaves of the pine, level 1 as baked, level 1 refined](refine.png)

The leaves of the pine at 256², level 1 as it is baked, level 1 after `--refine long`.
"""


def level_1(leaves: leafcloud.Foliage, billboards: int, effort: leafcloud.Refine, side: int) -> leafcloud.Level:
    return leafcloud.build_chain(
        leaves,
        max_billboards=billboards,
        extra_error=0.25,
        texture_size=side,
        back_sides=False,
        levels=1,
        cross=False,
        refine=effort,
    ).clouds[0]


def errors(base: Pictures, other: Pictures) -> dict[str, float]:
    """Return FLIP by the size of the pictures, and the coverage."""
    by_size = {str(size): flip(*(smaller(each, SIZES[0] // size) for each in (base, other))) for size in SIZES}
    return {**by_size, "coverage": coverage(base, other)}


def measure(tree: Path) -> dict[str, Any]:
    folder = KEPT / tree.stem
    billboards = make_alternatives(tree, folder)
    leaves = folder / "leaves.glb"
    base = leafcloud.read_gltf(str(leaves), names=["leaves"])
    seen = judged(base, leaves, ["leaves"])
    row: dict[str, Any] = {"tree": tree.stem, "commit": measured_commit(), "billboards": billboards}
    row["literal"] = errors(seen, judged(base, folder / "paper.glb", ["b"]))
    pictures = {"leaves": seen}
    for name, (effort, side) in BAKES.items():
        level = level_1(base, billboards, effort, side)
        pictures[name] = rendered(base, [level.foliage()], SIZES[0])
        row[name] = {**errors(seen, pictures[name]), "seconds": level.seconds["refine"]}
    if tree.stem == PICTURED:
        row_of_pictures = [over_gray(pictures[name][VIEW]) for name in ("leaves", "off", "long")]
        leafcloud.write_png(str(MEASURED.with_suffix(".png")), np.ascontiguousarray(np.hstack(row_of_pictures)))
    return row


def over_gray(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a premultiplied picture in linear light as codes over mid-gray, opaque."""
    light = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    codes = np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    shown = np.full(picture.shape, 255, np.uint8)
    shown[..., :3] = np.rint(255.0 * (codes * picture[..., 3:] + 0.5 * (1.0 - picture[..., 3:])))
    return shown


def error_table(rows: list[dict[str, Any]], size: int) -> str:
    """Return the table of FLIP relative to that of the published method."""
    ratios = np.array([[row[name][str(size)] / row["literal"][str(size)] for name in BAKES] for row in rows])
    body = [
        [row["tree"], f"{row['literal'][str(size)]:.4f}", *(f"{ratio:.2f}" for ratio in each)]
        for row, each in zip(rows, ratios, strict=True)
    ]
    body.append(["mean", "", *(f"**{ratio:.2f}**" for ratio in ratios.mean(axis=0))])
    return lines_of([f"FLIP at {size}², relative to literal", "literal", *BAKES], body)


def tables(rows: list[dict[str, Any]]) -> str:
    times = [[row["tree"], *(f"{row[name]['seconds']:.1f}" for name in BAKES)] for row in rows]
    covered = [[row["tree"], *(f"{row[name]['coverage']:.3f}" for name in BAKES)] for row in rows]
    rest = [lines_of(["seconds", *BAKES], times), lines_of(["coverage", *BAKES], covered)]
    return "\n\n".join([*(error_table(rows, size) for size in SIZES), *rest])


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare level 1 with its leaves before and after refinement.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: ../shared/foliage but the largest)")
    arguments = parser.parse_args()
    trees = arguments.trees or [tree for tree in sorted(FOLIAGE.glob("*.glb")) if triangles(tree) <= TREE_LIMIT]
    rows = {row["tree"]: row for row in json.loads(MEASURED.read_text())} if MEASURED.is_file() else {}
    for tree in trees:
        rows[tree.stem] = measure(tree.resolve())
        print(json.dumps(rows[tree.stem]), file=sys.stderr, flush=True)
        kept = [rows[name] for name in sorted(rows)]
        MEASURED.write_text(json.dumps(kept, indent=1) + "\n")
        MEASURED.with_suffix(".md").write_text(f"{INTRODUCTION}\n{tables(kept)}\n")


if __name__ == "__main__":
    main()
