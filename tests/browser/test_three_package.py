"""The package for three.js: the code of its README draws trees and forests, and its types are right."""

from __future__ import annotations

import json
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from browser import BrowserError
from command_line import QUICK, run
from engine_views import (
    code_of,
    forest_file,
    forest_of,
    hand_overs,
    levels_of,
    pictures,
    sphere_of,
    triangles,
    views_of_all_levels,
)

from tools.copy_laws import copies

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "engines" / "three"
SIDE = 256


def test_each_level_is_drawn_at_its_distances(three_bake: Path) -> None:
    levels = levels_of(three_bake / "shrub.glb")
    drawn, views = views_of_all_levels(levels)
    assert len([line for line in code_of("three").splitlines() if line]) <= 5
    for numbers, picture in zip(drawn, pictures("three", three_bake / "shrub.glb", views=views), strict=True):
        most = sum(triangles(levels[number]) for number in numbers)
        # Pruned leaves are not drawn.
        assert picture["triangles"] == most or (0 in numbers and picture["triangles"] < most)
        assert (picture["pixels"][..., 3] > 0).any()


def test_a_forest_looks_like_its_trees_drawn_one_by_one(three_bake: Path) -> None:
    """All levels are in view. Trees are turned, scaled and blown; the fades of levels and the pruning agree, too."""
    extras = levels_of(three_bake / "shrub.glb")[0].extras["leafcloud"]
    radius, centre = extras["radius"], np.array(extras["centre"])
    places = forest_of(radius, 64)
    views = [
        {"eye": (centre + radius * np.array([dx, up, dz])).tolist(), "target": [0.0, 0.0, -10.0 * radius], "fov": fov}
        for dx, up, dz, fov in ((0.0, 2.0, 6.0, 60.0), (9.0, 1.0, 15.0, 60.0), (-4.0, 12.0, 60.0, 25.0))
    ]
    common = {"places": places, "views": views, "seconds": 3.7}
    forest = pictures("three", three_bake / "shrub.glb", code=code_of("three", 1), **common)
    single = pictures("three", three_bake / "shrub.glb", copies=True, **common)
    for one, other in zip(forest, single, strict=True):
        covered = (other["pixels"][..., 3] > 0).mean()
        assert covered > 0.01
        differs = np.abs(one["pixels"] - other["pixels"]).max(axis=-1) > 8.0
        assert differs.mean() < 0.02 * covered
        assert one["calls"] < other["calls"]


@pytest.mark.night
def test_a_forest_of_octahedral_impostors_looks_like_single_ones(octahedral_bake: Path) -> None:
    """All trees are far away. Single ones are blended; in the forest they are cut out: their order does not matter."""
    level = levels_of(octahedral_bake / "shrub.glb")[-1]
    extras = level.extras["leafcloud"]
    away = 2.0 * extras["octahedral"]["switch_distance"] * SIDE / 1080.0
    places = forest_of(0.6 * extras["radius"], 24)
    view = {"eye": [0.2 * away, 0.4 * away, 0.9 * away], "target": [0.0, 0.0, -2.0 * extras["radius"]], "fov": 12.0}
    common = {"places": places, "views": [view], "settings": {"level": level.extras["leafcloud"]["level"]}}
    file = octahedral_bake / "shrub.glb"
    pixels = [
        pictures("three", file, **common, **way)[0]["pixels"] / 255.0
        for way in ({"code": code_of("three", 1)}, {"copies": True})
    ]
    areas = [each[..., 3].sum() for each in pixels]
    assert areas[1] > 300
    assert areas[0] == pytest.approx(areas[1], rel=0.15)
    colors = [each[..., :3].sum(axis=(0, 1)) / each[..., 3].sum() for each in pixels]
    assert colors[0] == pytest.approx(colors[1], rel=0.1)


def test_a_forest_shows_a_trunk_whose_crown_is_outside_of_the_picture(three_bake: Path) -> None:
    """The camera looks at the foot of the stem, which lies below the sphere of the crown."""
    [level, *_] = levels_of(three_bake / "shrub.glb")
    radius = level.extras["leafcloud"]["radius"]
    points = np.concatenate([level.to_world(trunk.attributes["POSITION"]) for trunk in level.trunk])
    foot = points[points[:, 1].argmin()]
    view = {"eye": (foot + np.array([0.0, 0.0, 0.3 * radius])).tolist(), "target": foot.tolist(), "fov": 10.0}
    common = {"places": [np.eye(4).ravel().tolist()], "views": [view]}
    [forest] = pictures("three", three_bake / "shrub.glb", code=code_of("three", 1), **common)
    [single] = pictures("three", three_bake / "shrub.glb", copies=True, **common)
    assert single["triangles"] > 0
    assert forest["triangles"] == single["triangles"]


FROM_FILE = """
import { Forest, LeafcloudLoader } from "leafcloud-three";
const tree = await new LeafcloudLoader(renderer).loadAsync("pine.glb");
const forest = new Forest(tree, tree.places);
scene.add(forest);
renderer.setAnimationLoop((time) => (forest.update(camera, time / 1000), renderer.render(scene, camera)));
"""


def test_a_forest_stands_where_its_file_says(three_bake: Path, tmp_path: Path) -> None:
    extras = levels_of(three_bake / "shrub.glb")[0].extras["leafcloud"]
    radius, centre = extras["radius"], np.array(extras["centre"])
    places = forest_of(radius, 16)
    eye = (centre + radius * np.array([0.0, 4.0, 14.0])).tolist()
    common = {"views": [{"eye": eye, "target": [0.0, 0.0, -4.0 * radius], "fov": 50.0}]}
    given = pictures("three", three_bake / "shrub.glb", code=code_of("three", 1), places=places, **common)
    read = pictures(
        "three", forest_file(Path(shutil.copy(three_bake / "shrub.glb", tmp_path)), places), code=FROM_FILE, **common
    )
    assert read[0]["triangles"] == given[0]["triangles"]
    covered = given[0]["pixels"][..., 3] > 0
    assert covered.mean() > 0.02
    differs = np.abs(read[0]["pixels"] - given[0]["pixels"]).max(axis=-1) > 8.0
    assert differs.sum() < 0.01 * covered.sum()


NUMBERED = """
import { Tree } from "leafcloud-three";
const tree = await Tree.load("pine.glb", { renderer, tree: NUMBER });
scene.add(tree);
renderer.setAnimationLoop(() => (tree.update(camera), renderer.render(scene, camera)));
"""


@pytest.mark.night
def test_one_of_several_trees_is_read(shrub: Path, tmp_path: Path) -> None:
    (tmp_path / "bush.glb").write_bytes(shrub.read_bytes())
    out = tmp_path / "out"
    done = run("--input", shrub, tmp_path / "bush.glb", "--out", out, *QUICK, "--engine", "three", "--last", "cross")
    assert done.returncode == 0, done.stderr
    file = out / "shrub_bush.glb"
    levels = [level for level in levels_of(file) if level.extras["leafcloud"]["level"] == 0]
    assert len(levels) == 2
    centre, radius = sphere_of(levels[0])
    view = {"eye": (centre + np.array([0.0, 0.0, 3.0 * radius])).tolist(), "target": centre.tolist(), "fov": 50.0}
    for number, level in enumerate(levels):
        [picture] = pictures("three", file, code=NUMBERED.replace("NUMBER", str(number)), views=[view])
        assert picture["triangles"] == triangles(level)
    with pytest.raises(BrowserError, match="2 trees, and no tree 2"):
        pictures("three", file, code=NUMBERED.replace("NUMBER", "2"), views=[view])


def test_trees_behind_the_camera_are_not_drawn(three_bake: Path) -> None:
    extras = levels_of(three_bake / "shrub.glb")[0].extras["leafcloud"]
    radius = extras["radius"]
    view = {"eye": [0.0, radius, 5.0 * radius], "target": [0.0, radius, 100.0 * radius], "fov": 50.0}
    [picture] = pictures(
        "three", three_bake / "shrub.glb", code=code_of("three", 1), places=forest_of(radius, 16), views=[view]
    )
    assert picture["triangles"] == 0


def test_a_copy_keeps_its_own_level(three_bake: Path) -> None:
    """Two copies at different distances in one picture are in different levels."""
    levels = levels_of(three_bake / "shrub.glb")
    extras = levels[0].extras["leafcloud"]
    far = 3.0 * hand_overs(levels)[-1] * SIDE / 1080.0
    places = [np.eye(4).ravel().tolist(), np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -far], [0, 0, 0, 1]])]
    view = {"eye": [0.0, 0.0, 3.0 * extras["radius"]], "target": [0.0, 0.0, 0.0], "fov": 50.0}
    common = {"copies": True, "views": [view]}
    [both] = pictures("three", three_bake / "shrub.glb", places=[places[0], places[1].ravel().tolist()], **common)
    [near] = pictures("three", three_bake / "shrub.glb", places=places[:1], **common)
    assert both["triangles"] == near["triangles"] + triangles(levels[-1])


def test_its_laws_are_those_of_all_engines() -> None:
    for path, content in copies().items():
        assert path.read_text() == content, "run python tools/copy_laws.py"


def test_it_has_the_version_of_the_project() -> None:
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert json.loads((PACKAGE / "package.json").read_text())["version"] == version


EXAMPLE_WEBGL = 'import { WebGLRenderer } from "three"; const renderer = new WebGLRenderer();'
EXAMPLE = """
import { Matrix4, PerspectiveCamera, Scene } from "three";
const scene = new Scene();
const camera = new PerspectiveCamera();
const places = [new Matrix4()];
"""


@pytest.mark.parametrize("renderer", [EXAMPLE_WEBGL, code_of("three", 2)], ids=["webgl", "webgpu"])
@pytest.mark.parametrize("number", [0, 1])
def test_the_code_of_its_readme_has_the_declared_types(renderer: str, number: int) -> None:
    example = PACKAGE / f"example_{number}.ts"
    options = ("--noEmit", "--strict", "--module", "nodenext", "--target", "es2022", "--skipLibCheck")
    try:
        example.write_text(EXAMPLE + renderer + code_of("three", number) + "\nexport {};\n")
        done = subprocess.run(
            ["node_modules/.bin/tsc", *options, example.name], cwd=PACKAGE, capture_output=True, text=True, check=False
        )
    finally:
        example.unlink()
    assert done.returncode == 0, done.stdout
