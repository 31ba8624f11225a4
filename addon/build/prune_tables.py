"""What engines prune by: how much of the index buffer to draw for each λ, and the areas that give the scale."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cloud_mesh import Surface

PREFIX_STEPS = 64
"""The table of prefixes has one entry per λ = 0, 1/64 … 1, that of areas one per rank 0, (1/64)² … 1."""


def prefix_table(surface: Surface, ranks: NDArray[np.float32]) -> list[dict[str, Any]]:
    """For each material in use its index and how many triangles, from the first, have a rank below λ = 0, 1/64 … 1.

    `ranks` (f,) rise among the faces of a material.
    """
    keep = np.arange(PREFIX_STEPS + 1, dtype=np.float32) / np.float32(PREFIX_STEPS)
    table = []
    for material in np.unique(surface.material_ids):
        faces = np.flatnonzero(surface.material_ids == material)
        triangles = np.concatenate([[0], np.cumsum(surface.sizes[faces] - 2)])
        prefixes = triangles[np.searchsorted(ranks[faces], keep, side="left")]
        table.append({"material": int(material), "triangles": prefixes.tolist()})
    return table


def area_shares(areas: NDArray[np.float32], ranks: NDArray[np.float32]) -> list[float]:
    """The share of the area that has a rank below (i/64)², i = 0 … 64: what engines take the scale s from.

    The squares tell few leaves apart, where s is large. `areas` and `ranks` (f,) are those of all faces; what is never
    pruned, of a negative rank, does not count. All 0 where nothing has an area.
    """
    order = np.argsort(ranks, kind="stable")
    below = np.concatenate([[0.0], np.cumsum(np.where(ranks < 0.0, 0.0, areas)[order], dtype=np.float64)])
    knots = (np.arange(PREFIX_STEPS + 1, dtype=np.float32) / np.float32(PREFIX_STEPS)) ** 2
    sums = below[np.searchsorted(ranks[order], knots, side="left")]
    return (sums / (below[-1] or 1.0)).tolist()
