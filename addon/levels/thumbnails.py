"""A picture of each level, kept as the preview of its object: the sidebar shows it, and files keep it."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

SIZE = 128
"""Side of the pictures in pixels."""


def keep_thumbnails(objects: Sequence[bpy.types.Object], levels: Sequence[leafcloud.AnyLevel]) -> None:
    """Store a picture of every level as the preview of its object.

    objects: of all levels, the leaves first. levels: those after the leaves. The picture of the leaves is the one that
    the last level was compared with: beside an impostor it has the trunk, too.
    """
    pictures = [level.pictures() for level in levels]
    shown = [pictures[-1][0], *(picture for _, picture in pictures)]
    for obj, picture in zip(objects, shown, strict=True):
        preview = obj.preview_ensure()
        preview.image_size = (SIZE, SIZE)
        preview.image_pixels_float.foreach_set(_reduced(picture).ravel())


def thumbnail_of(obj: bpy.types.Object) -> int:
    """Return the icon with the picture of a level; 0 if there is none."""
    return 0 if obj.preview is None else int(obj.preview.icon_id)


def _reduced(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a picture as `SIZE` rows of floats in [0, 1], from bottom to top, with premultiplied alpha, as Blender
    draws previews."""
    step = picture.shape[0] // SIZE
    colors = picture.astype(np.float32) / 255.0
    colors[..., :3] *= colors[..., 3:]
    means = colors.reshape(SIZE, step, SIZE, step, 4).mean(axis=(1, 3))
    return np.ascontiguousarray(means[::-1])
