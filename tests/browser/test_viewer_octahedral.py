"""The viewer draws the octahedral impostor by the law, from the numbers and pages in the file."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest
from bakes import folder_of
from browser import ask
from glb import read_glb
from octahedral import unit
from octahedral_pictures import SIDE, by_the_law, impostor_in
from viewing import PAGE, PATIENCE

EYES = [(1.0, 0.4, 0.2), (-0.3, 0.2, 1.0), (0.6, -0.3, -0.7), (0.2, 1.0, -0.4)]


@pytest.fixture(scope="module")
def folder() -> Path:
    return folder_of("octahedral")


def test_the_viewer_draws_it_by_the_law(folder: Path) -> None:
    nodes = read_glb(folder / "shrub.glb")
    name = max(name for name in nodes if name.startswith("shrub_LOD"))
    extras = nodes[name].extras["leafcloud"]
    numbers = extras["octahedral"]
    impostor = impostor_in(folder / "shrub.glb", numbers)
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
        expected, light = by_the_law(impostor, rows, middle, radius, eye)
        expected[..., :3] *= light[..., None]
        expected[expected[..., 3] < 0.02] = 0.0
        solid = expected[..., 3] > 0.9
        # Graphics cards filter with 8 bits, and texels of sharpened pages differ more.
        assert np.abs(picture[..., 3] - expected[..., 3]).mean() < 0.03
        assert np.abs(picture - expected)[solid, :3].mean() < 0.02
        assert solid.mean() > 0.05
