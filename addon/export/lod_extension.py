"""All levels in one GLB file by `MSFT_lod`. A viewer that ignores the extension shows the leaves only.

The scene contains only the node of each tree's level 0. The extension on that node lists the nodes of the other levels,
which are in no scene.

`extras.MSFT_screencoverage` of the node has a number for each level: the fraction of the image height that the crown's
bounding sphere covers at the distance where the next level takes over. The last level's is 0. The extension does not
define coverage exactly; its importer UnityGLTF reads it as a fraction of the height.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..plan.lod_range import View
from .glb_file import Glb

EXTENSION = "MSFT_lod"
COVERAGE = "MSFT_screencoverage"


@dataclass(frozen=True)
class LodChain:
    """The node names of one tree's levels, LOD 0 first, and the screen coverage down to which each level is drawn."""

    names: tuple[str, ...]
    coverages: tuple[float, ...]


def screen_coverages(switch_distances: Sequence[float], radius: float, view: View) -> tuple[float, ...]:
    """Return for each level the fraction of the image height that the sphere covers where the next level takes over.

    `switch_distances` rise from 0, in the unit of `radius`. The fractions are in [0, 1]; the last one is 0.
    """
    tangent = math.tan(view.field_of_view / 2.0)
    return (*(min(radius / (distance * tangent), 1.0) for distance in switch_distances[1:]), 0.0)


def add_lods(glb: Glb, chains: Iterable[LodChain]) -> None:
    """Add `MSFT_lod` to level 0 of each tree, and remove the other levels from the scene."""
    document = glb.document
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
    glb.use_extension(EXTENSION)
    glb.align()  # As in files of earlier releases, so that the same tree gives the same bytes.
