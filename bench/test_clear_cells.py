"""Removal of transparent cells before Cycles renders: texels with alpha stay, most transparent cells go."""

from __future__ import annotations

import numpy as np
import pytest
from clear_cells import without_clear
from numpy.typing import NDArray

SIZE = 64


def square(low: float, high: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return a unit square in the plane z = 0 as two triangles, with texture coordinates from `low` to `high`."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], np.float32)
    return corners, low + (high - low) * corners[..., :2]


def area(corners: NDArray[np.float32]) -> float:
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )


def held(point: tuple[float, float], places: NDArray[np.float32]) -> bool:
    """Return whether a triangle contains the point, from the signs of three areas."""
    to = places - np.array(point, np.float32)
    after = np.roll(to, -1, axis=1)
    signs = to[..., 0] * after[..., 1] - to[..., 1] * after[..., 0]
    return bool(((signs >= -1e-6).all(1) | (signs <= 1e-6).all(1)).any())


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.3, 0.6), (0.0, 3.0)])
def test_texels_with_alpha_stay(low: float, high: float) -> None:
    drawn = np.zeros((SIZE, SIZE), bool)
    drawn[5, 9] = drawn[40:44, 0] = drawn[63, 30] = True
    corners, places = without_clear(square(low, high), drawn, 100_000)
    for row, column in np.argwhere(drawn):
        for tile in np.ndindex(5, 5):
            # A filter reads a texel as far away as the center of the neighboring texel.
            for across, up in ((0.5, 0.5), (-0.4, 0.5), (1.4, 1.4)):
                point = ((column + across) / SIZE + tile[0] - 1.0, (row + up) / SIZE + tile[1] - 1.0)
                if all(low <= part <= high for part in point):
                    assert held(point, places), point
    # Coordinates and corners still belong together.
    np.testing.assert_allclose(low + (high - low) * corners[..., :2], places, atol=1e-6)


def test_most_transparent_cells_are_removed() -> None:
    drawn = np.zeros((SIZE, SIZE), bool)
    drawn[5, 9] = True
    corners, _ = without_clear(square(0.0, 1.0), drawn, 100_000)
    assert 1.0 / SIZE**2 < area(corners) < 100.0 / SIZE**2


def test_a_full_texture_leaves_the_triangles_as_they_are() -> None:
    corners, places = square(0.1, 0.6)
    kept = without_clear((corners, places), np.ones((SIZE, SIZE), bool), 100_000)
    np.testing.assert_array_equal(kept[0], corners)


def test_the_number_of_triangles_stays_within_the_limit() -> None:
    drawn = np.random.default_rng(1).random((SIZE, SIZE)) < 0.5
    corners, _ = without_clear(square(0.0, 1.0), drawn, 500)
    assert 100 < len(corners) <= 500
    assert area(corners) == pytest.approx(1.0, abs=0.1)
