"""Levels of detail of another tool, told by their names, else by their form: the finest is the tree."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_LEVEL = re.compile(r"(?:^|[\W_])lod[\W_]*(\d{1,2})(?![a-z0-9])", re.IGNORECASE)
_PICTURE = re.compile(r"billboard|impost[eo]r", re.IGNORECASE)


def level_in(names: Sequence[str]) -> int | None:
    """Return the number of the level in the first name that has one: 2 for "Oak_LOD2"; None without any."""
    found = (_LEVEL.search(name) for name in names)
    return next((int(each[1]) for each in found if each is not None), None)


def coarser(parts: Sequence[Sequence[str]]) -> list[int]:
    """Return the indices of the parts that are coarser levels of the others.

    parts: for each, its names from the nearest: of the object, of its parents, of its collections. With at least two
    different numbers among them, those above the least are coarser levels, and so are billboards without a number.
    """
    numbers = [level_in(names) for names in parts]
    known = {number for number in numbers if number is not None}
    if len(known) < 2:
        return []
    finest = min(known)
    return [
        i
        for i, number in enumerate(numbers)
        if (number is None and any(map(_PICTURE.search, parts[i]))) or (number is not None and number > finest)
    ]


@dataclass(frozen=True)
class Extent:
    """Form of an object: its box (2, 3) in the world, its area, its triangles, and the names of its materials."""

    box: NDArray[np.float64]
    area: float
    triangles: int
    materials: frozenset[str]


def coarser_by_form(parts: Sequence[Extent]) -> list[int]:
    """Return the indices of the parts that are coarser levels of others, told by form alone.

    A coarser level fills the same box with about the same area and materials, by fewer triangles. Exports of three.js's
    LOD and of Unity's LODGroup may have no names. A tree may have leaves of two sizes in one crown: so at least two
    levels are coarser than a part. Beside such levels a few triangles in the tree's box are its picture. O(n²).
    """
    if len(parts) > _MOST_PARTS:
        return []
    chains = [[i for i, part in enumerate(parts) if _is_coarser(part, other)] for other in parts]
    found = {i for chain in chains if len({parts[i].triangles for i in chain}) >= _FEWEST_LEVELS for i in chain}
    if not found:
        return []
    low = np.min([part.box[0] for part in parts], axis=0)
    tree = np.sort(np.max([part.box[1] for part in parts], axis=0) - low)[-2:]
    pictures = {
        i
        for i, part in enumerate(parts)
        if part.triangles <= _MOST_OF_PICTURE and (np.sort(np.ptp(part.box, axis=0))[-2:] >= _LIKE_TREE * tree).all()
    }
    return sorted(found | pictures)


_MOST_PARTS = 300
_SAME_BOX, _SAME_AREA, _FEWER = 0.05, 1.5, 1.5
"""Greatest distance of the faces of two boxes, in diagonals; greatest ratio of areas; least ratio of triangles."""


_FEWEST_LEVELS = 2

_MOST_OF_PICTURE, _LIKE_TREE = 12, 0.8
"""Most triangles of a picture of the tree, and its least width and height, in those of all parts."""


def _diagonal(part: Extent) -> float:
    return float(np.linalg.norm(np.ptp(part.box, axis=0)))


def _is_coarser(part: Extent, other: Extent) -> bool:
    if other.triangles < _FEWER * part.triangles or not part.materials <= other.materials:
        return False
    near = float(np.abs(part.box - other.box).max()) <= _SAME_BOX * _diagonal(other)
    return near and max(part.area, other.area) <= _SAME_AREA * min(part.area, other.area)
