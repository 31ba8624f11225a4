"""The octahedral impostor in the package for Babylon.js, by the law, from the numbers and pages in the file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bakes import folder_of
from engine_views import code_of, for_babylon, levels_of, pictures
from laws import Floats
from night import rest_at_night
from octahedral import unit
from octahedral_pictures import SIDE, by_the_law, impostor_in

EYES = [(1.0, 0.4, 0.2), (-0.3, 0.2, 1.0), (0.6, -0.3, -0.7), (0.2, 1.0, -0.4)]
LAST = 3


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return for_babylon(folder_of("babylon octahedral"), tmp_path_factory.mktemp("babylon_octahedral"))


MOVED = """
tree.root.rotation.y = 0.7;
tree.root.scaling.setAll(2);
tree.root.position.set(3, -1, 2);
"""


def moved(points: Floats) -> Floats:
    """Return where `MOVED` takes points (n, 3) of the tree."""
    c, s = math.cos(0.7), math.sin(0.7)
    return 2.0 * points @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + [3.0, -1.0, 2.0]


@pytest.mark.parametrize(("code", "left_handed"), rest_at_night([("", False), (MOVED, False), ("", True)]))
def test_it_is_drawn_by_the_law(tree: Path, code: str, left_handed: bool) -> None:
    level = levels_of(tree)[LAST]
    extras = level.extras["leafcloud"]
    numbers, middle, radius = extras["octahedral"], np.array(extras["centre"]), extras["radius"]
    distance = 3.0 * numbers["switch_distance"]
    eyes = [middle + distance * unit(np.array(eye)) for eye in EYES]
    fov = math.degrees(2.0 * math.atan(radius / distance))
    place = moved if code else np.asarray
    views = [{"eye": place(eye).tolist(), "target": place(middle).tolist(), "fov": fov} for eye in eyes]
    asked = {"code": code_of("babylon") + code, "views": views, "side": SIDE, "leftHanded": left_handed}
    found = pictures("babylon", tree, settings={"level": LAST}, **asked)
    rows, impostor = np.array(numbers["to_layout"]).reshape(3, 4), impostor_in(tree, numbers)
    for eye, picture in zip(eyes, found, strict=True):
        expected, _ = by_the_law(impostor, rows, middle, radius, eye)
        expected = expected[::-1]
        covered, share = picture["pixels"][..., 3] > 0, expected[..., 3]
        assert picture["triangles"] == 2
        assert share.mean() > 0.05
        # Each place has a cutoff of its own.
        assert covered[share < 0.001].mean() < 0.02
        assert covered[share > 0.9].mean() > 0.85
        assert covered.mean() == pytest.approx(share.mean(), rel=0.06)
        both = covered & (share > 0.5)
        colors = (picture["pixels"][both][:, :3] / 255.0) ** 2.2  # The curve of Babylon.js.
        base = expected[both][:, :3]
        # Light from all sides loses what the surface reflects, some 4 %.
        factor = colors.sum() / base.sum()
        assert 0.9 < factor < 1.0
        assert np.abs(colors - factor * base).mean() < 0.008


SHADOWS = """
import { DirectionalLight, MeshBuilder, ShadowGenerator, Vector3 } from "@babylonjs/core";
const sun = new DirectionalLight("sun", new Vector3(-0.3, -1, 0.5), scene);
sun.position = new Vector3(0, 20, 0);
scene.lights[0].setEnabled(false);
const ground = MeshBuilder.CreateGround("ground", { width: 20, height: 20 }, scene);
ground.position.y = -1;
ground.receiveShadows = true;
const shadows = new ShadowGenerator(1024, sun);
tree.root.getChildMeshes().forEach((mesh) => shadows.addShadowCaster(mesh, false));
"""


def test_its_shadow_is_that_of_the_leaves(tree: Path) -> None:
    """The camera is above the tree, the sun beside: in the shadow map the quad faces the sun."""
    radius = levels_of(tree)[0].extras["leafcloud"]["radius"]
    view = {"eye": [0.0, 8.0 * radius, 0.1], "target": [0.0, -1.0, 0.0], "fov": 40.0}
    shadow = []
    for level in (0, LAST):
        asked = {"code": code_of("babylon") + SHADOWS, "views": [view], "settings": {"level": level}}
        [picture] = pictures("babylon", tree, **asked)
        light = picture["pixels"][..., :3]
        shadow.append(light.max(axis=-1) < 0.1 * light.max())
    both, either = (shadow[0] & shadow[1]).sum(), (shadow[0] | shadow[1]).sum()
    assert either > 500
    assert both > 0.57 * either  # 0.61, and 0.6 on a machine that does other work.
