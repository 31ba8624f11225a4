"""Contents of GLB files for `leafcloud inspect`: the document, numbers of accessors, sizes of images.

Reads only what a check has found to lie inside of the file.
"""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import LeafcloudError, decompress

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MOST_ELEMENTS = 2**26
"""Most elements of an accessor: a file may claim any number without holding it."""

_COMPRESSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_PNG, _JPEG, _KTX2 = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"\xabKTX 20\xbb\r\n\x1a\n"


class Unreadable(Exception):
    """Numbers that a file stores in a form that is not decoded here."""


@dataclass(frozen=True)
class Picture:
    """Format, width and height of an image, and its bytes in the file."""

    kind: str
    width: int
    height: int
    size: int

    @property
    def gpu_bytes(self) -> int:
        """Bytes on a graphics card with mip levels: 4 a texel, 1 if the texture stays compressed."""
        return self.width * self.height * (1 if self.kind == "KTX2" else 4) * 4 // 3


class GlbFile:
    """A GLB file. Raises `LeafcloudError` for another file, and for numbers that lie outside of it."""

    def __init__(self, path: Path) -> None:
        try:
            content = path.read_bytes()
        except OSError as error:
            raise LeafcloudError(f"{path} cannot be read: {error.strerror or error}; check the path") from error
        try:
            magic, version, length = struct.unpack_from("<4sII", content)
            if magic != b"glTF" or version != 2 or length > len(content):
                raise ValueError("the header is not that of a GLB file of version 2")
            size, _ = struct.unpack_from("<I4s", content, 12)
            self.document: dict[str, Any] = json.loads(content[20 : 20 + size])
            self._body = content[28 + size : length]
            if not isinstance(self.document, dict):
                raise ValueError("its JSON is no object")
            if "asset" not in self.document:
                raise ValueError("its JSON has no asset")
        except (struct.error, ValueError, RecursionError, MemoryError) as error:
            raise LeafcloudError(f"{path} is no GLB file, or is broken: {error}; export it again") from error
        self.path = path

    def with_only(self, nodes: Collection[int]) -> bytes:
        """Return the file with the meshes of these nodes alone, all in its scene."""
        document = copy.deepcopy(self.document)
        inner = {child for node in document["nodes"] for child in node.get("children", [])}
        for number, node in enumerate(document["nodes"]):
            if number not in nodes:
                node.pop("mesh", None)
        document |= {"scene": 0, "scenes": [{"nodes": [n for n in range(len(document["nodes"])) if n not in inner]}]}
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self._body), b"BIN\0") + self._body
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def items(self, name: str) -> list[dict[str, Any]]:
        """Return a list of the document; empty if it is missing."""
        found = self.document.get(name, [])
        return found if isinstance(found, list) else []

    def view(self, number: int) -> bytes:
        """Return the bytes of a buffer view, decompressed. Raise `LeafcloudError` for a broken stream."""
        view = self.items("bufferViews")[number]
        source = next((view["extensions"][name] for name in _COMPRESSIONS if name in view.get("extensions", {})), None)
        if source is None:
            return self._bytes(number, view)
        stream, count, stride = self._bytes(number, source), source["count"], source["byteStride"]
        self._check_count(f"buffer view {number}", count)
        return decompress(stream, count, stride, source["mode"], source.get("filter", "NONE"))

    def _bytes(self, number: int, source: dict[str, Any]) -> bytes:
        """Return the bytes in the file of a buffer view, or of its compressed numbers."""
        start, length = source.get("byteOffset", 0), source["byteLength"]
        if source["buffer"] != 0 or not 0 <= start <= start + length <= len(self._body):
            raise LeafcloudError(f"{self.path}: buffer view {number} lies outside of the file; export it again")
        return self._body[start : start + length]

    def values(self, number: int) -> NDArray[Any]:
        """Return the numbers (n, width) of an accessor, as stored. Raise `Unreadable` if they have to be decoded."""
        accessor = self.items("accessors")[number]
        width, kind = _WIDTHS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        count, row = accessor["count"], width * kind.itemsize
        self._check_count(f"accessor {number}", count)
        if "bufferView" not in accessor or accessor.get("sparse") or accessor.get("normalized"):
            raise Unreadable(f"accessor {number} is sparse or normalized")
        view = self.view(accessor["bufferView"])
        stride = self.items("bufferViews")[accessor["bufferView"]].get("byteStride", row)
        start = accessor.get("byteOffset", 0)
        if stride < row or start < 0 or start + stride * (count - 1) + row > len(view):
            raise LeafcloudError(f"{self.path}: accessor {number} lies outside of its buffer view; export it again")
        return np.ndarray((count, width), kind, view, start, (stride, kind.itemsize))

    def size_of(self, number: int) -> int:
        """Return the bytes of an accessor, without gaps."""
        accessor = self.items("accessors")[number]
        width, kind = _WIDTHS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        return self._count(number) * width * kind.itemsize

    def _count(self, number: int) -> int:
        """Return the number of elements of an accessor."""
        count = self.items("accessors")[number]["count"]
        self._check_count(f"accessor {number}", count)
        return int(count)

    def _check_count(self, owner: str, count: Any) -> None:
        if not isinstance(count, int) or not 1 <= count <= _MOST_ELEMENTS:
            raise LeafcloudError(f"{self.path}: {owner} has {count} elements; the limit is {_MOST_ELEMENTS:,}")

    def picture(self, number: int) -> Picture:
        """Return format and size of an image. Images outside of the file have no size."""
        image = self.items("images")[number]
        if "bufferView" not in image:
            return Picture("file", 0, 0, 0)
        data = self.view(image["bufferView"])
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
            return Picture("PNG", width, height, len(data))
        if data.startswith(_KTX2):
            width, height = struct.unpack_from("<II", data, 20)
            return Picture("KTX2", width, height, len(data))
        if data.startswith(_JPEG):
            return Picture("JPEG", *_jpeg_size(data), len(data))
        return Picture("unknown", 0, 0, len(data))


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Return width and height from the first frame header; (0, 0) without one."""
    at = 2
    while at + 9 < len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        at += 2 + length
    return 0, 0
