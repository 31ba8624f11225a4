"""How many triangles the trunk of a level may have, and how much of a level's picture it may change."""

from __future__ import annotations

from collections.abc import Sequence

CHANGE = 0.01
"""A simplified trunk may change this fraction of the area that shows leaves or trunk, where its level appears."""

MOST_CHANGE = 0.05
"""Where fewer triangles would change more of the picture, a trunk keeps more than its number: stems of flowers are a
third of the picture."""

FAR_TRIANGLES = 250
"""Trunk triangles that each level may always have: with fewer, branches seem to vanish."""

NEAR_TRIANGLES, NEAR_SHARE = 1000, 0.15
"""Trunk triangles that level 1 may have beside leaves of fewer: a number, and a fraction of LOD 0's triangles."""

WHOLE_SHARE = 0.25
"""A trunk with at most this fraction of a level's leaf triangles stays as it is: simpler it would save little."""


def trunk_limits(leaf_triangles: Sequence[int], tree_triangles: int, wished: int | None = None) -> tuple[int, ...]:
    """Return how many trunk triangles each cloud should have at most: as many as its leaves have, or a fixed number.

    `leaf_triangles`: triangles of each cloud without its trunk. `tree_triangles`: of LOD 0, with its trunk. `wished`:
    most triangles of level 1 (the setting `triangles`), of which its trunk has what its leaves leave.
    """
    if not leaf_triangles:
        return ()
    first, *later = leaf_triangles
    near = max(first, round(min(NEAR_TRIANGLES, NEAR_SHARE * tree_triangles)), FAR_TRIANGLES)
    return near if wished is None else max(wished - first, 1), *(max(leaves, FAR_TRIANGLES) for leaves in later)
