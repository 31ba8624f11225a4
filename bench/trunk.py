"""Measures the trunk of each level: `make bench-trunk`.

usage: python bench/trunk.py [TREE.glb …]      (default: all of ../shared/foliage with a trunk)

Measures each cloud of a bake with default settings: the triangles of the original and of the simplified trunk, and
the distance between the two as a fraction of R. Then, in 8 views with the pixel size of the level's switch: the
coverage of the trunk relative to the original; the overlap of the two silhouettes (intersection over union of alpha >
½); and both numbers for the whole level. Last the trunk's graphics memory, and the number and memory of the
billboards that would show it with the same error and the level's texel size. Prints a table in Markdown; for all
trees it also writes docs/bench/trunk.md.
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

FOLIAGE = ROOT.parent / "shared" / "foliage"
VIEWS = [(math.cos(a), math.sin(a), 0.2) for a in np.arange(8) * math.pi / 4.0]
HEADER = (
    *("tree", "level", "original", "shown", "error / R", "coverage", "overlap", "level's coverage", "level's overlap"),
    *("KiB", "as billboards", "their KiB"),
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
        baked = finish(prepared, start(prepared).result(), "tree", view_of(bpy.context.scene))
        table += ["| " + " | ".join([path.stem, *row]) + " |" for row in rows(baked)]
    print("\n".join(table))
    if not trees:
        (ROOT / "docs" / "bench" / "trunk.md").write_text("\n".join([*table, ""]), encoding="utf-8")


def rows(baked: Baked) -> Iterator[list[str]]:
    """Yield a row for each cloud. LOD 0 and the cross impostor have no simplified trunk."""
    radius = baked.prepared.foliage.radius
    bpy.context.scene.collection.children.link(baked.collection)
    bpy.context.view_layer.update()
    came = seen(baked.levels[0].trunk)
    for level, built in zip(baked.chain.levels, baked.levels[1:], strict=True):
        if level.cloud is None:
            continue
        shown, leaves = seen(built.trunk), [level.foliage()]
        pixel = 2.0 * math.tan(baked.view.field_of_view / 2.0) * baked.switch_distances[built.number]
        size = max(16, round(2.0 * came[0].radius * baked.view.resolution / pixel))
        ratios = (*compared(came, shown, size), *compared(leaves + came, leaves + shown, size))
        counts = (baked.levels[0].trunk_triangles, built.trunk_triangles)
        numbers = [*map(str, counts), f"{built.trunk_error / radius:.4f}", *(f"{ratio:.3f}" for ratio in ratios)]
        memory = [f"{mesh_bytes(built.trunk) / 1024:.0f}", *as_billboards(came[0], level, built.trunk_error)]
        yield [f"{built.number} ({size} px)", *numbers, *memory]


def mesh_bytes(trunk: bpy.types.Object | None) -> int:
    """Return the bytes of an object's corners and of three indices per triangle; 0 without an object."""
    return 0 if trunk is None else CORNER_BYTES * len(trunk.data.vertices) + 4 * len(trunk.data.loops)


def as_billboards(trunk: leafcloud.Foliage, level: leafcloud.Level, error: float) -> tuple[str, str]:
    """Fit billboards to `trunk` within `error`; return their number and their KiB (corners, texels with mips)."""
    if error == 0.0:
        return "–", "–"
    epsilon = min(error / trunk.radius, 1.0)
    [own] = leafcloud.build_chain(trunk, levels=1, cross=False, epsilon=epsilon, texture_size=1024).levels
    texels = own.texels * (own.texel_size / level.texel_size) ** 2
    nbytes = CORNER_BYTES * own.corners.size / 3 + 4.0 * texels * 4.0 / 3.0
    return str(len(own.corners)), f"{nbytes / 1024:.0f}"


def seen(trunk: bpy.types.Object | None) -> list[leafcloud.Foliage]:
    """Return a triangle mesh object as foliage, in a list; an empty list without an object."""
    if trunk is None:
        return []
    positions = np.empty((len(trunk.data.vertices), 3), np.float32)
    trunk.data.vertices.foreach_get("co", positions.ravel())
    corners = np.empty(len(trunk.data.loops), np.int32)
    trunk.data.loops.foreach_get("vertex_index", corners)
    matrix = np.array(trunk.matrix_world)
    return [leafcloud.Foliage(positions, corners.reshape(-1, 3), matrix=matrix)]


def compared(came: Sequence[leafcloud.Foliage], shown: Sequence[leafcloud.Foliage], size: int) -> tuple[float, float]:
    """Return the coverage of `shown` relative to `came`, and their overlap, in views around the last item of `came`."""
    centre, radius = came[-1].world_centre.tolist(), came[-1].radius

    def alpha(parts: Sequence[leafcloud.Foliage]) -> NDArray[np.float64]:
        views = [leafcloud.render(parts, view, size, centre=centre, radius=radius) for view in VIEWS]
        return np.stack(views)[..., 3] / 255.0

    before = alpha(came)
    after = alpha(shown) if shown else np.zeros_like(before)
    both, either = ((before > 0.5) & (after > 0.5)).sum(), ((before > 0.5) | (after > 0.5)).sum()
    return float(after.sum() / before.sum()), float(both / max(either, 1))


if __name__ == "__main__":
    main()
