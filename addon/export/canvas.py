"""Blocks of pixels for preview.png: pictures on a background, text, and their arrangement in rows and columns.

A block is an opaque sRGB image (h, w, 3). Pictures have an alpha (h, w, 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

import leafcloud

Block = NDArray[np.uint8]
Picture = NDArray[np.uint8]
Color = tuple[int, int, int]
Box = tuple[int, int, int, int]
"""First row, end of the rows, first column, end of the columns."""

_Pixel = TypeVar("_Pixel", bound=np.generic)

PAPER: Color = (247, 248, 250)
"""Color around the pictures."""
GROUND: Color = (204, 214, 224)
"""Background of the pictures, a pale sky. It is not gray because surfaces without a material are gray."""
INK: Color = (28, 33, 40)
GRAY: Color = (92, 102, 114)

COLORS = 256
"""Maximum number of colors of a file. With this palette a file has a third of the bytes and looks the same."""

_HEAT = np.array(
    [(0, 0, 4), (28, 16, 68), (79, 18, 123), (129, 37, 129), (181, 54, 122),
     (229, 80, 100), (251, 135, 97), (254, 194, 135), (252, 253, 191)], np.float64
)  # fmt: skip
"""Colors of matplotlib's map magma at equal steps."""
HOTTEST = 0.5
"""FLIP of a pixel from which the heat map has its brightest color."""
_BAR = 10
"""Width of the color bar in pixels."""


def empty(height: int, width: int, color: Color = PAPER) -> Block:
    """Return a block of one color."""
    block = np.empty((height, width, 3), np.uint8)
    block[:] = color
    return block


def opaque(block: Block) -> Picture:
    """Return the block as a picture without transparency."""
    return np.dstack([block, np.full(block.shape[:2], 255, np.uint8)])


def png(block: Block) -> bytes:
    """Return the block as a PNG file in few colors."""
    return leafcloud.encode_png([opaque(block)], colors=COLORS)


def over(picture: Picture, color: Color = GROUND) -> Block:
    """Return the picture on a background."""
    alpha = picture[..., 3:].astype(np.float32) / 255.0
    return np.rint(picture[..., :3] * alpha + _codes(color) * (1.0 - alpha)).astype(np.uint8)


def text(line: str, size: float, color: Color = INK, ground: Color = PAPER) -> Block:
    """Return a line of text. `size`: pixels per em."""
    ink = leafcloud.draw_text(line[:200], size)[..., None].astype(np.float32) / 255.0
    return np.rint(_codes(color) * ink + _codes(ground) * (1.0 - ink)).astype(np.uint8)


def number(value: float) -> str:
    """Return a length in few digits."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def wrapped(parts: Sequence[str], size: float, width: int, color: Color = GRAY) -> Block:
    """Return the parts in as few lines as fit into `width`, with dots between the parts of a line."""
    lines: list[str] = []
    for part in parts:
        longer = f"{lines[-1]}  ·  {part}" if lines else part
        if lines and leafcloud.draw_text(longer, size).shape[1] <= width:
            lines[-1] = longer
        else:
            lines.append(part)
    return below([text(line, size, color) for line in lines], 2)


def beside(blocks: Sequence[Block], gap: int, align: Literal["top", "bottom"] = "top", color: Color = PAPER) -> Block:
    """Return the blocks from left to right."""
    height = max(block.shape[0] for block in blocks)
    columns: list[Block] = []
    for block in blocks:
        rest = empty(height - block.shape[0], block.shape[1], color)
        column = np.concatenate([block, rest] if align == "top" else [rest, block])
        columns += [empty(height, gap, color), column] if columns else [column]
    return np.concatenate(columns, axis=1)


def below(blocks: Sequence[Block], gap: int, color: Color = PAPER) -> Block:
    """Return the blocks from top to bottom, at the left edge."""
    width = max(block.shape[1] for block in blocks)
    rows: list[Block] = []
    for block in blocks:
        row = np.concatenate([block, empty(block.shape[0], width - block.shape[1], color)], axis=1)
        rows += [empty(gap, width, color), row] if rows else [row]
    return np.concatenate(rows)


def framed(block: Block, margin: int, color: Color = PAPER) -> Block:
    """Return the block with a margin on all sides."""
    height, width, _ = block.shape
    result = empty(height + 2 * margin, width + 2 * margin, color)
    result[margin : margin + height, margin : margin + width] = block
    return result


def enlarged(block: Block, times: int) -> Block:
    """Return the block with `times` × `times` pixels for each pixel."""
    return block.repeat(times, axis=0).repeat(times, axis=1)


def silhouette(pictures: Sequence[Picture], margin: int = 1) -> Box:
    """Return the box of all pixels that any picture covers, with a margin; the whole picture if none covers any.

    The box is within the picture.
    """
    covered = np.any([picture[..., 3] > 0 for picture in pictures], axis=0)
    height, width = covered.shape
    if not covered.any():
        return 0, height, 0, width
    rows, columns = (np.flatnonzero(covered.any(axis=axis)) for axis in (1, 0))
    top, left = max(int(rows[0]) - margin, 0), max(int(columns[0]) - margin, 0)
    return top, min(int(rows[-1]) + 1 + margin, height), left, min(int(columns[-1]) + 1 + margin, width)


def cropped(image: NDArray[_Pixel], box: Box) -> NDArray[_Pixel]:
    """Return the part of an image in the box."""
    top, bottom, left, right = box
    return image[top:bottom, left:right]


def outlined(block: Block, box: Box, color: Color = INK) -> Block:
    """Return the block with a thin frame along the inside of the box."""
    marked = block.copy()
    top, bottom, left, right = box
    marked[[top, bottom - 1], left:right] = color
    marked[top:bottom, [left, right - 1]] = color
    return marked


def heat(errors: NDArray[np.float32]) -> Block:
    """Return the colors of FLIP errors (h, w), from black at 0 to pale yellow at `HOTTEST`."""
    steps = np.clip(errors.astype(np.float64) / HOTTEST, 0.0, 1.0) * (len(_HEAT) - 1)
    channels = [np.interp(steps, np.arange(len(_HEAT)), _HEAT[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def color_bar(height: int) -> Block:
    """Return the scale of the heat map, upright, with the errors at its ends."""
    bar = heat(np.repeat(np.linspace(HOTTEST, 0.0, height, dtype=np.float32)[:, None], _BAR, axis=1))
    ends = [text(f"{end:g}", 11, GRAY) for end in (HOTTEST, 0.0)]
    room = height - sum(end.shape[0] for end in ends)
    labels = below([ends[0], empty(max(room, 0), 1), ends[1]], 0)[:height]
    return beside([bar, labels], 3)


def _codes(color: Color) -> NDArray[np.float32]:
    return np.array(color, np.float32)
