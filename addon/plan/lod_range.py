"""LOD ranges: the distances at which each level appears, morphs and disappears. World units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

import leafcloud

START_SHARE = 0.5
"""The leaves start to morph at this fraction of the distance where the morph ends: nearer, single leaves are seen."""

FADE, FADE_BEHIND_MORPH = 0.15, 0.08
"""Two levels cross-fade over this fraction of the distance at which the next one appears. After a morph only light and
the edges of alpha are left to fade. Engines draw both levels there, so a fade is short."""

LEAST_STEP = 1.25
"""Minimum ratio of a level's switch distance to that of the level before."""


class HandOverKind(Enum):
    """How a level takes over from the level before, with transitions."""

    FADE = auto()
    """Impostors show the trunk, so nothing morphs to them."""
    MORPH = auto()
    """Simplified and fewer leaves are the leaves at the end of their morph. If both were drawn, they would shade each
    other."""
    MORPH_AND_FADE = auto()
    """Clouds differ from the leaves that lie on them by their light and the edges of their alpha."""


@dataclass(frozen=True)
class View:
    """The view of a camera: vertical resolution in pixels, vertical field of view in radians."""

    resolution: float = 1080.0
    field_of_view: float = math.radians(50.0)

    def of_height(self, pixels: float) -> str:
        """Return a length in the picture as text, as a percentage of the picture's height."""
        share = 100.0 * pixels / self.resolution
        return f"{share:.0f} % of the picture's height" if share >= 9.5 else f"{share:.1f} % of the picture's height"


@dataclass(frozen=True)
class LodRange:
    """The LOD range of a level. Infinite means never.

    The level is drawn for appear ≤ distance < vanish. Its transition a runs from 0 at `start` to 1 at `end`. The level
    fades in from `appear` to `fade_in_end`, and out from `fade_out_start` to `vanish`.
    """

    appear: float
    start: float
    end: float
    vanish: float
    fade_in_end: float
    fade_out_start: float

    @property
    def fades(self) -> bool:
        return self.fade_in_end > self.appear or self.fade_out_start < self.vanish


def lod_ranges(
    switch_distances: Sequence[float], hand_overs: Sequence[HandOverKind], *, transitions: bool
) -> tuple[LodRange, ...]:
    """Return the LOD range of every level.

    Level i takes over at `switch_distances[i]`, which rise from 0. `hand_overs`: one for each level; that of LOD 0
    is not used.

    With `transitions` a level morphs to the next one, cross-fades with it, or both. A cloud morphs over all of its
    distances: it moves in proportion to the distance, so in no picture by more pixels than at the hand-over. After a
    morph alone the next level appears where the morph ends, else shortly before that. Without a morph it appears at its
    switch distance. It fades in while this level fades out.
    """
    result: list[LodRange] = []
    appear = gone = switch_distances[0]
    for end, way in zip((*switch_distances[1:], math.inf), (*hand_overs[1:], HandOverKind.FADE), strict=True):
        morphs, fades = transitions and way is not HandOverKind.FADE, transitions and way is not HandOverKind.MORPH
        start = (gone if result else max(START_SHARE * end, gone)) if morphs else math.inf
        hand_over = start + leafcloud.HAND_OVER * (end - start) if morphs and fades else end
        fade = (FADE_BEHIND_MORPH if morphs else FADE) * hand_over if fades else 0.0
        lod_range = LodRange(
            appear=appear,
            start=start,
            end=end if morphs else math.inf,
            vanish=hand_over + fade,
            fade_in_end=gone,
            fade_out_start=hand_over,
        )
        result.append(lod_range)
        appear, gone = hand_over, lod_range.vanish
    return tuple(result)


def shows_trunk(level: leafcloud.AnyLevel) -> bool:
    """Return whether the level's own textures show the trunk. Nothing morphs to such a level."""
    return level.method in ("cross", "octahedral")


def hand_over_to(level: leafcloud.AnyLevel) -> HandOverKind:
    """Return how this level takes over from the level before."""
    if shows_trunk(level):
        return HandOverKind.FADE
    return HandOverKind.MORPH if isinstance(level, leafcloud.LeafLevel) else HandOverKind.MORPH_AND_FADE


def trunk_range(ranges: Sequence[LodRange], number: int) -> LodRange:
    """Return the LOD range of the trunk of level `number`. Trunks neither morph nor cross-fade.

    Much of a trunk coincides with the next level's trunk, so the change is hardly seen. Only before an impostor does a
    trunk fade out with its level, because the impostor's textures show it.
    """
    own = ranges[number]
    morphs = math.isfinite(own.end)
    vanish = ranges[number + 1].appear if morphs else own.vanish
    fading = vanish if morphs else own.fade_out_start
    return LodRange(own.appear, math.inf, math.inf, vanish, fade_in_end=own.appear, fade_out_start=fading)


def rising(distances: Sequence[float]) -> tuple[float, ...]:
    """Return the distances, each raised to at least `LEAST_STEP` times the one before, so that every level is drawn."""
    result: list[float] = []
    for distance in distances:
        result.append(max(distance, LEAST_STEP * result[-1]) if result else distance)
    return tuple(result)
