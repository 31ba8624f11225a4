"""Trunks of the levels. LOD 0 has the original trunk. Later levels have simplified ones if asked for.

`simplified` does not touch Blender, so it runs on another thread; `trunks` makes the meshes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..geometry import Geometry, world_positions
from ..material.textures import repeats
from ..plan.trunk_limits import CHANGE, WHOLE_SHARE
from .material import layer_names
from .mesh import create_mesh, split_vertices, triangle_surface


@dataclass(frozen=True, eq=False)
class Kept:
    """What a level keeps of the trunk.

    change: fraction of the level's picture, leaves and trunk, that differs from the input's.
    corners: (n, 3) indices of the kept input corners, counted through all triangles; None keeps all.
    """

    geometry: Geometry
    change: float = 0.0
    corners: NDArray[np.integer[Any]] | None = None

    @property
    def triangles(self) -> int:
        return len(self.geometry.triangles)

    @property
    def nbytes(self) -> int:
        """Bytes of the used vertices and of the data per corner and triangle."""
        own = self.geometry
        used = len(np.unique(own.triangles)) * own.positions.itemsize * 3
        arrays = (own.triangles, own.uvs, own.normals, own.colors, own.material_ids)
        return used + sum(array.nbytes for array in arrays if array is not None)


@dataclass(frozen=True)
class Trunk:
    """The trunk of one level. mesh: None if no triangles are kept."""

    mesh: bpy.types.Mesh | None
    kept: Kept


@dataclass(frozen=True)
class TrunkView:
    """How a level's trunk is seen where the level appears.

    level: the leaves or the cloud that hide parts of the trunk. pixel: side of a pixel on the tree, world units.
    limit: wanted number of triangles at most. twigs: triangles of the trunk that the cloud shows itself, those of the
    cloud before among them. most_change: more triangles than `limit` are kept where fewer would change more of the
    picture, as a share.
    """

    level: leafcloud.LeafLevel | leafcloud.Level
    pixel: float
    limit: int
    twigs: NDArray[np.integer[Any]] = field(default_factory=lambda: np.empty(0, np.uint32))
    most_change: float = 1.0


def geometry_mesh(name: str, geometry: Geometry) -> bpy.types.Mesh:
    """Create a mesh from the geometry, with its materials and the UV maps and color attributes that they read."""
    order = np.arange(len(geometry.triangles))
    split = split_vertices(geometry.triangles, np.zeros(len(order), np.int32))
    surface = triangle_surface(geometry, order, split)
    return create_mesh(name, surface, geometry.materials, layer_names(geometry.materials))


def trunks(name: str, kept: Sequence[Kept]) -> list[Trunk]:
    """Return a trunk for each level, the first unsimplified. A mesh is named after its first level.

    Levels that keep the same share one mesh.
    """
    made: dict[Kept, Trunk] = {}
    for number, each in enumerate(kept):
        if each not in made:
            own = f"{name}_{number}" if number else name
            made[each] = Trunk(geometry_mesh(own, each.geometry) if each.triangles else None, each)
    return [made[each] for each in kept]


def unrolled(geometry: Geometry) -> Geometry:
    """Return the geometry with texture coordinates that run on over its edges where the texture repeats.

    Simplified trunks are made from it, because they lose rings at which the coordinates of many trunks start anew.
    """
    if geometry.uvs is None:
        return geometry
    of_triangle = np.array([repeats(material) for material in geometry.materials])[geometry.material_ids]
    uvs = leafcloud.unrolled_uvs(geometry.positions, geometry.triangles, geometry.uvs, of_triangle)
    return replace(geometry, uvs=uvs)


def simplified(first: Kept, geometry: Geometry, matrix: NDArray[np.float64], views: Sequence[TrunkView]) -> list[Kept]:
    """Return what each view keeps, from level 1 on. `first`: all. `geometry`: that of `first`, `unrolled`.
    `matrix`: (4, 4) from the geometry to the world.

    Each trunk is made from `geometry`, so changes do not add up. If one has no fewer triangles than the one before, or
    that one has few beside the level's leaves, that one is used again, unless the cloud shows more twigs than the one
    before.
    """
    result, twigs = [first], 0
    positions = world_positions(geometry, matrix)
    for view in views:
        before, same = result[-1], len(view.twigs) == twigs
        most = min(view.limit, WHOLE_SHARE * view.level.triangles)
        if same and before.triangles <= most:
            result.append(before)
            continue
        branches = np.setdiff1d(np.arange(len(geometry.triangles), dtype=np.uint32), view.twigs)
        corners, change = _simplified(geometry, branches, positions, view, most)
        if same and len(corners) >= before.triangles:
            result.append(before)
            continue
        left = outward(gathered(geometry, corners), geometry, corners)
        result.append(Kept(left, change, corners))
        twigs = len(view.twigs)
    return result[1:]


def gathered(geometry: Geometry, corners: NDArray[np.integer[Any]]) -> Geometry:
    """Return the geometry of triangles (n, 3) given by corners of `geometry`, counted through all of its triangles.

    All data per corner and per triangle is kept.
    """
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


def outward(left: Geometry, geometry: Geometry, corners: NDArray[np.integer[Any]]) -> Geometry:
    """Return simplified triangles `left` without normals that their simplification has turned against their faces.

    `left` is `gathered(geometry, corners)`. Such corners get the normal of their face. Corners with normals against
    their faces in `geometry`, too, keep them.
    """
    faces = _face_normals(left)[:, None]
    before = _face_normals(geometry)[corners // 3]
    agreed = np.einsum("tcd,tcd->tc", left.normals, before) >= 0.0
    against = agreed & (np.einsum("tcd,tcd->tc", left.normals, np.broadcast_to(faces, left.normals.shape)) < 0.0)
    return replace(left, normals=np.where(against[..., None], faces, left.normals).astype(np.float32))


def _face_normals(geometry: Geometry) -> NDArray[np.float64]:
    """Return (t, 3) unit normals of the triangles; 0 without area."""
    a, b, c = geometry.positions.astype(np.float64)[geometry.triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)


def per_corner(values: NDArray[np.float32], corners: NDArray[np.integer[Any]]) -> NDArray[np.float32]:
    """Return `values` (t, 3, …) at corners (n, 3), counted through all triangles, as (n, 3, …)."""
    return values.reshape(-1, values.shape[-1])[corners]


def _simplified(
    geometry: Geometry,
    branches: NDArray[np.uint32],
    positions: NDArray[np.float64],
    view: TrunkView,
    most: float,
) -> tuple[NDArray[np.integer[Any]], float]:
    """Return the kept corners (n, 3) of `branches`, triangles of the trunk, and the change of the level's picture.

    If the cloud shows twigs, and at most `most` triangles are left, these stay as they are.
    """
    if len(branches) < len(geometry.triangles) and len(branches) <= most:
        return 3 * branches[:, None] + np.arange(3, dtype=np.uint32), 0.0
    simplify = partial(
        leafcloud.simplify,
        positions,
        geometry.triangles[branches],
        leaves=view.level.foliage(),
        pixel=view.pixel,
        uvs=None if geometry.uvs is None else geometry.uvs[branches],
        normals=geometry.normals[branches],
        colors=None if geometry.colors is None else geometry.colors[branches],
        material_ids=geometry.material_ids[branches],
    )
    found = simplify(change=CHANGE, most=view.limit)
    if found.change > view.most_change:
        found = simplify(change=view.most_change)
    return 3 * branches[found.corners // 3] + found.corners % 3, found.change
