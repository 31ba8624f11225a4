"""Parts of meshes by their connected components, and their shapes: leaves and trunk may share a mesh and a material.

In each material slot many small components stay together, but for those of another kind that lie on the ground, and for
those that are far larger than the others. Any other component is a part of its own, unless there are several of the
same number of triangles, or very many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..material.surface import Surface
from ..plan.leaves import GROUND, MANY_COMPONENTS, SMALL_TRIANGLES, Shape

_FEW = 24
"""Most components of a slot that are parts of their own; more of them stay together."""
_ALIKE = 3
"""Fewest of them with the same number of triangles that stay together."""
_UNLIKE = 4.0
"""Area of a component that is of another kind, over the median or below it."""
_GIANT = 25.0
"""Area of a component of few triangles that is no leaf among others, over their median."""
_THIN, _ROUND = 0.3, 0.3
"""Of a rod: the greatest width over its length; the greatest sum of its faces' area vectors over its area."""
_SMALL, _ON_GROUND, _GIANTS, _MANY = -1, -2, -3, -4
"""Groups of components. Others are the number of a component."""


@dataclass(frozen=True)
class Piece:
    """A part of a mesh: its material slot, the triangles of its components, and whether most of these are rods."""

    slot: int
    sizes: NDArray[np.int64]
    are_rods: bool


def divided(
    positions: NDArray[np.float32],
    triangles: NDArray[np.int32],
    slots: NDArray[np.int32],
    matrix: NDArray[np.float64],
    ground: float,
) -> tuple[NDArray[np.int32], list[Piece]]:
    """Divide a mesh into parts, each within one material slot.

    triangles: (t, 3) indices of vertices. slots: (t,) the material slot of each triangle. matrix: (4, 4), from the mesh
    to the world. ground: height in the world; what is lower lies on the ground.

    Return the part of each triangle (t,), and the parts. Those of a slot follow one another.
    """
    corners = positions[triangles].astype(np.float64)
    a, b, c = corners.transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    tops = (corners @ matrix[2, :3] + matrix[2, 3]).max(axis=1)
    parts = np.zeros(len(triangles), np.int32)
    pieces: list[Piece] = []
    for slot in np.unique(slots).tolist():
        own = np.flatnonzero(slots == slot)
        component = leafcloud.leaf_ids(np.ascontiguousarray(positions, np.float64), triangles[own])
        counts = np.bincount(component)
        area, top = np.bincount(component, areas[own]).astype(np.float64), np.full(len(counts), -np.inf)
        np.maximum.at(top, component, tops[own])
        groups, group_of = np.unique(_groups(counts, area, top < ground), return_inverse=True)
        parts[own] = (len(pieces) + group_of)[component]
        for group in range(len(groups)):
            members = np.flatnonzero(group_of == group)
            are_leaves = len(members) >= MANY_COMPONENTS and counts[members].min() <= SMALL_TRIANGLES
            some = members[: 0 if are_leaves else _FEW]
            rods = [_is_rod(corners[own[component == each]]) for each in some]
            pieces.append(Piece(slot, counts[members], 2 * sum(rods) > len(rods)))
    return parts, pieces


def _is_rod(corners: NDArray[np.float64]) -> bool:
    """Return whether the surface of triangles (t, 3, 3) is long, thin and round, as a branch is."""
    points = corners.reshape(-1, 3)
    long, middle = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
    a, b, c = corners.transpose(1, 0, 2)
    faces = np.cross(b - a, c - a)
    around = np.linalg.norm(faces.sum(axis=0)) < _ROUND * np.linalg.norm(faces, axis=1).sum()
    return bool(middle < _THIN * long and around)


def ground_of(lows: Sequence[float], highs: Sequence[float]) -> float:
    """Return the height below which things lie on the ground, by the lowest and highest points of a tree's parts."""
    return min(lows) + GROUND * (max(highs) - min(lows))


def _groups(counts: NDArray[np.int64], areas: NDArray[np.float64], lie: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return a group for each component, by its triangles, its area and whether it lies on the ground."""
    small = counts <= SMALL_TRIANGLES
    small &= np.count_nonzero(small) >= MANY_COMPONENTS
    groups = np.full(len(counts), _SMALL)
    standing = small & ~lie
    if standing.any():
        count, area = np.median(counts[standing]), np.median(areas[standing])
        groups[small & lie & ((counts != count) | (areas < area / _UNLIKE) | (areas > area * _UNLIKE))] = _ON_GROUND
        groups[small & (areas > _GIANT * area)] = _GIANTS
    others = np.flatnonzero(~small)
    if len(others) > _FEW:
        groups[others] = _MANY
        return groups
    for component in others.tolist():
        alike = others[counts[others] == counts[component]]
        groups[component] = alike[0] if len(alike) >= _ALIKE else component
    return groups


def shape_of(
    positions: NDArray[np.float32],
    triangles: NDArray[np.int32],
    matrices: NDArray[np.float64],
    piece: Piece,
    surface: Surface,
) -> Shape:
    """Return the shape of a piece with these triangles (t, 3), in copies (n, 4, 4)."""
    corners = positions[triangles.ravel()].astype(np.float64)
    low, high = corners.min(axis=0), corners.max(axis=0)
    box = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    a, b, c = corners.reshape(-1, 3, 3).transpose(1, 0, 2)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
    turned = matrices[:, :3, :3] @ box.T + matrices[:, :3, 3:]
    scales = np.abs(np.linalg.det(matrices[:, :3, :3])) ** (2.0 / 3.0)
    lowest, highest = turned.min(axis=(0, 2)).tolist(), turned.max(axis=(0, 2)).tolist()
    has_texture = surface.texture is not None
    return Shape(
        np.tile(piece.sizes, len(matrices)),
        area * float(scales.sum()),
        tuple(lowest),
        tuple(highest),
        None if has_texture or surface.gaps else surface.color,
        has_texture and surface.alpha_mode != "OPAQUE",
        piece.are_rods,
    )
