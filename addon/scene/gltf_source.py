"""A glTF file: its document, its buffers, and the files that it names."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from .gltf_format import COMPONENTS, SHAPES, Broken, Document
from .input_files import check_regular, exists, file_in, opened, shown

_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")

_MOST_JSON, _MOST_VALUES, DEEPEST = 1 << 29, 2_000_000, 64
"""Limits on the JSON text in bytes, on its values, and on their nesting."""

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions of buffer views that are compressed by meshoptimizer."""


@dataclass(frozen=True)
class Buffer:
    """Bytes of a file, or those of a data URI."""

    size: int
    path: Path | None = None
    start: int = 0
    content: bytes = b""

    def read(self, start: int, size: int) -> bytes:
        if self.path is None:
            return self.content[start : start + size]
        with opened(self.path) as file:
            file.seek(self.start + start)
            return file.read(size)


@dataclass
class GltfSource:
    """A document, the folder of its files, and its buffers, which are opened once. body: the binary chunk of a .glb."""

    home: Path
    document: Document
    body: Buffer | None
    file: Path | None = None
    """The file that has exactly this; None if there is none."""

    def __post_init__(self) -> None:
        self.buffers = [self._buffer(number, each) for number, each in enumerate(self.list("buffers"))]

    def list(self, name: str) -> list[dict[str, Any]]:
        return self.document.get(name, [])

    def primitives(self) -> Iterator[tuple[str, dict[str, Any]]]:
        for number, mesh in enumerate(self.list("meshes")):
            for index, primitive in enumerate(mesh["primitives"]):
                yield f"meshes[{number}].primitives[{index}]", primitive

    def values(self, index: int) -> NDArray[Any] | None:
        """Return (count, components) the values of an accessor; `None` if compressed, sparse or without data."""
        accessor = self.list("accessors")[index]
        if "bufferView" not in accessor or "sparse" in accessor:
            return None
        view = self.list("bufferViews")[accessor["bufferView"]]
        component, width = np.dtype(COMPONENTS[accessor["componentType"]]), SHAPES[accessor["type"]]
        stride = view.get("byteStride") or component.itemsize * width
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        size = stride * (accessor["count"] - 1) + component.itemsize * width
        content = self.buffers[view["buffer"]].read(start, size)
        if len(content) < size:  # A buffer without data, or a file that has changed meanwhile.
            raise Broken(f"accessors[{index}] has {len(content)} of its {size} bytes")
        return np.ndarray((accessor["count"], width), component, content, 0, (stride, component.itemsize))

    def image(self, number: int) -> bytes | Path | None:
        """Return the bytes of an image, or its file; None if it has none, or the file is missing.

        Raise `Broken` for a data URI that cannot be decoded, `SceneError` for a file outside of the folder.
        """
        image, place = self.list("images")[number], f"images[{number}]"
        uri = image.get("uri")
        if uri is None:
            return self.view(image["bufferView"]) if "bufferView" in image else None
        if uri.startswith("data:"):
            return embedded(uri, place)
        path = file_in(self.home, self.home / path_of(uri), place)
        return path if exists(path) else None

    def view(self, number: int) -> bytes:
        """Return the bytes of a buffer view, as stored. Raise `Broken` if its buffer has no data."""
        view = self.list("bufferViews")[number]
        content = self.buffers[view["buffer"]].read(view.get("byteOffset", 0), view["byteLength"])
        if len(content) < view["byteLength"]:
            raise Broken(f"bufferViews[{number}] has {len(content)} of its {view['byteLength']} bytes")
        return content

    def _buffer(self, number: int, buffer: dict[str, Any]) -> Buffer:
        place = f"buffers[{number}]"
        uri = buffer.get("uri")
        if any(buffer.get("extensions", {}).get(name, {}).get("fallback") for name in MESHOPT):
            return Buffer(buffer["byteLength"])  # Without data: its views are compressed elsewhere.
        if uri is None:
            found = self.body if number == 0 and self.body is not None else Buffer(0)
        elif uri.startswith("data:"):
            content = embedded(uri, place)
            found = Buffer(len(content), content=content)
        else:
            path = file_in(self.home, self.home / path_of(uri), place)
            found = Buffer(check_regular(path), path)
        if buffer["byteLength"] > found.size:
            raise Broken(f"{place} has {buffer['byteLength']} bytes, but its data has {found.size}")
        return found


def path_of(uri: str) -> str:
    """Return the path that Blender's importer reads for a URI."""
    return unquote(uri.replace("\\", "/"))


def embedded(uri: str, place: str) -> bytes:
    head, mark, code = uri.partition(";base64,")
    try:
        if not mark:
            raise ValueError("no base64")
        return base64.b64decode(code)
    except (ValueError, binascii.Error) as error:
        raise Broken(f"{place} has the data URI {shown(head)}, which cannot be decoded ({error})") from error


def read_document(path: Path, size: int) -> tuple[Any, Buffer | None]:
    """Return the JSON of a file of `size` bytes and the binary chunk of a .glb file."""
    with opened(path) as file:
        head = file.read(_HEADER.size)
        if not head.startswith(b"glTF"):
            _check_json_size(size)
            return _parsed(head + file.read()), None
        _, version, length = _unpacked(_HEADER, head)
        if version != 2 or length != size:
            raise Broken(f"version {version} and {length} bytes in the header, {size} in the file")
        count, kind = _unpacked(_CHUNK, file.read(_CHUNK.size))
        if kind != b"JSON" or count > size - file.tell():
            raise Broken(f"the first chunk is {shown(kind)} with {count} bytes, but must be JSON within the file")
        _check_json_size(count)
        document = _parsed(file.read(count))
        if file.tell() == size:
            return document, None
        count, kind = _unpacked(_CHUNK, file.read(_CHUNK.size))
        if count > size - file.tell():
            raise Broken(f"the second chunk has {count} bytes, but the file has only {size - file.tell()} for it")
        return document, Buffer(count, path, file.tell()) if kind == b"BIN\0" else None


def _unpacked(form: struct.Struct, content: bytes) -> tuple[Any, ...]:
    if len(content) < form.size:
        raise Broken(f"the file ends within a header: {len(content)} of {form.size} bytes")
    return form.unpack(content)


def _check_json_size(size: int) -> None:
    if size > _MOST_JSON:
        raise Broken(f"the JSON text has {size} bytes, more than {_MOST_JSON}; use binary buffers")


def _parsed(text: bytes) -> Any:
    values = text.count(b",") + text.count(b"[") + text.count(b"{")
    if values > _MOST_VALUES:
        raise Broken(f"the JSON text has about {values} values, more than {_MOST_VALUES}")
    try:
        return json.loads(text)
    except ValueError as error:
        raise Broken(f"the text is not JSON: {error}") from error
    except RecursionError as error:
        raise Broken(f"the JSON text is nested too deeply: at most {DEEPEST} levels are possible") from error
