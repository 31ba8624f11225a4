"""From how far each level is drawn: where it takes over, where it begins to morph, where it hands over. World units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

HAND_OVER = 0.998
"""The a at which the next level takes over: at 1 itself overlapping leaves have next to no depth order left."""
START_SHARE = 0.5
"""A transition begins at this share of the distance at which it ends."""

FADE, FADE_BEHIND_MORPH = 0.25, 0.1
"""Two levels cross-fade over this share of the distance at which the next appears. Where one has morphed to the next
little is left to fade: light, and the edges of alpha."""

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

    With `transitions` each level morphs to the cloud behind it, if one is, and cross-fades with whatever is. The next
    appears shortly before the morph ends, or at its switch distance, and fades in before this one fades out: what both
    cover is never seen through.
    """
    result: list[Reach] = []
    appear = whole = gone = switch_distances[0]
    for end, cloud in zip((*switch_distances[1:], math.inf), (*clouds[1:], False), strict=True):
        morphs = transitions and cloud
        start = max(START_SHARE * end, gone) if morphs else math.inf
        hand_over = start + HAND_OVER * (end - start) if morphs else end
        fade = (FADE_BEHIND_MORPH if morphs else FADE) * hand_over if transitions else 0.0
        reach = Reach(
            appear=appear,
            start=start,
            end=end if morphs else math.inf,
            vanish=hand_over + fade,
            whole=whole,
            fading=hand_over + fade / 2.0,
        )
        result.append(reach)
        appear, whole, gone = hand_over, reach.fading, reach.vanish
    return tuple(result)


def wood_reach(reached: Sequence[Reach], number: int) -> Reach:
    """The reach of the wood of level `number`, which neither moves nor fades from level to level.

    Much of it lies where that of the next level does: where a ray passes one, it passes the other. Only behind the last
    wood, which is in the next level's textures, it fades with its level.
    """
    own = reached[number]
    morphs = math.isfinite(own.end)
    vanish = reached[number + 1].appear if morphs else own.vanish
    fading = vanish if morphs else own.fading
    return Reach(own.appear, math.inf, math.inf, vanish, whole=own.appear, fading=fading)


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
