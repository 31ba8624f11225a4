"""How much one picture of a tree differs from another: difference, coverage, contrast, cells and color."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import flip_evaluator
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter

Picture = NDArray[np.float32]
"""(size, size, 4), sRGB codes from 0 to 1 with straight alpha."""
Pictures = NDArray[np.float32]
"""(views, size, size, 4), linear light, premultiplied."""

SKY = np.array([0.55, 0.66, 0.78], np.float32)
SIGMAS = (1.0, 2.0, 4.0)
"""Widths in pixels of the blurs between which the octaves lie, behind the picture itself."""
CELLS = 16
LEAST_INSIDE = 40
"""Fewest pixels inside the crown for its contrast to count: a few pixels between two gaps are no texture."""


def looks(base: Pictures, other: Pictures) -> dict[str, Any]:
    """Compare pictures of a tree with those of its leaves. Returns means over the views.

    - flip: mean FLIP within four pixels of either silhouette, over a sky.
    - coverage: over that of the leaves.
    - contrast: of the finest three octaves inside the crown, over that of the leaves. 0.3 in the first is a blur, 1.2
      in the others are lumps.
    - cells: error of the covered share of 16 × 16 cells.
    - color: largest difference of a channel's mean code.
    """
    rows = [compared(encoded(a), encoded(b)) for a, b in zip(base, other, strict=True)]
    return {name: np.mean([row[name] for row in rows], axis=0).tolist() for name in rows[0]}


def compared(a: Picture, b: Picture) -> dict[str, Any]:
    color_a, color_b = ((each[..., :3] * each[..., 3:]).sum((0, 1)) / each[..., 3].sum() for each in (a, b))
    return {
        "flip": flip(a, b),
        "coverage": b[..., 3].sum() / a[..., 3].sum(),
        "contrast": contrast(a, b),
        "cells": np.abs(cells(a) - cells(b)).sum() / cells(a).sum(),
        "color": np.abs(color_a - color_b).max(),
    }


def encoded(picture: NDArray[np.float32]) -> Picture:
    light = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    codes = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1.0 / 2.4) - 0.055)
    return np.concatenate([codes, picture[..., 3:]], axis=-1).clip(0.0, 1.0).astype(np.float32)


def over_sky(picture: Picture) -> NDArray[np.float32]:
    codes, alpha = picture[..., :3], picture[..., 3:]
    return np.asarray(codes * alpha + SKY * (1.0 - alpha), np.float32)


def flip(a: Picture, b: Picture) -> float:
    near = binary_dilation(np.maximum(a[..., 3], b[..., 3]) > 0.5, iterations=4)
    error = np.asarray(flip_evaluator.evaluate(over_sky(a), over_sky(b), "LDR", applyMagma=False)[0])
    return float(error.reshape(*near.shape, -1)[..., 0][near].mean())


def contrast(a: Picture, b: Picture) -> list[float]:
    inside = gaussian_filter(a[..., 3], 4.0) > 0.6
    if inside.sum() < LEAST_INSIDE:
        return [1.0] * len(SIGMAS)
    return [y / x for x, y in zip(octaves(a, inside), octaves(b, inside), strict=True)]


def octaves(picture: Picture, inside: NDArray[np.bool_]) -> list[float]:
    """Return the root mean square of each octave of the luminance."""
    luminance = over_sky(picture) @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    blurred = [luminance, *(gaussian_filter(luminance, sigma) for sigma in SIGMAS)]
    return [float(np.sqrt(((fine - coarse)[inside] ** 2).mean())) for fine, coarse in pairwise(blurred)]


def cells(picture: Picture) -> NDArray[np.float32]:
    """Return the covered share of each cell."""
    step = len(picture) // CELLS
    whole = picture[: CELLS * step, : CELLS * step, 3]
    means: NDArray[np.float32] = whole.reshape(CELLS, step, CELLS, step).mean((1, 3))
    return means
