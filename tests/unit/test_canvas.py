"""Blocks of preview.png: arrangement without overlaps, tight frames, text that is not clipped, heat maps."""

from __future__ import annotations

import numpy as np
import pytest

from addon.export import canvas

RED, BLUE = (255, 0, 0), (0, 0, 255)


def test_blocks_beside_and_below_one_another_keep_their_pixels() -> None:
    red, blue = canvas.empty(4, 6, RED), canvas.empty(7, 3, BLUE)
    for block, shape in ((canvas.beside([red, blue], 5), (7, 14, 3)), (canvas.below([red, blue], 5), (16, 6, 3))):
        assert block.shape == shape
        assert (block == RED).all(axis=2).sum() == red.shape[0] * red.shape[1]
        assert (block == BLUE).all(axis=2).sum() == blue.shape[0] * blue.shape[1]


def test_a_frame_is_the_smallest_box_of_both_silhouettes() -> None:
    pictures = [np.zeros((20, 30, 4), np.uint8) for _ in range(2)]
    pictures[0][5, 7, 3], pictures[1][12, 21, 3] = 1, 255
    assert canvas.silhouette(pictures, 0) == (5, 13, 7, 22)
    assert canvas.silhouette(pictures, 2) == (3, 15, 5, 24)
    assert canvas.silhouette([np.zeros((20, 30, 4), np.uint8)]) == (0, 20, 0, 30)
    assert canvas.silhouette([np.full((20, 30, 4), 255, np.uint8)], 2) == (0, 20, 0, 30)


def test_lines_are_wrapped_between_their_parts() -> None:
    parts = ["1,058 triangles with trunk", "texture 1024 × 512", "image error 0.114"]
    one = canvas.wrapped(parts, 14, 2000)
    three = canvas.wrapped(parts, 14, 200)
    assert one.shape[0] < three.shape[0]
    assert three.shape[1] <= 200 < one.shape[1]
    for block in (one, three):
        inked = np.flatnonzero((block != canvas.PAPER).any(axis=(0, 2)))
        assert 0 < len(inked) < block.shape[1]


def test_heat_rises_with_the_error() -> None:
    colors = canvas.heat(np.array([[0.0, 0.1, 0.25, 0.5, 1.0]], np.float32))[0].astype(int)
    assert (np.diff(colors.sum(axis=1))[:3] > 0).all()
    assert (colors[3] == colors[4]).all()
    bar = canvas.color_bar(60)
    assert bar.shape[0] == 60
    assert (bar[0, 0] == colors[3]).all()
    assert (bar[-1, 0] == colors[0]).all()


@pytest.mark.parametrize(
    ("value", "said"), [(0.0, "0"), (0.012345, "0.0123"), (39.22, "39.2"), (547.5, "548"), (2415.2, "2,415")]
)
def test_lengths_have_few_digits(value: float, said: str) -> None:
    assert canvas.number(value) == said
