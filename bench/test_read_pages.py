"""Textures as engines read them in `make bench-pages`: the mip level for a slant, and the mix of two levels."""

from __future__ import annotations

import numpy as np
import pytest
from read_pages import mip_levels, mixed


def triangle(right: tuple[float, float, float], up: tuple[float, float, float]) -> list[list[float]]:
    return [[0.0, 0.0, 0.0], list(right), list(up)]


def test_triangles_that_slant_are_read_coarser() -> None:
    """A triangle of 8 × 8 pixels with a texel a pixel; seen at 60°, it is half as wide: one level."""
    eye = np.array([0.0, -1.0, 0.0])
    slant = 8.0 * np.sqrt(0.75)
    diagonal = np.sqrt(0.5)
    corners = np.array(
        [
            triangle((8.0, 0.0, 0.0), (0.0, 0.0, 8.0)),
            triangle((4.0, slant, 0.0), (0.0, 0.0, 8.0)),
            triangle((8.0, 0.0, 0.0), (0.0, slant, 4.0)),
            triangle((8.0 * diagonal, 0.0, 8.0 * diagonal), (-8.0 * diagonal, 0.0, 8.0 * diagonal)),
            triangle((-8.0, 0.0, 0.0), (0.0, 0.0, 8.0)),
        ]
    )
    texels = np.tile(np.array([[0.0, 0.0], [8.0, 0.0], [0.0, 8.0]]), (len(corners), 1, 1))
    assert mip_levels(corners, texels, eye) == pytest.approx([0.0, 1.0, 1.0, 0.0, 0.0])
    assert mip_levels(corners, 4.0 * texels, eye) == pytest.approx([2.0, 3.0, 3.0, 2.0, 2.0])


def test_a_mip_level_is_mixed_with_the_next_in_linear_light() -> None:
    fine = np.full((4, 4, 4), 255, np.uint8)
    coarse = np.zeros((2, 2, 4), np.uint8)
    assert (mixed(fine, coarse, 0.25)[..., 3] == 191).all()
    assert (mixed(fine, coarse, 0.5)[..., 0] == 188).all(), "half the light is the code 188"
    coarse[:, 1] = 255
    columns = mixed(np.zeros_like(fine), coarse, 1.0)[0, :, 3]
    assert columns.tolist() == [0, 64, 191, 255], "centers lie at 0, 1/4, 3/4 and 1 of the way between texels"
