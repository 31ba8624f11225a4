"""GLB files in memory. After Blender's exporter each file is read once, changed by edits, and written once."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ExportError

_JSON, _BIN = 0x4E4F534A, 0x004E4942
FLOAT, ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 5126, 34962, 34963
_TYPES = {5120: np.int8, 5121: np.uint8, 5123: np.uint16, 5125: np.uint32, FLOAT: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass
class Glb:
    """A GLB file in memory: the JSON document, and the binary chunk, which is the document's only buffer."""

    document: dict[str, Any]
    binary: bytearray

    @staticmethod
    def read(path: Path) -> Glb:
        """Read the file at `path`. Raises `ValueError` for a file that is no GLB file."""
        content = path.read_bytes()
        if content[:4] != b"glTF" or len(content) < 20:
            raise ValueError(f"{path.name} is no GLB file")
        size = struct.unpack_from("<I", content, 12)[0]
        document = json.loads(content[20 : 20 + size])
        begin = 28 + size
        return Glb(document, bytearray(content[begin : begin + document["buffers"][0]["byteLength"]]))

    def write(self, path: Path) -> None:
        """Write the file to `path`. Raises `ExportError` if that fails."""
        try:
            path.write_bytes(self.content())
        except OSError as error:
            raise ExportError(f"{path.name}: {error.strerror or error}") from error

    def content(self) -> bytes:
        """Return the bytes of the file."""
        self.document["buffers"][0]["byteLength"] = len(self.binary)
        text = json.dumps(self.document, separators=(",", ":"), ensure_ascii=False).encode()
        chunks = [(_JSON, text + b" " * (-len(text) % 4)), (_BIN, bytes(self.binary) + bytes(-len(self.binary) % 4))]
        body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    @property
    def primitives(self) -> list[dict[str, Any]]:
        """The primitives of all meshes."""
        return [primitive for mesh in self.document.get("meshes", []) for primitive in mesh["primitives"]]

    @property
    def materials(self) -> list[dict[str, Any]]:
        materials: list[dict[str, Any]] = self.document.get("materials", [])
        return materials

    def use_extension(self, name: str) -> None:
        """List the extension `name` as used."""
        self.document["extensionsUsed"] = sorted({*self.document.get("extensionsUsed", []), name})

    def align(self) -> None:
        """Fill the binary chunk with zeros to a multiple of four bytes."""
        self.binary += bytes(-len(self.binary) % 4)

    def append_view(self, data: bytes, **more: int) -> int:
        """Append `data` at a multiple of four bytes. Return the index of its buffer view."""
        self.align()
        views = self.document["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(views) - 1

    def values(self, number: int) -> NDArray[Any]:
        """Return a copy of the values of an accessor, (n, width).

        Blender's exporter writes no interleaved or sparse accessors.
        """
        accessor = self.document["accessors"][number]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width, kind = _WIDTHS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        start, count = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), accessor["count"] * width
        return np.frombuffer(bytes(self.binary[start : start + count * kind.itemsize]), kind).reshape(-1, width)

    def bytes_of(self, number: int) -> int:
        """Return the bytes of an accessor on a graphics card: with the gaps between its elements, decompressed."""
        accessor = self.document["accessors"][number]
        width, kind = _WIDTHS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        stride = self.document["bufferViews"][accessor["bufferView"]].get("byteStride", width * kind.itemsize)
        return int(accessor["count"] * stride)

    def append_accessor(self, values: NDArray[Any]) -> int:
        """Append a vertex attribute with `values` (v, width) in single precision. Return the index of its accessor."""
        data = np.ascontiguousarray(values, np.float32)
        view = self.append_view(data.tobytes(), target=ARRAY_BUFFER)
        kind = next(name for name, width in _WIDTHS.items() if width == data.shape[1])
        accessor = {"bufferView": view, "componentType": FLOAT, "count": len(data), "type": kind}
        self.document["accessors"].append(accessor)
        return len(self.document["accessors"]) - 1

    def append_indices(self, values: NDArray[Any]) -> int:
        """Append indices in 16 or 32 bits, by the largest. Return the index of their accessor."""
        kind, dtype = (5123, np.uint16) if values.max(initial=0) < 2**16 - 1 else (5125, np.uint32)
        view = self.append_view(values.astype(dtype).tobytes(), target=ELEMENT_ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": kind, "count": values.size, "type": "SCALAR"}
        self.document["accessors"].append(accessor)
        return len(self.document["accessors"]) - 1

    def append_texture(self, material: dict[str, Any], name: str, content: bytes) -> int:
        """Append a PNG or JPEG file as texture, with the sampler of the base color of `material`. Return its index.

        An image already appended under the same name is reused: trees may share images, and Blender's image names are
        unique.
        """
        images, textures = self.document["images"], self.document["textures"]
        known = next((n for n, image in enumerate(images) if image.get("name") == name), None)
        if known is not None:
            return next(n for n, texture in enumerate(textures) if texture.get("source") == known)
        kind = "jpeg" if content.startswith(b"\xff\xd8") else "png"
        images.append({"bufferView": self.append_view(content), "mimeType": f"image/{kind}", "name": name})
        colors = textures[material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
        textures.append({**colors, "source": len(images) - 1})
        return len(textures) - 1

    def remove_unused(self) -> None:
        """Remove the accessors and buffer views that no primitive or image uses."""
        uses = [use for primitive in self.primitives for use in accessor_uses(primitive)]
        accessors, numbers = self.document["accessors"], sorted({values[name] for values, name in uses})
        self.document["accessors"] = [accessors[number] for number in numbers]
        renumbered = {number: place for place, number in enumerate(numbers)}
        for values, name in uses:
            values[name] = renumbered[values[name]]
        self.remove_unused_views()

    def remove_unused_views(self) -> None:
        """Remove the buffer views that no accessor or image uses."""
        kinds = ("accessors", "images")
        users = [user for kind in kinds for user in self.document.get(kind, []) if "bufferView" in user]
        views, binary = self.document["bufferViews"], bytes(self.binary)
        self.document["bufferViews"], self.binary = [], bytearray()
        numbers: dict[int, int] = {}
        for number in sorted({user["bufferView"] for user in users}):
            start = views[number].pop("byteOffset", 0)
            data = binary[start : start + views[number]["byteLength"]]
            more = {key: value for key, value in views[number].items() if key not in ("buffer", "byteLength")}
            numbers[number] = self.append_view(data, **more)
        for user in users:
            user["bufferView"] = numbers[user["bufferView"]]


Edit = Callable[[Glb], None]
"""Function that changes a GLB file in memory."""


def accessor_uses(primitive: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Return the JSON object and the key of every reference from a primitive to an accessor."""
    sets = [primitive["attributes"], *primitive.get("targets", [])]
    return [(primitive, "indices"), *((values, name) for values in sets for name in values)]
