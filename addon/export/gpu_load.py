"""Bytes and triangles of the written levels on a graphics card.

Geometry: the values of all vertex attributes, morph targets and indices, as written. Textures: all mip levels, a third
more than the largest; 4 bytes per texel, or 1 where the file also has a KTX2 texture, which engines keep compressed in
blocks. A texture counts whole, also if other trees share it. Triangles: as written; alpha blending splits some.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ..plan.pages import KTX2_EXTENSION
from .glb_file import Glb, accessor_uses

Texture = tuple[int, bool]
"""An image of the file by its index, and whether its KTX2 texture is used: engines hold both if a file uses both."""

MIPS = 4.0 / 3.0
"""Texels of all mip levels relative to the largest."""
_PNG, _JPEG = b"\x89PNG", b"\xff\xd8"
_SIZED = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG's frames, which have its size."""


@dataclass
class GpuLoad:
    """Figures of each node of the files read so far: bytes of its geometry, bytes of its textures, and triangles."""

    geometry: dict[str, int] = field(default_factory=dict)
    textures: dict[str, dict[Texture, int]] = field(default_factory=dict)
    triangles: dict[str, int] = field(default_factory=dict)

    def read(self, glb: Glb) -> None:
        """Measure all nodes of a complete file. It does not change."""
        document = glb.document
        for node in document.get("nodes", []):
            if "mesh" in node:
                primitives = document["meshes"][node["mesh"]]["primitives"]
                used = {values[key] for each in primitives for values, key in accessor_uses(each)}
                self.geometry[node["name"]] = sum(map(glb.bytes_of, used))
                self.triangles[node["name"]] = (
                    sum(document["accessors"][each["indices"]]["count"] for each in primitives) // 3
                )
                materials = {each["material"] for each in primitives if "material" in each}
                found = {index for each in materials for index in _textures(document["materials"][each])}
                self.textures[node["name"]] = dict(_of_texture(glb, index) for index in found)

    def bytes_of(self, name: str) -> int:
        """Return the bytes of a node: of its geometry and its textures, each once."""
        return self.geometry.get(name, 0) + self.texture_bytes_of(name)

    def texture_bytes_of(self, name: str) -> int:
        """Return the bytes of a node's textures, each once."""
        return sum(self.textures.get(name, {}).values())


def _textures(value: Any) -> Iterator[int]:
    """Yield the textures that a material or a part of it uses."""
    for key, each in value.items() if isinstance(value, dict) else ():
        if key.endswith("Texture"):
            yield each["index"]
        else:
            yield from _textures(each)


def _of_texture(glb: Glb, index: int) -> tuple[Texture, int]:
    """Return a texture of the document and its bytes; 0 bytes for an image of unknown format."""
    texture = glb.document["textures"][index]
    compressed = KTX2_EXTENSION in texture.get("extensions", {})
    source = texture.get("source")
    if source is None or "bufferView" not in glb.document["images"][source]:
        return (index, compressed), 0
    view = glb.document["bufferViews"][glb.document["images"][source]["bufferView"]]
    start = view.get("byteOffset", 0)
    width, height = image_size(bytes(glb.binary[start : start + view["byteLength"]]))
    return (source, compressed), round(width * height * (1 if compressed else 4) * MIPS)


def image_size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG or JPEG file; (0, 0) for other files."""
    if data.startswith(_PNG):
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    place = 2 if data.startswith(_JPEG) else len(data)
    while place + 9 <= len(data):
        marker, length = struct.unpack_from(">xBH", data, place)
        if marker in _SIZED:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return width, height
        place += 2 + length
    return 0, 0
