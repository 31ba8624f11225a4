"""Compares level 1 and its alternatives with the leaves: `make bench-fidelity`.

usage: make bench-fidelity ARGS='[--judge] [--samples 32] [TREE.glb …]'   (default: foliage of up to 200,000 triangles)

../shared/measure makes the alternatives from the same leaves: the published method implemented literally, a cross of
two billboards, and meshoptimizer's sloppy simplification to the same number of triangles. Level 1 has at most the
billboards of the published method and the same number of texels, then a quarter of them. Cycles (bench/flat_views.py)
and the project's own renderer for metrics both render all of them from 8 views. target/fidelity keeps the pictures
that do not depend on the project. A tree takes Cycles a quarter of an hour and the metrics a minute. With --judge
only the metrics are measured, and Cycles' earlier results stay. Each tree's results go into docs/bench/fidelity.json
immediately, with the measured commit; docs/bench/fidelity.md shows them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import flip_evaluator
import numpy as np
from commits import measured_commit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.stats import spearmanr

import leafcloud

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE, INSTRUMENT = ROOT.parent / "shared" / "foliage", ROOT.parent / "shared" / "measure"
KEPT = ROOT / "target" / "fidelity"
MEASURED = ROOT / "docs" / "bench" / "fidelity.json"
TREE_LIMIT = 200_000
"""Maximum triangles of a tree in the comparison."""
EPSILON, CANDIDATES, SEED = "0.04", "600", "1"
TEXELS = 8_388_608
SIZE, VIEWS = 256, 8
PICTURE_RADIUS = 1.025
"""Half the width of a picture, in R."""
SIZES = ("256", "64")
SAMPLES, JUDGED = 32, 16
"""Samples along a pixel's side, in Cycles (cross and sloppy have half as many) and in the metrics."""
ALTERNATIVES = {"literal": "paper", "cross": "cross", "sloppy": "sloppy"}
"""Stems of the alternatives' files."""
LEVELS = {"level 1": math.isqrt(TEXELS), "a quarter": math.isqrt(TEXELS // 4)}
"""Width of the atlas page in texels."""

Pictures = NDArray[np.float32]
Shown = Sequence[leafcloud.Foliage] | leafcloud.OctahedralLevel
"""(views, size, size, 4), linear light, premultiplied."""

INTRODUCTION = f"""# Fidelity

Made by `make bench-fidelity`: level 1 against the leaves, rendered from {VIEWS} directions by
Cycles, flat-lit, orthographic, on a grid of samples in each pixel. *Samples* are along its side (half as many for
cross and sloppy, which differ a lot). FLIP is the mean within four pixels of either silhouette, over gray. The
alternatives are made from the same leaves. Trees with more than {TREE_LIMIT:,} triangles are left out: they are for
speed tests.

- *literal*: the published algorithm (ε = {EPSILON} R, N = {CANDIDATES}), rectangles, one front texture each,
  {TEXELS / 1e6:.1f} M texels.
- *cross*: two perpendicular billboards. *sloppy*: meshoptimizer's simplifySloppy to as many triangles as *literal*.
- *level 1*: at most the billboards of *literal*, one texture for both sides, an atlas page of {LEVELS["level 1"]}²;
  *a quarter*: a page of {LEVELS["a quarter"]}².
- *coverage*: alpha relative to the leaves. *floor*: the leaves against themselves, sampled half a sample aside: the
  error of the sampling itself.
- *metrics*: the project's own renderer and its FLIP, from the same views, with {JUDGED} × {JUDGED} unfiltered texture
  samples in each pixel. The metrics are compared with Cycles on trees where both measured the same files.
"""


def run(*command: object, **more: Any) -> str:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, **more)
    if done.returncode != 0:
        raise SystemExit(f"{command[1]} failed:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    return done.stdout


def digest(*files: Path) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def make_alternatives(tree: Path, folder: Path) -> int:
    """Write leaves.glb, paper.glb, cross.glb and sloppy.glb; return the number of billboards in paper.glb."""
    count = folder / f"billboards-{digest(tree)}"
    if not count.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        fitter = KEPT / "alg1"
        run("rustc", "-O", "-C", "target-cpu=native", INSTRUMENT / "alg1.rs", "-o", fitter)
        alone = {"env": {**os.environ, "BLENDER_USER_RESOURCES": str(folder / "user")}}
        paper = (tree, folder / "paper.glb", fitter, EPSILON, CANDIDATES, SEED, TEXELS)
        told = run(sys.executable, INSTRUMENT / "paper_cloud.py", *paper, **alone)
        billboards = int(told.rsplit("billboards", 1)[1])
        run(sys.executable, INSTRUMENT / "peers.py", tree, folder, 2 * billboards, **alone)
        count.write_text(str(billboards))
    return int(count.read_text())


def bake(leaves: Path, billboards: int, side: int, out: Path) -> Path:
    """Bake level 1 of the leaves; return its file."""
    shape = ("--max-billboards", billboards, "--texture-size", side, "--levels", 1, "--no-cross", "--effects", "none")
    run(sys.executable, ROOT / "bake.py", "--input", leaves, "--out", out, *shape, "--files", "levels")
    return out / f"{leaves.stem}_LOD1.glb"


def look(folder: Path, grid: int, frame: Path, *models: str) -> list[Pictures]:
    """Render models with Cycles, framed by the model `frame`."""
    file = folder / "views.npz"
    run(sys.executable, ROOT / "bench" / "flat_views.py", file, SIZE, VIEWS, grid, *models, f"{frame}:@frame")
    with np.load(file) as pictures:
        return [pictures[model] for model in models]


def reference(folder: Path, samples: int) -> dict[str, Pictures]:
    """Return Cycles' pictures of the leaves and the alternatives, rendered once and kept."""
    leaves = folder / "leaves.glb"
    tools = (ROOT / "bench" / name for name in ("flat_views.py", "clear_cells.py"))
    file = folder / f"reference-{samples}-{digest(leaves, *tools)}.npz"
    if not file.is_file():
        models = {"leaves": leaves, "floor": f"{leaves}:@half"}
        models |= {name: folder / f"{stem}.glb" for name, stem in ALTERNATIVES.items()}
        grids = {name: samples // 2 if name in ("cross", "sloppy") else samples for name in models}
        pictures = {name: look(folder, grids[name], leaves, str(model))[0] for name, model in models.items()}
        np.savez(file, **pictures)
    with np.load(file) as kept:
        return dict(kept)


def judged(base: leafcloud.Foliage, model: Path, names: list[str]) -> Pictures:
    """Render the same views of a file with the project's own renderer."""
    return rendered(base, [leafcloud.read_gltf(str(model), names=names)], SIZE)


def directions() -> list[tuple[float, float, float]]:
    """Return the directions from the crown to the eye in the compared views."""
    golden = math.pi * (3.0 - math.sqrt(5.0))
    heights = [1.0 - 1.5 * (i + 0.5) / VIEWS for i in range(VIEWS)]
    across = [math.sqrt(1.0 - z * z) for z in heights]
    return [
        (r * math.cos(i * golden), r * math.sin(i * golden), z)
        for i, (r, z) in enumerate(zip(across, heights, strict=True))
    ]


def premultiplied(pictures: Sequence[NDArray[np.uint8]]) -> Pictures:
    """Return pictures with straight sRGB codes as premultiplied linear light."""
    codes = np.stack(pictures).astype(np.float32) / 255.0
    light = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    light[..., 3] = codes[..., 3]
    light[..., :3] *= light[..., 3:]
    return light


def rendered(
    base: leafcloud.Foliage,
    shown: Shown,
    size: int,
    samples: int = JUDGED,
    sun: tuple[float, float, float] | None = None,
) -> Pictures:
    """Render views of parts or of an impostor that the sphere of `base` fills, with the project's own renderer."""
    frame = {"centre": base.world_centre.tolist(), "radius": PICTURE_RADIUS * base.radius, "sun": sun}
    pictures = []
    for direction in directions():
        if isinstance(shown, leafcloud.OctahedralLevel):
            pictures.append(shown.render(direction, size, samples=samples, **frame))
        else:
            pictures.append(leafcloud.render(shown, direction, size, samples=samples, filtered=False, **frame))
    return premultiplied(pictures)


def smaller(pictures: Pictures, times: int) -> Pictures:
    views, size = pictures.shape[:2]
    return pictures.reshape(views, size // times, times, size // times, times, 4).mean((2, 4))


def flip(base: Pictures, other: Pictures) -> float:
    """Return the mean FLIP over the views, each within four pixels of either silhouette. Pictures without any alpha are
    alike."""

    def over_grey(picture: NDArray[np.float32]) -> NDArray[np.float32]:
        alpha = picture[..., 3:]
        light = picture[..., :3] / np.maximum(alpha, 1e-6)
        codes = np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
        return (codes * alpha + 0.5 * (1.0 - alpha)).astype(np.float32)

    errors = []
    for a, b in zip(base, other, strict=True):
        error = np.asarray(flip_evaluator.evaluate(over_grey(a), over_grey(b), "LDR", applyMagma=False)[0])
        alpha = np.maximum(a[..., 3], b[..., 3])
        # Thin crowns may cover less than half of every pixel.
        near = binary_dilation(alpha > min(0.5, 0.5 * alpha.max()), iterations=4)
        errors.append(error.reshape(*near.shape, -1)[..., 0][near].mean() if near.any() else 0.0)
    return float(np.mean(errors))


def coverage(base: Pictures, other: Pictures) -> float:
    return float(np.mean(other[..., 3].sum((1, 2)) / base[..., 3].sum((1, 2))))


def figures(base: Pictures, others: dict[str, Pictures]) -> dict[str, dict[str, float]]:
    def of(other: Pictures) -> dict[str, float]:
        return {
            "coverage": coverage(base, other),
            "256": flip(base, other),
            "64": flip(smaller(base, 4), smaller(other, 4)),
        }

    return {name: of(other) for name, other in others.items()}


def measure(tree: Path, samples: int | None) -> dict[str, Any]:
    """Measure a tree with the metrics and, unless `samples` is None, with Cycles."""
    folder = KEPT / tree.stem
    billboards = make_alternatives(tree, folder)
    leaves = folder / "leaves.glb"
    base = leafcloud.read_gltf(str(leaves), names=["leaves"])
    seen = {name: judged(base, folder / f"{stem}.glb", ["b", "cross", "leaves"]) for name, stem in ALTERNATIVES.items()}
    pictures = {} if samples is None else reference(folder, samples)
    files = {}
    with tempfile.TemporaryDirectory() as out:
        for name, side in LEVELS.items():
            file = bake(leaves, billboards, side, Path(out) / str(side))
            files[name] = digest(file)
            seen[name] = judged(base, file, ["leaves"])
            if samples is not None:
                [pictures[name]] = look(folder, samples, leaves, str(file))
        report = json.loads((Path(out) / str(LEVELS["level 1"]) / "report.json").read_text())
    what: dict[str, Any] = {"commit": measured_commit(), "files": files}
    row: dict[str, Any] = {
        "tree": tree.stem,
        "literal": billboards,
        "billboards": report["levels"][1]["billboards"],
        "judge": {**what, **figures(judged(base, leaves, ["leaves"]), seen)},
    }
    if samples is not None:
        row["cycles"] = {**what, "samples": samples, **figures(pictures.pop("leaves"), pictures)}
    return row


def lines_of(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def error_table(rows: list[dict[str, Any]], who: str, size: str) -> str:
    floor = ["floor"] if who == "cycles" else []
    names = [*floor, *ALTERNATIVES, *LEVELS]
    errors = [[row[who][name][size] for name in names] for row in rows]
    literal = names.index("literal")
    ratios = np.array([[e[names.index(level)] / e[literal] for level in LEVELS] for e in errors])
    grids = [[str(row[who]["samples"])] if floor else [] for row in rows]
    body = [
        [row["tree"], *grid, *(f"{x:.4f}" for x in e), *(f"{x:.2f}" for x in ratio)]
        for row, grid, e, ratio in zip(rows, grids, errors, ratios, strict=True)
    ]
    head = [*(["samples"] if floor else []), *names]
    body.append(["mean", *[""] * len(head), *(f"**{x:.2f}**" for x in ratios.mean(axis=0))])
    title = {"cycles": "Cycles", "judge": "metrics"}[who]
    return lines_of([f"FLIP at {size}², {title}", *head, *(f"{level} / literal" for level in LEVELS)], body)


def coverage_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of coverages, from Cycles for the trees that it rendered."""
    names = [*ALTERNATIVES, *LEVELS]
    body = []
    for row in rows:
        who = "cycles" if "cycles" in row else "judge"
        seen = [f"{row[who][name]['coverage']:.3f}" for name in names]
        body.append([row["tree"], f"{row['billboards']} of {row['literal']}", *seen])
    return lines_of(["coverage", "billboards", *names], body)


def agreement_table(rows: list[dict[str, Any]]) -> str:
    """Return the table that compares the metrics with Cycles, over trees where both rendered the same files."""
    names = [*ALTERNATIVES, *LEVELS]

    def errors(who: str, row: dict[str, Any], size: str) -> NDArray[np.float64]:
        return np.array([row[who][name][size] for name in names])

    def cells(rows: list[dict[str, Any]]) -> list[str]:
        found = []
        for size in SIZES:
            mine, theirs = (np.concatenate([errors(who, row, size) for row in rows]) for who in ("judge", "cycles"))
            found += [f"{spearmanr(mine, theirs).statistic:.3f}", f"{np.abs(mine / theirs - 1.0).max():.1%}"]
        return found

    body = [[row["tree"], *cells([row])] for row in rows]
    head = [part for size in SIZES for part in (f"rank correlation at {size}²", "greatest difference")]
    return lines_of(["metrics and Cycles", *head], [*body, ["all", *cells(rows)]])


def tables(rows: list[dict[str, Any]]) -> str:
    seen = [row for row in rows if "cycles" in row]
    parts = [error_table(rows, "judge", size) for size in SIZES]
    together = [row for row in seen if row["cycles"]["files"] == row["judge"]["files"]]
    if seen:
        agreement = [agreement_table(together)] if together else []
        parts = [*(error_table(seen, "cycles", size) for size in SIZES), *agreement, *parts]
    return "\n\n".join([coverage_table(rows), *parts])


def triangles(tree: Path) -> int:
    return leafcloud.read_gltf(str(tree)).triangle_count


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare level 1 and its alternatives with the leaves.")
    parser.add_argument(
        "trees", nargs="*", type=Path, help="GLB files (default: all of ../shared/foliage but the largest)"
    )
    parser.add_argument("--judge", action="store_true", help="measure with the project's own renderer only")
    parser.add_argument(
        "--samples", type=int, default=SAMPLES, help=f"Cycles' samples along a pixel, even (default: {SAMPLES})"
    )
    arguments = parser.parse_args()
    trees = arguments.trees or [tree for tree in sorted(FOLIAGE.glob("*.glb")) if triangles(tree) <= TREE_LIMIT]
    rows = {row["tree"]: row for row in json.loads(MEASURED.read_text())} if MEASURED.is_file() else {}
    for tree in trees:
        row = measure(tree.resolve(), None if arguments.judge else arguments.samples)
        print(json.dumps(row), file=sys.stderr, flush=True)
        rows[tree.stem] = {**rows.get(tree.stem, {}), **row}
        keep([rows[name] for name in sorted(rows)])
    print(tables([rows[tree.stem] for tree in trees]))


def keep(rows: list[dict[str, Any]]) -> None:
    MEASURED.write_text(json.dumps(rows, indent=1) + "\n")
    MEASURED.with_suffix(".md").write_text(f"{INTRODUCTION}\n{tables(rows)}\n")


if __name__ == "__main__":
    main()
