"""Measures the trunk of each level: `make bench-trunk`.

usage: python bench/trunk.py [TREE.glb …]      (default: all of ../shared/foliage with a trunk)

Measures each cloud of a bake with default settings: the triangles of the cloud, of the original and of the simplified
trunk, the change of the pictures that the simplification reports, and its seconds. Then, in 8 views with the pixel size
of the level's switch, which are not the simplification's: the coverage of the trunk relative to the original; the
overlap of the two silhouettes (intersection over union of alpha > ½); both numbers for the level with its trunk; and
the mean difference of colors over gray, as a share of the level's area, beside the same difference without any trunk.
Last the trunk's graphics memory, and the number and memory of the billboards that would show it with an error of two
pixels and the level's texel size. Prints a table in Markdown; for all trees it also writes docs/bench/trunk.md.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402

import leafcloud  # noqa: E402
from addon.bake.pipeline import finish, prepare, start, view_of  # noqa: E402
from addon.bake.values import Baked  # noqa: E402
from addon.mesh.extract import extract  # noqa: E402
from addon.scene.load import load  # noqa: E402
from addon.settings.bake import BakeSettings  # noqa: E402
from addon.steps import all_steps  # noqa: E402

FOLIAGE = ROOT.parent / "shared" / "foliage"
VIEWS = [(math.cos(a), math.sin(a), 0.2) for a in np.arange(8) * math.pi / 4.0]
HEADER = (
    *("tree", "level", "billboards", "original", "shown", "change", "seconds", "coverage", "overlap"),
    *("level's coverage", "level's overlap", "colors", "without trunk", "KiB", "as billboards", "their KiB"),
)
CORNER_BYTES = 32
"""Bytes of a corner: position, normal, texture coordinates."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    trees = parser.parse_args().trees
    table = ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    for path in trees or sorted(FOLIAGE.glob("*.glb")):
        load(path)
        tree = extract(bpy.context.evaluated_depsgraph_get(), None)
        if tree.trunk is None:
            continue
        prepared = prepare(tree, BakeSettings())
        baked = all_steps(finish(prepared, start(prepared).result(), "tree", view_of(bpy.context.scene)))
        table += ["| " + " | ".join([path.stem, *row]) + " |" for row in rows(baked)]
    print("\n".join(table))
    if not trees:
        (ROOT / "docs" / "bench" / "trunk.md").write_text("\n".join([*table, ""]), encoding="utf-8")


def rows(baked: Baked) -> Iterator[list[str]]:
    """Yield a row for each cloud. LOD 0 and the cross impostor have no simplified trunk."""
    bpy.context.scene.collection.children.link(baked.collection)
    bpy.context.view_layer.update()
    came, part = baked.prepared.trunk, baked.prepared.trunk_part
    assert came is not None
    assert part is not None
    for level, built in zip(baked.chain.levels, baked.levels[1:], strict=True):
        if level.cloud is None:
            continue
        corners = built.trunk_corners
        shown = came if corners is None else part.of(corners).foliage() if len(corners) else None
        leaves, pixel = level.foliage(), baked.schedule.trunk_pixels[built.number - 1]
        size = max(16, round(2.0 * came.radius / pixel))
        before, after, bare = (pictures(parts, came, size) for parts in ([leaves, came], [leaves, shown], [leaves]))
        ratios = (*compared(pictures([came], came, size), pictures([shown], came, size)), *compared(before, after))
        counts = (built.triangles, baked.levels[0].trunk_triangles, built.trunk_triangles)
        seconds = f"{baked.costs.seconds['trunk_levels']:.2f}" if built.number == 1 else ""
        numbers = [*map(str, counts), f"{built.trunk_change:.4f}", seconds, *(f"{ratio:.3f}" for ratio in ratios)]
        colors = [f"{difference(before, other):.4f}" for other in (after, bare)]
        memory = [f"{mesh_bytes(built.trunk) / 1024:.0f}", *as_billboards(came, level, 2.0 * pixel)]
        yield [f"{built.number} ({size} px)", *numbers, *colors, *memory]


def mesh_bytes(trunk: bpy.types.Object | None) -> int:
    """Return the bytes of an object's corners and of three indices per triangle; 0 without an object."""
    return 0 if trunk is None else CORNER_BYTES * len(trunk.data.vertices) + 4 * len(trunk.data.loops)


def as_billboards(trunk: leafcloud.Foliage, level: leafcloud.Level, error: float) -> tuple[str, str]:
    """Fit billboards to `trunk` within `error`; return their number and their KiB (corners, texels with mips)."""
    epsilon = min(error / trunk.radius, 1.0)
    [own] = leafcloud.build_chain(trunk, levels=1, cross=False, epsilon=epsilon, texture_size=1024).clouds
    texels = own.texels * (own.texel_size / level.texel_size) ** 2
    nbytes = CORNER_BYTES * own.corners.size / 3 + 4.0 * texels * 4.0 / 3.0
    return str(len(own.corners)), f"{nbytes / 1024:.0f}"


def pictures(parts: Sequence[leafcloud.Foliage | None], around: leafcloud.Foliage, size: int) -> NDArray[np.float64]:
    """Return pictures (views, size, size, 4) of the parts, in [0, 1], around the sphere of `around`."""
    there = [part for part in parts if part is not None]
    if not there:
        return np.zeros((len(VIEWS), size, size, 4))
    centre, radius = around.world_centre.tolist(), around.radius
    return np.stack([leafcloud.render(there, view, size, centre=centre, radius=radius) for view in VIEWS]) / 255.0


def compared(before: NDArray[np.float64], after: NDArray[np.float64]) -> tuple[float, float]:
    """Return the coverage of `after` relative to `before`, and the overlap of their silhouettes."""
    a, b = before[..., 3], after[..., 3]
    both, either = ((a > 0.5) & (b > 0.5)).sum(), ((a > 0.5) | (b > 0.5)).sum()
    return float(b.sum() / a.sum()), float(both / max(either, 1))


def difference(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Return the sum of the color differences over mid-gray, by the area of `before`."""
    a, b = (each[..., :3] * each[..., 3:] + 0.5 * (1.0 - each[..., 3:]) for each in (before, after))
    return float(np.abs(a - b).mean(axis=-1).sum() / before[..., 3].sum())


if __name__ == "__main__":
    main()
