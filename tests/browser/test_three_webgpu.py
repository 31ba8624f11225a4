"""The package for three.js with WebGPURenderer: both of its backends draw the pictures of WebGLRenderer."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import folder_of
from browser import ask
from engine_views import (
    DIRECTION,
    ENGINES,
    ROWS,
    code_of,
    fade_behind,
    forest_of,
    hand_overs,
    levels_of,
    pictures,
    sphere_of,
)
from glb import rewritten
from laws import Floats
from night import rest_at_night
from numpy.typing import NDArray

import leafcloud

PAGE = "three_webgpu"
SIDE = 384
AWAY = 2.6
"""Distance of the eye from the tree in crown radii."""
TURNED = (0.7, 0.0, 0.9, 0.1, 0.0, 1.14, 0.0, 0.05, -0.9, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 1.0)
"""The place of one tree of a forest: turned about the vertical axis, scaled by 1.14 and moved."""


@pytest.fixture(scope="module", params=rest_at_night(["webgpu", "webgl2"]))
def backend(request: pytest.FixtureRequest) -> str:
    """Return a backend of WebGPURenderer. Skip the test if Chromium lacks it."""
    name = str(request.param)
    lacking = ask(f"tests/browser/{PAGE}.html", {"renderer": name}, patience=60.0)["lacking"]
    if lacking:
        pytest.skip(lacking)
    return name


def drawn(renderer: str, file: Path, views: Sequence[dict[str, Any]], **more: Any) -> list[dict[str, Any]]:
    page = "three" if renderer == "webgl" else PAGE
    return pictures("three", file, page=page, renderer=renderer, views=views, side=SIDE, **more)


def near(file: Path) -> dict[str, Any]:
    centre, radius = sphere_of(levels_of(file)[0])
    return {"eye": (centre + AWAY * radius * DIRECTION).tolist(), "target": centre.tolist(), "fov": 50.0}


def mask(picture: dict[str, Any]) -> NDArray[np.bool_]:
    return np.asarray(picture["pixels"][..., 3] > 25.0)


def error(one: dict[str, Any], other: dict[str, Any]) -> float:
    """Return the mean FLIP of the pixels that either picture covers."""
    flip = leafcloud.flip_map(*(each["pixels"].astype(np.uint8) for each in (one, other)))
    return float(flip[mask(one) | mask(other)].mean())


def agree(one: dict[str, Any], other: dict[str, Any], most: float = 0.03) -> None:
    """Compare pictures. Each renderer prefers another compressed format of the textures: its colors differ a little."""
    covered = mask(other).sum()
    assert covered > 0.01 * SIDE * SIDE
    assert (mask(one) != mask(other)).sum() <= 0.01 * covered
    assert error(one, other) <= most


def at_rest(level: int) -> dict[str, Any]:
    return {"settings": {"level": level, "wind": 0.0, "byHand": {"transition": 0.0, "keep": 1.0}}, "seconds": 0.0}


def with_laws(level: int, transition: float, keep: float, wind: float) -> dict[str, Any]:
    settings = {"level": level, "wind": wind, "byHand": {"transition": transition, "keep": keep}}
    return {"settings": settings, "seconds": 3.7}


LAWS = {
    "half of the way": with_laws(0, 0.5, 1.0, 0.0),
    "a cloud on its way": with_laws(1, 0.7, 1.0, 0.0),
    "pruned leaves": with_laws(0, 0.0, 0.3, 0.0),
    "leaves in wind": with_laws(0, 0.0, 1.0, 40.0),
    "a cloud in wind": with_laws(1, 0.3, 1.0, 40.0),
    "the cross impostor in wind": with_laws(3, 0.0, 1.0, 40.0),
    "all at once": with_laws(0, 0.4, 0.5, 40.0),
}


@pytest.fixture(scope="module")
def pruned_bake(three_bake: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy whose kept leaves grow and redden, more than those of any tree do."""

    numbers = {"growth": [-0.2, 0.0], "contrast": [0.6, 0.0], "mean_color": [0.5, 0.02, 0.0]}

    def edit(document: dict[str, Any], _: bytearray) -> None:
        levels = [node["extras"]["leafcloud"] for node in document["nodes"] if "leafcloud" in node.get("extras", {})]
        for level in levels:
            level |= numbers

    return rewritten(three_bake / "shrub.glb", tmp_path_factory.mktemp("pruned") / "shrub.glb", edit)


@pytest.fixture(scope="module")
def views(pruned_bake: Path) -> list[dict[str, Any]]:
    looks = [*(at_rest(level) for level in range(4)), *LAWS.values()]
    return [{**near(pruned_bake), **look} for look in looks]


@pytest.fixture(scope="module")
def by_webgl(pruned_bake: Path, views: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return drawn("webgl", pruned_bake, views)


def test_the_laws_show_in_the_pictures_to_compare(by_webgl: list[dict[str, Any]]) -> None:
    """Otherwise shaders without them would pass."""
    for picture, look in zip(by_webgl[4:], LAWS.values(), strict=True):
        assert error(picture, by_webgl[look["settings"]["level"]]) > 0.1


def test_levels_and_their_laws_look_as_with_webgl(
    backend: str, pruned_bake: Path, views: list[dict[str, Any]], by_webgl: list[dict[str, Any]]
) -> None:
    for picture, other in zip(drawn(backend, pruned_bake, views), by_webgl, strict=True):
        agree(picture, other, 0.04)  # Most on the cross impostor from near; a law that is missing makes more than 0.1.
        assert picture["triangles"] == other["triangles"] + 1  # WebGPURenderer copies its picture by a triangle.


def pattern() -> Floats:
    """Return the threshold of each pixel by interleaved gradient noise (Jimenez 2014), rows counted from below."""
    x, y = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE)[::-1] + 0.5)
    return np.asarray(np.modf(52.9829189 * np.modf(0.06711056 * x + 0.00583715 * y)[0])[0])


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_fade_takes_the_pixels_of_its_pattern_from_each_level(backend: str, three_bake: Path, number: int) -> None:
    """A factor on the distances makes the large picture one of the hand-over, at a third of the fade."""
    file = three_bake / "shrub.glb"
    levels = levels_of(file)
    _, radius = sphere_of(levels[0])
    length, share = fade_behind("transition_end" in levels[number].extras["leafcloud"]), 1.0 / 3.0
    factor = AWAY * radius * ROWS / SIDE / (hand_overs(levels)[number] * (1.0 + length * share))
    looks = [{"lodDistance": factor, "level": level} for level in (None, number, number + 1)]
    faded, before, behind = (
        mask(each) for each in drawn(backend, file, [near(file) | {"settings": each} for each in looks])
    )
    expected = np.where(pattern() < share, behind, before)
    assert before.sum() > 0.01 * SIDE * SIDE
    assert (before != behind).sum() > 0.01 * before.sum()
    assert (faded != expected).sum() <= 0.003 * before.sum()


def test_a_forest_looks_as_with_webgl(backend: str, pruned_bake: Path) -> None:
    """All levels are in one of the views, and trees move between levels from view to view."""
    centre, radius = sphere_of(levels_of(pruned_bake)[0])
    views = [
        {"eye": (centre + radius * np.array([dx, up, dz])).tolist(), "target": [0.0, 0.0, -10.0 * radius], "fov": fov}
        for dx, up, dz, fov in ((0.0, 2.0, 6.0, 60.0), (9.0, 1.0, 15.0, 60.0), (-4.0, 12.0, 60.0, 25.0))
    ]
    common = {
        "code": code_of("three", 1),
        "places": forest_of(radius, 64),
        "seconds": 3.7,
        "settings": {"lodDistance": 1.15, "pruneStart": 20.0 * radius},
    }
    found, expected = (drawn(renderer, pruned_bake, views, **common) for renderer in (backend, "webgl"))
    assert (
        max(picture["calls"] for picture in expected) == 7
    )  # Leaves and trunk of three levels, and the cross impostor.
    for picture, other in zip(found, expected, strict=True):
        agree(picture, other)
        assert picture["triangles"] == other["triangles"] + 1
        assert picture["calls"] == other["calls"] + 1


@pytest.mark.parametrize("number", rest_at_night([0, 1]))
def test_an_octahedral_impostor_looks_as_with_webgl(backend: str, octahedral_bake: Path, number: int) -> None:
    """As a tree it is blended, in a forest cut out."""
    file = octahedral_bake / "shrub.glb"
    view = near(file) | {"settings": {"level": 3}}
    common = {"code": code_of("three", number), "places": [TURNED]}
    [picture], [other] = (drawn(each, file, [view], **common) for each in (backend, "webgl"))
    assert other["triangles"] == 2
    agree(picture, other)


def blended(file: Path, folder: Path) -> Path:
    """Write a copy of a file whose leaves and billboards are alpha-blended."""

    def edit(document: dict[str, Any], _: bytearray) -> None:
        for material in document["materials"]:
            if material.pop("alphaCutoff", None) is not None:
                material["alphaMode"] = "BLEND"

    return rewritten(file, folder / "blended.glb", edit)


@pytest.mark.night
def test_blended_leaves_look_as_with_webgl(backend: str, three_bake: Path, tmp_path: Path) -> None:
    file = blended(three_bake / "shrub.glb", tmp_path)
    views = [near(file) | at_rest(level) for level in (0, 1, 2)]
    for picture, other in zip(drawn(backend, file, views), drawn("webgl", file, views), strict=True):
        agree(picture, other)
    alpha = other["pixels"][..., 3]
    assert ((alpha > 50.0) & (alpha < 200.0)).any()


@pytest.fixture(scope="module")
def shaded_bake() -> Path:
    return folder_of("three shaded")


@pytest.mark.parametrize("number", rest_at_night([0, 1]))
def test_trees_get_shadows_from_themselves(backend: str, shaded_bake: Path, tmp_path: Path, number: int) -> None:
    """Shadow maps and self-shadowing; without the texture of self-shadowing the pictures differ more."""
    file = shaded_bake / "shrub.glb"

    def edit(document: dict[str, Any], _: bytearray) -> None:
        for material in document["materials"]:
            material.get("extras", {}).get("leafcloud", {}).pop("bentNormalTexture", None)

    _, radius = sphere_of(levels_of(file)[0])
    views = [near(file) | {"settings": {"level": level}} for level in (0, 1)]
    sun = (10.0 * radius * np.array([0.3, 0.9, 0.2])).tolist()
    common = {"code": code_of("three", number), "places": [TURNED], "sun": sun}
    found = drawn(backend, file, views, **common)
    expected = drawn("webgl", file, views, **common)
    unshaded = drawn("webgl", rewritten(file, tmp_path / "plain.glb", edit), views[1:], **common)
    assert error(expected[1], unshaded[0]) > 0.06
    for picture, other in zip(found, expected, strict=True):
        agree(picture, other, 0.035)


COMPRESSED = """
import { Tree } from "leafcloud-three";
const tree = await Tree.load("pine.glb", { renderer });
const maps = tree.levels.slice(1).flatMap(({ meshes }) => meshes.flatMap(({ material }) => material.map ?? []));
if (!maps.length || !maps.every((map) => map.isCompressedTexture)) throw new Error("PNG textures were read");
const copy = tree.clone();
tree.dispose();
scene.add(copy);
renderer.setAnimationLoop(() => (copy.update(camera), renderer.render(scene, camera)));
"""


def test_compressed_textures_are_read_and_a_copy_outlives_its_tree(backend: str, three_bake: Path) -> None:
    file = three_bake / "shrub.glb"
    view = near(file) | at_rest(1)
    [copy], [tree] = (drawn(backend, file, [view], code=code) for code in (COMPRESSED, code_of("three")))
    agree(copy, tree, 0.0)


def test_bundles_for_webgl_load_nothing_of_webgpu(tmp_path: Path) -> None:
    """Follow the imports of a bundle from its entry: only dynamic ones lead to three.webgpu.js."""
    command = ["../babylon/node_modules/.bin/esbuild", "--bundle", "--splitting", "--format=esm"]
    options = ["--minify", f"--outdir={tmp_path}", f"--metafile={tmp_path}/meta.json", "--log-level=error"]
    aliased = ["--alias:leafcloud-three=./src/index.js", "--sourcefile=entry.js"]
    source = 'import { WebGLRenderer } from "three"; const renderer = new WebGLRenderer();' + code_of("three")
    subprocess.run([*command, *options, *aliased], input=source, cwd=ENGINES / "three", text=True, check=True)
    outputs = json.loads((tmp_path / "meta.json").read_text())["outputs"]
    [entry] = [name for name, each in outputs.items() if each.get("entryPoint") == "entry.js"]
    nodes = {"node_modules/three/build/three.tsl.js", "node_modules/three/build/three.webgpu.js"}
    assert not nodes & sources_of(outputs, entry, ("import-statement",))
    assert nodes <= sources_of(outputs, entry, ("import-statement", "dynamic-import"))


def sources_of(outputs: dict[str, Any], entry: str, kinds: tuple[str, ...]) -> set[str]:
    """Return the source files in all outputs that imports of some kinds reach from an entry."""
    found, waiting = set(), [entry]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [each["path"] for each in outputs[name]["imports"] if each["kind"] in kinds]
    return {source for name in found for source in outputs[name]["inputs"]}
