"""Times forests in three.js, by the processor or by a graphics card: `make bench-frame-times`.

usage: make bench-frame-times ARGS='[--bake | --card]'

Bakes pine, oak and fir of ../shared/foliage for three.js into target/frame_times, and times pictures of 1, 100 and
1,000 trees in Chromium without a display (bench/three/frames.js): of the leaves only, of the levels, and of the levels
with pruning. Writes one section of docs/bench/frame_times.md, and keeps those of other renderers.

`--bake` only bakes. `--card` draws by the graphics card the trees that an earlier call has baked, and 10,000 of the
small ones: besides these files it needs only the repository with its package for three.js installed, Python and
Chromium. The processor does not draw the fir.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from browser import CARD, PROCESSOR, ROOT, ask
from commits import measured_commit
from sections import sections_of, table

FOLIAGE = ROOT.parent / "shared" / "foliage"
BAKED = ROOT / "target" / "frame_times"
COMMIT = BAKED / "commit"
DOCUMENT = ROOT / "docs" / "bench" / "frame_times.md"
SIZE = (1920, 1080)
PATIENCE = 900.0
VIEWS = {"near": {"above": 2.0, "before": 3.0}, "far": {"above": 10.0, "before": 40.0}}
"""Places of the eye in crown radii, above and in front of the middle tree of the first row."""
PRUNED = "pruned"
"""Folder of the bakes with pruning."""


@dataclass(frozen=True)
class Plan:
    """Pictures by one kind of renderer. `counts`: numbers of trees by the tree's name."""

    drawn_by: Sequence[str]
    counts: dict[str, Sequence[int]]
    pictures: int


FEW = (1, 100, 1000)
MANY = (*FEW, 10_000)
PINE, OAK, FIR = "pine_cards_20k", "oak_cards_11k", "douglas_fir_105k"
BY_PROCESSOR = Plan(PROCESSOR, {PINE: FEW, OAK: FEW}, 3)
BY_CARD = Plan(CARD, {PINE: MANY, OAK: MANY, FIR: FEW}, 15)

INTRODUCTION = """# Frame times

Made by `make bench-frame-times` with three.js in Chromium: milliseconds of a picture of 1,920 × 1,080 pixels, without
antialiasing, with a sun without shadows, until a pixel of it was read; the median of several pictures. *Drawing*:
those of the card or of SwiftShader alone, as the browser reports them. Trees stand in a square, 2.6 R apart. *Near*:
the camera is 2 R above the middle tree of the first row and 3 R in front of it. *Far*: 10 R above and 40 R in front.
It looks at a point 8 R behind that tree. All distances suit 1,080 rows, so near trees are drawn as leaf meshes in any
way. *Leaves only*: level 0 at all distances, with the shader that collapses far leaves onto their planes. *Levels,
pruned*: baked with `--chain both`. In parentheses: millions of triangles. Those of leaves that are pruned on the
nearest tree are not drawn; others collapse in the shader and count.
"""


def bake() -> None:
    """Bake the trees without and with pruning, and note the commit."""
    for name in BY_CARD.counts:
        command = [sys.executable, str(ROOT / "bake.py"), "--input", str(FOLIAGE / f"{name}.glb"), "--engine", "three"]
        for chain, out in {"billboards": BAKED, "both": BAKED / PRUNED}.items():
            subprocess.run([*command, "--chain", chain, "--out", str(out)], check=True, capture_output=True)
    COMMIT.write_text(measured_commit())


def ways_of(name: str) -> dict[str, dict[str, object]]:
    """Return the files and levels to draw, by the heads of the table."""
    whole, pruned = f"/files/{name}.glb", f"/files/{PRUNED}/{name}.glb"
    return {
        "leaves only": {"tree": whole, "level": 0},
        "levels": {"tree": whole, "level": None},
        "levels, pruned": {"tree": pruned, "level": None},
    }


def measured(plan: Plan) -> tuple[str, list[list[str]]]:
    """Return the name of the renderer and the table, its head first."""
    renderer, rows = "", [["tree", "trees", "view", *ways_of("")]]
    for name, count in ((name, count) for name, counts in plan.counts.items() for count in counts):
        question = {
            "count": count,
            "size": SIZE,
            "pictures": plan.pictures,
            "views": list(VIEWS.values()),
            "ways": list(ways_of(name).values()),
        }
        answer = ask("bench/three/frames.html", question, patience=PATIENCE, files=BAKED, drawn_by=plan.drawn_by)
        renderer = answer["renderer"]
        for view, times in zip(VIEWS, answer["times"], strict=True):
            rows.append([name, f"{count:,}", view, *(shown(**way) for way in times)])
            print(*rows[-1], sep=" | ", flush=True)
    return renderer, rows


def shown(frame: float, drawing: float | None, triangles: int) -> str:
    """Return one cell: milliseconds, those of drawing, and millions of triangles."""
    own = "" if drawing is None else f", drawing {drawing:,.2f}"
    return f"{frame:,.1f}{own} ({triangles / 1e6:,.2f})"


def section(renderer: str, rows: Sequence[Sequence[str]]) -> str:
    """Return the section of one renderer. `rows`: the head first."""
    return f"## {renderer}\n\nBaked at {COMMIT.read_text()}.\n\n{table(rows[0], rows[1:])}"


def write(made: str) -> None:
    """Write a section into the document, in place of the one of the same renderer."""
    name = made.partition("\n")[0].removeprefix("## ")
    parts = {**sections_of(DOCUMENT), name: made}
    DOCUMENT.write_text("\n".join([INTRODUCTION, *parts.values()]), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time pictures of forests in three.js.")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--bake", action="store_true", help="only bake the trees")
    only.add_argument("--card", action="store_true", help="draw by the graphics card what an earlier call has baked")
    arguments = parser.parse_args()
    if not arguments.card:
        bake()
    if arguments.bake:
        return
    write(section(*measured(BY_CARD if arguments.card else BY_PROCESSOR)))


if __name__ == "__main__":
    main()
