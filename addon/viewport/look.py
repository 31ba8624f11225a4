"""Shader uniforms of a level at a distance. No bpy.

The laws are in shaders/leafcloud.glsl. This module computes only the numbers that are the same for all vertices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import leafcloud

_TINY = 1e-30


@dataclass(frozen=True)
class LevelInputs:
    """The inputs of a level's node group (`nodes.lod.LodSettings`), and its table of areas (mesh extras).

    Distances are in the object's own units. `area_shares`: 65 numbers that rise from 0 to 1; if empty, the scale s of
    kept leaves stays 1.
    """

    start: float
    end: float
    prune_start: float
    prune_half: float
    appear: float
    vanish: float
    fade_in_end: float
    fade_out_start: float
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    mean_color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    area_shares: tuple[float, ...] = ()


@dataclass(frozen=True)
class Uniforms:
    """The uniforms of the shader.

    transition: d, start, end. keep: d, d₀, h. scale: s·γ. next_share: the fraction of the pixels that show the next
    level, or this level if `coming` is true. contrast, mean_color: arguments of the laws.
    """

    transition: tuple[float, float, float]
    keep: tuple[float, float, float]
    scale: float
    next_share: float
    coming: bool
    contrast: tuple[float, float]
    mean_color: tuple[float, float, float]


def look_at(level: LevelInputs, distance: float) -> Uniforms | None:
    """Return the uniforms at `distance` ≥ 0; None if the level is not drawn.

    During a cross-fade each of two levels shows a fraction of the pixels, from the distance where one appears to the
    distance where the other vanishes.
    """
    if not level.appear <= distance < level.vanish:
        return None
    kept = _keep(distance, level.prune_start, level.prune_half)
    fades_out, fades_in = level.fade_out_start < level.vanish, level.fade_in_end > level.appear
    going = _share(distance, level.fade_out_start, level.vanish) if fades_out else 0.0
    come = _share(distance, level.appear, level.fade_in_end) if fades_in else 1.0
    return Uniforms(
        transition=(distance, level.start, level.end),
        keep=(distance, level.prune_start, level.prune_half),
        scale=_area_scale(kept, level.area_shares) * _trend(kept, level.growth),
        next_share=going if going > 0.0 else come,
        coming=going == 0.0,
        contrast=level.contrast,
        mean_color=level.mean_color,
    )


def _share(value: float, start: float, end: float) -> float:
    return min(max((value - start) / (end - start), 0.0), 1.0)


def _keep(distance: float, start: float, half: float) -> float:
    """Return λ. Clamp the numbers as the node group does."""
    return leafcloud.keep(distance, max(start, _TINY), min(max(half, _TINY), 0.5))


def _trend(keep: float, numbers: tuple[float, float]) -> float:
    logarithm = math.log(keep)
    return math.exp(logarithm * (numbers[0] + numbers[1] * logarithm))


def _area_scale(keep: float, shares: Sequence[float]) -> float:
    """Return s from the table, as `lc_area_scale` does, but once instead of at each vertex."""
    if keep >= 1.0 or not shares:
        return 1.0
    whole, most = (_share_below(rank, shares) for rank in (keep * (1.0 - min(leafcloud.RAMP, 1.0 - keep)), keep))
    drawn = whole + (most - whole) / 3.0
    return 1.0 / math.sqrt(drawn) if drawn > 0.0 else 1.0


def _share_below(rank: float, shares: Sequence[float]) -> float:
    """Interpolate the table linearly between its entries at the ranks (i / n)²."""
    steps = len(shares) - 1
    below = min(int(math.sqrt(rank) * steps), steps - 1)
    first, second = ((i / steps) ** 2 for i in (below, below + 1))
    return shares[below] + (shares[below + 1] - shares[below]) * (rank - first) / (second - first)
