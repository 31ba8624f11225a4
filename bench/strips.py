"""Strips of twelve trees for a blind reader: six of them are another model.

The reader sees only the strip, not enlarged, and marks six. By chance three are right. Compare the right marks with
those in strips of the control (`sway.py`).
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leafcloud

Picture = NDArray[np.uint8]

ACROSS, TREES = 6, 12
GAP, LETTERS = 4, 12.0
"""Pixels around each tree, and per em of its number."""


def write_strip(leaves: Sequence[Picture], other: Sequence[Picture], path: Path, seed: int | None = None) -> list[int]:
    """Write a strip of opaque pictures of twelve views; return the numbers of the trees that are `other`."""
    choice = random.Random(seed)
    order, altered = choice.sample(range(TREES), TREES), choice.sample(range(TREES), TREES // 2)
    trees = [numbered((other if at in altered else leaves)[view], at + 1) for at, view in enumerate(order)]
    rows = [np.hstack(trees[start : start + ACROSS]) for start in range(0, TREES, ACROSS)]
    leafcloud.write_png(str(path), np.vstack(rows))
    return sorted(at + 1 for at in altered)


def numbered(picture: Picture, number: int) -> Picture:
    """Return the picture with a margin, and its number above it."""
    ink = leafcloud.draw_text(str(number), LETTERS)
    height, width = ink.shape
    framed = np.pad(picture, ((height, GAP), (GAP, GAP), (0, 0)), mode="edge")
    framed[:height, GAP : GAP + width, :3] = framed[:height, GAP : GAP + width, :3] * (1.0 - ink[..., None] / 255.0)
    return framed
