"""Sizes of images as their files declare them, checked before Blender decodes the image.

A file of some kilobytes may declare gigabytes of texels. The formats are those that Blender reads, and KTX2.
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from ..errors import SceneError
from .input_files import check_regular, opened

MOST_TEXELS = 8192**2
"""Limit on the texels of an image."""

MOST_TOGETHER = 4 * MOST_TEXELS
"""Limit on the texels of all images of a file."""

_Content: TypeAlias = bytes | mmap.mmap
_Size: TypeAlias = tuple[int, int]


def _packed(form: str, *, height_first: bool = False) -> Callable[[bytes], _Size]:
    def size(content: bytes) -> _Size:
        first, second = map(abs, struct.unpack(form, content))
        return (second, first) if height_first else (first, second)

    return size


def _webp(content: bytes) -> _Size:
    return 1 + int.from_bytes(content[:3], "little"), 1 + int.from_bytes(content[3:], "little")


def _webp_lossless(content: bytes) -> _Size:
    bits = int.from_bytes(content, "little")
    return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)


def _exr(content: bytes) -> _Size:
    left, top, right, bottom = struct.unpack("<4i", content)
    return abs(right - left) + 1, abs(bottom - top) + 1


def _text(content: bytes) -> _Size:
    height, width = map(int, re.findall(rb"\d+", content))
    return width, height


_FORMATS: tuple[tuple[bytes, Callable[[bytes], _Size]], ...] = (
    (rb"\x89PNG\r\n\x1a\n.{8}(.{8})", _packed(">II")),
    (rb"RIFF.{4}WEBPVP8X.{8}(.{6})", _webp),
    (rb"RIFF.{4}WEBPVP8L.{4}\x2f(.{4})", _webp_lossless),
    (rb"RIFF.{4}WEBPVP8 .{7}\x9d\x01\x2a(.{4})", _packed("<HH")),
    (rb"\xabKTX 20\xbb\r\n\x1a\n.{8}(.{8})", _packed("<II")),
    (rb"BM.{16}(.{8})", _packed("<ii")),
    (rb"DDS .{8}(.{8})", _packed("<II", height_first=True)),
    (rb"8BPS.{10}(.{8})", _packed(">II", height_first=True)),
    (rb"\x76\x2f\x31\x01.{0,65536}?dataWindow\0box2i\0\x10\0\0\0(.{16})", _exr),
    (rb"#\?.{0,4096}?\n(-Y \d{1,9} \+X \d{1,9})\n", _text),
    (rb"\0\0\0\x0cjP  .{0,4096}?ihdr(.{8})", _packed(">II", height_first=True)),
    (rb"\xff\x4f\xff\x51.{4}(.{8})", _packed(">II")),
    (rb"SDPX.{768}(.{8})", _packed(">II")),
    (rb"XPDS.{768}(.{8})", _packed("<II")),
    (rb"\x01\xda.{4}(.{4})", _packed(">HH")),
    # Targa files have no magic number, so this comes last.
    (rb".[\0\1][\1\2\3\x09\x0a\x0b].{9}(.{4})[\x08\x0f\x10\x18\x20]", _packed("<HH")),
)
"""Start of the files of each format, with the bytes of the size, and the reader of these bytes."""


def declared_size(content: _Content) -> _Size | None:
    """Return the width and height that the content of an image file declares; `None` for an unknown format."""
    if content[:2] == b"\xff\xd8":
        return _jpeg(content)
    if content[:4] in (b"II*\0", b"MM\0*"):
        return _tiff(content)
    for start, size in _FORMATS:
        if found := re.match(start, content, re.DOTALL):
            return size(found[1])
    return None


def _jpeg(content: _Content) -> _Size | None:
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", content[at + 5 : at + 9])
            return width, height
        # Markers without a length: fill bytes, restarts and the start of the image.
        alone = marker == 0xFF or 0xD0 <= marker <= 0xD8 or marker == 0x01
        at += 1 if marker == 0xFF else 2 if alone else 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return None


def _tiff(content: _Content) -> _Size | None:
    order = "<" if content[:2] == b"II" else ">"
    try:
        (at,) = struct.unpack(f"{order}I", content[4:8])
        (count,) = struct.unpack(f"{order}H", content[at : at + 2])
        sides: dict[int, int] = {}
        for number in range(count):
            start = at + 2 + 12 * number
            tag, kind, _ = struct.unpack(f"{order}HHI", content[start : start + 8])
            form = f"{order}H" if kind == 3 else f"{order}I"
            (sides[tag],) = struct.unpack(form, content[start + 8 : start + 8 + struct.calcsize(form)])
        return sides[256], sides[257]
    except (struct.error, KeyError):
        return None


class ImageSizes:
    """A check of all images of an input, each as `check` or `check_file` gets it."""

    def __init__(self) -> None:
        self._texels = 0

    def check_file(self, path: Path) -> None:
        """Raise `SceneError` for a file that is too large once decoded, or no regular file; `OSError` if missing."""
        if check_regular(path) > 0:
            with opened(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                self.check(content, str(path))

    def check(self, content: _Content, image: str) -> None:
        """Raise `SceneError` for the content of an image file that is too large once decoded."""
        size = declared_size(content)
        if size is not None:
            self.add(size, image)

    def add(self, size: _Size, image: str) -> None:
        """Raise `SceneError` for an image that is too large, by itself or with all others."""
        width, height = size
        if width * height > MOST_TEXELS:
            raise SceneError(
                f"{image} has {width} × {height} texels, more than {MOST_TEXELS} (8192 × 8192): make it smaller"
            )
        self._texels += width * height
        if self._texels > MOST_TOGETHER:
            raise SceneError(
                f"the images up to {image} have {self._texels} texels, more than {MOST_TOGETHER}: make them smaller"
            )
