"""Pruning distances for each chain, in world units.

- `billboards`: all leaves stay until level 1 takes over.
- `pruning`: leaves are pruned down to `CUT_OFF`; then the cross impostor takes over. There are no clouds.
- `both`: leaves are pruned from d₀ on. Level 1 is made from the leaves kept at the distance where it takes over, at the
  size that they have grown to, so it shows the same leaves.

The law is λ(d) = min((d₀/d)^p, 1) with p = log_h ½ (Gomez, after Cook et al.). At d₀ a leaf covers only a few pixels,
so pruning is hardly visible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import leafcloud

CUT_OFF = 0.005
"""The λ below which pruning gains nothing more."""


@dataclass(frozen=True)
class PruneDistances:
    """The constants of the pruning law: d₀ (`start`; infinite: no pruning) and h (`half`, in (0, ½])."""

    start: float = math.inf
    half: float = 0.5


def power(half: float) -> float:
    """Return the exponent p = ln ½ / ln h of the law, for h in (0, ½]."""
    return math.log(0.5) / math.log(half)


def share_left(start: float, distance: float, half: float) -> float:
    """Return λ at a distance, at least `CUT_OFF`: below it leaves are not worth drawing."""
    return max(leafcloud.keep(distance, start, half), CUT_OFF)


def start_for(share: float, distance: float, half: float) -> float:
    """Return the d₀ that keeps `share` of the leaves, in (0, 1), at the distance."""
    return float(distance * share ** (1.0 / power(half)))


def cut_off_distance(start: float, half: float) -> float:
    """Return the distance at which λ reaches `CUT_OFF`."""
    return float(start * CUT_OFF ** (-1.0 / power(half)))


def halvings(prune_start: float, prune_half: float, until: float) -> tuple[tuple[float, float], ...]:
    """Return pairs of a share ½, ¼ … of the leaves and the distance where λ(d) falls to it, nearer than `until`.

    λ(d₀/hⁿ) = ½ⁿ, with d₀ = `prune_start` > 0 and h = `prune_half` in (0, ½]. The shares end at `CUT_OFF`.
    Raises `ValueError` for values out of range.
    """
    if not (prune_start > 0.0 and 0.0 < prune_half <= 0.5):
        raise ValueError(f"prune_start is {prune_start}, prune_half {prune_half}: they must be above 0, and in (0, ½]")
    result = []
    keep, distance = 0.5, prune_start / prune_half
    while keep >= CUT_OFF and distance < until:
        result.append((keep, distance))
        keep, distance = keep / 2.0, distance / prune_half
    return tuple(result)
