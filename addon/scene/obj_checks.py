"""Checks of an OBJ file, its material libraries and their images before Blender imports them.

Blender's importer reads pipes and files anywhere, and images of any size. It silently sets coordinates that are not
finite to zero.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh.realise import first_not_finite
from .image_sizes import ImageSizes
from .input_files import CHUNK, check_regular, exists, file_in, opened

_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\n]+)", re.MULTILINE)
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(.*)$", re.MULTILINE)
# Matches numbers that float32 may not hold: "nan", "inf", "1e39". Only lines with a match are parsed.
_SUSPICIOUS = re.compile(rb"nan|inf|e\+?(?:3[89]|[4-9]\d|\d{3})", re.IGNORECASE)
_MAP = re.compile(rb"^[ \t]*(?:map_\w+|norm|bump|disp|decal|refl)[ \t]+([^\n]+)", re.MULTILINE | re.IGNORECASE)

_MOST_LIBRARY = 1 << 26
"""Limit on the bytes of a material library."""

_MOST_MATERIALS = 2000
"""Limit on the materials of a library."""


def check_obj(path: Path) -> None:
    """Raise `SceneError` or `OSError` for an OBJ file that Blender must not read."""
    home = path.resolve().parent
    vertices = 0
    libraries: dict[str, None] = {}
    for block in _blocks(path):
        libraries |= dict.fromkeys(map(_name, _LIBRARY.findall(block)))
        if _SUSPICIOUS.search(block):
            _check_vertices(path, block, vertices)
        vertices += len(_VERTEX.findall(block))
    default = path.with_suffix(".mtl")  # Blender reads it, too.
    if exists(default):
        libraries[default.name] = None
    images = ImageSizes()
    for library in libraries:
        _check_library(path, home, library, images)


def _blocks(path: Path) -> Iterator[bytes]:
    """Read a file of text in blocks of whole lines. Raise `SceneError` for a file with null bytes or endless lines."""
    check_regular(path)
    rest = b""
    with opened(path) as file:
        while block := file.read(CHUNK):
            if b"\0" in block:
                raise SceneError(f"{path} is no text: it has null bytes; export it again")
            lines, end, rest = (rest + block).rpartition(b"\n")
            if len(rest) > CHUNK:
                raise SceneError(f"{path} has a line of more than {CHUNK} bytes; export it again")
            yield lines + end
        yield rest


def _name(words: bytes) -> str:
    return os.fsdecode(words.strip())


def _check_library(path: Path, home: Path, name: str, images: ImageSizes) -> None:
    library = file_in(home, home / name, str(path))
    if not exists(library):
        raise SceneError(
            f"{path.parent / name} does not exist, but {path.name} reads its materials from it; put the file there"
        )
    size = check_regular(library)
    if size > _MOST_LIBRARY:
        raise SceneError(f"{library} has {size} bytes, more than {_MOST_LIBRARY}: remove materials")
    content = b"".join(_blocks(library))
    materials = len(re.findall(rb"^[ \t]*newmtl\b", content, re.MULTILINE))
    if materials > _MOST_MATERIALS:
        raise SceneError(f"{library} has {materials} materials, more than {_MOST_MATERIALS}: remove materials")
    joined = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")  # Backslashes may continue lines.
    for line in dict.fromkeys(_MAP.findall(content) + _MAP.findall(joined)):
        _check_map(library, home, _name(line), images)


def _check_map(library: Path, home: Path, line: str, images: ImageSizes) -> None:
    """Raise `SceneError` for an image that Blender must not read. `line`: options and the image's file."""
    for name in _spellings(line):
        # Blender looks beside the library first, then in the working directory.
        found = next((each for each in (library.parent / name, Path(name)) if exists(each)), None)
        if found is not None:
            images.check_file(file_in(home, found, str(library)))


def _spellings(line: str) -> dict[str, None]:
    """Return all names of files for which Blender may look: without options, quotes, underscores or folders."""
    words = line.split()
    found = [line, *(line.split(None, first)[-1] for first in range(1, min(len(words), 32)))]
    for change in (
        lambda name: name.strip('"'),
        lambda name: name.replace("_", " "),
        lambda name: name.replace("\\", "/"),
        os.path.basename,
    ):
        found += map(change, found.copy())
    return dict.fromkeys(filter(None, found))


def _check_vertices(path: Path, block: bytes, first: int) -> None:
    for number, match in enumerate(_VERTEX.finditer(block)):
        if _SUSPICIOUS.search(match[1]):
            coordinates = np.array([_number(word) for word in match[1].split()[:3]], np.float64)
            with np.errstate(over="ignore"):
                _check_finite(path, coordinates.astype(np.float32)[None], first + number)


def _check_finite(path: Path, position: NDArray[np.float32], number: int) -> None:
    bad = first_not_finite(position)
    if bad is not None:
        raise SceneError(
            f"{path}: vertex {number} of the file lies at ({bad[1]}), which is not finite; export it again"
        )


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")
