"""Sizes of the atlas pages: the largest ones, known before the bake, and those in files."""

from __future__ import annotations

import math

from ..settings.bake import BakeSettings
from ..settings.levels import LARGEST_TEXTURE, SMALLEST_TEXTURE

KTX2_ENGINES = ("three", "babylon")
"""The engines that are known to support KTX2 textures."""

MIP_ENGINES = ("babylon", "bevy", "godot")
"""The engines that read mip levels beside the PNG textures, by a package or an add-on of this repository."""

MOST_HALVINGS = 3
"""As many as `leafcloud.Level.for_engines` allows."""

LARGEST_TEXEL_PIXELS = 1.2

KTX2_EXTENSION = "KHR_texture_basisu"


def page_size(settings: BakeSettings, number: int) -> tuple[int, int]:
    """Return width and height in texels of the largest page of cloud `number`, from 0. Each is half as large as the
    last."""
    width = settings.texture_size or LARGEST_TEXTURE
    height = settings.texture_height or width
    return max(width >> number, SMALLEST_TEXTURE), max(height >> number, SMALLEST_TEXTURE)


def halvings(texel_pixels: float) -> int:
    """Return how often the sides of a base color are halved in files: as long as texels stay smaller than 1.2 pixels.

    texel_pixels: width of a texel in pixels, greater than 0, where the level takes over.
    """
    if texel_pixels >= LARGEST_TEXEL_PIXELS:
        return 0
    return min(MOST_HALVINGS, math.floor(math.log2(LARGEST_TEXEL_PIXELS / texel_pixels)))


def ktx2_warning(settings: BakeSettings, pages: int) -> str | None:
    """Return a warning if the engine takes KTX2, but one of `pages` pages cannot have it."""
    sizes = [page_size(settings, number) for number in range(pages)]
    odd = [f"{width} × {height}" for width, height in sizes if width % 4 or height % 4]
    if settings.engine not in KTX2_ENGINES or not odd:
        return None
    return (
        f"atlas pages of {', '.join(odd)} stay PNG only: {KTX2_EXTENSION} needs multiples of 4; "
        "choose a power of two as texture size"
    )
