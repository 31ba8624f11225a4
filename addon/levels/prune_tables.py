"""Pruning tables for engines: the part of the index buffer to draw for each λ, and the areas that give the scale s."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import MeshFaces

PREFIX_STEPS = 64
"""Steps of both tables. Prefixes have one entry per λ = 0, 1/64 … 1, areas one per rank 0, (1/64)² … 1."""


def prefix_table(surface: MeshFaces, ranks: NDArray[np.float32]) -> list[dict[str, Any]]:
    """Return, for each used material, its index and the numbers of triangles with a rank below λ = 0, 1/64 … 1.

    Each number counts from the material's first triangle. `ranks` (f,) ascend among the faces of a material.
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
    """Return the fraction of the area with a rank below (i/64)², i = 0 … 64. Engines compute the scale s from it.

    The squares give a finer step where few leaves are left and s is large. `areas` and `ranks` (f,) are of all faces.
    Protected faces, of negative rank, do not count. All fractions are 0 if no face has an area.
    """
    order = np.argsort(ranks, kind="stable")
    below = np.concatenate([[0.0], np.cumsum(np.where(ranks < 0.0, 0.0, areas)[order], dtype=np.float64)])
    knots = (np.arange(PREFIX_STEPS + 1, dtype=np.float32) / np.float32(PREFIX_STEPS)) ** 2
    sums = below[np.searchsorted(ranks[order], knots, side="left")]
    return (sums / (below[-1] or 1.0)).tolist()
