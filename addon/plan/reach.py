"""From how far each level is drawn: where it takes over, where it begins to morph, where it hands over. World units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

HAND_OVER = 0.998
"""The a at which the next level takes over: at 1 itself overlapping leaves have next to no depth order left."""
START_SHARE = 0.5
"""A transition begins at this share of the distance at which it ends."""

LEAST_STEP = 1.25
"""A level takes over at least this many times as far away as the one before."""

WOOD_PIXELS = 2.0
"""How far from where it lay a level's wood may be seen where the level appears."""


@dataclass(frozen=True)
class View:
    """What the levels are seen with: vertical resolution in pixels, vertical field of view in radians."""

    resolution: float = 1080.0
    field_of_view: float = math.radians(50.0)


@dataclass(frozen=True)
class Reach:
    """A level is drawn for appear ≤ distance < vanish; a runs from 0 at `start` to 1 at `end`; infinite means never."""

    appear: float
    start: float
    end: float
    vanish: float


def reaches(switch_distances: Sequence[float], morphs: Sequence[bool]) -> tuple[Reach, ...]:
    """The reach of every level; level i takes over at `switch_distances[i]`, and morphs to the next if `morphs[i]`.

    The distances rise from level to level, and the first is 0. A level that morphs hands over shortly before its
    transition ends, so the next appears that much earlier than its switch distance.
    """
    result: list[Reach] = []
    appear = switch_distances[0]
    for morph, end in zip(morphs, (*switch_distances[1:], math.inf), strict=True):
        if morph:
            start = max(START_SHARE * end, appear)
            reach = Reach(appear, start, end, start + HAND_OVER * (end - start))
        else:
            reach = Reach(appear, math.inf, math.inf, end)
        result.append(reach)
        appear = reach.vanish
    return tuple(result)


def wood_errors(deviations: Sequence[float], reached: Sequence[Reach], unit: float) -> tuple[float, ...]:
    """How far the wood of each level behind the leaves may lie from what came: as far as its leaves do, which have the
    `deviations`, but no farther than `WOOD_PIXELS` where the level appears. A length of 1 is seen so large from `unit`.

    Leaves slide onto their billboards, wood changes at once: what leaves may deviate would be seen to jump.
    """
    behind = zip(deviations, reached[1:], strict=True)
    return tuple(min(deviation, reach.appear / unit) for deviation, reach in behind)


def rising(distances: Sequence[float]) -> tuple[float, ...]:
    """The distances, each greater than the one before by a factor: every level is drawn for a while."""
    result: list[float] = []
    for distance in distances:
        result.append(max(distance, LEAST_STEP * result[-1]) if result else distance)
    return tuple(result)
