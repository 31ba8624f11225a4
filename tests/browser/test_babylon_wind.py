"""Leaves and trunk in the package for Babylon.js, beside the law of the wind in f64.

The file has a few small squares, each in its own color: leaves on long stalks, and one as a piece of a trunk. The place
of a square is the center of its pixels.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_views import bundle, pictures
from laws import Air, Floats, blown, fluttered
from night import rest_at_night
from numpy.typing import NDArray
from small_glb import write_glb

COLORS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]], float)
"""Those of the leaves, then that of the trunk."""
MIDDLES = np.array(
    [[-1.1, 1.0, 0.3], [1.2, 0.4, -0.5], [0.1, 1.7, 0.9], [-0.4, -0.3, -1.0], [0.9, 1.5, 0.1], [-0.7, 1.9, 0.5]]
)
LEAVES = len(COLORS) - 1
RNG = np.random.default_rng(5)
PIVOTS = MIDDLES[:LEAVES] + RNG.uniform(-0.5, 0.5, (LEAVES, 3))
TARGETS = RNG.uniform(-0.3, 0.3, (LEAVES, 3))
"""Offsets of the leaves to their billboards; those of the pivots are half as long."""
CARRIERS = MIDDLES[:LEAVES] + RNG.uniform(-0.5, 0.5, (LEAVES, 3))
PHASES, FREEDOM = RNG.uniform(0.0, 1.0, LEAVES), RNG.uniform(0.3, 1.0, LEAVES)
SIZE = 0.09
"""Half of a square's side."""
AWAY, FOV, SIDE = 60.0, 4.5, 512
DIRECTION = np.array([0.6, 0.0, 0.8])
WIND = {
    "direction": DIRECTION.tolist(),
    "up": [0.0, 1.0, 0.0],
    "foot": [0.1, -1.2, 0.0],
    "height": 3.0,
    "spread": 1.5,
    "strength": 6.0,
    "gusts": 0.5,
    "period": 2.5,
    "sway": 0.2,
    "branches": 0.3,
    "flutter": 0.6,
}
SEEN = AWAY / (math.tan(math.radians(25.0)) / 1080 * SIDE / math.tan(math.radians(FOV / 2.0)))
"""The distance by which the file's numbers decide."""


def squares(middles: Floats) -> tuple[Floats, Floats]:
    """Return corners (4n, 3) of squares in front of the camera, and their triangles' indices."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * SIZE
    indices = np.add.outer(4 * np.arange(len(middles)), [0, 1, 2, 0, 2, 3])
    return (middles[:, None] + corners).reshape(-1, 3), indices.ravel()


def write_tree(path: Path, transition: float) -> Path:
    """Write a file of one level, which is at `transition` when the camera is `AWAY`."""

    def vertices(values: Floats) -> Floats:
        return np.repeat(values, 4, axis=0).astype(np.float32)

    numbers = np.column_stack([np.full(LEAVES, -1.0), PIVOTS, PIVOTS + 0.5 * TARGETS, PHASES, CARRIERS, FREEDOM])
    arrays: list[NDArray[Any]] = []
    primitives: list[dict[str, Any]] = []
    for part, is_leaf in ((slice(0, LEAVES), True), (slice(LEAVES, None), False)):
        points, indices = squares(MIDDLES[part])
        named: dict[str, NDArray[Any]] = {"POSITION": points.astype(np.float32), "COLOR_0": vertices(COLORS[part])}
        named["NORMAL"] = np.tile(np.array([[0.0, 0.0, 1.0]], np.float32), (len(points), 1))
        if is_leaf:
            pairs = np.hsplit(vertices(numbers), 6)
            named |= {"TEXCOORD_0": pairs[0], "TEXCOORD_1": pairs[0]}
            named |= {f"TEXCOORD_{2 + i}": pair for i, pair in enumerate(pairs)}
        first = len(arrays)
        arrays += [*named.values(), indices.astype(np.uint32)]
        primitive: dict[str, Any] = {"attributes": {name: first + i for i, name in enumerate(named)}, "material": 0}
        primitives.append({**primitive, "indices": len(arrays) - 1})
    arrays.append(vertices(TARGETS))
    primitives[0]["targets"] = [{"POSITION": len(arrays) - 1}]
    primitives[1]["targets"] = [{"POSITION": primitives[1]["attributes"]["POSITION"]}]  # Trunks do not morph.
    start = SEEN - 2.0 * transition
    own = {"level": 0, "centre": [0.0, 0.0, 0.0], "radius": 2.0, "wind": WIND}
    own |= {"transition_start": start, "transition_end": start + 2.0}
    document = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "tree", "mesh": 0, "extras": {"leafcloud": own}}],
        "meshes": [
            {"primitives": primitives, "extras": {"leafcloud": {"first_texcoord": 2, "first_trunk_primitive": 1}}}
        ],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0}, "doubleSided": True}],
    }
    return write_glb(path, document, arrays)


def expected(a: float, seconds: float, strength: float, angle: float, place: Floats) -> Floats:
    """Return the middles (n, 3) in the world, of the tree at `place`, turned by `angle` about the vertical axis."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    air = Air(
        direction=turn.T @ DIRECTION,
        up=np.array(WIND["up"]),
        foot=np.array(WIND["foot"]),
        height=3.0,
        spread=1.5,
        strength=strength,
        gusts=0.5,
        turns=seconds / 2.5 + float(np.array([0.1732, 0.2236, -0.1414]) @ place),
        sway=0.2,
        branches=0.3,
        flutter=0.6,
    )
    points, pivots = MIDDLES[:LEAVES] + a * TARGETS, PIVOTS + 0.5 * a * TARGETS
    leaves = blown(fluttered(points, pivots, PHASES, FREEDOM, a, air), PIVOTS, CARRIERS, a, air)
    trunk = blown(MIDDLES[LEAVES:], MIDDLES[LEAVES:], MIDDLES[LEAVES:], 0.0, air)
    return np.vstack([leaves, trunk]) @ turn.T + place


def projected(points: Floats) -> Floats:
    """Return columns and rows (n, 2) of points for the camera on the axis z."""
    scale = SIDE / 2.0 / math.tan(math.radians(FOV / 2.0))
    depth = AWAY - points[:, 2:]
    return np.array([SIDE / 2.0, SIDE / 2.0]) + scale * points[:, :2] / depth * [1.0, -1.0]


def seen_in(picture: dict[str, Any]) -> Floats:
    """Return the centers (n, 2) of the squares' pixels, found by their colors."""
    pixels = picture["pixels"][..., :3]
    lit = pixels > 0.5 * pixels.max()
    masks = [(lit == (color > 0.5)).all(axis=-1) for color in COLORS]
    assert all(mask.sum() > 100 for mask in masks)
    return np.array([np.argwhere(mask)[:, ::-1].mean(axis=0) + 0.5 for mask in masks])


CODE = """
import { loadTree } from "leafcloud-babylon";
const tree = await loadTree("pine.glb", scene);
tree.root.rotation.y = ANGLE;
tree.root.position.set(...PLACE);
"""


@pytest.mark.parametrize(
    ("transition", "angle", "place", "left_handed"),
    rest_at_night(
        [
            (0.4, 0.8, (0.3, -0.2, 0.0), False),
            (0.0, 0.0, (0.0, 0.0, 0.0), False),
            (0.4, 0.0, (0.0, 0.0, 0.0), False),
            (0.4, 0.0, (0.0, 0.0, 0.0), True),
        ]
    ),
)
def test_leaves_and_trunk_follow_the_law(
    tmp_path: Path, transition: float, angle: float, place: tuple[float, float, float], left_handed: bool
) -> None:
    file = write_tree(tmp_path / "tree.glb", transition)
    bundle(tmp_path)
    code = CODE.replace("ANGLE", str(angle)).replace("PLACE", str(list(place)))
    view = {"eye": [0.0, 0.0, AWAY], "target": [0.0, 0.0, 0.0], "fov": FOV}
    common = {"code": code, "views": [view], "side": SIDE, "leftHanded": left_handed}
    moved = []
    for seconds, wind in ((3.7, None), (4.4, -9.0), (1.0, 0.0)):
        settings = {"seconds": seconds, "wind": wind, "stagger": 0.0}
        [picture] = pictures("babylon", file, settings=settings, **common)
        strength = 6.0 if wind is None else wind
        law = projected(expected(transition, seconds, strength, angle, np.array(place)))
        assert np.abs(seen_in(picture) - law).max() < 1.0
        moved.append(law)
    assert np.linalg.norm(moved[0] - moved[2], axis=1).min() > 3.0
    assert np.linalg.norm(moved[0] - moved[1], axis=1).max() > 20.0


SHADOWS = """
import { DirectionalLight, MeshBuilder, ShadowGenerator, Vector3 } from "@babylonjs/core";
const sun = new DirectionalLight("sun", new Vector3(...DOWN), scene);
sun.position = new Vector3(...DOWN).scale(-10);
scene.lights[0].setEnabled(false);
const wall = MeshBuilder.CreatePlane("wall", { size: 12 }, scene);
wall.position.z = -3;
wall.rotation.y = Math.PI;
wall.receiveShadows = true;
const shadows = new ShadowGenerator(2048, sun);
tree.root.getChildMeshes().forEach((mesh) => shadows.addShadowCaster(mesh, false));
"""


@pytest.mark.night
def test_shadows_move_with_the_leaves_and_the_trunk(tmp_path: Path) -> None:
    """The sun throws the squares onto a wall; their shadows lie where the law says."""
    file = write_tree(tmp_path / "tree.glb", 0.4)
    bundle(tmp_path)
    sun = np.array([0.9, -0.25, -1.0])
    code = CODE.replace("ANGLE", "0").replace("PLACE", "[0, 0, 0]") + SHADOWS.replace("DOWN", str(sun.tolist()))
    half = math.tan(math.radians(4.0))
    view = {"eye": [0.0, 0.0, AWAY], "target": [0.0, 0.0, 0.0], "fov": 8.0}
    # The wider view has more pixels, so that the distance of the laws stays.
    pixels = SIDE * half / math.tan(math.radians(FOV / 2.0))
    lit = []
    for wind in (0.0, -9.0):
        settings = {"seconds": 4.4, "wind": wind, "pixels": pixels}
        [picture] = pictures("babylon", file, settings=settings, code=code, views=[view], side=SIDE)
        points = expected(0.4, 4.4, wind, 0.0, np.zeros(3))
        fallen = points + sun * (points[:, 2:] + 3.0)
        places = SIDE / 2.0 + SIDE / 2.0 / half * fallen[:, :2] / (AWAY + 3.0) * [1.0, -1.0]
        columns, rows = places.astype(int).T
        light = picture["pixels"][..., :3].sum(axis=-1)
        assert (light[rows, columns] < 0.2 * light.max()).all()
        lit.append(light)
    assert ((lit[0] > 0.5 * lit[0].max()) != (lit[1] > 0.5 * lit[1].max())).sum() > 200
