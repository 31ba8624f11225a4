"""The viewer draws the octahedral impostor by the law, from the numbers and pages in the file."""

from __future__ import annotations

import base64
import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake
from glb import read_chunks, read_glb
from laws import Floats
from octahedral import Impostor, shown, unit
from viewing import PAGE, PATIENCE

from bench.browser import ask

SIDE = 64
EYES = [(1.0, 0.4, 0.2), (-0.3, 0.2, 1.0), (0.6, -0.3, -0.7), (0.2, 1.0, -0.4)]


@pytest.fixture(scope="module")
def folder(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("octahedral")
    bake(shrub, out, *QUICK, "--last", "octahedral", "--effects=+transitions")
    return out


def page(folder: Path, key: str) -> Floats:
    """Return the codes (h, w, 4) of a page of the last level, row 0 on top."""
    document, binary = read_chunks(folder / "shrub.glb")
    references = [material.get("extras", {}).get("leafcloud", {}) for material in document["materials"]]
    [index] = [reference[key]["index"] for reference in references if key in reference]
    view = document["bufferViews"][document["images"][document["textures"][index]["source"]]["bufferView"]]
    start = view.get("byteOffset", 0)
    path = folder / f"{key}.png"
    path.write_bytes(binary[start : start + view["byteLength"]])
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    pixels = np.empty(4 * math.prod(image.size), np.float32)
    image.pixels.foreach_get(pixels)
    return np.rint(pixels.reshape(*image.size, 4)[::-1].astype(float) * 255.0)


def test_the_viewer_draws_it_by_the_law(folder: Path) -> None:
    nodes = read_glb(folder / "shrub.glb")
    name = max(name for name in nodes if name.startswith("shrub_LOD"))
    extras = nodes[name].extras["leafcloud"]
    numbers = extras["octahedral"]
    impostor = Impostor.of(page(folder, "octahedralTexture"), page(folder, "octahedralNormalTexture"), numbers)
    middle, radius = np.array(extras["centre"]), extras["radius"]
    # Far beyond the fade, where the crown fills the picture, which is then as sharp as the pages.
    distance = 3.0 * max(numbers["switch_distance"], extras["switch_distance"])
    eyes = [middle + distance * unit(np.array(eye)) for eye in EYES]
    question = {
        "tree": "/files/shrub.glb",
        "settings": {"hysteresis": 0.0, "shadows": True},
        "eyes": [eye.tolist() for eye in eyes],
    }
    answers = ask(PAGE, question, patience=PATIENCE, files=folder)["seen"]
    rows = np.array(numbers["to_layout"]).reshape(3, 4)
    for eye, answer in zip(eyes, answers, strict=True):
        assert (answer["level"], answer["triangles"]) == (int(name[-1]), 2)
        picture = np.frombuffer(base64.b64decode(answer["pixels"]), "<f4").reshape(SIDE, SIDE, 4).astype(float)
        expected = by_the_law(impostor, rows, middle, radius, eye)
        solid = expected[..., 3] > 0.9
        assert np.abs(picture[..., 3] - expected[..., 3]).mean() < 0.02
        assert np.abs(picture - expected)[solid, :3].mean() < 0.02
        assert solid.mean() > 0.05


def by_the_law(impostor: Impostor, rows: Floats, middle: Floats, radius: float, eye: Floats) -> Floats:
    """Return the picture (SIDE, SIDE, 4), premultiplied, lowest row first, of the quad through the middle of the tree.

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
    seen[:, :3] *= light[:, None]
    seen[seen[:, 3] < 0.02] = 0.0
    return seen.reshape(SIDE, SIDE, 4)
