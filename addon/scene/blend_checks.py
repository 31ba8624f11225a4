"""Checks of a .blend file: of the files that it names before Blender opens it, and of its images before they are read.

Blender opens linked libraries while it opens the file, and waits for ever on a pipe. Unlike for other inputs, files may
be anywhere: scenes share folders of textures.
"""

from __future__ import annotations

import gzip
import os
import re
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

import bpy
import numpy as np

from ..errors import SceneError
from ..material.images import tile_file
from .image_sizes import ImageSizes
from .input_files import check_regular, exists, opened, shown

_NAMING = {b"LI\0\0", b"IM\0\0", b"SO\0\0", b"MC\0\0", b"VF\0\0", b"CF\0\0", b"VO\0\0"}
"""Blocks that name files: libraries, images, sounds, clips, fonts, caches and volumes."""

_LARGEST_STRUCT = 4096
"""Limit on the bytes of other blocks in which paths are looked for: modifiers and sockets of nodes name files, too."""

_PATH = re.compile(rb"[^\0]{2,1023}")

_MOST_UNPACKED = 200
"""Limit on the size of a file without compression, as a multiple of its size. Zstandard seldom exceeds 20."""

_FREE = 1 << 28
"""Number of bytes that a compressed file may always have without compression."""

_DEEPEST = 200
"""Limit on the parents of an object."""


class _Reader(Protocol):
    def read(self, size: int, /) -> bytes: ...

    def seek(self, offset: int, whence: int, /) -> int: ...


def check_blend(path: Path) -> None:
    """Raise `SceneError` or `OSError` for a .blend file that Blender must not open."""
    size = check_regular(path)
    try:
        with _unpacked(path) as (file, is_packed):
            for name in _names(file, max(_MOST_UNPACKED * size, _FREE) if is_packed else size):
                _check_name(path, name)
    except (ValueError, struct.error, EOFError, zlib.error) as error:
        raise SceneError(f"{path} cannot be read: {error}; check the file, or save it again") from error


@contextmanager
def _unpacked(path: Path) -> Iterator[tuple[_Reader, bool]]:
    """Open a .blend file for reading without its compression. Return whether it is compressed."""
    with opened(path) as file:
        start = file.read(4)
        file.seek(0)
        if start == b"\x28\xb5\x2f\xfd":
            import zstandard  # A module of Blender.

            try:
                yield zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True), True
            except zstandard.ZstdError as error:
                raise ValueError(str(error)) from error
        elif start[:2] == b"\x1f\x8b":
            with gzip.open(file) as unpacked:
                yield unpacked, True
        else:
            yield file, False


def _names(file: _Reader, most: int) -> Iterator[str]:
    """Return all texts that may be paths in the blocks that name files. Raise `ValueError` for a broken file."""
    start = file.read(12)
    if not start.startswith(b"BLENDER"):
        raise ValueError("it is no .blend file")
    order = ">" if start[8:9] == b"V" else "<"
    if start[7:8].isdigit():  # Since Blender 5: the size of this header, "-", the format, "v" and the version.
        file.read(int(start[7:9]) - 12)
        block, length_at = struct.Struct("<4siQqq"), 3
    else:
        block, length_at = struct.Struct(f"{order}4si{'Q' if start[7:8] == b'-' else 'I'}ii"), 1
    at = len(start)
    while True:
        head = block.unpack(_read(file, block.size))
        code, length = head[0], head[length_at]
        if code == b"ENDB":
            return
        at += block.size + length
        if length < 0 or at > most:
            raise ValueError(f"the block {shown(code.decode('latin-1'))} has {length} bytes, more than the file")
        if code in _NAMING or (code == b"DATA" and length <= _LARGEST_STRUCT):
            content = _read(file, length)
            if b"/" in content:
                yield from (os.fsdecode(name) for name in _PATH.findall(content) if b"/" in name)
        else:
            file.seek(length, os.SEEK_CUR)


def _read(file: _Reader, size: int) -> bytes:
    content = file.read(size)
    if len(content) < size:
        raise ValueError("the file ends within a block")
    return content


def _check_name(path: Path, name: str) -> None:
    """Raise `SceneError` if a text is the path of a pipe or a device."""
    file = path.resolve().parent / name[2:] if name.startswith("//") else Path(name)
    with suppress(OSError, ValueError):
        mode = file.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise SceneError(f"{path} names {file}, which is a pipe or a device, not a file: put a file there")


def check_blocks(path: Path, images: Iterable[bpy.types.Image], meshes: Iterable[bpy.types.Mesh]) -> None:
    """Raise `SceneError` for what was read of a file: images that are too large, broken meshes, too many parents."""
    sizes = ImageSizes()
    try:
        for image in images:
            _check_image(image, sizes)
        for mesh in meshes:
            _check_mesh(mesh)
        _check_parents()
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error


def _check_image(image: bpy.types.Image, sizes: ImageSizes) -> None:
    name = f"image {image.name!r}"
    if image.source == "GENERATED":
        sizes.add((image.generated_width, image.generated_height), name)
    elif image.packed_files:
        for packed in image.packed_files:
            sizes.check(packed.packed_file.data, name)
    elif image.source == "FILE":
        file = Path(bpy.path.abspath(image.filepath, library=image.library))
        if image.filepath and exists(file) and file.is_file():
            sizes.check_file(file)
    elif image.source == "TILED" and image.filepath:
        pattern = bpy.path.abspath(image.filepath, library=image.library)
        for tile in image.tiles:
            file = Path(tile_file(pattern, tile.number))
            if exists(file):
                sizes.check_file(file)


def _check_parents() -> None:
    """Raise `SceneError` for objects with too many parents: Blender's glTF exporter calls itself for each."""
    children = {obj: obj.parent for obj in bpy.data.objects if obj.parent is not None}
    for _ in range(_DEEPEST):
        # Each round goes up one parent.
        children = {obj: above.parent for obj, above in children.items() if above.parent is not None}
    if children:
        name = next(iter(children)).name
        raise SceneError(
            f"object {name!r} has more than {_DEEPEST} parents: clear the parents of some, keeping transforms"
        )


def _check_mesh(mesh: bpy.types.Mesh) -> None:
    """Raise `SceneError` for indices out of range, with which Blender crashes."""
    vertices, edges = len(mesh.vertices), len(mesh.edges)
    used = (
        ("vertices of corners", mesh.loops, "vertex_index", 1, vertices),
        ("edges of corners", mesh.loops, "edge_index", 1, edges),
        ("vertices of edges", mesh.edges, "vertices", 2, vertices),
        ("first corners of faces", mesh.polygons, "loop_start", 1, len(mesh.loops)),
    )
    for words, items, name, width, count in used:
        values = np.zeros(width * len(items), np.int32)
        items.foreach_get(name, values)
        if len(values) and not 0 <= (wrong := values.min() if values.min() < 0 else values.max()) < count:
            raise SceneError(
                f"the {words} of mesh {mesh.name!r} have the number {wrong}, not one of {count}: replace the mesh"
            )
