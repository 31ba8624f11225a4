"""Texels of a PNG file, for `leafcloud inspect`.

The filters of all rows are undone together, along diagonals: a texel needs only its neighbors on the left and above
(PNG specification, section 9). O(rows + columns) steps of numpy. Known limits: 8 bits a channel, not interlaced.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_MOST_TEXELS = 2**24


def alpha_of_png(content: bytes) -> NDArray[np.float64] | None:
    """Return alpha (h, w) in [0, 1] of a PNG file; None for a form that is not decoded here, or a broken file.

    Palettes, and pictures without alpha, are such forms.
    """
    width, height, depth, kind, interlaced = struct.unpack_from(">IIBB2xB", content, 16)
    if depth != 8 or interlaced or kind not in (4, 6) or not 0 < width * height <= _MOST_TEXELS:
        return None
    channels, size = _CHANNELS[kind], (_CHANNELS[kind] * width + 1) * height
    try:
        # A small file may claim to be any number of bytes.
        rows = zlib.decompressobj().decompress(b"".join(_parts(content)), size)
    except (zlib.error, struct.error):
        return None
    if len(rows) < size:
        return None
    codes = np.frombuffer(rows, np.uint8).reshape(height, -1)
    # Each channel is filtered apart.
    alpha = codes[:, channels::channels] if channels > 1 else codes[:, 1:]
    return _unfiltered(codes[:, 0], alpha).astype(np.float64) / 255.0


def _parts(content: bytes) -> list[bytes]:
    """Return the contents of the chunks that hold the picture."""
    at, found = 8, []
    while at + 8 <= len(content):
        length, name = struct.unpack_from(">I4s", content, at)
        if name == b"IDAT":
            found.append(content[at + 8 : at + 8 + length])
        at += 12 + length
    return found


def _unfiltered(filters: NDArray[np.uint8], codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the filter of each row of a channel (h, w)."""
    height, width = codes.shape
    # A row and a column of zeros stand above and on the left.
    out = np.zeros((height + 1, width + 1), np.int32)
    for diagonal in range(height + width - 1):
        y = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        x = diagonal - y
        left, above, corner = out[y + 1, x], out[y, x + 1], out[y, x]
        guess = left + above - corner
        near = [np.abs(guess - each) for each in (left, above, corner)]
        paeth = np.where((near[0] <= near[1]) & (near[0] <= near[2]), left, np.where(near[1] <= near[2], above, corner))
        added = np.choose(np.minimum(filters[y], 4), [np.zeros_like(left), left, above, (left + above) // 2, paeth])
        out[y + 1, x + 1] = (codes[y, x] + added) & 255
    return out[1:, 1:].astype(np.uint8)
