"""Forests in the package for Babylon.js: the code of its README draws what copies of the tree draw, at less cost."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bakes import folder_of
from engine_views import (
    code_of,
    fade_behind,
    for_babylon,
    forest_file,
    forest_of,
    hand_overs,
    levels_of,
    pictures,
    triangles,
)
from night import rest_at_night

SIDE = 256
COUNT = 48


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return for_babylon(folder_of("babylon octahedral"), tmp_path_factory.mktemp("babylon_forest"))


def views_of(tree: Path) -> list[dict[str, Any]]:
    """Return a view from within the forest, one from its edge, and one from afar."""
    extras = levels_of(tree)[0].extras["leafcloud"]
    radius, centre = extras["radius"], np.array(extras["centre"])
    return [
        {"eye": (centre + radius * np.array(eye)).tolist(), "target": [0.0, 0.0, -10.0 * radius], "fov": fov}
        for eye, fov in (((0.0, 2.0, 6.0), 60.0), ((9.0, 1.0, 15.0), 60.0), ((-4.0, 12.0, 60.0), 25.0))
    ]


def forest(tree: Path, **question: Any) -> list[dict[str, Any]]:
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    asked = {"code": code_of("babylon", 1), "places": forest_of(radius, COUNT), "views": views_of(tree), **question}
    return pictures("babylon", tree, **asked)


@pytest.mark.parametrize("left_handed", rest_at_night([False, True]))
def test_a_forest_looks_like_its_trees_drawn_one_by_one(tree: Path, left_handed: bool) -> None:
    """All levels are in view. Trees are turned, scaled and blown; the fades of levels and the pruning agree, too."""
    common = {"settings": {"seconds": 3.7, "wind": 6.0}, "leftHanded": left_handed}
    together, single = forest(tree, **common), forest(tree, copies=True, **common)
    for one, other in zip(together, single, strict=True):
        covered = (other["pixels"][..., 3] > 0).mean()
        assert covered > 0.01
        differs = np.abs(one["pixels"] - other["pixels"]).max(axis=-1) > 8.0
        assert differs.mean() < 0.02 * covered
    for number in range(len(levels_of(tree))):
        assert any(picture["counts"][number] > 0 for picture in together)


@pytest.mark.night
def test_levels_are_drawn_by_distance_and_save_triangles(tree: Path) -> None:
    """Each tree counts in the level for its distance; trees that fade count in both."""
    levels = levels_of(tree)
    ends = hand_overs(levels)
    extras = levels[0].extras["leafcloud"]
    places = np.array(forest_of(extras["radius"], COUNT)).reshape(-1, 4, 4)
    morphs = ["transition_end" in level.extras["leafcloud"] for level in levels]
    all_drawn = code_of("babylon", 1) + "\nforest.culling = false;\n"
    found = forest(tree, code=all_drawn, settings={"stagger": 0})
    leaves = forest(tree, code=all_drawn, settings={"level": 0})
    for view, picture, full in zip(views_of(tree), found, leaves, strict=True):
        # A pixel of the file's distances is one of 1080 rows over 50°.
        zoom = SIDE / 1080.0 * math.tan(math.radians(25.0)) / math.tan(math.radians(view["fov"]) / 2.0)
        middles = places @ [*extras["centre"], 1.0]
        scales = np.cbrt(np.linalg.det(places[:, :3, :3]))
        away = np.linalg.norm(middles[:, :3] - view["eye"], axis=1) / scales / zoom
        counts = [0] * len(levels)
        for distance in away:
            for number in range(len(levels)):
                begins = ends[number - 1] if number > 0 else 0.0
                gone = ends[number] * (1.0 + fade_behind(morphs[number])) if number < len(ends) else math.inf
                counts[number] += begins <= distance < gone
        assert picture["counts"] == counts
        most = sum(count * triangles(level) for count, level in zip(counts, levels, strict=True))
        assert picture["triangles"] <= most  # Pruned leaves are not drawn.
        assert full["counts"] == [len(places)] + [0] * (len(levels) - 1)
        assert picture["triangles"] < full["triangles"]


@pytest.mark.night
def test_the_forest_follows_the_camera_and_new_places(tree: Path) -> None:
    """The second picture of the same page is that of a page which shows nothing else."""
    views = views_of(tree)
    [_, after] = forest(tree, views=[views[0], views[2]], settings={"seconds": 1.0})
    [alone] = forest(tree, views=[views[2]], settings={"seconds": 1.0})
    assert np.array_equal(after["pixels"], alone["pixels"])
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    move = f"forest.plant(places.slice(0, {COUNT // 2}));\n"
    [planted] = forest(tree, views=views[2:], code=code_of("babylon", 1) + move, settings={"seconds": 1.0})
    [fewer] = forest(tree, views=views[2:], places=forest_of(radius, COUNT)[: COUNT // 2], settings={"seconds": 1.0})
    assert np.array_equal(planted["pixels"], fewer["pixels"])
    assert not np.array_equal(planted["pixels"], alone["pixels"])


def test_trees_behind_the_camera_are_not_drawn(tree: Path) -> None:
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    view = {"eye": [0.0, radius, 5.0 * radius], "target": [0.0, radius, 100.0 * radius], "fov": 50.0}
    [picture] = forest(tree, views=[view])
    assert picture["triangles"] == 0


SHADOWS = """
import { DirectionalLight, MeshBuilder, ShadowGenerator, Vector3 } from "@babylonjs/core";
const sun = new DirectionalLight("sun", new Vector3(-0.3, -1, 0.5), scene);
sun.position = new Vector3(0, 50, 0);
scene.lights[0].setEnabled(false);
const ground = MeshBuilder.CreateGround("ground", { width: 60, height: 60 }, scene);
ground.receiveShadows = true;
const shadows = new ShadowGenerator(2048, sun);
const casters = SOURCES.flatMap((each) => each.root.getChildMeshes());
casters.forEach((mesh) => shadows.addShadowCaster(mesh, false));
"""
COPIES = """
import { loadTree, Quaternion } from "leafcloud-babylon";
const tree = await loadTree("pine.glb", scene);
tree.root.setEnabled(false);
const copies = places.map((place) => {
  const copy = Object.assign(tree.clone(), { settings: { ...tree.settings, seconds: 2 } });
  copy.root.rotationQuaternion = new Quaternion();
  place.decompose(copy.root.scaling, copy.root.rotationQuaternion, copy.root.position);
  return copy;
});
"""


@pytest.mark.night
def test_a_forest_casts_the_shadows_of_its_trees(tree: Path) -> None:
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    view = {"eye": [5.0 * radius, 14.0 * radius, 2.0 * radius], "target": [0.0, 0.0, -8.0 * radius], "fov": 60.0}
    codes = [
        code_of("babylon", 1) + SHADOWS.replace("SOURCES", "[forest]"),
        COPIES + SHADOWS.replace("SOURCES", "copies"),
    ]
    dark = []
    for code in codes:
        [picture] = forest(tree, code=code, views=[view], settings={"seconds": 2.0})
        light = picture["pixels"][..., :3].max(axis=-1)
        dark.append((light < 0.1 * light.max()) & (picture["pixels"][..., 3] > 0))
    assert dark[1].mean() > 0.01
    # The light's map covers the casters' boxes, so that it has other texels around a forest.
    assert (dark[0] != dark[1]).mean() < 0.2 * dark[1].mean()


@pytest.mark.night
def test_a_forest_stands_where_its_file_says(tree: Path) -> None:
    """In both of Babylon.js's systems of axes. The left-handed one has the file's x-axis turned around."""
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    file = forest_file(tree, forest_of(radius, COUNT))
    from_file = code_of("babylon", 1).replace("places", "tree.places")
    for left_handed in (False, True):
        turned = np.diag([-1.0 if left_handed else 1.0, 1.0, 1.0, 1.0])
        places = turned @ np.array(forest_of(radius, COUNT)).reshape(-1, 4, 4) @ turned
        common = {"leftHanded": left_handed, "settings": {"seconds": 1.0}, "views": views_of(tree)[:1]}
        [given] = forest(tree, places=places.reshape(-1, 16).tolist(), **common)
        [read] = pictures("babylon", file, code=from_file, **common)
        assert read["counts"] == given["counts"]
        covered = given["pixels"][..., 3] > 0
        assert covered.mean() > 0.01
        assert (np.abs(read["pixels"] - given["pixels"]).max(axis=-1) > 8.0).sum() < 0.01 * covered.sum()
