"""Writer of small .glb files with known content."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUAD = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
QUAD_UVS = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
"""glTF counts v from the top, so the quad's corner (0, 0, 0) shows the image's lower left corner."""


def png(rows: list[list[tuple[int, int, int, int]]]) -> bytes:
    """Return an RGBA image as PNG bytes. The first row is the top row."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 6, 0, 0, 0)
    body = b"".join(b"\0" + bytes(value for pixel in row for value in pixel) for row in rows)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")


def write_glb(path: Path, document: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> Path:
    """Write a file whose accessor number i is arrays[i]: f32 (n, width), or u32 (n,)."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    body = b""
    for values in arrays:
        content = np.ascontiguousarray(values).tobytes()
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        entry = {"bufferView": len(views), "componentType": 5125 if values.dtype == np.uint32 else 5126, "type": kind}
        extremes = {"min": np.min(values, axis=0).tolist(), "max": np.max(values, axis=0).tolist()}
        accessors.append({**entry, "count": len(values), **(extremes if kind == "VEC3" else {})})
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(content)})
        body += content
    whole = {"asset": {"version": "2.0"}, "accessors": accessors, "bufferViews": views, **document}
    return write_document(path, whole | {"buffers": [{"byteLength": len(body)}]}, body)


def write_quad_glb(
    path: Path,
    *,
    positions: list[tuple[float, float, float]] = QUAD,
    material: dict[str, Any] | None = None,
    image: bytes | None = None,
    image_uri: str | None = None,
    sampler: dict[str, Any] | None = None,
    colors: list[tuple[float, float, float, float]] | None = None,
    node: dict[str, Any] | None = None,
) -> Path:
    """Write a file with one node "leaves": a quad with a material and an embedded or separate image."""
    attributes: dict[str, tuple[NDArray[Any], str]] = {
        "POSITION": (np.array(positions, "<f4"), "VEC3"),
        "TEXCOORD_0": (np.array(QUAD_UVS, "<f4"), "VEC2"),
    }
    if colors is not None:
        attributes["COLOR_0"] = (np.array(colors, "<f4"), "VEC4")
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    body = b""

    def view(content: bytes) -> int:
        nonlocal body
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(content)})
        body += content + b"\0" * (-len(content) % 4)
        return len(views) - 1

    for values, kind in attributes.values():
        entry = {"bufferView": view(values.tobytes()), "componentType": 5126, "count": len(values), "type": kind}
        accessors.append(entry)
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 1]}
    indices = view(np.array([0, 1, 2, 0, 2, 3], "<u4").tobytes())
    accessors.append({"bufferView": indices, "componentType": 5125, "count": 6, "type": "SCALAR"})
    primitive: dict[str, Any] = {
        "attributes": {name: i for i, name in enumerate(attributes)},
        "indices": len(accessors) - 1,
    }
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "leaves", "mesh": 0, **(node or {})}],
        "meshes": [{"name": "quad", "primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
    }
    if material is not None:
        primitive["material"] = 0
        document["materials"] = [{"name": "leaf", **material}]
    if image is not None:
        document["images"] = [{"bufferView": view(image), "mimeType": "image/png"}]
    if image_uri is not None:
        document["images"] = [{"uri": image_uri}]
    if "images" in document:
        document["textures"] = [{"source": 0, "sampler": 0}]
        document["samplers"] = [sampler or {}]
    if "KHR_texture_transform" in json.dumps(material):
        document["extensionsUsed"] = ["KHR_texture_transform"]
    document["buffers"] = [{"byteLength": len(body)}]
    return write_document(path, document, body)


def write_document(path: Path, document: dict[str, Any], body: bytes) -> Path:
    """Write a file of a document and its binary chunk."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(body))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    path.write_bytes(header + chunks)
    return path
