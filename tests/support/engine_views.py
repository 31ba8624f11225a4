"""Pictures of a baked tree from a package for an engine, drawn in Chromium by the code of the package's README."""

from __future__ import annotations

import base64
import itertools
import math
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy  # noqa: F401  (brings mathutils, which the add-on needs)
import numpy as np
from browser import ask
from glb import Node, read_glb
from laws import Floats

from addon.export.forest_file import write_forest

ROOT = Path(__file__).resolve().parents[2]
ENGINES = ROOT / "engines"
ROWS = 1080.0
"""Height in pixels of the picture that a file's distances are for."""
DIRECTION = np.array([0.36, 0.48, 0.8])
"""From the tree to the eye."""


def code_of(engine: str, number: int = 0) -> str:
    """Return one of the examples in the README of a package: 0 draws a tree, 1 a forest."""
    readme = (ENGINES / engine / "README.md").read_text()
    return re.findall(r"```js\n(.*?)```", readme, re.DOTALL)[number]


def bundle(folder: Path) -> None:
    """Write the package for Babylon.js and Babylon.js itself as one module, folder/bundle.js."""
    source = 'export * from "@babylonjs/core"; export * from "./src/index.js";'
    command = ["node_modules/.bin/esbuild", "--bundle", "--format=esm", "--log-level=warning"]
    subprocess.run(
        [*command, f"--outfile={folder}/bundle.js"], input=source, cwd=ENGINES / "babylon", text=True, check=True
    )


def for_babylon(baked: Path, folder: Path) -> Path:
    """Return a copy in `folder` of the tree that was baked into a folder, beside the module."""
    bundle(folder)
    return Path(shutil.copy(baked / "shrub.glb", folder))


def pictures(engine: str, file: Path, **question: Any) -> list[dict[str, Any]]:
    """Return the answer for each view of tests/browser/`page`.html; without a `page` it has the engine's name.

    `pixels` is (side, side, 4) in [0, 255], the top row first.
    """
    asked = {"file": f"/files/{file.name}", "side": 256, "code": code_of(engine), **question}
    answer = ask(f"tests/browser/{asked.pop('page', engine)}.html", asked, patience=200.0, files=file.parent)
    side = asked["side"]
    for picture in answer["pictures"]:
        pixels = np.frombuffer(base64.b64decode(picture["pixels"]), np.uint8)
        picture["pixels"] = pixels.reshape(side, side, 4)[::-1].astype(float)
    return list(answer["pictures"])


def levels_of(file: Path) -> list[Node]:
    """Return the nodes of the levels, the leaves first."""
    levels = [node for node in read_glb(file).values() if "level" in node.extras.get("leafcloud", {})]
    return sorted(levels, key=lambda node: node.extras["leafcloud"]["level"])


def sphere_of(level: Node) -> tuple[Floats, float]:
    """Return center and radius of the crown in the file's world."""
    extras = level.extras["leafcloud"]
    scale = abs(float(np.linalg.det(level.matrix[:3, :3]))) ** (1.0 / 3.0)
    return level.to_world(np.array([extras["centre"]]))[0], scale * float(extras["radius"])


def hand_overs(levels: Sequence[Node]) -> list[float]:
    """Return the distance at which each level but the last begins to fade, for a picture of `ROWS`."""
    extras = [level.extras["leafcloud"] for level in levels]
    return [
        each["transition_start"] + 0.998 * (each["transition_end"] - each["transition_start"])
        if "transition_end" in each
        else following["switch_distance"]
        for each, following in itertools.pairwise(extras)
    ]


def seen_from(distance: float, centre: Floats, side: int = 256) -> dict[str, Any]:
    """Return a view for a page, at a distance for `ROWS` rows: the tree is as large in pixels as there."""
    eye = np.asarray(centre) + distance * side / ROWS * DIRECTION
    return {"eye": eye.tolist(), "target": np.asarray(centre).tolist(), "fov": 50.0}


def forest_of(radius: float, count: int) -> list[list[float]]:
    """Return matrices (4, 4), as rows, of trees in eight columns: turned about the vertical axis, scaled and moved."""
    rng, found = np.random.default_rng(3), []
    for i in range(count):
        angle, scale = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.6, 1.5)
        c, s = scale * math.cos(angle), scale * math.sin(angle)
        x, z = 3.0 * radius * np.array([i % 8 - 3.5, -(i // 8)]) + rng.uniform(-0.5, 0.5, 2)
        found.append([c, 0.0, s, x, 0.0, scale, 0.0, 0.0, -s, 0.0, c, z, 0.0, 0.0, 0.0, 1.0])
    return found


def triangles(level: Node) -> int:
    """Return the triangles of a level with its trunk."""
    return sum(len(primitive.indices) for primitive in (*level.primitives, *level.trunk))


def fade_behind(morphs: bool) -> float:
    """Return the length of the fade behind a level, as a fraction of the distance where it starts."""
    return 0.08 if morphs else 0.15


def drawn_levels(distance: float, ends: Sequence[float], morphs: Sequence[bool]) -> list[int]:
    """Return the levels that are drawn at a distance: two while they fade."""
    number = sum(distance >= end for end in ends)
    fades = number > 0 and distance < ends[number - 1] * (1.0 + fade_behind(morphs[number - 1]))
    return [number - 1, number] if fades else [number]


def views_of_all_levels(levels: Sequence[Node], side: int = 256) -> tuple[list[list[int]], list[dict[str, Any]]]:
    """Return the levels to draw and the view for six distances of each hand-over, from 0.5 to 4 times it."""
    centre, _ = sphere_of(levels[0])
    ends = hand_overs(levels)
    distances = [share * end for end in ends for share in (0.5, 0.8, 0.99, 1.3, 2.0, 4.0)]
    morphs = ["transition_end" in level.extras["leafcloud"] for level in levels]
    drawn = [drawn_levels(distance, ends, morphs) for distance in distances]
    return drawn, [seen_from(distance, centre, side) for distance in distances]


def forest_file(file: Path, places: Sequence[Sequence[float]]) -> Path:
    """Write the tree of a bake at places (4, 4), as rows and Y-up, which move it from where it stands."""
    [leaves, *_] = levels_of(file)
    stands = np.eye(4)
    stands[:3, 3] = leaves.to_world(np.zeros((1, 3)))[0]
    to_blender = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    rows = to_blender @ (np.array(places).reshape(-1, 4, 4) @ stands) @ to_blender.T
    made = file.with_name(f"{file.stem}_forest.glb")
    write_forest(file, made, rows)
    return made
