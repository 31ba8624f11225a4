"""Mip levels of a page that lie under one another in one image of a file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def levels_in(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the square mip levels that lie under one another at the left side of an image, the largest first."""
    found, top, side = [], 0, image.shape[1]
    while side:
        found.append(image[top : top + side, :side])
        top, side = top + side, side // 2
    assert top == len(image)
    return found
