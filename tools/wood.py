"""Measures the wood beside each level: `make wood`.

usage: python tools/wood.py [TREE.glb …]      (default: all of ../shared/foliage that have wood)

For each tree and cloud of a bake with the usual settings: triangles of the wood that came and of what is shown; how far
that lies from what came, as a share of R. Then, in 8 views around it in which a pixel is what it is where the level
takes over: what the wood alone covers, over what it covered; the overlap of the two silhouettes (intersection over
union of alpha > ½); and the same two numbers of the whole level. At last what the wood takes in graphics memory, and
how many billboards would show it with the same error, and take with texels as large as those of the level. Prints a
table in Markdown; for all trees it also writes docs/bench/wood.md.
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
from addon.baked import Baked  # noqa: E402
from addon.pipeline import finish, prepare, start, view_of  # noqa: E402
from addon.scene.extract import extract  # noqa: E402
from addon.scene.load import load  # noqa: E402
from addon.settings import BakeSettings  # noqa: E402

FOLIAGE = ROOT.parent / "shared" / "foliage"
VIEWS = [(math.cos(a), math.sin(a), 0.2) for a in np.arange(8) * math.pi / 4.0]
HEADER = (
    *("tree", "level", "came", "shown", "error / R", "coverage", "overlap", "level's coverage", "level's overlap"),
    *("KiB", "as billboards", "their KiB"),
)
CORNER_BYTES = 32
"""Position, normal, texture coordinates."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    trees = parser.parse_args().trees
    table = ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    for path in trees or sorted(FOLIAGE.glob("*.glb")):
        load(path)
        tree = extract(bpy.context.evaluated_depsgraph_get(), None)
        if tree.wood is None:
            continue
        prepared = prepare(tree, BakeSettings())
        baked = finish(prepared, start(prepared).result(), "tree", view_of(bpy.context.scene))
        table += ["| " + " | ".join([path.stem, *row]) + " |" for row in rows(baked)]
    print("\n".join(table))
    if not trees:
        (ROOT / "docs" / "bench" / "wood.md").write_text("\n".join([*table, ""]), encoding="utf-8")


def rows(baked: Baked) -> Iterator[list[str]]:
    """One for each level that may have wood beside it, but for LOD 0."""
    radius = baked.prepared.foliage.radius
    bpy.context.scene.collection.children.link(baked.collection)
    bpy.context.view_layer.update()
    came = seen(baked.levels[0].wood)
    for level, built in zip(baked.chain.levels, baked.levels[1:], strict=True):
        if level.cloud is None:
            continue
        shown, leaves = seen(built.wood), [level.foliage()]
        pixel = 2.0 * math.tan(baked.view.field_of_view / 2.0) * baked.switch_distances[built.number]
        size = max(16, round(2.0 * came[0].radius * baked.view.resolution / pixel))
        ratios = (*compared(came, shown, size), *compared(leaves + came, leaves + shown, size))
        counts = (baked.levels[0].wood_triangles, built.wood_triangles)
        numbers = [*map(str, counts), f"{built.wood_error / radius:.4f}", *(f"{ratio:.3f}" for ratio in ratios)]
        memory = [f"{mesh_bytes(built.wood) / 1024:.0f}", *as_billboards(came[0], level, built.wood_error)]
        yield [f"{built.number} ({size} px)", *numbers, *memory]


def mesh_bytes(wood: bpy.types.Object | None) -> int:
    """Corners, and three indices for each triangle."""
    return 0 if wood is None else CORNER_BYTES * len(wood.data.vertices) + 4 * len(wood.data.loops)


def as_billboards(wood: leafcloud.Foliage, level: leafcloud.Level, error: float) -> tuple[str, str]:
    """How many billboards lie no farther than `error` from `wood`, and their KiB: corners, texels with their mips."""
    if error == 0.0:
        return "–", "–"
    epsilon = min(error / wood.radius, 1.0)
    [own] = leafcloud.build_chain(wood, levels=1, cross=False, epsilon=epsilon, texture_size=1024).levels
    texels = own.texels * (own.texel_size / level.texel_size) ** 2
    nbytes = CORNER_BYTES * own.corners.size / 3 + 4.0 * texels * 4.0 / 3.0
    return str(len(own.corners)), f"{nbytes / 1024:.0f}"


def seen(wood: bpy.types.Object | None) -> list[leafcloud.Foliage]:
    """The object, whose faces are triangles, as something to look at in the world; nothing of none."""
    if wood is None:
        return []
    positions = np.empty((len(wood.data.vertices), 3), np.float32)
    wood.data.vertices.foreach_get("co", positions.ravel())
    corners = np.empty(len(wood.data.loops), np.int32)
    wood.data.loops.foreach_get("vertex_index", corners)
    matrix = np.array(wood.matrix_world)
    return [leafcloud.Foliage(positions @ matrix[:3, :3].T + matrix[:3, 3], corners.reshape(-1, 3))]


def compared(came: Sequence[leafcloud.Foliage], shown: Sequence[leafcloud.Foliage], size: int) -> tuple[float, float]:
    """Coverage of `shown` over that of `came`, and the overlap of the two, in views around what came last."""
    centre, radius = came[-1].centre.tolist(), came[-1].radius

    def alpha(parts: Sequence[leafcloud.Foliage]) -> NDArray[np.float64]:
        views = [leafcloud.render(parts, view, size, centre=centre, radius=radius) for view in VIEWS]
        return np.stack(views)[..., 3] / 255.0

    before = alpha(came)
    after = alpha(shown) if shown else np.zeros_like(before)
    both, either = ((before > 0.5) & (after > 0.5)).sum(), ((before > 0.5) | (after > 0.5)).sum()
    return float(after.sum() / before.sum()), float(both / max(either, 1))


if __name__ == "__main__":
    main()
