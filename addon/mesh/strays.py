"""Leaves far away from all others: a forgotten card, or the prototype of a particle system. ε is a share of the crown's
radius, so one of them would spoil all levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry import Geometry
from .realise import Triangles, used_only

_FAR = 3.0
"""Distance from the crown's middle, over that of 99 % of the leaves' area."""
_MOST = 0.99


def without_strays(leaves: Geometry) -> tuple[Geometry, list[str]]:
    """Return the leaves without those far away from the others, and a sentence on these. O(t log t)."""
    corners = leaves.positions[leaves.triangles].astype(np.float64)
    a, b, c = corners.transpose(1, 0, 2)
    areas, middles = np.linalg.norm(np.cross(b - a, c - a), axis=1), corners.mean(axis=1)
    if not areas.sum() > 0.0:
        return leaves, []
    centre = [_share_of_area(middles[:, axis], areas, 0.5) for axis in range(3)]
    distances = np.linalg.norm(middles - centre, axis=1)
    usual = _share_of_area(distances, areas, _MOST)
    far = distances > _FAR * usual
    if leaves.protected is not None:
        far &= ~leaves.protected
    if not far.any() or usual == 0.0:
        return leaves, []
    source = Triangles(
        leaves.positions,
        leaves.triangles,
        leaves.normals,
        leaves.uvs,
        leaves.colors,
        leaves.material_ids,
        np.zeros(len(leaves.triangles), np.float32) if leaves.randoms is None else leaves.randoms,
        leaves.protected,
    )
    kept = used_only(source, ~far)
    times = distances.max() / usual
    said = (
        f"leaf triangles left out: {far.sum()} of {len(far)}. The farthest lies {times:.0f} times as far from the "
        "crown's middle as 99 % of the leaves; move or delete them"
    )
    return (
        replace(
            leaves,
            positions=kept.positions,
            triangles=kept.triangles,
            normals=kept.normals,
            uvs=kept.uvs,
            colors=kept.colors,
            material_ids=kept.material_ids,
            randoms=None if leaves.randoms is None else kept.randoms,
            protected=kept.protected,
        ),
        [said],
    )


def _share_of_area(values: NDArray[np.float64], areas: NDArray[np.float64], share: float) -> float:
    """Return the value that this share of the area does not exceed."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(areas[order])
    return float(values[order[np.searchsorted(below, share * below[-1])]])
