"""Bakes real trees and measures the results from the files alone: `make bench-measure`.

usage: make bench-measure ARGS='[--no-views] [TREE.glb …]'      (default: all of ../shared/foliage)

For each tree: exit status, wall time and peak memory of the bake; errors and warnings of the Khronos validator; for
each level the largest distance of a vertex from its parent plane, divided by ε, from the GLB in f64; and from Cycles
(8 views, 256², 6 × 6 samples, flat-lit) the coverage of LOD 1 relative to the leaves and the silhouette overlap of
the collapsed leaves with LOD 1. Prints a table in Markdown; for all trees it also writes docs/measured.md and
docs/bench/bake.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from glb import Node, read_glb

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
VIEW_LIMIT = 200_000
"""Maximum triangles of a tree for the views in Cycles."""

INTRODUCTION = """# Measured

Made by `make bench-measure` on two cores, from the files of a bake of each tree. `make bench`
compares the fit with the published algorithm in [bench/fit.md](bench/fit.md).

- *s*, *GiB*: wall time and peak memory of the whole command, including Blender's start and import.
- *validator*: errors and warnings of the Khronos validator over all GLB files.
- *billboards*, *greatest deviation / ε*: by level; in f64, along the normal, over every vertex of the level before. At
  most 1.
- *coverage*: of LOD 1 relative to the leaves. *overlap*: of the silhouettes of the collapsed leaves (morph target at 1)
  and LOD 1 (intersection over union of alpha > ½). Both from Cycles, flat-lit, mean of 8 views, 256², 6 × 6 samples.
"""


def bake(tree: Path, out: Path) -> dict[str, Any]:
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out), "--every-level"]
    command += ["--files", "levels"]
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begin
    return {"exit": os.waitstatus_to_exitcode(status), "seconds": seconds, "gib": usage.ru_maxrss / 2**20}


def validate(files: list[Path]) -> int:
    """Return the number of errors and warnings of the Khronos validator."""
    command = ["node", "validate.mjs", *(str(file) for file in files)]
    run = subprocess.run(command, cwd=ROOT / "tests" / "gltf_validator", capture_output=True, text=True, check=True)
    return sum(issue["severity"] <= 1 for issues in json.loads(run.stdout).values() for issue in issues)


def greatest_deviation(node: Node) -> float:
    """Return the largest distance between a vertex and its morph target, along the normal of the target's plane.

    Vertices of one triangle share a plane. The triangle's targets give the normal; triangles with nearly collinear
    targets are skipped.
    """
    greatest = 0.0
    for primitive in node.primitives:
        rest, motion = (v["POSITION"].astype(float) for v in (primitive.attributes, primitive.targets[0]))
        position, target = node.to_world(rest), node.to_world(rest + motion)
        corners, targets = position[primitive.indices], target[primitive.indices]
        cross = np.cross(targets[:, 1] - targets[:, 0], targets[:, 2] - targets[:, 0])
        length = np.linalg.norm(cross, axis=1)
        longest = np.linalg.norm(targets - np.roll(targets, 1, axis=1), axis=2).max(axis=1)
        firm = length > 1e-3 * longest**2
        normals = cross[firm] / length[firm, None]
        heights = np.einsum("tcd,td->tc", corners[firm] - targets[firm], normals)
        greatest = max(greatest, float(np.abs(heights).max(initial=0.0)))
    return greatest


def views(name: str, out: Path) -> dict[str, float]:
    leaves, level = (str(out / f"{name}_LOD{number}.glb:{name}_LOD{number}") for number in (0, 1))
    collapsed = f"{leaves}@1"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "views.npz"
        script = [sys.executable, str(ROOT / "bench" / "flat_views.py"), str(file), "256", "8", "6"]
        run = [*script, leaves, collapsed, level]
        looked = subprocess.run(run, capture_output=True, text=True, timeout=1800)
        if looked.returncode != 0:
            raise SystemExit(f"flat_views.py failed on {name}:\n{looked.stderr}")
        pictures = dict(np.load(file))
    alpha = {key: value[..., 3] for key, value in pictures.items()}
    inside = {key: value > 0.5 for key, value in alpha.items()}
    both, either = inside[collapsed] & inside[level], inside[collapsed] | inside[level]
    return {
        "coverage": float(np.mean(alpha[level].sum((1, 2)) / alpha[leaves].sum((1, 2)))),
        "overlap": float(np.mean(both.sum((1, 2)) / either.sum((1, 2)))),
    }


def measure(tree: Path, out: Path, look: bool) -> dict[str, Any]:
    name = tree.stem
    row: dict[str, Any] = {"tree": name, **bake(tree, out)}
    report = json.loads((out / "report.json").read_text())
    row["missing"] = [file for file in report["files"] if not (out / file).is_file()]
    row["issues"] = validate(sorted(out.glob("*.glb")))
    nodes = read_glb(out / f"{name}.glb")
    levels = report["levels"]
    row["billboards"] = [level["billboards"] for level in levels[1:]]
    row["error"] = [level["image_error"] for level in levels[1:]]
    row["deviation"] = [
        greatest_deviation(nodes[f"{name}_LOD{finer}"]) / (level["epsilon"] * report["input"]["radius"])
        for finer, level in enumerate(levels[1:])
        if level["epsilon"] is not None
    ]
    row["stages"] = {
        stage: sum(level["seconds"][stage] for level in levels) for stage in ("fit", "pack", "bake", "look", "write")
    }
    if look and report["input"]["triangles"] <= VIEW_LIMIT:
        row.update(views(name, out))
    return row


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| tree | exit | s | GiB | validator | billboards | greatest deviation / ε | coverage | overlap at a = 1 |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        share = {key: f"{row[key]:.3f}" if key in row else "–" for key in ("coverage", "overlap")}
        lines.append(
            f"| {row['tree']} | {row['exit']} | {row['seconds']:.1f} | {row['gib']:.1f} | {row['issues']} | "
            f"{', '.join(map(str, row['billboards']))} | {', '.join(f'{d:.4f}' for d in row['deviation'])} | "
            f"{share['coverage']} | {share['overlap']} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Bake real trees and measure the results from the files alone.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: all of ../shared/foliage)")
    parser.add_argument("--no-views", action="store_true", help="do not render with Cycles")
    arguments = parser.parse_args()
    rows = []
    for tree in arguments.trees or sorted(FOLIAGE.glob("*.glb")):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure(tree, Path(folder), not arguments.no_views))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    print(table(rows))
    if arguments.trees or arguments.no_views:
        return
    docs = ROOT / "docs"
    (docs / "bench").mkdir(parents=True, exist_ok=True)
    (docs / "bench" / "bake.json").write_text(json.dumps(rows, indent=2) + "\n")
    (docs / "measured.md").write_text(f"{INTRODUCTION}\n{table(rows)}\n")


if __name__ == "__main__":
    main()
