"""How many triangles the trunk of a level may have, and how much of a level's picture it may change."""

from __future__ import annotations

from collections.abc import Sequence

CHANGE = 0.01
"""A simplified trunk may change this fraction of the area that shows leaves or trunk, where its level appears."""

FAR_TRIANGLES = 250
"""Trunk triangles that each level may always have: with fewer, branches seem to vanish."""

MOST_BESIDE = 800
"""Most trunk triangles of level 1 beside leaves that need more than the level's share of the tree's triangles."""

MOST_TRIANGLES, MOST_SHARE = 3000, 0.15
"""Most triangles of level 1 with its trunk, if none are wished: a number, and a fraction of LOD 0's triangles."""


def trunk_limits(leaf_triangles: Sequence[int], tree_triangles: int, wished: int | None = None) -> tuple[int, ...]:
    """Return the maximum number of trunk triangles of each cloud.

    `leaf_triangles`: triangles of each cloud without its trunk. `tree_triangles`: of LOD 0, with its trunk. `wished`:
    most triangles of level 1 (the setting `triangles`). Level 1's trunk has what its leaves leave of them: the core
    makes billboards for three quarters, so that a quarter is left. The leaves of a small tree may need more than all of
    them; then the trunk may have as many as the leaves, at most `MOST_BESIDE`: thin branches make much of its picture.
    """
    if not leaf_triangles:
        return ()
    first, later = leaf_triangles[0], (FAR_TRIANGLES for _ in leaf_triangles[1:])
    if wished is not None:
        return max(wished - first, 1), *later
    most = round(min(MOST_TRIANGLES, MOST_SHARE * tree_triangles))
    beside = min(first, MOST_BESIDE) if first > most else 0
    return max(most - first, beside, FAR_TRIANGLES), *later
