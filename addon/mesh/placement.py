"""Facts of a tree's matrix (4, 4) float64, which transforms the tree's coordinates to the world and is never singular.

The core transforms a tree's own arrays to the world and back. These functions serve all others that work in the world.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

_SHEAR_TOLERANCE = 1e-6

_Corners = TypeVar("_Corners", bound=NDArray[Any] | None)


def scale_of(matrix: NDArray[np.float64]) -> float:
    """Return the world units per unit of tree coordinates, the geometric mean of the axes."""
    return float(abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0))


def is_sheared(matrix: NDArray[np.float64]) -> bool:
    """Return whether the axes are not at right angles. No object's location, rotation and scale give such a matrix."""
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    return bool(np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR_TOLERANCE)


def wound(corners: _Corners, matrix: NDArray[np.float64]) -> _Corners:
    """Reorder values per corner (t, 3, …) to keep the front of each triangle in the other coordinates.

    The first corner stays first. A second call restores the order. None stays None.
    """
    if corners is None or np.linalg.det(matrix[:3, :3]) > 0.0:
        return corners
    swapped: Any = corners[:, [0, 2, 1]]
    return swapped


def normals_to_world(normals: NDArray[np.float32], matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """Transform normals (…, 3) to unit normals in the world. A zero normal stays zero."""
    turned = normals.astype(np.float64) @ np.linalg.inv(matrix)[:3, :3]
    length = np.linalg.norm(turned, axis=-1, keepdims=True)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0.0).astype(np.float32)
