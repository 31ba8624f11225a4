"""Leaves and billboards of a GLB file as engines read their textures: with the engine's mip levels, trilinear filters.

Graphics cards choose the mip level by the longer of the two steps, in texels, to the neighbors of a pixel in its row
and in its column (OpenGL 4.6, section 8.14.1). In a parallel view a triangle has the same steps everywhere. So each is
drawn with the mix of two mip levels that a card reads for it, without anisotropic filters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from box_mips import box_filtered, encoded, linear
from glb import Node, Primitive, read_chunks, read_glb
from numpy.typing import NDArray

import leafcloud

Floats = NDArray[np.float64]

MIXES = 4
"""Steps from one mip level to the next."""


class Surface:
    """Triangles of one material."""

    def __init__(self, node: Node, primitive: Primitive, image: NDArray[np.uint8] | None) -> None:
        x, y, z = node.to_world(primitive.attributes["POSITION"]).T
        self.positions = np.column_stack([x, -z, y])
        self.triangles = primitive.indices
        self.uvs = primitive.attributes.get("TEXCOORD_0", np.zeros((len(x), 2))) * (1.0, -1.0) + (0.0, 1.0)
        self.settings = settings_of(primitive.material)
        self.mips = [] if image is None else box_filtered(image)
        self.material = cache(self._material)

    def _material(self, step: int) -> leafcloud.Material:
        """Return the material between mip levels, by steps of 1 / MIXES."""
        if not self.mips:
            return leafcloud.Material(**self.settings)
        mip, share = divmod(step, MIXES)
        image = self.mips[mip] if share == 0 else mixed(self.mips[mip], self.mips[mip + 1], share / MIXES)
        return leafcloud.Material(image=image, **self.settings)

    def read(self, direction: Sequence[float], pixel: float) -> Iterator[leafcloud.Foliage]:
        """Yield the triangles in parts, each with the texture that is read for pixels of this width in world units."""
        steps = np.zeros(len(self.triangles), int)
        if self.mips:
            texels = self.uvs[self.triangles] * np.array(self.mips[0].shape[1::-1])
            chosen = mip_levels(self.positions[self.triangles] / pixel, texels, np.array(direction))
            steps = np.rint(MIXES * chosen.clip(0.0, len(self.mips) - 1)).astype(int)
        for step in np.unique(steps):
            part = self.triangles[steps == step]
            yield leafcloud.Foliage(self.positions, part, uvs=self.uvs, materials=[self.material(int(step))])


def surfaces_of(file: Path, node: str) -> list[Surface]:
    """Return the leaves or billboards of a level, without its trunk; Z is up."""
    level = read_glb(file)[node]
    return [Surface(level, each, page_of(file, each.material)) for each in level.primitives]


def page_of(file: Path, material: dict[str, Any]) -> NDArray[np.uint8] | None:
    """Return the base color texture (h, w, 4) that a reader without extensions uses, if there is one."""
    content = image_bytes(file, material)
    return None if content is None else leafcloud.decode_image(content)


def image_bytes(file: Path, material: dict[str, Any], extension: str | None = None) -> bytes | None:
    """Return the image file of the base color: that of an extension such as KHR_texture_basisu, or the plain one."""
    document, binary = read_chunks(file)
    texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    if texture is None:
        return None
    source = document["textures"][texture["index"]]
    image = document["images"][(source["extensions"][extension] if extension else source)["source"]]
    view = document["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]


def settings_of(material: dict[str, Any]) -> dict[str, Any]:
    return {
        "base_color": material.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)),
        "alpha_mode": material.get("alphaMode", "OPAQUE"),
        "alpha_cutoff": material.get("alphaCutoff", 0.5),
        "double_sided": material.get("doubleSided", False),
    }


def mip_levels(corners: Floats, texels: Floats, direction: Floats) -> Floats:
    """Return the mip level (t,) at which a card reads each triangle, below 0 where texels are larger than pixels.

    corners: (t, 3, 3) in pixels. texels: (t, 3, 2) places on the texture. direction: to the eye, not vertical.
    """
    right = np.cross((0.0, 0.0, 1.0), direction)
    right /= np.linalg.norm(right)
    places = corners @ np.column_stack([right, np.cross(direction, right)])
    (a, b), (c, d) = np.moveaxis(places[:, 1:] - places[:, :1], 0, -1)
    along, up = np.moveaxis(texels[:, 1:] - texels[:, :1], 1, 0)
    area = np.abs(a * d - b * c).clip(1e-9)
    row = np.linalg.norm(d[:, None] * along - b[:, None] * up, axis=1) / area
    column = np.linalg.norm(a[:, None] * up - c[:, None] * along, axis=1) / area
    levels: Floats = np.log2(np.maximum(row, column).clip(1e-9))
    return levels


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
