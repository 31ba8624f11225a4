"""Image for preview.png: leaves and levels side by side, enlarged and at the size where each level takes over."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..plan.lod_range import View

WIDEST = 1600
"""Maximum width of the image in pixels."""
LARGEST_CELL = 384
SMALLEST_CELL = 8
GAP = 16
GROUND = (204, 214, 224)
"""Background color in sRGB, a pale sky. It is not gray because surfaces without a material are gray."""
DIRECTION = (0.45, -1.0, 0.2)
"""Direction from the tree to the eye."""


def preview_image(
    foliage: leafcloud.Foliage,
    trunks: Sequence[leafcloud.Foliage | None],
    levels: Sequence[leafcloud.Level],
    switch_distances: Sequence[float],
    view: View,
) -> NDArray[np.uint8]:
    """Return an image (h, w, 4) with three rows of pictures.

    Row 1: leaves and levels, enlarged. Rows 2 and 3: the leaves, and below them each level, at the size where the level
    takes over. `trunks` (the trunks) and `switch_distances` have one entry per level, LOD 0 first.
    """
    leaves = [foliage, *(level.foliage() for level in levels)]
    subjects = [[part, *([] if trunk is None else [trunk])] for part, trunk in zip(leaves, trunks, strict=True)]
    centre, radius = _sphere(subjects[0])
    cell = min(LARGEST_CELL, (WIDEST - GAP) // len(subjects) - GAP)
    sizes = [seen_size(radius, distance, view, cell) for distance in switch_distances[1:]]

    def picture(parts: Sequence[leafcloud.Foliage], size: int) -> NDArray[np.uint8]:
        return leafcloud.render(parts, DIRECTION, size, centre=centre, radius=radius)

    nothing = np.zeros((0, 0, 4), np.uint8)
    rows = [
        [picture(parts, cell) for parts in subjects],
        [nothing, *(picture(subjects[0], size) for size in sizes)],
        [nothing, *(picture(parts, size) for parts, size in zip(subjects[1:], sizes, strict=True))],
    ]
    return compose(rows, cell)


def stacked(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Stack the images of several trees, with the background color beside narrower ones."""
    width = max(picture.shape[1] for picture in pictures)
    sheet = np.empty((sum(picture.shape[0] for picture in pictures), width, 4), np.uint8)
    sheet[:] = (*GROUND, 255)
    top = 0
    for picture in pictures:
        sheet[top : top + picture.shape[0], : picture.shape[1]] = picture
        top += picture.shape[0]
    return sheet


def seen_size(radius: float, distance: float, view: View, largest: int) -> int:
    """Return the pixels that the sphere's diameter covers at `distance`, from `SMALLEST_CELL` to `largest`."""
    reach = 2.0 * distance * math.tan(view.field_of_view / 2.0)
    size = largest if reach <= 0.0 else 2.0 * radius / reach * view.resolution
    return int(min(max(size, SMALLEST_CELL), largest))


def compose(rows: Sequence[Sequence[NDArray[np.uint8]]], cell: int) -> NDArray[np.uint8]:
    """Arrange pictures (s, s, 4), sRGB with straight alpha, s ≤ `cell`, in centered cells on the background."""
    heights = [max(picture.shape[0] for picture in row) for row in rows]
    width = max(len(row) for row in rows) * (cell + GAP) + GAP
    sheet = np.empty((sum(heights) + GAP * (len(rows) + 1), width, 4), np.uint8)
    sheet[:] = (*GROUND, 255)
    top = GAP
    for row, height in zip(rows, heights, strict=True):
        for column, picture in enumerate(row):
            size = picture.shape[0]
            x = GAP + column * (cell + GAP) + (cell - size) // 2
            y = top + (height - size) // 2
            _lay_over(sheet[y : y + size, x : x + size], picture)
        top += height + GAP
    return sheet


def _lay_over(ground: NDArray[np.uint8], picture: NDArray[np.uint8]) -> None:
    alpha = picture[..., 3:].astype(np.float32) / 255.0
    ground[..., :3] = np.rint(picture[..., :3] * alpha + ground[..., :3] * (1.0 - alpha))


def _sphere(parts: Sequence[leafcloud.Foliage]) -> tuple[list[float], float]:
    """Return center and radius of a sphere around the bounding spheres of the parts."""
    centre, radius = np.asarray(parts[0].world_centre), parts[0].radius
    for part in parts[1:]:
        offset = np.asarray(part.world_centre) - centre
        distance = float(np.linalg.norm(offset))
        if distance + part.radius <= radius:
            continue
        if distance + radius <= part.radius:
            centre, radius = np.asarray(part.world_centre), part.radius
            continue
        grown = (distance + radius + part.radius) / 2.0
        centre, radius = centre + offset * ((grown - radius) / distance), grown
    return centre.tolist(), radius
