"""The preview's shader in Chromium's WebGL 2. Blender draws the preview only in windows, so tests use Chromium."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from browser import FILES, ask
from numpy.typing import NDArray

from addon.viewport.corners import MaterialTriangles, parts_of
from addon.viewport.draw import centre_of, inputs_of, levels_in, uniforms_in_view
from addon.viewport.shader import ATTRIBUTES, FRAGMENT, SAMPLERS, UNIFORMS, VARYINGS, VERTEX, laws, uniforms_of_paint

PAGE, PATIENCE = "tests/browser/probe.html", 120.0


def shader() -> dict[str, str]:
    """Return the shader sources in GLSL ES 3.00, with the declarations that Blender adds by itself."""
    samplers = "".join(f"uniform sampler2D {name};\n" for name in SAMPLERS)
    return {
        "vertex": _declared(ATTRIBUTES, VARYINGS, ("in", "out")) + VERTEX,
        "fragment": _declared(VARYINGS, {"shown_color": "VEC4"}, ("in", "out")) + samplers + FRAGMENT,
    }


def _declared(inputs: dict[str, str], outputs: dict[str, str], words: tuple[str, str]) -> str:
    kinds = {**{f"VEC{n}": f"vec{n}" for n in (2, 3, 4)}, "FLOAT": "float", "MAT4": "mat4"}
    parts = zip((*words, "uniform"), (inputs, outputs, UNIFORMS), strict=True)
    lines = [f"{word} {kinds[kind]} {name};" for word, names in parts for name, kind in names.items()]
    return "\n".join(["#version 300 es", "precision highp float;", *lines, laws()])


def attributes_of(part: MaterialTriangles) -> dict[str, Any]:
    return {
        name: {"values": part.attributes[name].ravel().tolist(), "size": 1 if kind == "FLOAT" else int(kind[3])}
        for name, kind in ATTRIBUTES.items()
    }


def numbers(uniforms: dict[str, Any]) -> dict[str, list[float]]:
    """Return each uniform as a list of numbers. Matrices are in row order."""
    return {name: np.array(value, np.float64).ravel().tolist() for name, value in uniforms.items()}


def preview_pictures(
    folder: Path, cameras: Sequence[bpy.types.Object], side: int, objects: Sequence[bpy.types.Object] | None = None
) -> list[NDArray[np.float32]]:
    """Draw the scene's levels, or only `objects`, with the preview's shader, once from each camera.

    Each picture is (side, side, 4), linear, with the lowest row first. Alpha is 1 where the shader draws anything.
    `folder` takes temporary image files.
    """
    bpy.context.view_layer.update()
    objects = levels_in(bpy.context.scene) if objects is None else objects
    parts = [(obj, part) for obj in objects for part in parts_of(obj)]
    pages = {image for _, part in parts for image in (part.paint.color, part.paint.opacity) if image is not None}
    images = {image.name: _stored(folder / f"{number}.bytes", image) for number, image in enumerate(pages)}
    pictures = [_draws(parts, camera) for camera in cameras]
    question = {**shader(), "side": side, "images": images, "pictures": pictures}
    answer = ask(PAGE, question, patience=PATIENCE, files=folder)
    return [np.frombuffer(base64.b64decode(text), np.float32).reshape(side, side, 4) for text in answer["pictures"]]


def _draws(
    parts: Sequence[tuple[bpy.types.Object, MaterialTriangles]], camera: bpy.types.Object
) -> list[dict[str, Any]]:
    to_clip = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=1, y=1)
    to_clip = to_clip @ camera.matrix_world.inverted()
    eye = camera.matrix_world.translation
    draws = []
    for obj, part in parts:
        uniforms = uniforms_in_view(obj.matrix_world, inputs_of(obj), centre_of(obj), eye, to_clip)
        if uniforms is not None:
            draws.append(_draw(part, uniforms))
    return draws


def _draw(part: MaterialTriangles, uniforms: dict[str, Any]) -> dict[str, Any]:
    images = (part.paint.color, part.paint.opacity)
    return {
        "attributes": attributes_of(part),
        "uniforms": numbers({**uniforms, **uniforms_of_paint(part.paint)}),
        "samplers": {name: "" if image is None else image.name for name, image in zip(SAMPLERS, images, strict=True)},
    }


def _stored(file: Path, image: bpy.types.Image) -> dict[str, Any]:
    """Write the image's bytes as Blender uploads them to the GPU. Return the description for the browser page."""
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    codes = np.full((width * height, 4), 255, np.uint8)
    codes[:, : image.channels] = np.rint(values.reshape(-1, image.channels) * 255.0)
    file.write_bytes(codes.tobytes())
    encoded = image.colorspace_settings.name == "sRGB"
    return {"path": f"{FILES}{file.name}", "width": width, "height": height, "encoded": encoded}
