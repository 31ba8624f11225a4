"""Whether images have pixels."""

from __future__ import annotations

from pathlib import Path

import bpy

from . import SceneError


def check_readable(image: bpy.types.Image, material_name: str) -> None:
    """Raises `SceneError` where it has none."""
    width, height = image.size  # makes Blender read the file
    missing = _origin(image) if width == 0 or height == 0 else _missing_tile(image)
    if missing is not None:
        raise SceneError(
            f"texture {image.name!r} of material {material_name!r} cannot be read: {missing}; "
            f"put the file there, or pack it into the .blend"
        )


def _missing_tile(image: bpy.types.Image) -> str | None:
    """The first file that a tiled image lacks, which Blender shows in pink or as it was when it was made."""
    if image.source != "TILED" or not image.filepath or len(image.packed_files) > 0:
        return None
    pattern = bpy.path.abspath(image.filepath, library=image.library)
    files = (_tile_file(pattern, tile.number) for tile in image.tiles)
    return next((file for file in files if not Path(file).is_file()), None)


def _tile_file(pattern: str, number: int) -> str:
    """By the number 1001 + u + 10 v, or by both from 1 on."""
    v, u = divmod(number - 1001, 10)
    return pattern.replace("<UDIM>", str(number)).replace("<UVTILE>", f"u{u + 1}_v{v + 1}")


def _origin(image: bpy.types.Image) -> str:
    if image.packed_file is not None:
        return "its packed data are no image"
    return bpy.path.abspath(image.filepath, library=image.library) or "it has no file"
