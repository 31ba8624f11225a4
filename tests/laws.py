"""The laws of transition and pruning in f64, written out as addon/build/lod_nodes.py states them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KNOTS = (np.arange(65) / 64) ** 2
"""The ranks of the table of areas."""


def transition(distance: Floats, start: Floats, end: Floats) -> Floats:
    return np.clip((distance - start) / np.maximum(end - start, 1e-30), 0.0, 1.0)


def kept(distance: Floats, start: Floats, half: Floats) -> Floats:
    return np.minimum((start / np.maximum(distance, start)) ** (np.log(0.5) / np.log(half)), 1.0)


def ramp(rank: Floats, keep: Floats) -> Floats:
    width = np.minimum(0.05, 1.0 - keep) * keep
    ratio = np.clip((keep - rank) / np.maximum(width, 1e-30), 0.0, 1.0)
    return np.where(rank < 0.0, 1.0, np.where(rank < keep, ratio, 0.0))


def drawn_share(keep: Floats | float, shares: Floats) -> Any:
    """1/s² by the table: C(λ(1−ρ)) + (C(λ) − C(λ(1−ρ)))/3."""
    whole = np.interp(keep * (1.0 - np.minimum(0.05, 1.0 - keep)), KNOTS, shares)
    return whole + (np.interp(keep, KNOTS, shares) - whole) / 3.0


def trend(keep: Floats, first: Floats, second: Floats) -> Floats:
    """γ, and κ before it is cut off at 1; of `keep` above 0."""
    logarithm = np.log(keep)
    return np.exp(logarithm * (first + second * logarithm))


def grazing(cosine: Floats, width: float) -> Floats:
    """The share of a face that is shown; `width` above 0."""
    t = np.clip(np.abs(cosine) / width, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
