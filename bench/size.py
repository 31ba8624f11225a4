"""Compares billboards of the default size with billboards of any size: `make bench-size`.

usage: python bench/size.py [TREE.glb …]      (default: all of ../shared/foliage up to 10 MB)

Bakes each tree twice: with the default size limit and with --max-size 2, which is no limit. For levels 1 and 2 of both
bakes it reports billboards, triangles of leaves, image error, seconds of the core, and the number of fragments relative
to level 0 at crowns of 400, 200, 100 and 50 pixels, counted by ../shared/measure/fragments.py. Prints a table in
Markdown; for all trees it also writes docs/bench/size.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from commits import measured_commit

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
INSTRUMENT = ROOT.parent / "shared" / "measure" / "fragments.py"
BAKED = ROOT / "target" / "size"
LARGEST_FILE = 10_000_000
LEVELS = (1, 2)
HEIGHTS = ("400", "200", "100", "50")
"""Heights of a crown in pixels: the keys in the output of fragments.py."""
LIMITS: dict[str, tuple[str, ...]] = {"none": ("--max-size", "2"), "default": ()}

INTRODUCTION = """# The size of billboards

Made by `make bench-size` on {commit}: the default size limit against no limit. *Fragments*: 2 x 2 quads
without early z, relative to level 0's leaves, at crowns of 400, 200, 100 and 50 pixels. *Error*: the report's image
error. *Seconds*: of the core, for this level. Files larger than 10 MB are left out.

"""
HEADER = ("tree", "level", "limit", "billboards", "triangles", "fragments × leaves", "error", "seconds")


def bake(tree: Path, limit: str) -> Path:
    out = BAKED / f"{tree.stem}_{limit}"
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out), *LIMITS[limit]]
    subprocess.run(command, check=True, capture_output=True)
    return out


def fragments(files: list[Path]) -> list[list[float]]:
    """Return each file's number of fragments relative to the first file, at the four sizes."""
    command = [sys.executable, str(INSTRUMENT), "--json", *map(str, files)]
    told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    counts = [[told[str(file)][height][0] for height in HEIGHTS] for file in files]
    return [[count / base for count, base in zip(row, counts[0], strict=True)] for row in counts]


def rows(tree: Path) -> list[list[str]]:
    """Return a table row for each level and limit."""
    baked = {limit: bake(tree, limit) for limit in LIMITS}
    cases = [(level, limit) for level in LEVELS for limit in LIMITS]
    files = [baked[limit] / f"{tree.stem}_LOD{level}.glb" for level, limit in cases]
    [_, *ratios] = fragments([baked["default"] / f"{tree.stem}_LOD0.glb", *files])
    return [
        row(tree.stem, level, limit, baked[limit], drawn) for (level, limit), drawn in zip(cases, ratios, strict=True)
    ]


def row(name: str, level: int, limit: str, folder: Path, ratios: list[float]) -> list[str]:
    told: dict[str, Any] = json.loads((folder / "report.json").read_text(encoding="utf-8"))["levels"][level]
    seconds = sum(value for stage, value in told["seconds"].items() if stage != "write")
    shares = ", ".join(f"{share:.2f}" for share in ratios)
    counts = (str(told["billboards"]), str(told["triangles"]))
    return [name, str(level), limit, *counts, shares, f"{told['image_error']:.3f}", f"{seconds:.1f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    trees = parser.parse_args().trees
    lines = ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    for tree in trees or [tree for tree in sorted(FOLIAGE.glob("*.glb")) if tree.stat().st_size <= LARGEST_FILE]:
        lines += ["| " + " | ".join(cells) + " |" for cells in rows(tree)]
        print(lines[-1], file=sys.stderr, flush=True)
    text = INTRODUCTION.format(commit=measured_commit()) + "\n".join(lines) + "\n"
    print(text)
    if not trees:
        (ROOT / "docs" / "bench" / "size.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
