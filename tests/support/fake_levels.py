"""Levels of literal arrays, in place of those of the core."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud


@dataclass
class FakeLevel:
    """Stand-in for a level of the core, with literal arrays."""

    corners: NDArray[np.float64]
    targets: NDArray[np.float64]
    pivots: NDArray[np.float64]
    pivot_targets: NDArray[np.float64]
    ranks: NDArray[np.float32]
    cloud: Any
    two_sided: bool = False
    plane_ids: NDArray[np.uint32] = field(init=False)
    page_share: float = 1.0
    alpha_cutoff: float = 0.375
    max_deviation_leaves: float = 0.05
    normal: NDArray[np.uint8] | None = None
    orm: NDArray[np.uint8] | None = None
    translucency: NDArray[np.uint8] | None = None
    bent_normal: NDArray[np.uint8] | None = None
    leaf_uv: NDArray[np.uint8] | None = None
    leaf_id: NDArray[np.uint8] | None = None
    uvs: NDArray[np.float32] = field(init=False)
    polygon_sizes: NDArray[np.uint32] = field(init=False)
    polygon_billboards: NDArray[np.uint32] = field(init=False)
    triangles: int = field(init=False)
    base_color: NDArray[np.uint8] = field(init=False)

    @property
    def method(self) -> str:
        return "cross" if self.cloud is None else "stochastic"

    def foliage(self) -> leafcloud.Foliage:
        first = 4 * np.arange(len(self.corners) // 4)[:, None, None]
        faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        return leafcloud.Foliage(self.corners.astype(np.float32), faces.astype(np.int32))

    def __post_init__(self) -> None:
        unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
        count = len(self.corners) // 4
        self.uvs = np.tile(unit, (count, 1))
        self.polygon_sizes = np.full(count, 4, np.uint32)
        self.polygon_billboards = np.arange(count, dtype=np.uint32)
        self.plane_ids = np.arange(count, dtype=np.uint32) // (2 if self.two_sided else 1)
        self.triangles = 2 * count
        self.base_color = np.full((4, 4, 4), (90, 140, 40, 255), np.uint8)


def rectangle(y: float) -> list[list[float]]:
    return [[0, y, 0], [1, y, 0], [1, y, 1], [0, y, 1]]
