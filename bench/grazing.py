"""Compares pictures with and without billboards seen edge-on: `make bench-grazing`.

usage: python bench/grazing.py [TREE.glb …]

Renders levels 1 and 2 of each tree, flat-lit, from six directions: with all billboards, and without billboards whose
|cos| between normal and view is below each of three bounds. At the bound a fade twice as wide is half done. A level
has the size at its switch, where its deviation is 8 pixels, and twice that size, as seen from too near. The error is
the root mean square difference from the leaves, linear and premultiplied, over all pixels that either covers;
coverage is relative to the leaves. Prints a table in Markdown; for all trees it also writes docs/bench/grazing.md.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leafcloud

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
TREES = ("shapespark_tree1", "maple_13k", "bush_ash_5k", "oak_cards_11k", "pine_cards_20k", "douglas_fir_105k")
BOUNDS = (0.0, 0.05, 0.1, 0.2)
NEARER = (1, 2)
PIXELS = 8.0
VIEWS = 6

Pictures = NDArray[np.float64]


def main() -> None:
    named = [Path(name) for name in sys.argv[1:]]
    columns = [f"all: error, coverage × {nearer}" for nearer in NEARER]
    columns[1:1] = [f"cos ≥ {bound} × {NEARER[0]}" for bound in BOUNDS[1:]]
    columns += [f"cos ≥ {bound} × {NEARER[1]}" for bound in BOUNDS[1:]]
    lines = [
        "Levels without the billboards seen edge-on (`make bench-grazing`): error against the leaves",
        "and coverage relative to them, at the switch distance (× 1) and at half of it (× 2).",
        "",
        f"| tree | level | {' | '.join(columns)} |",
        "|---" * (len(columns) + 2) + "|",
    ]
    for tree in named or [FOLIAGE / f"{name}.glb" for name in TREES]:
        for row in rows(tree):
            lines.append(row)
            print(row, flush=True)
    if not named:
        (ROOT / "docs" / "bench" / "grazing.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def rows(tree: Path) -> Iterator[str]:
    foliage = leafcloud.read_gltf(str(tree))
    chain = leafcloud.build_chain(foliage, levels=2, cross=False)
    for number, level in enumerate(chain.levels, start=1):
        cells = []
        for nearer in NEARER:
            size = min(round(2.0 * PIXELS * nearer / level.max_deviation_leaves), 2048)
            leaves = seen(foliage, [foliage] * VIEWS, size)
            for bound in BOUNDS:
                cut = seen(foliage, [facing(level, view, bound) for view in views()], size)
                cells.append(f"{difference(leaves, cut):.4f}, {cut[..., 3].sum() / leaves[..., 3].sum():.3f}")
        yield f"| {tree.stem} | {number} | {' | '.join(cells)} |"


def views() -> NDArray[np.float64]:
    """Return directions (n, 3) on a spiral over the upper three quarters of the sphere: `flat_views.directions`."""
    z = 1.0 - 1.5 * (np.arange(VIEWS) + 0.5) / VIEWS
    turn = np.arange(VIEWS) * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def facing(level: leafcloud.Level, view: NDArray[np.float64], bound: float) -> leafcloud.Foliage:
    """Return the level's billboards with at least this |cos| between normal and view, for views of either side."""
    across = np.cross(level.corners[:, 1] - level.corners[:, 0], level.corners[:, 2] - level.corners[:, 0])
    steep = np.abs(across @ view) / np.linalg.norm(across, axis=1)
    kept = steep >= bound
    corners, uvs = level.corners[kept], level.uvs[kept]
    count, each = corners.shape[:2]
    second = np.arange(1, each - 1)
    fan = np.stack([0 * second, second, second + 1], axis=1)
    triangles = (np.arange(count)[:, None, None] * each + fan).reshape(-1, 3)
    material = leafcloud.Material(
        image=level.base_color, alpha_mode="MASK", alpha_cutoff=level.alpha_cutoff, double_sided=not level.two_sided
    )
    return leafcloud.Foliage(corners.reshape(-1, 3), triangles, uvs=uvs.reshape(-1, 2), materials=[material])


def seen(frame: leafcloud.Foliage, models: list[leafcloud.Foliage], size: int) -> Pictures:
    """Render the models, one per view: (n, size, size, 4), linear light, premultiplied."""
    centre, radius = frame.centre.tolist(), frame.radius
    shown = [
        leafcloud.render([model], view.tolist(), size, centre=centre, radius=radius)
        for model, view in zip(models, views(), strict=True)
    ]
    codes = np.stack(shown) / 255.0
    light = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    return np.concatenate([light[..., :3] * codes[..., 3:], codes[..., 3:]], axis=-1)


def difference(first: Pictures, second: Pictures) -> float:
    covered = (first[..., 3] > 0.0) | (second[..., 3] > 0.0)
    return float(np.sqrt(((first - second) ** 2)[covered].mean()))


if __name__ == "__main__":
    main()
