"""Reference formulas for transitions, pruning and wind in f64, as addon/nodes/lod.py and wind.py define them.

Symbols: γ growth, κ contrast, λ kept fraction of the leaves, ρ width of the ramp, τ phase in turns, φ phase of a leaf,
f flutter of a leaf, c pivot of a leaf, C pivot of its billboard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KNOTS = (np.arange(65) / 64) ** 2
"""Ranks of the entries in the table of area fractions."""


def transition(distance: Floats, start: Floats, end: Floats) -> Floats:
    return np.clip((distance - start) / np.maximum(end - start, 1e-30), 0.0, 1.0)


def stagger(place: Floats, amount: float) -> Floats:
    """Return the factor on the distances of trees at places (n, 3), y up: 1 + s·w(t), w a triangle wave from 0."""
    turns = np.asarray(place @ [0.7549, 0.4387, -0.5698])
    return 1.0 + amount * 2.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * turns))


def kept(distance: Floats, start: Floats, half: Floats) -> Floats:
    return np.minimum((start / np.maximum(distance, start)) ** (np.log(0.5) / np.log(half)), 1.0)


def ramp(rank: Floats, keep: Floats) -> Floats:
    width = np.minimum(0.05, 1.0 - keep) * keep
    ratio = np.clip((keep - rank) / np.maximum(width, 1e-30), 0.0, 1.0)
    return np.where(rank < 0.0, 1.0, np.where(rank < keep, ratio, 0.0))


def drawn_share(keep: Floats | float, shares: Floats) -> Any:
    """Return the drawn fraction of the area, 1/s², from the table C: C(λ(1−ρ)) + (C(λ) − C(λ(1−ρ)))/3."""
    whole = np.interp(keep * (1.0 - np.minimum(0.05, 1.0 - keep)), KNOTS, shares)
    return whole + (np.interp(keep, KNOTS, shares) - whole) / 3.0


def trend(keep: Floats, first: Floats, second: Floats) -> Floats:
    """Return γ, or κ without its limit of 1, for a kept fraction above 0."""
    logarithm = np.log(keep)
    return np.exp(logarithm * (first + second * logarithm))


def bisected(rises: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of an increasing function between `low` and `high`, by bisection."""
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if rises(middle) < 0.0 else (low, middle)
    return low


def sun_share(opened: float, toward: float, cosine: float) -> float:
    """Return the visible fraction of the sun at an angle with this cosine, from the fitted ramp clamp(c + k · cos).

    Bisection fits the ramp: its mean over the sphere is `opened`, and three times its mean with the cosine is `toward`.
    `toward` lies between 0 and the value of a cone, 3 · opened · (1 − opened).
    """
    heights = (np.arange(2000) + 0.5) / 1000 - 1.0

    def ramp_of(slope: float) -> Callable[[Any], Any]:
        mean = bisected(lambda c: np.clip(c + slope * heights, 0.0, 1.0).mean() - opened, -slope, 1.0 + slope)
        return lambda cosine: np.clip(mean + slope * cosine, 0.0, 1.0)

    slope = bisected(lambda slope: 3.0 * (ramp_of(slope)(heights) * heights).mean() - toward, 0.0, 20.0)
    return float(ramp_of(slope)(cosine))


FORCE_HALF = 4.0
PLACE_TURNS = np.array([0.1732, 0.1414, 0.2236])


@dataclass(frozen=True)
class Air:
    """Inputs of the wind.

    `direction` and `up` have length 1. `foot`, `height` and `spread` are in the tree's coordinates. `turns` is τ.
    """

    direction: Floats
    up: Floats
    foot: Floats
    height: float
    spread: float
    strength: float
    gusts: float
    turns: float
    sway: float = 0.1
    branches: float = 0.1
    flutter: float = 0.35

    @property
    def force(self) -> float:
        return self.strength / (abs(self.strength) + FORCE_HALF)

    @property
    def across(self) -> Floats:
        return np.cross(self.up, self.direction)

    @property
    def gust(self) -> float:
        full, slow = (np.sin(2.0 * np.pi * speed * self.turns) for speed in (1.0, 0.618))
        return 1.0 - self.gusts + self.gusts * (0.6 * full + 0.4 * slow)


def tree_turns(seconds: float, period: float, place: Floats) -> float:
    """Return τ of a tree at the world position `place`."""
    return seconds / period + float(PLACE_TURNS @ place)


def sway_at(places: Floats, air: Air) -> Any:
    """Return the displacement w (n, 3) of the trunk at `places` (n, 3).

    Places may be complex, because w is analytic above the foot.
    """
    y = places - air.foot
    rise = y @ air.up
    above = np.where(rise.real > 0.0, rise, 0.0)
    out = y - rise[:, None] * air.up
    theta = 2.0 * np.pi * 2.3 * air.turns - y @ (2.0 * (air.direction + air.across)) / air.spread
    lean = air.force * air.sway * air.height * air.gust * (above / air.height) ** 2
    swing = air.force * air.branches * air.spread * (out * out).sum(axis=1) / air.spread**2 * np.sin(theta)
    return lean[:, None] * air.direction + swing[:, None] * (air.direction + air.up) / 2.0


def carried(points: Floats, pivots: Floats, air: Air) -> Floats:
    """Return W_c (n, 3), the sum of w and its derivative along x − c. A complex step gives the exact derivative."""
    step = 1e-20
    moved = sway_at(pivots + 1j * step * (points - pivots), air)
    return moved.real + moved.imag / step


def turned(arms: Floats, axes: Floats, angles: Floats) -> Floats:
    """Rotate the vectors (n, 3) about `axes` (n, 3) of any length by `angles` (n,), with Rodrigues' formula."""
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    n = np.divide(axes, length, out=np.zeros_like(axes), where=length > 0.0)
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return arms * cosine + np.cross(n, arms) * sine + n * (n * arms).sum(axis=1, keepdims=True) * (1.0 - cosine)


def fluttered(points: Floats, centres: Floats, phases: Floats, free: Floats, a: float, air: Air) -> Floats:
    """Return the points (n, 3) after the flutter: turned about c(a), with φ and f (n,) of their leaves."""
    rolls = np.sin(2.0 * np.pi * (5.0 * air.turns + phases))[:, None] * air.direction
    rolls = rolls + np.sin(2.0 * np.pi * (6.9 * air.turns + 3.0 * phases))[:, None] * air.across
    axes = rolls / np.sqrt(2.0)
    angles = abs(air.force) * air.flutter * free * (1.0 - a) * np.linalg.norm(axes, axis=1)
    return centres + turned(points - centres, axes, angles)


def blown(points: Floats, pivots: Floats, carriers: Floats, a: float, air: Air) -> Floats:
    """Return the fluttered points (n, 3) after sway and branch motion. Leaf pivots are c, billboard pivots are C."""
    return points + (1.0 - a) * carried(points, pivots, air) + a * carried(points, carriers, air)
