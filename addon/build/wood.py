"""The wood beside each level: LOD 0 has it as it came, those behind it with fewer triangles if asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..placement import Placement
from ..scene.extract import Geometry, world_positions
from .cloud_mesh import create_mesh, split_vertices, triangle_surface
from .materials import layer_names


@dataclass(frozen=True)
class Wood:
    """The wood of one level. `mesh` is None where nothing is left.

    name: of the wood of all levels; error: how far it lies from what came, world units; nbytes: of what made the mesh;
    corners: (n, 3) the corners of what came, counted through all its triangles, of which it is made; None of all.
    """

    name: str
    mesh: bpy.types.Mesh | None
    triangles: int
    error: float
    nbytes: int
    corners: NDArray[np.integer[Any]] | None = None


def geometry_mesh(name: str, geometry: Geometry) -> bpy.types.Mesh:
    """The geometry as it is, with its materials and what these read."""
    order = np.arange(len(geometry.triangles))
    split = split_vertices(geometry.triangles, np.zeros(len(order), np.int32))
    surface = triangle_surface(geometry, order, split)
    return create_mesh(name, surface, geometry.materials, layer_names(geometry.materials))


def whole(name: str, geometry: Geometry) -> Wood:
    """All of it."""
    return Wood(name, geometry_mesh(name, geometry), len(geometry.triangles), 0.0, _nbytes(geometry))


def simplified(first: Wood, geometry: Geometry, placement: Placement, errors: Sequence[float]) -> list[Wood]:
    """The wood for levels that may lie as far from `geometry` as `errors`, rising, in the world; `first` is all of it.

    Each is made from the input, so that errors do not add up, and is there only where it has fewer triangles than the
    one before; else that one serves again. It is called after `first` and the number of its level, which counts from 1.
    """
    result = [first]
    positions = world_positions(geometry, placement.matrix)
    for level, error in enumerate(errors, start=1):
        before = result[-1]
        found = _simplify(geometry, positions, error) if error > 0.0 and before.triangles > 0 else None
        if found is None or len(found.corners) >= before.triangles:
            result.append(before)
            continue
        left = gathered(geometry, found.corners)
        mesh = geometry_mesh(f"{first.name}_{level}", left) if len(found.corners) else None
        result.append(Wood(first.name, mesh, len(found.corners), found.error, _nbytes(left), found.corners))
    return result[1:]


def gathered(geometry: Geometry, corners: NDArray[np.integer[Any]]) -> Geometry:
    """Triangles (n, 3) of corners of `geometry`, counted through all of its triangles, with all that these carry."""

    of_triangle = corners[:, 0] // 3
    return replace(
        geometry,
        triangles=geometry.triangles.ravel()[corners],
        uvs=None if geometry.uvs is None else per_corner(geometry.uvs, corners),
        normals=per_corner(geometry.normals, corners),
        colors=None if geometry.colors is None else per_corner(geometry.colors, corners),
        material_ids=geometry.material_ids[of_triangle],
        randoms=None if geometry.randoms is None else geometry.randoms[of_triangle],
        protected=None if geometry.protected is None else geometry.protected[of_triangle],
    )


def per_corner(values: NDArray[np.float32], corners: NDArray[np.integer[Any]]) -> NDArray[np.float32]:
    """(n, 3, …) of the `values` (t, 3, …) at the corners, counted through all triangles."""
    return values.reshape(-1, values.shape[-1])[corners]


def _nbytes(geometry: Geometry) -> int:
    """Of the vertices in use, and of what the corners carry."""
    used = len(np.unique(geometry.triangles)) * geometry.positions.itemsize * 3
    arrays = (geometry.triangles, geometry.uvs, geometry.normals, geometry.colors, geometry.material_ids)
    return used + sum(array.nbytes for array in arrays if array is not None)


def _simplify(geometry: Geometry, positions: NDArray[np.float64], error: float) -> leafcloud.Simplified:
    return leafcloud.simplify(
        positions,
        geometry.triangles,
        error=error,
        uvs=geometry.uvs,
        normals=geometry.normals,
        colors=geometry.colors,
        material_ids=geometry.material_ids,
    )
