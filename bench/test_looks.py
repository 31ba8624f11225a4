"""Comparisons of pictures in `make bench-pages`: coverage, contrast, cells and color of pictures with known ones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("flip_evaluator", reason="only tools/requirements/fidelity.txt has it")
pytest.importorskip("scipy")

from looks import looks

SIDE = 64


def crown(light: NDArray[np.float64] | float, *, width: int = 32) -> NDArray[np.float32]:
    """Return one picture of a gray square in its middle, in linear light."""
    picture = np.zeros((1, SIDE, SIDE, 4), np.float32)
    start = (SIDE - width) // 2
    inside = slice(start, start + width)
    picture[0, inside, inside, :3] = np.broadcast_to(np.asarray(light)[..., None], (width, width, 3))
    picture[0, inside, inside, 3] = 1.0
    return picture


def stripes(period: int, contrast: float) -> NDArray[np.float64]:
    """Return gray codes around 0.5, as linear light."""
    codes = 0.5 + contrast * (np.arange(32) // (period // 2) % 2 - 0.5)
    return np.tile(((codes + 0.055) / 1.055) ** 2.4, (32, 1))


def test_a_picture_is_like_itself() -> None:
    found = looks(crown(stripes(2, 0.2)), crown(stripes(2, 0.2)))
    assert (found["flip"], found["cells"], found["color"]) == (0.0, 0.0, 0.0)
    assert (found["coverage"], found["contrast"]) == (1.0, [1.0, 1.0, 1.0])


def test_coverage_is_that_of_the_areas() -> None:
    assert looks(crown(0.2), crown(0.2, width=16))["coverage"] == pytest.approx(0.25)


def test_half_of_the_contrast_is_found_in_the_finest_octave() -> None:
    found = looks(crown(stripes(2, 0.4)), crown(stripes(2, 0.2)))
    assert found["contrast"][0] == pytest.approx(0.5, abs=0.02)


def test_color_is_the_difference_of_codes() -> None:
    assert looks(crown(stripes(2, 0.0)), crown(((0.6 + 0.055) / 1.055) ** 2.4))["color"] == pytest.approx(0.1, abs=1e-4)
