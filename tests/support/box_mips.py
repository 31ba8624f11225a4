"""Mip levels as engines make them, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def linear(codes: Floats) -> Floats:
    """Return sRGB codes from 0 to 1 as linear light (IEC 61966-2-1)."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def encoded(light: Floats) -> Floats:
    """Return linear light from 0 to 1 as sRGB codes."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 1e-9) ** (1.0 / 2.4) - 0.055)


def box_filtered(page: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return an image (h, w, 4) and its mip levels, by means of 2 × 2 texels in linear light, down to 8 texels."""
    levels = [page]
    while min(levels[-1].shape[:2]) >= 16:
        height, width = (side // 2 for side in levels[-1].shape[:2])
        texels = levels[-1][: 2 * height, : 2 * width] / 255.0
        texels[..., :3] = linear(texels[..., :3])
        means = texels.reshape(height, 2, width, 2, 4).mean((1, 3))
        means[..., :3] = encoded(means[..., :3])
        levels.append(np.rint(255.0 * means).astype(np.uint8))
    return levels
