"""Writes a picture of a part of a tree's atlas page, with its channels side by side: docs/page.png (`make docs`).

usage: python tools/page_picture.py TREE.glb OUT.png
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

import leafcloud

SIDE = 360
"""Side of the square cut out of each channel, in texels."""
GROUND = (120, 120, 120)


def cut(image: NDArray[np.uint8], left: int, top: int) -> NDArray[np.uint8]:
    """Cut an opaque square out of a channel, over the color `GROUND`."""
    part = image[top : top + SIDE, left : left + SIDE].astype(np.float32)
    alpha = part[..., 3:] / 255.0
    shown = np.full((SIDE, SIDE, 4), 255, np.uint8)
    shown[..., :3] = np.rint(part[..., :3] * alpha + np.array(GROUND) * (1.0 - alpha))
    return shown


def main() -> None:
    tree, out = sys.argv[1:]
    level = leafcloud.build_chain(leafcloud.read_gltf(tree), levels=1, cross=False, normals=0.0).clouds[0]
    assert level.normal is not None
    color, normal = level.base_color, level.normal.copy()
    dilated = color.copy()
    dilated[..., 3] = 255
    normal[..., 3] = color[..., 3]
    left, top = (side // 8 for side in color.shape[1::-1])
    gap = np.full((SIDE, 8, 4), 255, np.uint8)
    row = [part for image in (color, dilated, normal) for part in (gap, cut(image, left, top))][1:]
    leafcloud.write_png(out, np.ascontiguousarray(np.hstack(row)))


if __name__ == "__main__":
    main()
