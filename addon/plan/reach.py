"""From how far each level is drawn: where it takes over, where it begins to morph, where it hands over. World units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

HAND_OVER = 0.998
"""The a at which the next level takes over: at 1 itself overlapping leaves have next to no depth order left."""
START_SHARE = 0.5
"""A transition begins at this share of the distance at which it ends."""

FADE = 0.25
"""A level that nothing morphs to fades in over this share of the distance at which it appears."""

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
    """A level is drawn for appear ≤ distance < vanish; a runs from 0 at `start` to 1 at `end`; infinite means never.

    It fades in from `appear` to `whole`, and out from `fading` to `vanish`.
    """

    appear: float
    start: float
    end: float
    vanish: float
    whole: float
    fading: float

    @property
    def fades(self) -> bool:
        return self.whole > self.appear or self.fading < self.vanish


def reaches(switch_distances: Sequence[float], clouds: Sequence[bool], *, transitions: bool) -> tuple[Reach, ...]:
    """The reach of every level; level i takes over at `switch_distances[i]`, which rise from 0. `clouds[i]`: it is one.

    With `transitions` each level morphs to the cloud behind it, and cross-fades with what is none. One that morphs
    hands over shortly before its transition ends, so the next appears that much earlier than its switch distance. Where
    there is nothing to morph to, the next fades in before this one fades out: what both cover is never seen through.
    """
    result: list[Reach] = []
    appear = whole = switch_distances[0]
    for end, cloud in zip((*switch_distances[1:], math.inf), (*clouds[1:], False), strict=True):
        if transitions and cloud:
            start = max(START_SHARE * end, appear)
            vanish = start + HAND_OVER * (end - start)
            result.append(Reach(appear, start, end, vanish, whole, vanish))
            appear = whole = vanish
        else:
            fade = FADE * end if transitions else 0.0
            result.append(Reach(appear, math.inf, math.inf, end + fade, whole, end + fade / 2.0))
            appear, whole = end, end + fade / 2.0
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
