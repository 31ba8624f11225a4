"""KTX2 and PNG textures in the package for Babylon.js keep the coverage. Without a transcoder PNG is drawn."""

from __future__ import annotations

import math
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import kept
from command_line import QUICK
from engine_views import code_of, for_babylon, hand_overs, levels_of, pictures, sphere_of
from night import rest_at_night

ROOT = Path(__file__).resolve().parents[2]
BASIS = ROOT / "engines" / "babylon" / "node_modules" / "@babylonjs" / "core" / "assets" / "Basis"
TRANSCODER = "/engines/babylon/node_modules/@babylonjs/core/assets/Basis"
DIRECTIONS = [
    (math.cos(2.4 * i) * math.sqrt(1.0 - up * up), up, math.sin(2.4 * i) * math.sqrt(1.0 - up * up))
    for i, up in enumerate(np.linspace(0.0, 0.8, 48).tolist())
]
"""From the tree to the eye. A crown at its hand-overs has some 65 pixels in the picture: the coverage of few of them is
noise."""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    still = kept(*QUICK, "--engine", "babylon", "--last", "cross", "--effects=+transitions")
    return for_babylon(still, tmp_path_factory.mktemp("babylon_ktx2"))


def code_with(transcoder: str | None) -> str:
    """Return the README's code with KTX2 textures, by the transcoder in a folder; None: with PNG textures."""
    return code_of("babylon") if transcoder is None else code_of("babylon", 2).replace("/basis/", transcoder)


def drawn(tree: Path, transcoder: str | None, level: int, distance: float, views: int = 1) -> list[dict[str, Any]]:
    """Return pictures of a level at a distance, from so many directions."""
    centre, _ = sphere_of(levels_of(tree)[0])
    # Distances of files are for 1080 rows; the picture has 256.
    eyes = [centre + distance * 256.0 / 1080.0 * np.array(direction) for direction in DIRECTIONS[:views]]
    cameras = [{"eye": eye.tolist(), "target": centre.tolist(), "fov": 50.0} for eye in eyes]
    return pictures("babylon", tree, code=code_with(transcoder), views=cameras, settings={"level": level})


def coverage(found: list[dict[str, Any]]) -> int:
    return sum(int((picture["pixels"][..., 3] > 0).sum()) for picture in found)


@pytest.mark.night
def test_hand_overs_keep_the_coverage(tree: Path) -> None:
    errors = {}
    for transcoder in (None, TRANSCODER):
        changes = []
        for number, distance in enumerate(hand_overs(levels_of(tree))):
            before, after = (
                coverage(drawn(tree, transcoder, level, distance, len(DIRECTIONS))) for level in (number, number + 1)
            )
            assert before > 900
            changes.append(abs(math.log(after / before)))
        errors[transcoder] = changes
    assert max(errors[None]) < 0.08
    # The pivots of two mip levels are mixed, not the shares.
    assert max(errors[TRANSCODER]) < 0.12


@pytest.mark.parametrize("times", rest_at_night([2.5, 0.5, 1.0, 1.5]))
def test_ktx2_covers_as_much_as_png(tree: Path, times: float) -> None:
    """Mip levels in KTX2 bend alpha for readers with a cutoff. The package undoes it."""
    distance = times * hand_overs(levels_of(tree))[0]
    ktx2, png = (coverage(drawn(tree, transcoder, 1, distance, len(DIRECTIONS))) for transcoder in (TRANSCODER, None))
    print(f"{times} of the distance: {ktx2} pixels by KTX2, {png} by PNG")
    assert abs(math.log(ktx2 / png)) < 0.08


def test_colors_are_those_of_the_png(tree: Path) -> None:
    """Mean colors, because each texture keeps the coverage in its own way."""
    _, radius = sphere_of(levels_of(tree)[0])
    means = []
    for transcoder in (None, TRANSCODER):
        [picture] = drawn(tree, transcoder, 1, 4.0 * radius * 1080.0 / 256.0)
        covered = picture["pixels"][..., 3] > 0
        assert covered.sum() > 2000
        means.append(picture["pixels"][covered].mean(axis=0))
    assert np.abs(means[0] - means[1]).max() < 3.0


@contextmanager
def silent_server() -> Iterator[str]:
    """Yield the address of a server that accepts connections and never answers."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield f"http://127.0.0.1:{server.getsockname()[1]}/"


def same_as_png(tree: Path, transcoder: str) -> bool:
    distance = hand_overs(levels_of(tree))[0]
    pairs = zip(drawn(tree, transcoder, 1, distance), drawn(tree, None, 1, distance), strict=True)
    return all(np.array_equal(one["pixels"], other["pixels"]) for one, other in pairs)


@pytest.mark.night
def test_without_a_transcoder_the_png_textures_are_drawn(tree: Path) -> None:
    assert not same_as_png(tree, TRANSCODER)
    assert same_as_png(tree, "/nowhere/")
    (tree.parent / "basis_transcoder.js").write_text("this is no script")
    (tree.parent / "basis_transcoder.wasm").write_bytes(b"nor a program")
    assert same_as_png(tree, "/files/")
    shutil.copy(BASIS / "basis_transcoder.js", tree.parent)
    assert same_as_png(tree, "/files/"), "the script is right, its program is not"
    with silent_server() as address:
        assert same_as_png(tree, address)
