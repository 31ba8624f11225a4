"""Where a tree's own coordinates lie in the world: the core works in the world, meshes are kept in the tree's own."""

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
    """`matrix` (4, 4) float64 carries the tree's coordinates to the world; it is not singular."""

    matrix: NDArray[np.float64]

    @cached_property
    def inverse(self) -> NDArray[np.float64]:
        return np.linalg.inv(self.matrix)

    @cached_property
    def mirrored(self) -> bool:
        """Whether a triangle that winds counter-clockwise in the tree's coordinates winds clockwise in the world."""
        return bool(np.linalg.det(self.matrix[:3, :3]) < 0.0)

    @cached_property
    def scale(self) -> float:
        """World units per unit of the tree's coordinates, the mean of the axes."""
        return float(abs(np.linalg.det(self.matrix[:3, :3])) ** (1.0 / 3.0))

    @cached_property
    def sheared(self) -> bool:
        """Whether the axes are not at right angles: no object's location, rotation and scale give such a matrix."""
        axes = self.matrix[:3, :3] / np.linalg.norm(self.matrix[:3, :3], axis=0)
        return bool(np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR_TOLERANCE)

    def to_tree(self, points: ArrayLike) -> NDArray[np.float32]:
        """The points (…, 3) of the world in the tree's coordinates, rounded last."""
        return (np.asarray(points, np.float64) @ self.inverse[:3, :3].T + self.inverse[:3, 3]).astype(np.float32)

    def normals_to_world(self, normals: ArrayLike) -> NDArray[np.float32]:
        """The unit normals (…, 3) of the tree's coordinates in the world; a zero normal stays zero."""
        turned = np.asarray(normals, np.float64) @ self.inverse[:3, :3]
        length = np.linalg.norm(turned, axis=-1, keepdims=True)
        return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0.0).astype(np.float32)

    def wind(self, corners: _Corners) -> _Corners:
        """Values per corner (faces, corners, …) in the order that keeps a face's front when it changes coordinates.

        The first corner stays first, so that a quad keeps its diagonal; done twice it is undone. None stays None.
        """
        if corners is None or not self.mirrored:
            return corners
        wound: Any = np.roll(corners[:, ::-1], 1, axis=1)
        return wound


def y_up(vector: tuple[float, float, float]) -> list[float]:
    """A vector of Blender's Z-up coordinates in glTF's, for extras."""
    x, y, z = vector
    return [x, z, 0.0 - y]  # Not −0.
