"""glTF files in the form that Blender's importer reads: without meshoptimizer's streams and Basis Universal's textures.

Specifications: the glTF extensions `EXT_meshopt_compression`, `KHR_meshopt_compression` and `KHR_texture_basisu`.
"""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import leafcloud

from .gltf_format import Broken, Document
from .gltf_source import MESHOPT, Buffer, GltfSource
from .image_sizes import ImageSizes
from .input_files import opened

_BASIS = "KHR_texture_basisu"
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"

_MOST_DECODED = 1 << 30
"""Limit on the bytes of all decoded buffer views."""

_OVERLAP = 2
"""Limit on the bytes of the other buffer views, over those of the buffers: they may overlap, and are copied."""


def unpacked(source: GltfSource) -> GltfSource:
    """Return the file without compressed data; the file itself if it has none.

    Raise `Broken` for a stream that cannot be decoded, `SceneError` for an image that is too large.
    """
    views, textures = _compressed_views(source), _ktx2_textures(source)
    if not views and not textures:
        return source
    document = copy.deepcopy(source.document)
    _check_size(source, views)
    contents = [
        _decoded(source, number, views[number]) if number in views else source.view(number)
        for number in range(len(source.list("bufferViews")))
    ]
    for view in document.get("bufferViews", []):
        view.pop("extensions", None)
    for texture in textures:
        document["textures"][texture]["source"] = document["textures"][texture]["extensions"].pop(_BASIS)["source"]
    images = sorted({document["textures"][texture]["source"] for texture in textures})
    files = {number: _ktx2(source, number) for number in images}
    sizes = ImageSizes()
    for number, content in files.items():
        sizes.check(content, f"images[{number}]")
    for number, content in files.items():
        contents.append(_png(content, number))
        document["images"][number] = {
            **{key: value for key, value in document["images"][number].items() if key != "uri"},
            "bufferView": len(contents) - 1,
            "mimeType": "image/png",
        }
        document.setdefault("bufferViews", []).append({})
    for key in ("extensionsUsed", "extensionsRequired"):
        document[key] = [name for name in document.get(key, []) if name not in (*MESHOPT, _BASIS)]
    return _with_views(source.home, document, contents)


def as_glb(source: GltfSource) -> bytes:
    """Return a .glb file with all that a file names. The importer reads no file beside it."""
    _check_size(source, ())
    document = copy.deepcopy(source.document)
    contents = [source.view(number) for number in range(len(document.get("bufferViews", [])))]
    for number, image in enumerate(document.get("images", [])):
        content = source.image(number)
        if isinstance(content, Path):
            with opened(content) as file:
                contents.append(file.read())
            document.setdefault("bufferViews", []).append({})
            image.setdefault("name", content.stem)
            image |= {"bufferView": len(contents) - 1, "mimeType": _mime_type(contents[-1])}
            del image["uri"]
    packed = _with_views(source.home, document, contents)
    text = json.dumps(packed.document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = packed.buffers[0].content if packed.buffers else b""
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _with_views(home: Path, document: Document, contents: Sequence[bytes]) -> GltfSource:
    """Return the document with one buffer, which holds `contents`: the bytes of each buffer view, in order."""
    body = bytearray()
    for view, content in zip(document.get("bufferViews", []), contents, strict=True):
        view |= {"buffer": 0, "byteOffset": len(body), "byteLength": len(content)}
        body += content + bytes(-len(content) % 4)
    document["buffers"] = [{"byteLength": len(body)}] if body else []
    return GltfSource(home, document, Buffer(len(body), content=bytes(body)))


def _compressed_views(source: GltfSource) -> dict[int, dict[str, Any]]:
    """Return the description of each compressed buffer view by its number."""
    return {
        number: extension
        for number, view in enumerate(source.list("bufferViews"))
        for name, extension in view.get("extensions", {}).items()
        if name in MESHOPT
    }


def _check_size(source: GltfSource, views: Collection[int]) -> None:
    sizes = [view["byteLength"] for view in source.list("bufferViews")]
    total = sum(sizes[number] for number in views)
    if total > _MOST_DECODED:
        raise Broken(f"its compressed buffer views have {total} bytes, more than {_MOST_DECODED}")
    most = _OVERLAP * sum(buffer.size for buffer in source.buffers)
    if sum(sizes) - total > most:
        raise Broken(f"its buffer views have {sum(sizes) - total} bytes, more than {most}")


def _decoded(source: GltfSource, number: int, packed: dict[str, Any]) -> bytes:
    """Return the bytes of a buffer view that `packed` describes."""
    place, length = f"bufferViews[{number}]", source.list("bufferViews")[number]["byteLength"]
    buffer, start = source.buffers[packed["buffer"]], packed.get("byteOffset", 0)
    count, stride = packed["count"], packed["byteStride"]
    if start + packed["byteLength"] > buffer.size:
        raise Broken(f"{place}: its compressed bytes end at {start + packed['byteLength']} of {buffer.size}")
    if count * stride != length:
        raise Broken(f"{place} has {length} bytes, but {count} compressed elements of {stride}")
    stream = buffer.read(start, packed["byteLength"])
    try:
        return leafcloud.decompress(stream, count, stride, packed["mode"], packed.get("filter", "NONE"))
    except leafcloud.LeafcloudError as error:
        raise Broken(f"{place}: {error}") from error


def _ktx2_textures(source: GltfSource) -> list[int]:
    """Return the numbers of the textures that have an image of Basis Universal."""
    return [number for number, texture in enumerate(source.list("textures")) if _BASIS in texture.get("extensions", {})]


def _ktx2(source: GltfSource, number: int) -> bytes:
    """Return the file of an image of Basis Universal."""
    content = source.image(number)
    if isinstance(content, Path):
        with opened(content) as file:
            content = file.read()
    if content is None or not content.startswith(_KTX2):
        raise Broken(f"images[{number}] is no KTX2 texture, or its file is missing")
    return content


def _png(content: bytes, number: int) -> bytes:
    """Return a KTX2 file as a PNG file. Colors keep their codes."""
    try:
        return leafcloud.encode_png([leafcloud.decode_image(content)])
    except leafcloud.LeafcloudError as error:
        raise Broken(f"images[{number}]: {error}") from error


def _mime_type(content: bytes) -> str:
    return "image/jpeg" if content.startswith(b"\xff\xd8") else "image/png"
