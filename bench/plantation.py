"""Draws a plantation with leaves alone and with levels: `make bench-plantation`.

usage: make bench-plantation ARGS='[TREE.glb [PICTURE.png]]'      (default: the oak of ../shared/foliage)

The tree is baked without settings. Its copies stand evenly to a horizon of 50 R. Above all of them have all leaves,
below each has the level for its distance. Cycles draws both, with 8 transparent bounces. Prints the triangles of both
pictures, and writes docs/plantation.png if no tree is named.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray
from stage import FOLIAGE, ROOT, bake_alone, light_up

import leafcloud
from addon.bake.values import Baked
from addon.settings.bake import BakeSettings

WIDTH, HEIGHT, SAMPLES = 960, 400, 48
HORIZON, SPACING, EYE = 50.0, 2.8, 0.6
"""Distance of the farthest trees, of neighbors, and height of the eye over the crowns' centers, in R."""
VIEW = math.radians(50.0)
"""Vertical field of view."""
ROWS = slice(150, 380)
"""Rows of a picture with trees."""


def places(seed: int = 5) -> Iterator[tuple[float, float, float]]:
    """Yield x and y of each tree in R, with the camera at 0 looking along y, and its turn."""
    random = np.random.default_rng(seed)
    count = math.ceil(HORIZON / SPACING)
    for row in range(1, count + 1):
        for column in range(-count, count + 1):
            x, y = (np.array([column + 0.5 * (row % 2), row]) + random.uniform(-0.3, 0.3, 2)) * SPACING
            in_view = abs(x) < 1.5 * y * math.tan(VIEW / 2.0) * WIDTH / HEIGHT / 1.4 + 2.0
            if in_view and math.hypot(x, y) < HORIZON:
                yield float(x), float(y), float(random.uniform(0.0, 2.0 * math.pi))


def level_for(distance: float, switches: Sequence[float]) -> int:
    return max(number for number, switch in enumerate(switches) if switch <= distance)


def plant(baked: Baked, *, levels: bool) -> tuple[list[bpy.types.Object], int]:
    """Add the trees to the scene; return them and their triangles."""
    foliage = baked.prepared.foliage
    radius, middle = foliage.radius, Vector(foliage.world_centre)
    switches = [distance / radius for distance in baked.switch_distances]
    own = Matrix(baked.prepared.tree.matrix.tolist())
    made, triangles = [], 0
    for x, y, turn in places():
        built = baked.levels[level_for(math.hypot(x, y), switches) if levels else 0]
        move = Matrix.Translation((x * radius, y * radius, 0.0)) @ Matrix.Rotation(turn, 4, "Z")
        for part in filter(None, (built.object, built.trunk)):
            copy = bpy.data.objects.new("tree", part.data)
            copy.matrix_world = move @ Matrix.Translation(-middle) @ own
            bpy.context.scene.collection.objects.link(copy)
            made.append(copy)
        triangles += built.triangles + built.trunk_triangles
    return made, triangles


def picture(camera: bpy.types.Object, radius: float, file: Path) -> NDArray[np.uint8]:
    camera.location = (0.0, 0.0, EYE * radius)
    camera.rotation_euler = (math.radians(86.0), 0.0, 0.0)
    camera.data.sensor_fit, camera.data.angle, camera.data.clip_end = "VERTICAL", VIEW, 1e6
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    return leafcloud.decode_image(file.read_bytes())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=FOLIAGE / "oak_cards_11k.glb")
    parser.add_argument("picture", nargs="?", type=Path, default=ROOT / "docs" / "plantation.png")
    options = parser.parse_args()
    baked = bake_alone(options.tree, BakeSettings(viewer="anywhere"))
    for level in baked.levels:
        for part in filter(None, (level.object, level.trunk)):
            part.hide_render = True
    camera, shown = light_up(WIDTH, SAMPLES), []
    bpy.context.scene.cycles.transparent_max_bounces = 8
    for levels in (False, True):
        trees, triangles = plant(baked, levels=levels)
        print(f"{len(trees)} parts of trees, {triangles:,} triangles {'with levels' if levels else 'of leaves alone'}")
        with tempfile.TemporaryDirectory() as folder:
            shown.append(picture(camera, baked.prepared.foliage.radius, Path(folder) / "forest.png"))
        for tree in trees:
            bpy.data.objects.remove(tree)
    options.picture.write_bytes(leafcloud.encode_png([np.vstack([each[ROWS] for each in shown])], colors=256))


if __name__ == "__main__":
    main()
