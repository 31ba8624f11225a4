"""A tree as arrays, in its own coordinates, and its transform to the world.

The core transforms a tree's arrays itself. The functions here serve all others that work in the world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

_SHEAR_TOLERANCE = 1e-6

_Corners = TypeVar("_Corners", bound=NDArray[Any] | None)


@dataclass(frozen=True)
class Geometry:
    """Triangles of one or several objects in the tree's own coordinates. `Tree.matrix` transforms them to the world."""

    positions: NDArray[np.float32]
    """(v, 3) vertices, each used by a triangle. Vertices of the frame object are bit-identical to the source."""
    triangles: NDArray[np.int32]
    """(t, 3)"""
    uvs: NDArray[np.float32] | None
    """(t, 3, 2) the UV map that the material's image uses; the render-active map by default.

    `None` if no object has a UV map; zeros for single objects without one.
    """
    normals: NDArray[np.float32]
    """(t, 3, 3) evaluated corner normals, including custom normals."""
    colors: NDArray[np.float32] | None
    """(t, 3, 4) linear factors of base color and alpha from color attributes; `None` if no material uses any."""
    material_ids: NDArray[np.int32]
    """(t,) indices into `materials`."""
    materials: list[bpy.types.Material | None]
    randoms: NDArray[np.float32] | None = None
    """(t,) the Random output of Blender's Object Info node; `None` counts as ½ everywhere."""
    protected: NDArray[np.bool_] | None = None
    """(t,) whether the triangle is painted as a leaf that is never pruned; `None` for no such leaves."""


@dataclass(frozen=True)
class Tree:
    """A tree to bake."""

    name: str
    """As given to `extract`, else the name of the .blend file, the active object or the frame object. Any text."""
    matrix: NDArray[np.float64]
    """(4, 4) world matrix of the frame object: the first leaf object by name, or the instancer of its copies.

    Never singular; may mirror.
    """
    leaves: Geometry
    trunk: Geometry | None
    choice: str
    """One sentence that names the leaf parts and the reason."""
    dropped: list[str]
    """One sentence for each thing left out."""
    warnings: list[str]
    sources: tuple[bpy.types.Object, ...] = ()
    """The objects that show the tree, directly or as instancers."""

    @property
    def scale(self) -> float:
        """World units per unit of the tree's coordinates, the geometric mean of the axes."""
        return float(abs(np.linalg.det(self.matrix[:3, :3])) ** (1.0 / 3.0))


def world_positions(geometry: Geometry, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (v, 3) the vertices in world space. `matrix` is that of the tree."""
    return geometry.positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def world_normals(geometry: Geometry, matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return (t, 3, 3) the unit normals in world space. A zero normal stays zero."""
    turned = geometry.normals.astype(np.float64) @ np.linalg.inv(matrix)[:3, :3]
    length = np.linalg.norm(turned, axis=-1, keepdims=True)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0.0).astype(np.float32)


def wound(corners: _Corners, matrix: NDArray[np.float64]) -> _Corners:
    """Reorder values per corner (t, 3, …) to keep the front of each triangle in the other coordinates.

    The first corner stays first. A second call restores the order. None stays None.
    """
    if corners is None or np.linalg.det(matrix[:3, :3]) > 0.0:
        return corners
    swapped: Any = corners[:, [0, 2, 1]]
    return swapped


def without_shear(tree: Tree) -> Tree:
    """Return the tree, with coordinates along the world's axes if its matrix has a shear.

    Neither an object nor a glTF node can have a shear.
    """
    if not is_sheared(tree.matrix):
        return tree
    return replace(
        tree,
        matrix=_translation(tree.matrix),
        leaves=_along_axes(tree.leaves, tree.matrix),
        trunk=None if tree.trunk is None else _along_axes(tree.trunk, tree.matrix),
        warnings=[
            *tree.warnings,
            "the leaves' object is sheared by its parents: LOD 0 is aligned with the world's axes instead",
        ],
    )


def is_sheared(matrix: NDArray[np.float64]) -> bool:
    """Return whether the axes are not at right angles. No object's location, rotation and scale give such a matrix."""
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    return bool(np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR_TOLERANCE)


def _along_axes(geometry: Geometry, matrix: NDArray[np.float64]) -> Geometry:
    """Return the geometry along the world's axes. Keep its origin, where single precision is finest."""
    return replace(
        geometry,
        positions=world_positions(geometry, matrix - _translation(matrix) + np.eye(4)).astype(np.float32),
        triangles=wound(geometry.triangles, matrix),
        uvs=wound(geometry.uvs, matrix),
        normals=wound(world_normals(geometry, matrix), matrix),
        colors=wound(geometry.colors, matrix),
    )


def _translation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the translation of a matrix, (4, 4)."""
    translation = np.eye(4)
    translation[:3, 3] = matrix[:3, 3]
    return translation
