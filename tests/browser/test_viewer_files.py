"""How the viewer's module reads a file's textures, and chooses levels for a view or by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import folder_of
from browser import ask
from glb import read_glb
from viewing import PAGE, PATIENCE

SIDE = 64
"""Height of the probe's pictures in pixels. The crown's sphere fills them at any distance."""


@pytest.fixture(scope="module")
def folder() -> Path:
    return folder_of("three")


def textures(folder: Path, **transcoder: str) -> dict[str, int]:
    question = {"textures": "/files/shrub.glb", **transcoder}
    return dict(ask(PAGE, question, patience=PATIENCE, files=folder))


def test_the_textures_of_the_clouds_are_compressed_and_have_their_own_mips(folder: Path) -> None:
    found = textures(folder)
    assert found["compressed"] >= 2, "the clouds and the cross impostor"
    assert found["plain"] >= 1, "the leaves' own texture"


def test_without_a_transcoder_the_png_textures_are_drawn(folder: Path) -> None:
    found = textures(folder, transcoder="/no/such/folder/")
    assert found["compressed"] == 0
    assert found["plain"] >= 3


def levels_from(folder: Path, distances: list[float], **settings: Any) -> list[int]:
    """Return the drawn level from each of the distances, in R."""
    extras = read_glb(folder / "shrub.glb")["shrub_LOD0"].extras["leafcloud"]
    centre, radius = np.array(extras["centre"]), extras["radius"]
    eyes = [(centre + np.array([0.0, 0.0, radius * distance])).tolist() for distance in distances]
    question = {"tree": "/files/shrub.glb", "settings": {"hysteresis": 0.0, **settings}, "eyes": eyes}
    return [view["level"] for view in ask(PAGE, question, patience=PATIENCE, files=folder)["seen"]]


def test_one_level_is_shown_at_all_distances(folder: Path) -> None:
    assert levels_from(folder, [2.0, 30.0, 1000.0], level=1) == [1, 1, 1]


@pytest.mark.night
def test_the_lod_distance_moves_all_levels(folder: Path) -> None:
    distances = [2.0 * 1.2**i for i in range(40)]
    plain = levels_from(folder, distances)
    assert plain[0] == 0
    assert plain == sorted(plain)
    assert levels_from(folder, [2.0 * each for each in distances], lodDistance=2.0) == plain
    assert levels_from(folder, [0.5 * each for each in distances], lodDistance=0.5) == plain


def test_with_a_height_in_pixels_the_size_of_the_crown_decides(folder: Path) -> None:
    """All eyes see the crown as large as the picture, so all see one level: that of the distance for this size."""
    distances = [3.0, 30.0, 300.0]
    assert len(set(levels_from(folder, distances))) > 1
    # R appears as SIDE / 2 pixels at this distance in the file's view, 50° over 1080 pixels.
    there = 1080.0 / SIDE / math.tan(math.radians(25.0))
    [level] = levels_from(folder, [there])
    assert levels_from(folder, distances, pixels=SIDE) == [level] * 3
