"""Small Cycles renders for comparisons."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def render(
    folder: Path,
    location: tuple[float, float, float],
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    width: float,
    size: tuple[int, int] = (32, 32),
    samples: int = 64,
    pixel_filter: str = "BLACKMAN_HARRIS",
) -> NDArray[np.float32]:
    """Render the scene with an orthographic camera over a transparent background.

    Return (rows, columns, 4), linear, premultiplied, with the lowest row first. `rotation` is in radians. Without a
    rotation the camera looks down. `width` is the longer side of the visible rectangle.
    """
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = location, rotation
    camera.data.type, camera.data.ortho_scale = "ORTHO", width
    bpy.context.scene.collection.objects.link(camera)
    pixels = render_from(folder, camera, size=size, samples=samples, pixel_filter=pixel_filter)
    bpy.data.objects.remove(camera)
    return pixels


def render_from(
    folder: Path,
    camera: bpy.types.Object,
    *,
    size: tuple[int, int],
    samples: int,
    pixel_filter: str = "BLACKMAN_HARRIS",
) -> NDArray[np.float32]:
    """Render the scene with this camera, which becomes the scene's camera. Return pixels as `render` does."""
    scene = bpy.context.scene
    scene.camera, scene.render.engine, scene.render.film_transparent = camera, "CYCLES", True
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_denoising, cycles.pixel_filter_type = "CPU", samples, False, pixel_filter
    cycles.transparent_max_bounces = 64
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / f"{len(bpy.data.images)}.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(size[0] * size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(size[1], size[0], 4)
