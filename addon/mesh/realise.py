"""Array operations that join many copies of a mesh into one: positions, normals, winding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True)
class Triangles:
    """Triangles with values per corner. All arrays except `positions` have the length t."""

    positions: NDArray[np.float32]
    """(v, 3)"""
    triangles: NDArray[np.int32]
    """(t, 3)"""
    normals: NDArray[np.float32]
    """(t, 3, 3)"""
    uvs: NDArray[np.float32] | None
    """(t, 3, 2)"""
    colors: NDArray[np.float32] | None
    """(t, 3, 4)"""
    material_ids: NDArray[np.int32]
    """(t,)"""
    randoms: NDArray[np.float32]
    """(t,) the Random output of Blender's Object Info node."""
    protected: NDArray[np.bool_] | None = None
    """(t,) whether the triangle is painted as a leaf that is never pruned."""


def first_not_finite(positions: NDArray[np.float32]) -> tuple[int, str] | None:
    """Return the index of the first of the points (v, 3) that is not finite, and its coordinates as text; else None."""
    finite = np.isfinite(positions).all(axis=1)
    if finite.all():
        return None
    index = int(np.argmin(finite))
    return index, ", ".join(f"{value:g}" for value in positions[index])


def are_singular(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (n,) whether each of (n, 4, 4) matrices is singular in single precision, or not finite."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    sizes = np.linalg.svd(np.where(finite[:, None, None], matrices[:, :3, :3], 0.0), compute_uv=False)
    return sizes[:, 2] <= 1e-7 * sizes[:, 0]


def relative(frame: NDArray[np.float64], matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 4, 4) the transforms from each matrix's space to that of `frame`; exact identities where equal."""
    result = np.linalg.inv(frame) @ matrices
    result[(matrices == frame).all(axis=(1, 2))] = np.eye(4)
    return result


def used_only(source: Triangles, chosen: NDArray[np.bool_]) -> Triangles:
    """Return the triangles chosen by a mask (t,) and the vertices that they use, in the same order."""
    if chosen.all() and (np.bincount(source.triangles.ravel(), minlength=len(source.positions)) > 0).all():
        return source
    triangles = source.triangles[chosen]
    used = np.zeros(len(source.positions), bool)
    used[triangles] = True
    numbers = np.cumsum(used, dtype=np.int32) - 1
    return Triangles(
        source.positions[used],
        numbers[triangles],
        source.normals[chosen],
        None if source.uvs is None else source.uvs[chosen],
        None if source.colors is None else source.colors[chosen],
        source.material_ids[chosen],
        source.randoms[chosen],
        None if source.protected is None else source.protected[chosen],
    )


def realise(source: Triangles, matrices: NDArray[np.float64], randoms: NDArray[np.float32]) -> Triangles:
    """Return one copy of `source` for each of the (n, 4, 4) matrices, each with its own of the `randoms` (n,).

    No matrix may be singular. A copy by the identity keeps every bit. Normals are transformed by the inverse transpose.
    A mirrored copy swaps the last two corners of its triangles, so they still wind counter-clockwise about the normals.
    """
    count = len(matrices)
    kept = (matrices == np.eye(4)).all(axis=(1, 2))
    if count == 1 and kept[0]:
        return replace(source, randoms=np.repeat(randoms, len(source.triangles)))
    linear = matrices[:, :3, :3]
    positions = np.einsum("nij,vj->nvi", linear, source.positions.astype(np.float64)) + matrices[:, None, :3, 3]
    placed = positions.astype(np.float32)
    placed[kept] = source.positions
    normals = np.einsum("tcj,njk->ntck", source.normals.astype(np.float64), np.linalg.inv(linear))
    length = np.linalg.norm(normals, axis=3, keepdims=True)
    turned = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0).astype(np.float32)
    turned[kept] = source.normals
    offsets = np.arange(count, dtype=np.int32) * len(source.positions)
    mirrored = np.linalg.det(linear) < 0.0
    return Triangles(
        placed.reshape(-1, 3),
        _wound(source.triangles + offsets[:, None, None], mirrored),
        _wound(turned, mirrored),
        None if source.uvs is None else _wound(_repeated(source.uvs, count), mirrored),
        None if source.colors is None else _wound(_repeated(source.colors, count), mirrored),
        np.tile(source.material_ids, count),
        np.repeat(randoms, len(source.triangles)),
        None if source.protected is None else np.tile(source.protected, count),
    )


def joined(blocks: list[Triangles]) -> Triangles:
    """Join blocks, at least one. If only some blocks have UVs, the others get zeros; colors get white."""
    offsets = np.cumsum([0, *(len(block.positions) for block in blocks[:-1])], dtype=np.int32)
    return Triangles(
        np.concatenate([block.positions for block in blocks]),
        np.concatenate([block.triangles + offset for block, offset in zip(blocks, offsets, strict=True)]),
        np.concatenate([block.normals for block in blocks]),
        _joined_corners([block.uvs for block in blocks], [len(block.triangles) for block in blocks], 2, 0.0),
        _joined_corners([block.colors for block in blocks], [len(block.triangles) for block in blocks], 4, 1.0),
        np.concatenate([block.material_ids for block in blocks]),
        np.concatenate([block.randoms for block in blocks]),
        _joined_marks(blocks),
    )


def _joined_marks(blocks: list[Triangles]) -> NDArray[np.bool_] | None:
    """Return (t,) whether triangles are protected; False for blocks without that array."""
    if all(block.protected is None for block in blocks):
        return None
    unpainted = (np.zeros(len(block.triangles), bool) for block in blocks)
    marks = [
        none if block.protected is None else block.protected for block, none in zip(blocks, unpainted, strict=True)
    ]
    return np.concatenate(marks)


def _joined_corners(
    arrays: list[NDArray[np.float32] | None], counts: list[int], width: int, missing: float
) -> NDArray[np.float32] | None:
    if all(array is None for array in arrays):
        return None
    return np.concatenate(
        [
            np.full((count, 3, width), missing, np.float32) if array is None else array
            for array, count in zip(arrays, counts, strict=True)
        ]
    )


def _repeated(corners: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    return np.tile(corners, (count, 1, 1, 1))


def _wound(corners: NDArray[_Scalar], mirrored: NDArray[np.bool_]) -> NDArray[_Scalar]:
    """Reshape (n, t, 3, …) to (n·t, 3, …), with the last two corners swapped in mirrored copies."""
    corners[mirrored] = corners[mirrored][:, :, [0, 2, 1]]
    return corners.reshape(-1, *corners.shape[2:])
