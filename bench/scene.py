"""What do the levels save in a scene? `make bench-scene`.

usage: make bench-scene ARGS='[PLANT.glb …]'
       (default: ../shared/foliage up to 10 MB, and all plants of tests/support/plants.py and unseen_trees.py)

Each plant is baked without settings. The scene is an even plantation to 50 and to 200 R, from the distance where one
crown fills the picture: pictures of 1080 lines, a vertical field of view of 50°. Beside it stand what else one might
use, made from the same leaves, each level at the largest size at which it passes the yardstick, or at the size that
its users give it:
- *halves*: meshoptimizer's simplification, pruned, to 1/2, 1/4 and 1/8 of the triangles at 1/2, 1/4 and 1/8 of the
  picture's height; the trunk has the same share,
- *published*: the literal algorithm, ε = 0.04 R, a page of 1024²,
- *cross*: the cross impostor alone.
Without plants it writes docs/bench/scene.md and scene.png.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshoptimizer
import numpy as np
from commits import measured_commit
from numpy.typing import NDArray
from plants import PLANTS, write
from stage import ROOT, bake_alone, measured_trees
from unseen_trees import TREES
from unseen_trees import write as write_unseen

import leafcloud
from addon.bake.drawing import drawing_costs, level_trunks
from addon.bake.part import described_part
from addon.bake.values import Baked
from addon.settings.bake import BakeSettings

DOCUMENT = ROOT / "docs" / "bench" / "scene.md"
PICTURE = DOCUMENT.with_suffix(".png")
SIDE, BESIDE = 256, 3
"""Greatest side of the pictures of leaves and level 1; plants in a row."""
SKY = np.array([140.0, 168.0, 199.0])
Bytes = NDArray[np.uint8]
LINES, PIXELS = 1080.0, 2313.0
"""Lines of the picture; diameter of a crown in pixels times its distance in R."""
HORIZONS = (50.0, 200.0)
HALVES = {0.5: 540.0, 0.25: 270.0, 0.125: 135.0}
"""Shares of the triangles, with the sizes in pixels at which they take over."""

INTRODUCTION = """# What the levels save in a scene

Made by `make bench-scene` on {commit}; the first lines of `bench/scene.py` tell how. *Triangles*, *fragments*: how
many times fewer a plantation needs than with leaves alone. *Takes over*: diameter of the crown in pixels.
*Difference*, *places*: over those of the leaves in a light breeze; *contrast*, *coverage*: over the leaves'. *Excess*:
the most that a figure uses of what is allowed (at most 1 passes). *MB*: compressed textures of all levels.

Leaves and level 1 of each plant, with their trunks, at the size where it takes over (at most {side} pixels):

![Leaves and level 1 of each plant](scene.png)
"""


@dataclass(frozen=True)
class Drawn:
    """A level in the scene: where it takes over, and what it costs there with its trunk.

    fragments: over those of the leaves at the same size. judged: its figures; None for the leaves.
    """

    name: str
    crown: float
    triangles: int
    fragments: float
    judged: leafcloud.Judgement | None = None


def saved(levels: Sequence[Drawn], horizon: float) -> tuple[float, float]:
    """Return how many times fewer triangles and fragments a plantation needs. The first level is the leaves."""
    near, starts = PIXELS / LINES, [PIXELS / level.crown for level in levels[1:]]
    triangles = fragments = 0.0
    for level, start, end in zip(levels, [0.0, *starts], [*starts, math.inf], strict=True):
        first, last = max(near, start), min(horizon, end)
        if last > first:
            triangles += level.triangles * (last**2 - first**2) / 2.0
            fragments += level.fragments * math.log(last / first)
    whole = levels[0].triangles * (horizon**2 - near**2) / 2.0
    return whole / triangles, math.log(horizon / near) / fragments


def ours(baked: Baked) -> list[Drawn]:
    """Return the leaves and the levels of a bake."""
    leaves, *costs = drawing_costs(baked)
    trunk = 0 if leaves.trunk is None else leaves.trunk["triangles"]
    found = [Drawn("leaves", math.inf, leaves.own["triangles"] + trunk, 1.0)]
    for level, cost, taken in zip(baked.chain.levels, costs, baked.chain.takes_over, strict=True):
        trunk = 0 if cost.trunk is None else cost.trunk["triangles"]
        share = cost.own["fragments"] / max(cost.leaves["fragments"], 1.0)
        found.append(Drawn(level.method, cost.crown_pixels, cost.own["triangles"] + trunk, share, taken["judged"]))
    return found


def megabytes(levels: Iterable[leafcloud.AnyLevel]) -> float:
    """Return the size of compressed textures: a byte a texel, and a third more for mip levels."""
    texels = 0
    for level in levels:
        if isinstance(level, leafcloud.OctahedralLevel):
            texels += 2 * level.texels
        elif isinstance(level, leafcloud.Level):
            pages = (level.base_color, level.normal, level.orm, level.translucency)
            texels += sum(math.prod(page.shape[:2]) for page in pages if page is not None)
    return texels * 4.0 / 3.0 / 2.0**20


def fragments_at(shown: leafcloud.Foliage, leaves: leafcloud.Foliage, crown: float) -> float:
    scale = crown / 2.0 / leaves.radius
    own, whole = (leafcloud.drawing_cost([each], scale)["fragments"] for each in (shown, leaves))
    return own / max(whole, 1.0)


def nearest(judged: Sequence[leafcloud.Judgement], crown: float) -> leafcloud.Judgement:
    return min(judged, key=lambda each: abs(math.log(each["crown_pixels"] / crown)))


def largest(judged: Sequence[leafcloud.Judgement]) -> float:
    """Return the largest judged size at which a level passes, or 10 pixels."""
    return max((each["crown_pixels"] for each in judged if each["excess"] <= 1.0), default=10.0)


def rivals(baked: Baked) -> dict[str, list[Drawn]]:
    """Return what else one might use, the leaves first."""
    prepared = baked.prepared
    leaves, trunk = prepared.foliage, prepared.trunk
    bare = 0 if trunk is None else trunk.triangle_count
    first = Drawn("leaves", math.inf, leaves.triangle_count + bare, 1.0)
    yardstick = leafcloud.Yardstick(leaves)

    def drawn(name: str, shown: leafcloud.Foliage, triangles: int, crown: float | None = None) -> Drawn:
        judged = yardstick.judge(shown)
        crown = largest(judged) if crown is None else crown
        return Drawn(name, crown, triangles, fragments_at(shown, leaves, crown), nearest(judged, crown))

    part = described_part(prepared.tree.leaves, prepared.tree.matrix, (), 0.0, None)
    halves = [first]
    for share, crown in HALVES.items():
        corners = simplified(prepared.tree.leaves, share)
        if len(corners):
            triangles = len(corners) + round(share * bare)
            halves.append(drawn(f"1/{1 / share:.0f}", part.of(corners).foliage(), triangles, crown))
    shape: dict[str, Any] = {"normals": 0.0, "every_level": True, "cross": False}
    cloud = leafcloud.build_chain(leaves, effort="literal", epsilon=0.04, levels=1, texture_size=1024, **shape).levels[
        0
    ]
    assert isinstance(cloud, leafcloud.Level)
    plain = leafcloud.build_chain(leaves, levels=0, cross=True, normals=0.0).clouds[-1]
    return {
        "halves": halves,
        "published": [first, drawn("cloud", cloud.foliage(), cloud.triangles + bare)],
        "cross": [first, drawn("cross", plain.foliage(), plain.triangles)],
    }


def simplified(geometry: Any, share: float) -> NDArray[np.int64]:
    """Return corners (n, 3) of the triangles that meshoptimizer keeps: indices as `DescribedGeometry.of` takes them."""
    triangles = geometry.triangles
    corners = np.arange(3 * len(triangles), dtype=np.uint32)
    positions = geometry.positions[triangles.ravel()].astype(np.float32)
    rows = [positions, geometry.normals.reshape(-1, 3)]
    if geometry.uvs is not None:
        rows.append(geometry.uvs.reshape(-1, 2))
    _, unique, places = np.unique(np.hstack(rows).astype(np.float32), axis=0, return_index=True, return_inverse=True)
    indices = places.reshape(-1).astype(np.uint32)[corners]
    kept = np.zeros_like(indices)
    vertices = np.ascontiguousarray(positions[unique])
    wanted = 3 * int(share * len(triangles))
    count = meshoptimizer.simplify(
        kept, indices, vertices, len(indices), len(unique), 12, wanted, 1.0, options=meshoptimizer.SIMPLIFY_PRUNE
    )
    return unique[kept[:count]].reshape(-1, 3).astype(np.int64)


def beside(baked: Baked) -> Bytes:
    """Return pictures of the leaves and of level 1 with their trunks, at its hand-over."""
    prepared, level = baked.prepared, baked.chain.levels[0]
    side = max(16, min(SIDE, round(baked.chain.takes_over[0]["crown_pixels"])))
    trunk, thin = level_trunks(baked)[:2]
    own = level if isinstance(level, leafcloud.OctahedralLevel) else level.foliage()
    view: dict[str, Any] = {
        "centre": prepared.foliage.world_centre,
        "radius": prepared.foliage.radius,
        "sun": (0.5, -0.5, 0.7),
    }
    sheet = np.empty((SIDE + 24, 2 * SIDE + 8, 3))
    sheet[:] = SKY
    text = leafcloud.draw_text(prepared.tree.name, 16.0)[:, : 2 * SIDE]
    sheet[2 : 2 + len(text), 4 : 4 + text.shape[1]] *= 1.0 - text[..., None] / 255.0
    for number, (shown, wood) in enumerate(((prepared.foliage, trunk), (own, thin))):
        if isinstance(shown, leafcloud.OctahedralLevel):
            picture = shown.render((0.9, 0.4, 0.2), side, **view)
        else:
            picture = leafcloud.render([shown, *([wood] if wood else [])], (0.9, 0.4, 0.2), side, **view)
        alpha = picture[..., 3:] / 255.0
        top, left = 24 + (SIDE - side) // 2, number * (SIDE + 8) + (SIDE - side) // 2
        sheet[top : top + side, left : left + side] = picture[..., :3] * alpha + SKY * (1.0 - alpha)
    return sheet.astype(np.uint8)


def sheet_of(pictures: Sequence[Bytes]) -> Bytes:
    """Return all pictures in rows, opaque."""
    empty = np.full_like(pictures[0], SKY.astype(np.uint8))
    filled = [*pictures, *[empty] * (-len(pictures) % BESIDE)]
    rows = [np.hstack(filled[first : first + BESIDE]) for first in range(0, len(filled), BESIDE)]
    whole = np.vstack(rows)
    return np.dstack([whole, np.full(whole.shape[:2], 255, np.uint8)])


def lines_of(name: str, levels: Sequence[Drawn], memory: float | None) -> list[str]:
    """Return the row of a chain, and those of its levels."""
    figures = [f"{value:.2f}" for horizon in HORIZONS for value in saved(levels, horizon)]
    size = "" if memory is None else f"{memory:.1f}"
    lines = [f"| **{name}** | {levels[0].triangles:,} | | {' | '.join(figures)} | {size} | | | | | |"]
    for level in levels[1:]:
        judged = level.judged
        assert judged is not None
        contrast = " ".join(f"{each:.2f}" for each in judged["contrast"])
        lines.append(
            f"| {level.name} | {level.triangles:,} | {level.crown:.0f} | | {level.fragments:.2f} | | | | "
            f"{judged['difference']:.2f} | {judged['places']:.2f} | {contrast} | {judged['coverage']:.3f} | "
            f"{judged['excess']:.2f} {judged['by']} |"
        )
    return lines


HEAD = [
    "| | triangles | takes over | triangles to 50 R | fragments to 50 R | to 200 R | fragments | MB | difference "
    "| places | contrast | coverage | excess |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
]


def geometric(rows: Sequence[tuple[float, float]]) -> str:
    means = (math.exp(sum(math.log(row[k]) for row in rows) / len(rows)) for k in (0, 1))
    return " and ".join(f"{mean:.2f}" for mean in means)


def measured(plants: Sequence[Path]) -> tuple[list[str], Bytes]:
    """Return the lines of the document, and its picture."""
    tables, chains, pictures = [], dict[str, list[Sequence[Drawn]]](), []
    for plant in plants:
        started = time.perf_counter()
        baked = bake_alone(plant, BakeSettings())
        seconds = time.perf_counter() - started
        found = {"ours": ours(baked), **rivals(baked)}
        memory = megabytes(baked.chain.levels)
        pictures.append(beside(baked))
        lines = [f"\n## {plant.stem}\n", f"Baked in {seconds:.0f} s.\n", *HEAD]
        for name, levels in found.items():
            lines += lines_of(name, levels, memory if name == "ours" else None)
            chains.setdefault(name, []).append(levels)
        print("\n".join(lines), flush=True)
        tables += lines
    whole = ["| | to 50 R: triangles and fragments | to 200 R | first level takes over, median |", "|---|---|---|---|"]
    for name, all_levels in chains.items():
        means = [geometric([saved(levels, horizon) for levels in all_levels]) for horizon in HORIZONS]
        sizes = [levels[1].crown for levels in all_levels if len(levels) > 1]
        whole.append(f"| {name} | {' | '.join(means)} | {np.median(sizes):.0f} |")
    print("\n".join(whole))
    return [f"Geometric means over {len(plants)} plants:\n", *whole, *tables], sheet_of(pictures)


def all_plants(folder: Path) -> list[Path]:
    """Return the files of the measured trees, and of all plants that are made from numbers, written into a folder."""
    made = [write(name, folder) for name in PLANTS] + [write_unseen(name, folder) for name in TREES]
    return [*measured_trees(), *made]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("plants", nargs="*", type=Path)
    given = parser.parse_args().plants
    with tempfile.TemporaryDirectory() as folder:
        lines, picture = measured(given or all_plants(Path(folder)))
    if not given:
        PICTURE.write_bytes(leafcloud.encode_png([picture], colors=256))
        DOCUMENT.write_text(INTRODUCTION.format(commit=measured_commit(), side=SIDE) + "\n" + "\n".join(lines) + "\n")
        print(f"{DOCUMENT} is written", file=sys.stderr)


if __name__ == "__main__":
    main()
