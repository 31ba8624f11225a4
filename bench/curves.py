"""Measures error over time, tree by tree: `make bench-curves` makes docs/accuracy.md.

usage: make bench-curves ARGS='[TREE.glb …]'          (default: those of ../shared/foliage, large ones quickly)
       make bench-curves ARGS='--verify [TREE.glb]'  metrics and Cycles on ten settings (minutes; cards an hour)

Small trees come first. A tree's curve takes minutes to an hour. It goes into docs/bench/curves.json immediately, its
charts and pictures into docs/curves; docs/accuracy.md shows them. bench/curve_checks.py measures the guarantees of
the curve, the bench `safeguards` the cost of safeguards.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from fidelity import TREE_LIMIT, flip, lines_of, run, triangles
from numpy.typing import NDArray
from scipy.stats import spearmanr

import leafcloud

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
CHARTS, MEASURED, PAGE = (
    ROOT / "docs" / "curves",
    ROOT / "docs" / "bench" / "curves.json",
    ROOT / "docs" / "accuracy.md",
)
TEXT, SAFEGUARDS = ROOT / "bench" / "accuracy.md", ROOT / "docs" / "bench" / "safeguards.md"
NOTHING = "Not measured yet: `make bench-curves`, on an idle machine."
COSTS: tuple[leafcloud.Cost, ...] = ("seconds", "billboards", "bytes")
PICTURE, GAP = 256, 8
VERIFIED = (
    {"epsilon": 0.02, "texture_size": 2048},
    {"epsilon": 0.03, "texture_size": 2048},
    {"epsilon": 0.04, "texture_size": 2048},
    {"epsilon": 0.04, "texture_size": 512},
    {"epsilon": 0.06, "texture_size": 1024},
    {"epsilon": 0.08, "texture_size": 512},
    {"epsilon": 0.1, "texture_size": 1024},
    {"epsilon": 0.14, "texture_size": 512},
    {"epsilon": 0.2, "texture_size": 512},
    {"epsilon": 0.3, "texture_size": 256},
)
"""Settings for the rank correlation of the metrics with Cycles."""


def points(rows: list[leafcloud.CurveRow]) -> list[leafcloud.CurveRow]:
    """Return up to five rows of the front, from the fastest to the best, at even ratios of error."""
    front = sorted((row for row in rows if row["front"]), key=lambda row: -row["image_error"])
    wanted = np.geomspace(front[0]["image_error"], front[-1]["image_error"], 5)
    chosen = [min(front, key=lambda row: abs(math.log(row["image_error"] / error))) for error in wanted]
    return [row for i, row in enumerate(chosen) if row not in chosen[:i]]


def options(row: leafcloud.CurveRow) -> dict[str, Any]:
    """Return the options that build level 1 of a row."""
    return {**row["settings"], "levels": 1, "cross": False}


def look(foliage: leafcloud.Foliage, part: leafcloud.Foliage) -> NDArray[np.uint8]:
    """Render a part over light gray."""
    seen = leafcloud.render(
        [part], (0.6, -1.0, 0.25), PICTURE, centre=foliage.world_centre.tolist(), radius=1.02 * foliage.radius
    )
    alpha = seen[..., 3:] / 255.0
    shown = np.full_like(seen, 255)
    shown[..., :3] = np.rint(seen[..., :3] * alpha + 225.0 * (1.0 - alpha))
    return shown


def strip(foliage: leafcloud.Foliage, rows: list[leafcloud.CurveRow]) -> NDArray[np.uint8]:
    """Return a picture of the tree at points of its curve, with the leaves themselves last."""
    levels = [leafcloud.build_chain(foliage, **options(row)).clouds[0].foliage() for row in rows]
    gap = np.full((PICTURE, GAP, 4), 255, np.uint8)
    pictures = [picture for part in (*levels, foliage) for picture in (gap, look(foliage, part))]
    return np.ascontiguousarray(np.hstack(pictures[1:]))


def measure(tree: Path) -> dict[str, Any]:
    """Measure the curve of a tree, and write its charts and pictures. Large trees get a quick curve."""
    foliage = leafcloud.read_gltf(str(tree))
    curve = leafcloud.cost_curve(foliage, quick=foliage.triangle_count > TREE_LIMIT)
    CHARTS.mkdir(parents=True, exist_ok=True)
    for cost in COSTS:
        (CHARTS / f"{tree.stem}_{cost}.svg").write_text(curve.svg(cost, title=f"{tree.stem}: error over {cost}"))
    shown = points(curve.rows)
    leafcloud.write_png(str(CHARTS / f"{tree.stem}_points.png"), strip(foliage, shown))
    return {
        "tree": tree.stem,
        "triangles": foliage.triangle_count,
        "rows": curve.rows,
        "refused": curve.refused,
        "shown": [curve.rows.index(row) for row in shown],
    }


def described(settings: leafcloud.CurveSettings) -> list[str]:
    names = ("method", "effort", "epsilon", "candidates", "levels", "texture_size", "samples", "tight_pages")
    values: dict[str, Any] = {**settings}
    return [str(values[name]) for name in names]


def row_cells(row: leafcloud.CurveRow) -> list[str]:
    seconds, peak = row["seconds"], row["peak_bytes"]
    return [
        *described(row["settings"]),
        f"{seconds['total']:.2f}",
        ", ".join(f"{seconds[stage]:.2f}" for stage in ("prepare", "fit", "pack", "bake", "look")),
        "–" if peak is None else f"{peak / 2**20:.0f}",
        str(row["billboards"]),
        f"{row['bytes'] / 2**20:.1f}",
        f"{row['max_deviation']:.4f}, {row['mean_deviation']:.4f}",
        f"{row['image_error']:.3f}{' ●' if row['front'] else ''}",
    ]


HEAD = [
    *("method", "effort", "ε / R", "N", "levels", "page", "samples", "tight"),
    *("s", "prepare, fit, pack, bake, look", "MiB grown", "billboards", "MiB", "deviation / R: most, mean", "error"),
]


def tree_part(row: dict[str, Any]) -> str:
    """Return the section of a tree in docs/accuracy.md."""
    name, rows = row["tree"], row["rows"]
    charts = "\n\n".join(f"![{name}: error over {cost}](curves/{name}_{cost}.svg)" for cost in COSTS)
    shown = "; ".join(
        f"error {one['image_error']:.3f} in {one['seconds']['total']:.1f} s with {one['billboards']} billboards"
        for one in (rows[i] for i in row["shown"])
    )
    table = lines_of(HEAD, [row_cells(one) for one in rows])
    sample = rows[0]["measured_on"]
    quick = f"A quick curve, of a sample of {sample} triangles, one level, seen from two directions.\n\n"
    return (
        f"### {name}, {row['triangles']} triangles\n\n{quick if sample < row['triangles'] else ''}{charts}\n\n"
        f"![{name} at points of its curve](curves/{name}_points.png)\n\n"
        f"From the left: {shown}; the leaves themselves.\n\n"
        f"<details><summary>All settings (● on the front)</summary>\n\n{table}\n\n</details>"
    )


def write_page(rows: list[dict[str, Any]]) -> None:
    """Write docs/accuracy.md: the text of bench/accuracy.md with the measurements."""
    safeguards = SAFEGUARDS.read_text() if SAFEGUARDS.is_file() else "Not measured yet: `make bench`."
    trees = "\n\n".join(tree_part(row) for row in rows) or NOTHING
    text = TEXT.read_text().replace("{trees}", trees)
    PAGE.write_text(text.replace("{safeguards}", safeguards.strip()))


def verify(tree: Path) -> None:
    """Print ten settings' errors by the metrics, FLIP of Cycles' pictures from other views, and their correlation."""
    with tempfile.TemporaryDirectory() as folder:
        models, judged = [], []
        for number, settings in enumerate(VERIFIED):
            out = Path(folder) / str(number)
            flags = [str(part) for name, value in settings.items() for part in (f"--{name.replace('_', '-')}", value)]
            shape = ("--levels", 1, "--no-cross", "--effects", "none")
            run(sys.executable, ROOT / "bake.py", "--input", tree, "--out", out, *shape, *flags, "--files", "levels")
            judged.append(json.loads((out / "report.json").read_text())["levels"][1]["image_error"])
            models.append(f"{out / tree.stem}_LOD1.glb")
            print(settings, judged[-1], file=sys.stderr, flush=True)
        leaves = f"{Path(folder) / '0' / tree.stem}_LOD0.glb"
        views = Path(folder) / "views.npz"
        run(sys.executable, ROOT / "bench" / "flat_views.py", views, 128, 8, 4, leaves, *models)
        with np.load(views) as pictures:
            rendered = [flip(pictures[leaves], pictures[model]) for model in models]
    rows = [
        [f"{s['epsilon']:g}", str(s["texture_size"]), f"{mine:.3f}", f"{theirs:.4f}"]
        for s, mine, theirs in zip(VERIFIED, judged, rendered, strict=True)
    ]
    print(lines_of(["ε / R", "page", "metrics' error", "Cycles' FLIP"], rows))
    print(f"\n{tree.stem}: rank correlation {spearmanr(judged, rendered).statistic:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure error over time, tree by tree.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: those of ../shared/foliage)")
    parser.add_argument("--verify", action="store_true", help="compare the metrics with Cycles on ten settings instead")
    parser.add_argument("--page", action="store_true", help="only write docs/accuracy.md from the kept results")
    arguments = parser.parse_args()
    if arguments.verify:
        verify((arguments.trees or [FOLIAGE / "shapespark_tree1.glb"])[0])
        return
    kept = {row["tree"]: row for row in json.loads(MEASURED.read_text())} if MEASURED.is_file() else {}
    trees = [] if arguments.page else arguments.trees or sorted(FOLIAGE.glob("*.glb"), key=triangles)
    for tree in trees:
        kept[tree.stem] = measure(tree.resolve())
        print(f"{tree.stem}: {len(kept[tree.stem]['rows'])} settings", file=sys.stderr, flush=True)
        keep(kept)
    write_page([kept[name] for name in sorted(kept)])


def keep(kept: dict[str, dict[str, Any]]) -> None:
    """Write the results and docs/accuracy.md."""
    rows = [kept[name] for name in sorted(kept)]
    MEASURED.write_text(json.dumps(rows, indent=1) + "\n")
    write_page(rows)


if __name__ == "__main__":
    main()
