"""Measures the cost and the accuracy of splitting billboards for alpha blending: `make bench-blending`.

usage: python bench/blending.py [TREE.glb …]

Splits level 1 of each tree with several limits on the number of pieces. Rays from six eyes cross the crown. Among all
pairs of triangles on a ray it counts the pairs drawn in the wrong order, the nearer first. For comparison it counts the
same with whole triangles sorted by the distance of their centers. Prints a table in Markdown; for all trees it also
writes docs/bench/blending.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
TREES = ("pine_cards_20k", "oak_cards_11k", "bush_ash_5k", "maple_13k", "shapespark_tree1")
MOST = (1, 4, 16, 64)
EYES, RAYS, AWAY = 6, 60, 6.0

Triangles = NDArray[np.float64]
Drawing = Callable[[NDArray[np.float64]], Triangles]


def main() -> None:
    named = [Path(name) for name in sys.argv[1:]]
    trees = named or [FOLIAGE / f"{name}.glb" for name in TREES]
    columns = [f"{most} ×: triangles, seconds, wrong" for most in MOST]
    lines = [
        "Level 1 split for alpha blending, by maximum pieces per triangle; and sorted without splitting.",
        "",
        f"| tree | leaves' triangles | billboards' | {' | '.join(columns)} | sorted by centers: wrong |",
        "|---" * (len(MOST) + 4) + "|",
    ]
    for tree in trees:
        lines.append(row(tree))
        print(lines[-1], flush=True)
    if not named:
        (ROOT / "docs" / "bench" / "blending.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def row(tree: Path) -> str:
    foliage = leafcloud.read_gltf(str(tree))
    [level] = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=1024, blended=True).clouds
    count, corners = level.corners.shape[:2]
    second = np.arange(1, corners - 1)
    fan = np.stack([0 * second, second, second + 1], axis=1)
    triangles = (np.arange(count)[:, None, None] * corners + fan).reshape(-1, 3)
    positions = level.corners.reshape(-1, 3)
    eyes = Eyes(np.asarray(foliage.centre), foliage.radius)
    cells = []
    for most in MOST:
        begun = time.perf_counter()
        order = leafcloud.blend_order(positions, triangles, most=most * len(triangles))
        seconds = time.perf_counter() - begun
        wrong = eyes.wrong(from_tree(order, positions[triangles]))
        cells.append(f"{len(order.triangles)}, {seconds:.2f}, {100 * wrong:.0f} %")
    wrong = eyes.wrong(by_middles(positions[triangles]))
    return f"| {tree.stem} | {foliage.triangle_count} | {len(triangles)} | {' | '.join(cells)} | {100 * wrong:.0f} % |"


class Eyes:
    """Fixed random rays through a crown, from eyes all around it."""

    def __init__(self, centre: NDArray[np.float64], radius: float) -> None:
        random = np.random.default_rng(1)
        directions = random.normal(size=(EYES, 3))
        self.eyes = centre + AWAY * radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        self.aims = centre + 0.7 * radius * random.uniform(-1.0, 1.0, (EYES, RAYS, 3))

    def wrong(self, drawing: Drawing) -> float:
        """Return the fraction of pairs, over all rays, whose nearer triangle is drawn first."""
        wrong = pairs = 0
        for eye, aims in zip(self.eyes, self.aims, strict=True):
            drawn = drawing(eye)
            for aim in aims:
                away = met(drawn, eye, aim - eye)
                first, later = np.triu_indices(len(away), 1)
                wrong += int((away[first] < away[later] - 1e-6).sum())
                pairs += len(first)
        return wrong / pairs


def met(triangles: Triangles, eye: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances, in units of `along`, to the triangles (t, 3, 3) that a ray hits, in their order."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.cross(u, v) @ along
    start = eye - a
    s = np.cross(start, v) @ along / area
    t = (np.cross(u, start) * along).sum(axis=1) / area
    away = -(np.cross(u, v) * start).sum(axis=1) / area
    return away[(s > 0.0) & (t > 0.0) & (s + t < 1.0) & (away > 0.0)]


def from_tree(order: Any, triangles: Triangles) -> Drawing:
    pieces = (triangles[order.sources] * order.weights[:, :, None]).sum(axis=1)[order.triangles]

    def drawn(eye: NDArray[np.float64]) -> Triangles:
        numbers: list[int] = []
        waiting = [(0, False)]
        while waiting:
            node, ready = waiting.pop()
            if ready:
                numbers.extend(range(*order.ranges[node]))
                continue
            front, back = order.children[node]
            near, far = (front, back) if order.planes[node, :3] @ eye > order.planes[node, 3] else (back, front)
            waiting += [entry for entry in ((near, False), (node, True), (far, False)) if entry[0] >= 0]
        return pieces[numbers]

    return drawn


def by_middles(triangles: Triangles) -> Drawing:
    return lambda eye: triangles[np.argsort(-np.linalg.norm(triangles.mean(axis=1) - eye, axis=1))]


if __name__ == "__main__":
    main()
