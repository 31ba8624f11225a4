"""Share of a mesh's corners on texture seams, which simplification has to keep.

Corners are compared by a hash of their bits, because sorting a million rows would take longer than the plan.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .extract import Geometry


def seam_share(geometry: Geometry) -> float:
    """Return the share in [0, 1) of distinct corners (position and UV) that repeat another's position; 0 without UVs.

    O(n log n) in the number of triangles.
    """
    if geometry.uvs is None or not len(geometry.triangles):
        return 0.0
    places = geometry.positions[geometry.triangles.ravel()]
    return 1.0 - _distinct(places) / _distinct(places, geometry.uvs.reshape(-1, 2))


def _distinct(*columns: NDArray[np.float32]) -> int:
    bits = np.concatenate([np.ascontiguousarray(each, np.float32).view(np.uint32) for each in columns], axis=1)
    factors = np.random.default_rng(0).integers(1, 2**63, bits.shape[1], dtype=np.uint64) | np.uint64(1)
    return len(np.unique((bits.astype(np.uint64) * factors).sum(axis=1, dtype=np.uint64)))
