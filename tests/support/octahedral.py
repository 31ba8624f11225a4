"""The law of octahedral impostors in NumPy, for many rays at once: the reference for nodes and shaders.

From the description at the head of rust/core/src/lod/octahedral/draw.rs and mapping.rs, in the impostor's axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from box_mips import linear
from laws import Floats

BELOW = 0.5
STEPS = 2
OPEN = 1.5


@dataclass(frozen=True)
class Impostor:
    """color (h, w, 4): linear light, straight alpha. normal_depth (h, w, 4): x and y of normals and the depth, in
    [−1, 1], openness in [0, 1]. Row 0 is on top.
    """

    color: Floats
    normal_depth: Floats
    extent: tuple[float, float]
    grid: int
    texels: int

    @classmethod
    def of(cls, color: Any, normal_depth: Any, numbers: Any) -> Impostor:
        """`color`, `normal_depth`: pages (h, w, 4) of codes. `numbers`: with extent, grid and texels."""
        codes = np.asarray(color, float) / 255.0
        codes[..., :3] = linear(codes[..., :3])
        depths = np.asarray(normal_depth, float) / 255.0
        depths[..., [0, 1, 3]] = 2.0 * depths[..., [0, 1, 3]] - 1.0
        return cls(codes, depths, tuple(numbers["extent"]), numbers["grid"], numbers["texels"])


def unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def axes(direction: Floats) -> tuple[Floats, Floats]:
    """Return the axes to the right and up of pictures seen from `direction` (…, 3)."""
    right = unit(np.stack([-direction[..., 1], direction[..., 0], np.zeros(direction.shape[:-1])], axis=-1))
    return right, np.cross(direction, right)


def shown(impostor: Impostor, points: Floats, eyes: Floats) -> tuple[Floats, Floats, Floats]:
    """Return linear color with straight alpha (n, 4), normal sums (n, 3) and light (n,) of rays through `points` (n, 3)
    toward `eyes` (n, 3), of length 1.
    """
    rays = eyes.copy()
    rays[:, 2] = np.maximum(eyes[:, 2], -np.linalg.norm(eyes[:, :2], axis=1))
    rays = unit(rays)
    # Eyes deeper than 45° below see the picture from 45°.
    (right, up), (_, upright) = axes(eyes), axes(rays)
    points = right * (right * points).sum(axis=1)[:, None] + upright * (up * points).sum(axis=1)[:, None]
    total, normals, open_sum = np.zeros((len(points), 4)), np.zeros((len(points), 3)), np.zeros((len(points), 1))
    for tiles, weights in _views(eyes, impostor.grid):
        color, normal, openness = _of_view(impostor, tiles, points, rays)
        share = color[:, 3:] * weights[:, None]
        total += np.hstack([color[:, :3] * share, share])
        normals += normal * share
        open_sum += openness * share
    straight = np.divide(total[:, :3], total[:, 3:], out=np.zeros((len(points), 3)), where=total[:, 3:] > 0.0)
    light = np.divide(OPEN * open_sum, total[:, 3:], out=np.ones((len(points), 1)), where=total[:, 3:] > 0.0)
    return np.hstack([straight, total[:, 3:]]), normals, np.minimum(light[:, 0], 1.0)


def _views(eyes: Floats, grid: int) -> list[tuple[Floats, Floats]]:
    """Return for each of three views the tiles (n, 2), column and row, and the weights (n,)."""
    level = np.abs(eyes[:, 0]) + np.abs(eyes[:, 1])
    whole = level + np.maximum(eyes[:, 2] + BELOW * level, 0.0)
    place = np.stack([eyes[:, 0] + eyes[:, 1], eyes[:, 0] - eyes[:, 1]], axis=1) / whole[:, None]
    place = (place * 0.5 + 0.5) * (grid - 1)
    cell = np.clip(np.floor(place), 0, grid - 2)
    x, y = np.clip(place - cell, 0.0, 1.0).T
    across = np.where((x > y)[:, None], [1.0, 0.0], [0.0, 1.0])
    squares = np.square([1.0 - np.maximum(x, y), np.abs(x - y), np.minimum(x, y)])
    weights = squares / squares.sum(axis=0)
    return [(cell, weights[0]), (cell + across, weights[1]), (cell + 1.0, weights[2])]


def _of_view(impostor: Impostor, tiles: Floats, points: Floats, rays: Floats) -> tuple[Floats, Floats, Floats]:
    p = tiles * (2.0 / (impostor.grid - 1)) - 1.0
    flat = 0.5 * np.stack([p[:, 0] + p[:, 1], p[:, 0] - p[:, 1]], axis=1)
    level = np.abs(flat).sum(axis=1)
    toward = unit(np.column_stack([flat, np.maximum(1.0 - level, 0.0) - BELOW * level]))
    right, up = axes(toward)
    height = np.zeros(len(points))
    for _ in range(STEPS + 1):
        steps = (height - (toward * points).sum(axis=1)) / (toward * rays).sum(axis=1)
        there = points + rays * steps[:, None]
        place = np.stack([(right * there).sum(axis=1), (up * there).sum(axis=1)], axis=1) / np.array(impostor.extent)
        color, stored = (_bilinear(page, impostor, tiles, place) for page in (impostor.color, impostor.normal_depth))
        height = stored[:, 3]
    x, y = stored[:, :1], stored[:, 1:2]
    normal = right * x + up * y + toward * np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    return color, normal, stored[:, 2:3]


def _bilinear(page: Floats, impostor: Impostor, tiles: Floats, place: Floats) -> Floats:
    """Return the page's values at places in [−1, 1]² of the tiles' pictures; outside is as the border."""
    size = impostor.texels
    at = np.clip((0.5 + 0.5 * place * [1.0, -1.0]) * size - 0.5, 0.0, size - 1.0)
    low = np.minimum(np.floor(at), size - 2.0)
    share = at - low
    column, row = (tiles * size + low).astype(int).T
    x, y = share[:, :1], share[:, 1:]
    above = page[row, column] * (1.0 - x) + page[row, column + 1] * x
    below = page[row + 1, column] * (1.0 - x) + page[row + 1, column + 1] * x
    return above * (1.0 - y) + below * y
