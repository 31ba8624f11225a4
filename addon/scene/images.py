"""Whether images have pixels."""

from __future__ import annotations

import bpy

from . import SceneError


def check_readable(image: bpy.types.Image, material_name: str) -> None:
    """Raises `SceneError` where it has none."""
    width, height = image.size  # makes Blender read the file
    if width == 0 or height == 0:
        raise SceneError(
            f"texture {image.name!r} of material {material_name!r} cannot be read: {_origin(image)}; "
            f"put the file there, or pack it into the .blend"
        )


def _origin(image: bpy.types.Image) -> str:
    if image.packed_file is not None:
        return "its packed data are no image"
    return bpy.path.abspath(image.filepath, library=image.library) or "it has no file"
