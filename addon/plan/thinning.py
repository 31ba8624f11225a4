"""Where leaves are pruned, in each of the chains. World units.

- `billboards`: all leaves stay until level 1 takes over.
- `pruning`: leaves are pruned down to `CUT_OFF`; then the cross takes over, without clouds between.
- `both`: leaves are pruned from d₀ on; level 1 is made of those that are left where it takes over, as large as they
  have grown by then, so that it shows just what was there before.

The law is λ(d) = min((d₀/d)^p, 1) with p = log_h ½ (Gomez, after Cook et al.). d₀ is where a leaf is seen smaller than
some pixels, so that what is lost is small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

CUT_OFF = 0.005
"""The λ below which nothing is gained."""


@dataclass(frozen=True)
class Thinning:
    """d₀ (`start`, infinite: nothing is pruned) and h (`half`, in (0, ½])."""

    start: float = math.inf
    half: float = 0.5


def power(half: float) -> float:
    """p = ln ½ / ln h of the law; h in (0, ½]."""
    return math.log(0.5) / math.log(half)


def share_left(start: float, distance: float, half: float) -> float:
    """λ at a distance, at least `CUT_OFF`: there leaves are no longer worth drawing."""
    return float(max(min((start / distance) ** power(half), 1.0), CUT_OFF))


def start_for(share: float, distance: float, half: float) -> float:
    """The d₀ from which just `share` of the leaves, in (0, 1), is left at the distance."""
    return float(distance * share ** (1.0 / power(half)))


def cut_off_distance(start: float, half: float) -> float:
    """Where λ reaches `CUT_OFF`."""
    return float(start * CUT_OFF ** (-1.0 / power(half)))


def halvings(prune_start: float, prune_half: float, until: float) -> tuple[tuple[float, float], ...]:
    """The shares ½, ¼ … of the leaves, and from where each is drawn: where λ(d) has fallen to it, nearer than `until`.

    λ(d₀/hⁿ) = ½ⁿ, with d₀ = `prune_start` > 0 and h = `prune_half` in (0, ½]. The shares end at the cut-off.
    Raises `ValueError` for values outside.
    """
    if not (prune_start > 0.0 and 0.0 < prune_half <= 0.5):
        raise ValueError(f"prune_start is {prune_start}, prune_half {prune_half}: they must be above 0, and in (0, ½]")
    result = []
    keep, distance = 0.5, prune_start / prune_half
    while keep >= CUT_OFF and distance < until:
        result.append((keep, distance))
        keep, distance = keep / 2.0, distance / prune_half
    return tuple(result)
