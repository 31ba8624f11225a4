"""Reader and writer of GLB files as a JSON document and a binary chunk, to add data after Blender's exporter."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_JSON, _BIN = 0x4E4F534A, 0x004E4942
FLOAT, ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 5126, 34962, 34963
_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, FLOAT: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON document and the binary chunk of the GLB file at `path`."""
    content = path.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    rest = content[20 + size :]
    return document, rest[8 : 8 + struct.unpack_from("<I", rest)[0]] if rest else b""


def write_glb(path: Path, document: dict[str, Any], binary: bytes) -> None:
    """Write a GLB file from a document and a binary chunk, which is the document's only buffer."""
    document["buffers"][0]["byteLength"] = len(binary)
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    chunks = [(_JSON, text + b" " * (-len(text) % 4)), (_BIN, binary + b"\0" * (-len(binary) % 4))]
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def append_view(document: dict[str, Any], binary: bytes, data: bytes, **more: int) -> tuple[int, bytes]:
    """Append `data` at a multiple of four bytes. Return the index of its buffer view, and the new chunk."""
    binary += b"\0" * (-len(binary) % 4)
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), **more})
    return len(document["bufferViews"]) - 1, binary + data


def accessor_values(document: dict[str, Any], binary: bytes, number: int) -> NDArray[Any]:
    """Return the values of an accessor, (n, width). Blender's exporter writes no interleaved or sparse accessors."""
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    width, kind = _WIDTHS[accessor["type"]], _TYPES[accessor["componentType"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(binary, kind, accessor["count"] * width, start).reshape(-1, width)


def append_accessor(document: dict[str, Any], binary: bytes, values: NDArray[Any]) -> tuple[int, bytes]:
    """Append a vertex attribute with `values` (v, width) in single precision.

    Return the index of its accessor, and the new chunk.
    """
    data = np.ascontiguousarray(values, np.float32)
    view, binary = append_view(document, binary, data.tobytes(), target=ARRAY_BUFFER)
    kind = next(name for name, width in _WIDTHS.items() if width == data.shape[1])
    accessor = {"bufferView": view, "componentType": FLOAT, "count": len(data), "type": kind}
    document["accessors"].append(accessor)
    return len(document["accessors"]) - 1, binary


def accessor_uses(primitive: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Return the JSON object and the key of every reference from a primitive to an accessor."""
    sets = [primitive["attributes"], *primitive.get("targets", [])]
    return [(primitive, "indices"), *((values, name) for values in sets for name in values)]


def without_unused(document: dict[str, Any], binary: bytes) -> bytes:
    """Remove the accessors and buffer views that no primitive or image uses. Return the new chunk."""
    primitives = [primitive for mesh in document["meshes"] for primitive in mesh["primitives"]]
    uses = [use for primitive in primitives for use in accessor_uses(primitive)]
    accessors, numbers = document["accessors"], sorted({values[name] for values, name in uses})
    document["accessors"] = [accessors[number] for number in numbers]
    renumbered = {number: place for place, number in enumerate(numbers)}
    for values, name in uses:
        values[name] = renumbered[values[name]]
    return _without_unused_views(document, binary)


def _without_unused_views(document: dict[str, Any], binary: bytes) -> bytes:
    users = [user for kind in ("accessors", "images") for user in document.get(kind, []) if "bufferView" in user]
    views, kept = document["bufferViews"], b""
    document["bufferViews"] = []
    numbers: dict[int, int] = {}
    for number in sorted({user["bufferView"] for user in users}):
        start = views[number].pop("byteOffset", 0)
        data = binary[start : start + views[number]["byteLength"]]
        more = {key: value for key, value in views[number].items() if key not in ("buffer", "byteLength")}
        numbers[number], kept = append_view(document, kept, data, **more)
    for user in users:
        user["bufferView"] = numbers[user["bufferView"]]
    return kept


def append_texture(
    document: dict[str, Any], binary: bytes, material: dict[str, Any], name: str, png: bytes
) -> tuple[int, bytes]:
    """Append a texture with the sampler of the base color texture of `material`.

    Return the index of the texture, and the new chunk. An image already appended under the same name is reused: trees
    may share images, and Blender's image names are unique.
    """
    known = next((n for n, image in enumerate(document["images"]) if image.get("name") == name), None)
    if known is not None:
        return next(n for n, texture in enumerate(document["textures"]) if texture.get("source") == known), binary
    view, binary = append_view(document, binary, png)
    document["images"].append({"bufferView": view, "mimeType": "image/png", "name": name})
    colors = document["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    document["textures"].append({**colors, "source": len(document["images"]) - 1})
    return len(document["textures"]) - 1, binary
