"""Thin leaves of a cut-out PNG texture neither dissolve nor flicker in the packages for three.js and Babylon.js.

The oracle has 4 × 4 samples a pixel and no mip levels, so it draws the texture itself. The leaf is four stripes, a
quarter of the texture. The transparent texels between them are red: a mip level that mixes them in shows it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import ask
from command_line import bake
from engine_views import ROWS, bundle, hand_overs, levels_of, pictures, sphere_of
from glb import rewritten
from laws import Floats
from numpy.typing import NDArray
from PIL import Image

SIDE = 256
SAMPLES = 4
DIRECTIONS = [(0.6, 0.0, 0.8), (-0.8, 0.2, 0.56), (0.3, 0.6, -0.74), (-0.5, 0.1, -0.86)]
GREEN, RED = (50, 160, 40, 255), (220, 0, 0, 0)


@pytest.fixture(scope="module")
def striped(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of bakes of the shrub with thin leaves for both engines."""
    out = tmp_path_factory.mktemp("striped")

    def paint(document: dict[str, Any], body: bytearray) -> None:
        texels = np.empty((128, 128, 4), np.uint8)
        texels[:] = RED
        texels[:, np.arange(128) % 32 < 8] = GREEN
        saved = io.BytesIO()
        Image.fromarray(texels).save(saved, "PNG")
        body += b"\0" * (-len(body) % 4)
        view = {"buffer": 0, "byteOffset": len(body), "byteLength": len(saved.getvalue())}
        body += saved.getvalue() + b"\0" * (-len(saved.getvalue()) % 4)
        document["images"][0]["bufferView"] = len(document["bufferViews"])
        document["bufferViews"].append(view)
        document["buffers"][0]["byteLength"] = len(body)

    tree = rewritten(shrub, out / "shrub.glb", paint)
    fine = ("--texture-size", 256, "--epsilon", 0.1, "--every-level")
    settings = (*fine, "--last", "cross", "--effects=+transitions")
    for engine in ("three", "babylon"):
        bake(tree, out / engine, *settings, "--engine", engine)
    bundle(out / "babylon")
    return out


def level_0(striped: Path, renderer: str, times: float, samples: int = 1, *, mips: bool = True) -> NDArray[np.float64]:
    """Return pictures (directions, 2, ...) of the leaves from the first hand-over, `times` as far; two places for each
    direction, a third of a pixel apart.
    """
    file = striped / ("babylon" if renderer == "babylon" else "three") / "shrub.glb"
    levels = levels_of(file)
    centre, _ = sphere_of(levels[0])
    away = times * hand_overs(levels)[0] * SIDE / ROWS
    pixel = 2.0 * away * np.tan(np.radians(25.0)) / SIDE
    views = []
    for direction in DIRECTIONS:
        for shift in (0.0, pixel / 3.0):
            eye, target = (centre + end + shift * beside(direction) for end in (away * np.array(direction), 0.0))
            views.append({"eye": eye.tolist(), "target": target.tolist(), "fov": 50.0})
    settings = {"level": 0} if renderer == "babylon" else {"level": 0, "byHand": {"transition": 0.0, "keep": 1.0}}
    own = {} if renderer in ("babylon", "webgl") else {"page": "three_webgpu", "renderer": renderer}
    if renderer == "babylon":
        settings["lodDistance"] = 1e6  # Leaves at rest.
    engine = "babylon" if renderer == "babylon" else "three"
    found = pictures(engine, file, views=views, side=SIDE * samples, settings=settings, mips=mips, **own)
    pixels = np.stack([picture["pixels"] for picture in found])
    return pixels.reshape(len(DIRECTIONS), 2, *pixels.shape[1:])


def beside(direction: tuple[float, float, float]) -> Floats:
    across = np.cross((0.0, 1.0, 0.0), direction)
    return np.asarray(across / np.linalg.norm(across), np.float64)


def drawn(found: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(found[..., 3] > 0.0)


def flicker(found: NDArray[np.float64]) -> float:
    """Return the pixels that a third of a pixel changes, over those that are covered."""
    one, other = drawn(found[:, 0]), drawn(found[:, 1])
    return float((one != other).sum() / one.sum())


@pytest.mark.night
@pytest.mark.parametrize("renderer", ["webgl", "webgl2", "webgpu", "babylon"])
def test_thin_leaves_neither_dissolve_nor_flicker(striped: Path, renderer: str) -> None:
    if renderer == "webgpu":
        lacking = ask("tests/browser/three_webgpu.html", {"renderer": renderer}, patience=60.0)["lacking"]
        if lacking:
            pytest.skip(lacking)
    for times in (0.35, 0.5):
        truth = level_0(striped, "webgl", times, SAMPLES, mips=False)
        without = level_0(striped, "webgl", times, mips=False)
        found = level_0(striped, renderer, times)
        share = drawn(found).mean() / drawn(truth).mean()
        print(f"{renderer}, {times} of the distance: coverage {share:.3f}, flicker {flicker(found):.3f}", end=", ")
        print(f"{flicker(without):.3f} without mip levels")
        assert 0.93 < share < 1.07
        assert flicker(found) < 0.8 * flicker(without)
        leaves = found[drawn(found)]
        assert (leaves[:, 0] > 1.5 * leaves[:, 1]).mean() < 0.01, "nothing of the red texels"
