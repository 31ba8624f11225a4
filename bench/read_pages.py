"""Billboards with a page as engines read it: mip levels that the engine makes, trilinear filters.

Graphics cards choose the mip level by the longer of the two steps, in texels, to the neighbors of a pixel in its row
and in its column (OpenGL 4.6, section 8.14.1). In a parallel view a billboard has the same steps everywhere. So each is
drawn with the mix of two mip levels that a card reads for it, without anisotropic filters, at many places in a pixel.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leafcloud

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from box_mips import box_filtered, encoded, linear

Floats = NDArray[np.float64]

MIXES = 4
"""Steps from one mip level to the next."""


class Page:
    """The page of a level for engines, halved so many times, with its billboards."""

    def __init__(self, level: leafcloud.Level, halved: int) -> None:
        page, self.cutoff = level.for_engines(halved)
        self.mips = box_filtered(page)
        self.texel = level.texel_size * 2**halved
        """World units."""
        self.level = level
        self.triangles, self.owners = fans(level.polygon_sizes)
        corners = level.corners.astype(np.float64)[self.triangles]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros((len(level.polygon_sizes), 3))
        np.add.at(normals, self.owners, doubled)
        self.normals: Floats = normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-30)
        self.material = cache(self._material)

    def _material(self, step: int) -> leafcloud.Material:
        """Return the material between mip levels, by steps of 1 / MIXES."""
        mip, share = divmod(step, MIXES)
        image = self.mips[mip] if share == 0 else mixed(self.mips[mip], self.mips[mip + 1], share / MIXES)
        return leafcloud.Material(image=image, alpha_mode="MASK", alpha_cutoff=self.cutoff)

    def read(self, direction: Sequence[float], pixel: float) -> Iterator[leafcloud.Foliage]:
        """Yield the billboards in parts, each with the texture that is read for pixels of this width in world units."""
        chosen = np.log2(pixel / self.texel) + slants(self.normals, np.array(direction))
        steps = np.rint(MIXES * chosen.clip(0.0, len(self.mips) - 1)).astype(int)
        for step in np.unique(steps):
            part = self.triangles[steps[self.owners] == step]
            yield leafcloud.Foliage(self.level.corners, part, uvs=self.level.uvs, materials=[self.material(int(step))])


def slants(normals: Floats, direction: Floats) -> Floats:
    """Return how many mip levels coarser billboards are read than one that faces the eye."""
    right = np.cross((0.0, 0.0, 1.0), direction)
    right /= np.linalg.norm(right)
    facing = np.abs(normals @ direction).clip(1e-6)
    across, along = normals @ right / facing, normals @ np.cross(direction, right) / facing
    return 0.5 * np.log2(1.0 + np.maximum(across**2, along**2))


def mixed(fine: NDArray[np.uint8], coarse: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """Return a mip level with this share of the next one."""
    height, width = fine.shape[:2]
    below = enlarged(enlarged(light(coarse), height, 0), width, 1)
    between = light(fine) * (1.0 - share) + below * share
    return np.rint(255.0 * np.dstack([encoded(between[..., :3]), between[..., 3]])).astype(np.uint8)


def light(image: NDArray[np.uint8]) -> Floats:
    codes = image / 255.0
    return np.dstack([linear(codes[..., :3]), codes[..., 3]])


def enlarged(values: Floats, count: int, axis: int) -> Floats:
    """Return values interpolated between the centers of texels."""
    last = values.shape[axis] - 1
    places = ((np.arange(count) + 0.5) * (last + 1) / count - 0.5).clip(0, last)
    low = places.astype(int)
    share = (places - low).reshape([-1 if each == axis else 1 for each in range(values.ndim)])
    return np.take(values, low, axis) * (1.0 - share) + np.take(values, np.minimum(low + 1, last), axis) * share


def fans(corners: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles (t, 3) of polygons with so many `corners` each, one after another, and their polygons."""
    sizes = corners.astype(np.int64)
    firsts = np.cumsum(sizes) - sizes
    owners = np.repeat(np.arange(len(sizes)), sizes - 2)
    place = np.arange(len(owners)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    return np.stack([firsts[owners], firsts[owners] + place + 1, firsts[owners] + place + 2], axis=1), owners
