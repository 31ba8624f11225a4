"""Reads palette PNG files and animations (APNG) without code of the project."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray


def chunks_of(png: bytes) -> list[tuple[bytes, bytes]]:
    """Return kind and content of each chunk."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    found, start = [], 8
    while start < len(png):
        (length,) = struct.unpack(">I", png[start : start + 4])
        found.append((png[start + 4 : start + 8], png[start + 8 : start + 8 + length]))
        start += 12 + length
    return found


def frames_of(png: bytes) -> list[NDArray[np.uint8]]:
    """Return the frames (h, w, 3) of a file with a palette; one for a still picture."""
    chunks = chunks_of(png)
    width, height, depth, color = struct.unpack(">IIBB", chunks[0][1][:10])
    assert (depth, color) == (8, 3), "8 bits, palette"
    palette = np.frombuffer(dict(chunks)[b"PLTE"], np.uint8).reshape(-1, 3)
    streams = [b""]
    for kind, content in chunks:
        if kind == b"fcTL" and streams[-1]:
            streams.append(b"")
        if kind in (b"IDAT", b"fdAT"):
            streams[-1] += content if kind == b"IDAT" else content[4:]
    lines = [np.frombuffer(zlib.decompress(stream), np.uint8).reshape(height, width + 1) for stream in streams]
    assert not any(line[:, 0].any() for line in lines), "no filter"
    return [palette[line[:, 1:]] for line in lines]


def durations_of(png: bytes) -> list[float]:
    """Return the seconds of each frame of an animation."""
    delays = [struct.unpack(">HH", content[20:24]) for kind, content in chunks_of(png) if kind == b"fcTL"]
    return [numerator / denominator for numerator, denominator in delays]
