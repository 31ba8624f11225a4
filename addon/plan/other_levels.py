"""Levels of detail of another tool, told by their names: the finest is the tree."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
