"""Reader of images as arrays of 8-bit values, and of the image that shows a surface's color and alpha."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from .surface import Rgb, Surface

Pixels = NDArray[np.uint8]

_BAND = 1 << 16
"""Number of pixels converted at a time."""

_FEW = 0.01
"""Share of an image's texels that may be clipped without a warning."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights for linear Rec. 709 colors. Blender uses them to convert a color to a value."""


def check_readable(image: bpy.types.Image, material_name: str) -> None:
    """Raise `SceneError` if an image has no pixels."""
    width, height = image.size  # makes Blender read the file
    missing = _origin(image) if width == 0 or height == 0 else _missing_tile(image)
    if missing is not None:
        raise SceneError(
            f"texture {image.name!r} of material {material_name!r} cannot be read: {missing}; "
            f"put the file there, or pack it into the .blend"
        )


def lacks_alpha(image: bpy.types.Image | None) -> bool:
    """Return whether an image has one or three channels. Blender reads 16 bits as numbers of 32."""
    return image is not None and image.depth in ((32, 96) if image.is_float else (8, 24))


def is_missing(image: bpy.types.Image | None) -> bool:
    """Return whether an image's file is not there. Does not read it."""
    if image is None or image.source != "FILE" or image.packed_file is not None:
        return False
    return not Path(bpy.path.abspath(image.filepath, library=image.library)).is_file()


def check_images(nodes: Iterable[bpy.types.Node], material_name: str) -> None:
    """Raise `SceneError` if an image of nodes has no pixels."""
    for node in nodes:
        if node.type == "TEX_IMAGE":
            check_readable(node.image, material_name)


def _missing_tile(image: bpy.types.Image) -> str | None:
    """Return the first missing file of a tiled image. Blender shows such a tile in pink or with its generated color."""
    if image.source != "TILED" or not image.filepath or len(image.packed_files) > 0:
        return None
    pattern = bpy.path.abspath(image.filepath, library=image.library)
    files = (tile_file(pattern, tile.number) for tile in image.tiles)
    return next((file for file in files if not Path(file).is_file()), None)


def tile_file(pattern: str, number: int) -> str:
    """Return the file of tile 1001 + u + 10 v: insert that number, or u and v counted from 1."""
    v, u = divmod(number - 1001, 10)
    return pattern.replace("<UDIM>", str(number)).replace("<UVTILE>", f"u{u + 1}_v{v + 1}")


def _origin(image: bpy.types.Image) -> str:
    if image.packed_file is not None:
        return "its packed data is not an image"
    return bpy.path.abspath(image.filepath, library=image.library) or "it has no file"


def pixels_of(image: bpy.types.Image, material_name: str, *, data: bool = False) -> Pixels:
    """Return (h, w, 4) an image in sRGB with straight alpha, row 0 on top. With `data`: linear and opaque."""
    check_readable(image, material_name)
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    rows = values.reshape(height, width, image.channels)[::-1]
    codes = np.empty((height, width, 4), np.uint8)
    # A few rows at a time, so that intermediate arrays stay in the CPU cache.
    step = max(_BAND // width, 1)
    for first in range(0, height, step):
        codes[first : first + step] = _codes(image, rows[first : first + step], data=data)
    return codes


def _codes(image: bpy.types.Image, values: NDArray[np.float32], *, data: bool) -> Pixels:
    """Convert an image's values (h, w, channels) to 8-bit values (h, w, 4)."""
    rgba = _with_four_channels(values)
    if data:
        # Blender shades with linear values, so it also decodes data in an image that is marked as sRGB.
        linear = rgba[..., :3] if _is_linear(image) else decoded(rgba[..., :3])
        return as_bytes(np.concatenate([linear, np.ones_like(rgba[..., 3:])], axis=2))
    color, alpha = rgba[..., :3], rgba[..., 3:]
    if image.alpha_mode == "NONE":
        alpha = np.ones_like(alpha)
    elif _is_premultiplied(image):
        color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0.0)
    if _is_linear(image):
        color = encoded(color)
    return as_bytes(np.concatenate([color, alpha], axis=2))


def _with_four_channels(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert gray, gray and alpha, RGB or RGBA to (h, w, 4)."""
    channels = values.shape[2]
    color = values[..., :3] if channels >= 3 else np.repeat(values[..., :1], 3, axis=2)
    alpha = values[..., -1:] if channels in (2, 4) else np.ones_like(values[..., :1])
    return np.concatenate([color, alpha], axis=2)


def _is_premultiplied(image: bpy.types.Image) -> bool:
    """Return whether pixels are premultiplied. Blender premultiplies straight float images, but not byte images."""
    return image.alpha_mode == "PREMUL" or (image.is_float and image.alpha_mode == "STRAIGHT")


def _is_linear(image: bpy.types.Image) -> bool:
    """Return whether pixels are linear. Blender reads float images as linear; byte images keep their color space."""
    space = image.colorspace_settings
    return image.is_float or space.is_data or space.name.startswith("Linear")


def encoded(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert linear values to sRGB."""
    positive = np.clip(linear, 0.0, None)
    return np.where(positive <= 0.0031308, 12.92 * positive, 1.055 * positive ** (1.0 / 2.4) - 0.055).astype(np.float32)


def decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert sRGB values to linear."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def as_bytes(values: NDArray[np.float32]) -> Pixels:
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def resized(pixels: Pixels, height: int, width: int) -> Pixels:
    """Resize (h, w, channels) to (height, width, channels) by bilinear interpolation with wrapping.

    An axis of equal size stays unchanged.
    """
    if pixels.shape[:2] == (height, width):
        return pixels
    values = pixels.astype(np.float32)
    for axis, count in ((0, height), (1, width)):
        before = values.shape[axis]
        if before != count:
            at = (np.arange(count) + 0.5) * before / count - 0.5
            first = np.floor(at).astype(int)
            share = np.expand_dims((at - first).astype(np.float32), tuple({0, 1, 2} - {axis}))
            values = (1.0 - share) * values.take(first % before, axis) + share * values.take((first + 1) % before, axis)
    return np.rint(values).astype(np.uint8)


def image_of(surface: Surface) -> Pixels | None:
    """Return (h, w, 4) the colors of one image with the alpha of the same or another; `None` without images.

    A missing color is white, a missing alpha opaque. The result has the larger size of both, so that a mask keeps its
    detail over a small palette. Raises `SceneError` for a missing image.
    """
    color, alpha = surface.color_texture, surface.alpha_texture
    images = dict.fromkeys(texture.image for texture in (color, alpha) if texture is not None)
    pixels = {image: pixels_of(image, surface.name) for image in images}
    if not pixels:
        return None
    height, width = (max(sides) for sides in zip(*(each.shape[:2] for each in pixels.values()), strict=True))
    result = np.full((height, width, 4), 255, np.uint8)
    if color is not None:
        result[..., :3] = resized(pixels[color.image], height, width)[..., :3]
    if alpha is not None:
        values = pixels[alpha.image][..., 3:]
        if surface.alpha_channel == "luminance":
            linear = decoded(pixels[alpha.image][..., :3].astype(np.float32) / 255.0)
            values = as_bytes(linear @ _LUMINANCE)[..., None]
        result[..., 3:] = resized(values, height, width)
    return result


def opacity_of(surface: Surface) -> NDArray[np.float64]:
    """Return (h, w) a surface's alpha times that of its image; (1, 1) without an image.

    Raises `SceneError` for a missing image.
    """
    image = image_of(surface)
    return surface.alpha * (np.ones((1, 1)) if image is None else image[..., 3] / 255.0)


def brightened(factor: Sequence[float], image: Pixels | None, by: float) -> tuple[Rgb, Pixels | None, bool]:
    """Brighten factor · image, and return both, and whether more than `_FEW` of the texels were clipped at 1.

    Neither may exceed 1, so the excess of the factor goes into the image.
    """
    red, green, blue = (by * part for part in factor)
    most = max(red, green, blue)
    if most <= 1.0 + 1e-6 or image is None:
        return (min(red, 1.0), min(green, 1.0), min(blue, 1.0)), image, most > 1.0 + 1e-6
    rest = (red / most, green / most, blue / most)
    color, alpha = most * decoded(image[..., :3].astype(np.float32) / 255.0), image[..., 3:]
    drawn = alpha[..., 0] > 0
    cut = bool((color[drawn] * rest > 1.0).any(axis=1).mean() > _FEW) if drawn.any() else False
    return rest, np.concatenate([as_bytes(encoded(color)), alpha], axis=2), cut
