"""Reference pictures of octahedral impostors from the numbers and pages in a file, for the engines' pictures."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from glb import read_chunks
from laws import Floats
from octahedral import Impostor, shown, unit

SIDE = 64


def impostor_in(file: Path, numbers: dict[str, Any]) -> Impostor:
    """Return the impostor of a file; `numbers`: extras of its level."""
    return Impostor.of(_page(file, "octahedralTexture"), _page(file, "octahedralNormalTexture"), numbers)


def _page(file: Path, key: str) -> Floats:
    """Return the codes (h, w, 4) of a page of the last level, row 0 on top."""
    document, binary = read_chunks(file)
    references = [material.get("extras", {}).get("leafcloud", {}) for material in document["materials"]]
    [index] = [reference[key]["index"] for reference in references if key in reference]
    view = document["bufferViews"][document["images"][document["textures"][index]["source"]]["bufferView"]]
    start = view.get("byteOffset", 0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{key}.png"
        path.write_bytes(binary[start : start + view["byteLength"]])
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
        pixels = np.empty(4 * math.prod(image.size), np.float32)
        image.pixels.foreach_get(pixels)
    return np.rint(pixels.reshape(*image.size, 4)[::-1].astype(float) * 255.0)


def by_the_law(impostor: Impostor, rows: Floats, middle: Floats, radius: float, eye: Floats) -> tuple[Floats, Floats]:
    """Return the picture (SIDE, SIDE, 4), straight alpha, lowest row first, of the quad through the middle of the tree.
    Also return the light (SIDE, SIDE) that the leaves let through.

    The camera is upright in glTF's coordinates, looks at `middle`, and sees as much as the crown's sphere is wide.
    """
    toward = unit(eye - middle)
    right = unit(np.cross([0.0, 1.0, 0.0], toward))
    up = np.cross(toward, right)
    tangent = math.tan(math.atan(radius / np.linalg.norm(eye - middle)))
    steps = 2.0 * (np.arange(SIDE) + 0.5) / SIDE - 1.0
    across, upward = np.meshgrid(steps, steps)
    rays = (tangent * (across[..., None] * right + upward[..., None] * up) - toward).reshape(-1, 3)
    camera = rows[:, :3] @ eye + rows[:, 3]
    directions = rays @ rows[:, :3].T
    seen_from = unit(camera)
    steps_along = -(camera @ seen_from) / (directions @ seen_from)
    points = camera + directions * steps_along[:, None]
    seen, _, light = shown(impostor, points, np.tile(seen_from, (len(points), 1)))
    return seen.reshape(SIDE, SIDE, 4), light.reshape(SIDE, SIDE)
