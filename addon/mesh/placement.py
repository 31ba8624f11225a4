"""Transform between tree coordinates and the world. The core works in the world, meshes keep tree coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

_SHEAR_TOLERANCE = 1e-6

_Corners = TypeVar("_Corners", bound=NDArray[Any] | None)


@dataclass(frozen=True)
class Placement:
    """The transform `matrix` (4, 4) float64 from tree coordinates to the world; it is not singular."""

    matrix: NDArray[np.float64]

    @cached_property
    def inverse(self) -> NDArray[np.float64]:
        return np.linalg.inv(self.matrix)

    @cached_property
    def mirrored(self) -> bool:
        """True if a counter-clockwise triangle in tree coordinates is clockwise in the world."""
        return bool(np.linalg.det(self.matrix[:3, :3]) < 0.0)

    @cached_property
    def scale(self) -> float:
        """World units per unit of tree coordinates, the geometric mean of the axes."""
        return float(abs(np.linalg.det(self.matrix[:3, :3])) ** (1.0 / 3.0))

    @cached_property
    def sheared(self) -> bool:
        """True if the axes are not at right angles. No object's location, rotation and scale give such a matrix."""
        axes = self.matrix[:3, :3] / np.linalg.norm(self.matrix[:3, :3], axis=0)
        return bool(np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR_TOLERANCE)

    def to_tree(self, points: ArrayLike) -> NDArray[np.float32]:
        """Transform world points (…, 3) to tree coordinates in float64, and round the result to float32."""
        return (np.asarray(points, np.float64) @ self.inverse[:3, :3].T + self.inverse[:3, 3]).astype(np.float32)

    def normals_to_world(self, normals: ArrayLike) -> NDArray[np.float32]:
        """Transform normals (…, 3) from tree coordinates to unit normals in the world. A zero normal stays zero."""
        turned = np.asarray(normals, np.float64) @ self.inverse[:3, :3]
        length = np.linalg.norm(turned, axis=-1, keepdims=True)
        return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0.0).astype(np.float32)

    def wind(self, corners: _Corners) -> _Corners:
        """Reorder values per corner (faces, corners, …) to keep the front of each face in the other coordinates.

        The first corner stays first, so a quad keeps its diagonal. A second call restores the order. None stays None.
        """
        if corners is None or not self.mirrored:
            return corners
        wound: Any = np.roll(corners[:, ::-1], 1, axis=1)
        return wound


def y_up(vector: tuple[float, float, float]) -> list[float]:
    """Convert a vector from Blender's Z-up coordinates to glTF's Y-up coordinates, for extras."""
    x, y, z = vector
    return [x, z, 0.0 - y]  # Avoid −0.
