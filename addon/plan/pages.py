"""Sizes of the atlas pages, known before the bake, and the engines that read KTX2."""

from __future__ import annotations

from ..settings.bake import BakeSettings
from ..settings.levels import LARGEST_TEXTURE, SMALLEST_TEXTURE

KTX2_ENGINES = ("three", "babylon")
"""The engines that are known to support KTX2 textures."""

KTX2_EXTENSION = "KHR_texture_basisu"


def page_size(settings: BakeSettings, number: int) -> tuple[int, int]:
    """Return width and height in texels of the largest page of cloud `number`, from 0. Each is half as large as the
    last."""
    width = settings.texture_size or LARGEST_TEXTURE
    height = settings.texture_height or width
    return max(width >> number, SMALLEST_TEXTURE), max(height >> number, SMALLEST_TEXTURE)


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
