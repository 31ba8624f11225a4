"""The share of a level's texture that mip levels keep above the cutoff, for `leafcloud inspect`.

Engines make box-filtered mip levels of a PNG: alpha is the mean of 2 × 2 texels. Places are drawn at random on the
triangles, by their area on the texture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PLACES = 20_000


def kept_by_mips(
    alpha: NDArray[np.float64], corners: NDArray[np.float64], cutoff: float, mips: int
) -> list[float] | None:
    """Return the share of the triangles at or above the cutoff in each mip level, over that of the texture itself.

    alpha: (h, w), row 0 on top. corners: texture coordinates (t, 3, 2). None if nothing reaches the cutoff.
    """
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    if not areas.sum() > 0.0:
        return None
    random = np.random.default_rng(1)
    chosen = random.choice(len(areas), _PLACES, p=areas / areas.sum())
    shares = random.random((_PLACES, 2))
    beyond = shares.sum(axis=1) > 1.0
    shares[beyond] = 1.0 - shares[beyond]
    places = corners[chosen, 0] + (sides[chosen] * shares[:, :, None]).sum(axis=1)
    own = _above(alpha, places, cutoff)
    found = []
    for _ in range(mips):
        alpha = _halved(alpha)
        found.append(_above(alpha, places, cutoff) / max(own, 1e-9))
    return found if own > 0.0 else None


def _above(alpha: NDArray[np.float64], places: NDArray[np.float64], cutoff: float) -> float:
    """Return the share of the places at which alpha, between centers of texels, reaches the cutoff."""
    size = np.array(alpha.shape[::-1])
    at = places * size - 0.5
    low = np.floor(at).astype(np.int64)
    right, down = (at - low).T
    (x, y), (beside, below) = (low % size).T, ((low + 1) % size).T
    above = alpha[y, x] * (1.0 - right) + alpha[y, beside] * right
    under = alpha[below, x] * (1.0 - right) + alpha[below, beside] * right
    return float((above * (1.0 - down) + under * down >= cutoff).mean())


def _halved(alpha: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return means of 2 × 2 texels. The last row and column of an odd size are left out, as engines do."""
    height, width = (max(side // 2, 1) for side in alpha.shape)
    rows = alpha if alpha.shape[0] == 1 else (alpha[: 2 * height : 2] + alpha[1 : 2 * height : 2]) / 2.0
    if alpha.shape[1] == 1:
        return rows
    means: NDArray[np.float64] = (rows[:, : 2 * width : 2] + rows[:, 1 : 2 * width : 2]) / 2.0
    return means
