"""The levels of a whole chain in a GLB file: `MSFT_lod`, so that every viewer shows the leaves, and nothing in them.

The scene has the node of each tree's level 0 alone, with its trunk. The extension on that node names those of the other
levels, which lie in no scene, each with its own trunk as its child. `extras.MSFT_screencoverage` beside it has for each
level the share of the picture's height down to which it is drawn: how much of it the crown's sphere covers where the
next level takes over. The last level is drawn down to 0. The extension's text does not say of what coverage is a share;
the importer that reads it, UnityGLTF, takes it for a share of the height.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..plan.reach import View
from .glb_file import read_glb, write_glb

EXTENSION = "MSFT_lod"
COVERAGE = "MSFT_screencoverage"


@dataclass(frozen=True)
class LodChain:
    """The names of the nodes of one tree's levels, the leaves first, and down to which coverage each is drawn."""

    names: tuple[str, ...]
    coverages: tuple[float, ...]


def screen_coverages(switch_distances: Sequence[float], radius: float, view: View) -> tuple[float, ...]:
    """For each level the share of the picture's height, in [0, 1], that the sphere covers where the next takes over.

    `switch_distances` rise from 0 and have the unit of `radius`; the last share is 0.
    """
    tangent = math.tan(view.field_of_view / 2.0)
    return (*(min(radius / (distance * tangent), 1.0) for distance in switch_distances[1:]), 0.0)


def add_lods(path: Path, chains: Iterable[LodChain]) -> None:
    """Hangs the levels of each tree in the GLB file at `path` on its level 0, and takes them out of the scene."""
    document, binary = read_glb(path)
    numbers = {node["name"]: number for number, node in enumerate(document["nodes"])}
    behind: set[int] = set()
    for chain in chains:
        first, *ids = (numbers[name] for name in chain.names)
        node = document["nodes"][first]
        node.setdefault("extensions", {})[EXTENSION] = {"ids": ids}
        node.setdefault("extras", {})[COVERAGE] = list(chain.coverages)
        behind.update(ids)
    for scene in document["scenes"]:
        scene["nodes"] = [number for number in scene["nodes"] if number not in behind]
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", []), EXTENSION})
    write_glb(path, document, binary)
