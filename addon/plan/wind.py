"""The wind that moves a tree, and what of the tree's shape it depends on: plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]

FOOT_SHARE = 0.05
"""The share of the wood's height, from below, whose middle is the foot."""

FLAT = 1e-3
"""No tree is flatter or thinner than this share of what it is across."""

TINIEST = 1e-20
"""Nor smaller than this: what is a point does not move."""

PERIOD = 0.8
"""Seconds of a tree that is one unit tall."""

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Multiples of it lie evenly in [0, 1) however many there are."""


@dataclass(frozen=True)
class Wind:
    """What blows.

    direction: where to, in the world; of length 1.
    strength: in the units of Blender's force fields; below 0 it blows the other way.
    gusts: the share of it that comes and goes, in [0, 1]; the rest leans on the tree all the time.
    field: the name of the force field that it follows; None for one that follows nothing.

    Raises `ValueError` for a value that is outside its range or not finite.
    """

    direction: Vector = (1.0, 0.0, 0.0)
    strength: float = 2.0
    gusts: float = 0.5
    field: str | None = None

    def __post_init__(self) -> None:
        if not math.isclose(math.hypot(*self.direction), 1.0, abs_tol=1e-4):
            raise ValueError(f"direction is {self.direction}, it must be of length 1")
        if not math.isfinite(self.strength):
            raise ValueError(f"strength is {self.strength}, it must be finite")
        if not 0.0 <= self.gusts <= 1.0:
            raise ValueError(f"gusts is {self.gusts}, it must be in [0, 1]")


BREEZE = Wind()
"""What blows where wind is asked for and no force field says more: along X, moderately."""


@dataclass(frozen=True)
class Stature:
    """How a tree stands, in its own coordinates: the trunk's foot, the unit vector up, its height above the foot, how
    far its leaves reach from the axis through it, and the seconds in which its trunk sways to and fro once."""

    foot: Vector
    up: Vector
    height: float
    spread: float
    period: float


def stature(leaves: NDArray[np.float32], wood: NDArray[np.float32] | None, matrix: NDArray[np.float64]) -> Stature:
    """Of a tree with the points of `leaves` (n, 3), n > 0, and of `wood` (m, 3), in its own coordinates.

    `matrix` (4, 4) carries these to the world, where up is +Z. The period is 0.8 s · √(height / 1 m), with world units
    as metres: trees of one shape sway the slower the taller they are, as pendulums do, and a tree of 10 m in 2 … 4 s.
    """
    up = matrix[2, :3] / np.linalg.norm(matrix[2, :3])
    crown = leaves.astype(np.float64)
    standing = crown if wood is None or not len(wood) else wood.astype(np.float64)
    heights = standing @ up
    low = standing[heights <= heights.min() + FOOT_SHARE * np.ptp(heights)]
    lowest, highest = min(heights.min(), (crown @ up).min()), max(heights.max(), (crown @ up).max())
    foot = (low.min(axis=0) + low.max(axis=0)) / 2.0
    foot += (lowest - foot @ up) * up
    arms = crown - foot
    spread = np.linalg.norm(arms - (arms @ up)[:, None] * up, axis=1).max()
    least = max(FLAT * math.hypot(highest - lowest, spread), TINIEST)
    height, spread = max(float(highest - lowest), least), max(float(spread), least)
    scale = abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0)
    return Stature(_vector(foot), _vector(up), height, spread, PERIOD * math.sqrt(height * float(scale)))


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
