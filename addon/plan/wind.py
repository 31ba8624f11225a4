"""The wind that moves a tree, and the tree's measurements that its motion depends on. Plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]

FOOT_SHARE = 0.05
"""The trunk's foot is the middle of this lowest fraction of its height."""

FLAT = 1e-3
"""Least height and spread of a tree, as a fraction of its diagonal (height and spread)."""

TINIEST = 1e-20
"""Least height and spread in the tree's own units. A tree that is a single point does not move."""

PERIOD = 0.8
"""Period of a tree one world unit tall, in seconds."""

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""The fractional parts of its multiples are spread evenly over [0, 1), for any number of them."""


@dataclass(frozen=True)
class Wind:
    """A wind.

    direction: the direction it blows to, in the world; of length 1.
    strength: in the units of Blender's force fields; below 0 it blows the other way.
    gusts: the fraction of the strength that comes and goes, in [0, 1]; the rest is constant.
    field: the name of the force field that sets the wind; None without one.

    Raises `ValueError` for a value that is out of range or not finite.
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
"""The wind if the effect is forced on but the scene has no force field: moderate, along X."""


@dataclass(frozen=True)
class Stature:
    """Measurements of a tree in its own coordinates.

    foot: the foot of the trunk. up: the unit vector up. height: above the foot. spread: the greatest distance of a leaf
    from the axis through the foot. period: the seconds of one sway of the trunk to and fro.
    """

    foot: Vector
    up: Vector
    height: float
    spread: float
    period: float


def stature(leaves: NDArray[np.float32], trunk: NDArray[np.float32] | None, matrix: NDArray[np.float64]) -> Stature:
    """Measure a tree with the points of `leaves` (n, 3), n > 0, and `trunk` (m, 3), in its own coordinates.

    `matrix` (4, 4) transforms its coordinates to the world, where up is +Z. The period is 0.8 s · √(height / 1 m), with
    world units as meters: taller trees of the same shape sway more slowly, as pendulums do. A 10 m tree takes 2 to 4 s.
    """
    up = matrix[2, :3] / np.linalg.norm(matrix[2, :3])
    crown = leaves.astype(np.float64)
    standing = crown if trunk is None or not len(trunk) else trunk.astype(np.float64)
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
