"""The package for Babylon.js: the code of its README draws a tree that switches its levels, and its types are right."""

from __future__ import annotations

import json
import math
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from bakes import folder_of
from engine_views import (
    ENGINES,
    ROOT,
    code_of,
    for_babylon,
    hand_overs,
    levels_of,
    pictures,
    seen_from,
    triangles,
    views_of_all_levels,
)
from night import rest_at_night
from numpy.typing import NDArray

PACKAGE = ENGINES / "babylon"


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return for_babylon(folder_of("babylon"), tmp_path_factory.mktemp("babylon"))


def test_each_level_is_drawn_at_its_distances(tree: Path) -> None:
    levels = levels_of(tree)
    drawn, views = views_of_all_levels(levels)
    for numbers, picture in zip(drawn, pictures("babylon", tree, views=views), strict=True):
        assert {name.split("_primitive")[0] for name in picture["shown"]} == {f"shrub_LOD{n}" for n in numbers}
        most = sum(triangles(levels[number]) for number in numbers)
        # Pruned leaves are not drawn.
        assert picture["triangles"] == most or (0 in numbers and picture["triangles"] < most)
        assert (picture["pixels"][..., 3] > 0).any()


def test_the_leaves_lie_on_level_1_at_the_hand_over(tree: Path) -> None:
    """Both levels cover the same places from there, more of them than with leaves at rest.

    The pictures are larger than engines draw the level: a texel of its page is several pixels large, and outlines are
    coarse.
    """
    levels = levels_of(tree)
    extras = levels[0].extras["leafcloud"]
    view = seen_from(hand_overs(levels)[0], extras["centre"], 256)
    centre = np.array(extras["centre"])
    x, y, z = np.array(view["eye"]) - centre
    turned = [(x, y, z), (z, y, -x), (-x, y, -z), (-z, y, x)]
    # The camera stays there and zooms in; fewer pixels make up for it, so that the levels stay where they are.
    half = 1.1 * extras["radius"] / math.hypot(x, y, z)
    fov = math.degrees(2.0 * math.atan(half))
    views = [{**view, "eye": (centre + eye).tolist(), "fov": fov} for eye in turned]
    settings = {"pixels": 256.0 * half / math.tan(math.radians(25.0)), "seconds": 3.7}

    def covered(**more: float) -> NDArray[np.bool_]:
        found = pictures("babylon", tree, views=views, settings={**settings, **more})
        return np.array([picture["pixels"][..., 3] > 0 for picture in found])

    billboards, collapsed, resting = covered(level=1), covered(level=0), covered(level=0, lodDistance=1e6)
    shares = [(leaves & billboards).sum() / (leaves | billboards).sum() for leaves in (collapsed, resting)]
    assert billboards.sum() > 8000
    assert shares[0] > 0.55
    assert shares[0] > shares[1] + 0.01


def test_it_has_the_version_of_the_project() -> None:
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert json.loads((PACKAGE / "package.json").read_text())["version"] == version


EXAMPLE = """
import { Matrix, NullEngine, Scene } from "@babylonjs/core";
const scene = new Scene(new NullEngine());
const places = [Matrix.Identity()];
"""


@pytest.mark.parametrize("number", rest_at_night([0, 1, 2]))
def test_the_code_of_its_readme_has_the_declared_types(number: int) -> None:
    example = PACKAGE / f"example_{number}.ts"
    options = ("--noEmit", "--strict", "--module", "nodenext", "--target", "es2022", "--skipLibCheck")
    assert len([line for line in code_of("babylon", number).splitlines() if line]) <= 5
    try:
        example.write_text(EXAMPLE + code_of("babylon", number) + "\ntree.settings.level = 1;\nexport {};\n")
        compiler = ENGINES / "three" / "node_modules" / ".bin" / "tsc"
        done = subprocess.run(
            [compiler, *options, example.name], cwd=PACKAGE, capture_output=True, text=True, check=False
        )
    finally:
        example.unlink()
    assert done.returncode == 0, done.stdout


def test_the_page_about_engines_has_the_code_of_its_readme() -> None:
    """The README's code runs in these tests."""
    _, section = (ROOT / "docs" / "engines.md").read_text().split("\n## Babylon.js\n")
    assert code_of("babylon", 1) in section.split("\n## ")[0]
