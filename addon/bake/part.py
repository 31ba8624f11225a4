"""The leaves or the trunk of a tree in the core's form, with material readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..geometry import Geometry
from ..levels.trunk import gathered, per_corner
from ..material.describe import describe_materials, texture_uvs
from ..scene.light import Light


@dataclass(frozen=True)
class DescribedGeometry:
    """A geometry with its appearance. `matrix` (4, 4) transforms it to the world.

    colors (t, 3, 4): factors of the base colors; None is white. back_colors (t, 3, 3): factors on the back instead;
    None is the same as the front. materials: indexed by `material_ids` (t,). owners: for each material its index in the
    geometry (see `Descriptions`). messages: the losses of the material readings.
    """

    geometry: Geometry
    matrix: NDArray[np.float64]
    materials: tuple[leafcloud.Material, ...]
    material_ids: NDArray[np.int32]
    owners: tuple[int, ...]
    colors: NDArray[np.float32] | None = None
    back_colors: NDArray[np.float32] | None = None
    messages: tuple[str, ...] = ()

    def foliage(self) -> leafcloud.Foliage:
        """Build the core's foliage. Raise `leafcloud.LeafcloudError` for geometry that the core refuses."""
        geometry = self.geometry
        return leafcloud.Foliage(
            geometry.positions,
            geometry.triangles,
            matrix=self.matrix,
            uvs=texture_uvs(geometry),
            normals=geometry.normals,
            colors=self.colors,
            back_colors=self.back_colors,
            material_ids=self.material_ids,
            materials=list(self.materials),
            protected=geometry.protected,
        )

    def of(self, corners: NDArray[np.integer[Any]]) -> DescribedGeometry:
        """Return the part made of the triangles `corners` (n, 3): indices as in `leafcloud.Simplified.corners`."""
        return replace(
            self,
            geometry=gathered(self.geometry, corners),
            material_ids=self.material_ids[corners[:, 0] // 3],
            colors=None if self.colors is None else per_corner(self.colors, corners),
            back_colors=None if self.back_colors is None else per_corner(self.back_colors, corners),
        )


def described_part(
    geometry: Geometry, matrix: NDArray[np.float64], channels: Sequence[str], share: float, light: Light | None
) -> DescribedGeometry:
    """Build a part from a geometry, under `light` if given. `channels` and `share`: see `describe_materials`."""
    described = describe_materials(geometry, channels, matrix, share)
    front, back = _colors(described.colors, described.back_colors, light)
    materials = tuple(leafcloud.Material(**keywords) for keywords in described.materials)
    messages = tuple(described.messages)
    return DescribedGeometry(
        geometry, matrix, materials, described.material_ids, described.owners, front, back, messages
    )


def _colors(
    colors: NDArray[np.float32] | None, back_colors: NDArray[np.float32] | None, light: Light | None
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return color factors (t, 3, 4) of the front and (t, 3, 3) of the back, times the light of each side if any."""
    if light is None:
        return colors, back_colors
    front = np.ones((*light.front.shape[:2], 4), np.float32) if colors is None else colors.copy()
    back = (front[..., :3] if back_colors is None else back_colors) * light.back
    front[..., :3] *= light.front
    return front, back
