"""Compares level 1 with its leaves before and after refinement: `make bench-refine`.

usage: python bench/refine.py [--ablation] [--cycles] [--suns] [--flight] [--again] [TREE.glb …]
       python bench/refine.py --page      only write docs/bench/refine.md from the kept results

Default trees: foliage of up to 200,000 triangles, and those of bench/unseen_trees.py, small ones first. As in
bench/fidelity.py, level 1 has at most the billboards of the published method and the same number of texels. The metrics
render leaves and level from the same 8 views, which no step of a refinement and no test of it uses. Level 1 is built
with `refine` `off`, `short` and `long`: some minutes a tree.

--ablation: refine the fit of the published method, only the planes, only the texels, and a quarter of the texels.
--cycles: compare in Cycles, too. --suns: under six suns in Cycles. --flight: on a flight past all levels in Cycles.

Each result goes into docs/bench/refine.json immediately, with the measured commit and the seconds that it took;
docs/bench/refine.md shows them (bench/refine_tables.py). Results of the same code are kept, so that a run goes on where
it was interrupted; --again measures them anew. The status is 1 if a refined level is worse than before at any
size, or has another coverage than the leaves (bench/refine_checks.py).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import refine_cycles
from commits import is_current, measured_commit
from fidelity import FOLIAGE, ROOT, TREE_LIMIT, flip, run, smaller, triangles
from numpy.typing import NDArray
from refine_checks import failures, summary
from refine_levels import ABLATION, BAKES, LARGEST, Subject, errors, size_nearest, takes_over
from refine_tables import write_page

import leafcloud

sys.path.insert(0, str(ROOT / "tests" / "support"))
from box_mips import encoded

MEASURED = ROOT / "docs" / "bench" / "refine.json"
PICTURED, VIEW = "pine_cards_20k", 4
"""Tree of the picture beside the document, and its view."""

Row = dict[str, Any]


def measure_levels(subject: Subject) -> Row:
    """Measure the errors of level 1 with each effort, by the metrics."""
    base, seen = subject.base, subject.seen
    paper = leafcloud.read_gltf(str(subject.folder / "paper.glb"), names=["b"])
    row: Row = {"billboards": subject.billboards, "literal": errors(seen, subject.pictures(paper))}
    row["takes_over"] = takes_over(subject.level("off").level, base.radius)
    shrunk = LARGEST // size_nearest(row["takes_over"])
    pictures = {"leaves": seen}
    for name in BAKES:
        level, seconds = subject.level(name).level, subject.level(name).seconds
        pictures[name] = subject.pictures(level.foliage())
        collapsed = subject.pictures(level.morphed(base, leafcloud.HAND_OVER))
        row[name] = {
            **errors(seen, pictures[name]),
            "seconds": seconds,
            "refine": level.seconds["refine"],
            "billboards": len(level.plane_ids),
            "hand_over": flip(smaller(collapsed, shrunk), smaller(pictures[name], shrunk)),
        }
    if subject.tree.stem == PICTURED:
        row_of_pictures = [over_gray(smaller(pictures[name], 2)[VIEW]) for name in ("leaves", "off", "long")]
        leafcloud.write_png(str(MEASURED.with_suffix(".png")), np.ascontiguousarray(np.hstack(row_of_pictures)))
    return row


def measure_ablation(subject: Subject) -> Row:
    """Measure the errors of level 1 with another fit, and refined in part."""
    row: Row = {}
    for name in ABLATION:
        built = subject.level(name)
        shown = errors(subject.seen, subject.pictures(built.level.foliage()))
        row[name] = {
            **shown,
            "seconds": built.seconds,
            "refine": built.level.seconds["refine"],
            "billboards": len(built.level.plane_ids),
        }
    return row


PARTS: dict[str, Callable[[Subject], Row]] = {
    "levels": measure_levels,
    "ablation": measure_ablation,
    "cycles": refine_cycles.compare,
    "suns": refine_cycles.compare_under_suns,
    "flight": refine_cycles.fly_past,
}


def over_gray(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a premultiplied picture in linear light as codes over mid-gray, opaque."""
    light = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    codes = encoded(light)
    shown = np.full(picture.shape, 255, np.uint8)
    shown[..., :3] = np.rint(255.0 * (codes * picture[..., 3:] + 0.5 * (1.0 - picture[..., 3:])))
    return shown


def unseen_trees() -> list[Path]:
    """Make the trees that no setting was chosen by; return their files."""
    folder = ROOT / "target" / "unseen"
    run(sys.executable, ROOT / "bench" / "unseen_trees.py", folder)
    return sorted(folder.glob("*.glb"))


def default_trees() -> list[Path]:
    """Return the trees of up to TREE_LIMIT triangles, small ones first."""
    counts = {tree: triangles(tree) for tree in [*FOLIAGE.glob("*.glb"), *unseen_trees()]}
    return sorted((tree for tree, count in counts.items() if count <= TREE_LIMIT), key=lambda tree: counts[tree])


def kept_rows() -> dict[str, Row]:
    """Return the kept results by tree. Results of before there were parts are left out."""
    rows = json.loads(MEASURED.read_text()) if MEASURED.is_file() else []
    return {row["tree"]: row for row in rows if "levels" in row}


def keep(rows: dict[str, Row]) -> list[Row]:
    """Write the results and their document; return the results in the order of the document."""
    kept = [rows[name] for name in sorted(rows)]
    MEASURED.write_text(json.dumps(kept, indent=1) + "\n")
    write_page(kept, MEASURED.with_suffix(".md"))
    return kept


def measure(tree: Path, parts: list[str], rows: dict[str, Row], *, again: bool) -> None:
    """Measure the parts of a tree that have no result of the same code, and write each."""
    subject, commit = Subject(tree), measured_commit()
    row = rows.get(tree.stem, {"tree": tree.stem})
    for part in parts:
        if part in row and is_current(row[part]["commit"]) and not again:
            print(f"{tree.stem}, {part}: kept", file=sys.stderr, flush=True)
            continue
        begin = time.perf_counter()
        measured = PARTS[part](subject)
        row[part] = {"commit": commit, "took": time.perf_counter() - begin, **measured}
        rows[tree.stem] = row
        keep(rows)
        print(f"{tree.stem}, {part}: {row[part]['took']:.0f} s", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare level 1 with its leaves before and after refinement.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: all but the largest)")
    parser.add_argument("--ablation", action="store_true", help="refine the published method's fit, and parts of ours")
    parser.add_argument("--cycles", action="store_true", help="compare in Cycles, too")
    parser.add_argument("--suns", action="store_true", help="compare under six suns in Cycles")
    parser.add_argument("--flight", action="store_true", help="measure popping on a flight in Cycles")
    parser.add_argument("--again", action="store_true", help="measure anew what the same code has measured")
    parser.add_argument("--page", action="store_true", help="only write the document from the kept results")
    arguments = parser.parse_args()
    rows, begin = kept_rows(), time.perf_counter()
    parts = ["levels", *(part for part in PARTS if getattr(arguments, part, False))]
    for tree in [] if arguments.page else arguments.trees or default_trees():
        measure(tree.resolve(), parts, rows, again=arguments.again)
    print(f"all trees: {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    kept = keep(rows) if rows else []
    print(summary(kept))
    sys.exit(1 if failures(kept) else 0)


if __name__ == "__main__":
    main()
