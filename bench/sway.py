"""The control of comparisons: the same tree as a light breeze has moved it, an equally good tree.

Every vertex of a leaf moves by a smooth random field: sixteen plane waves, 0.4 R long, of random direction, motion and
phase, together 0.025 R in root mean square, or another length. Neighbors stay neighbors, so the crown keeps its
coverage and its texture; only the places of the leaves are others. The trunk stays where it is.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from numpy.typing import NDArray

MOVE, LENGTH, WAVES = 0.025, 0.4, 16
"""Root mean square of the motion and length of the waves, in R; number of waves."""
SEED = 7

Vectors = NDArray[np.float64]


def sway(meshes: list[bpy.types.Object], move: float = MOVE) -> None:
    """Move the leaves of one tree, which has no shape keys, by `move` in R."""
    leaves = {obj: leaf_vertices(obj.data) for obj in meshes}
    _, radius = sphere_around(np.concatenate([places_of([obj])[own] for obj, own in leaves.items()]))
    random = np.random.default_rng(SEED)
    along, motion, phase = unit(random), unit(random), random.uniform(0.0, 2.0 * math.pi, WAVES)
    for obj, own in leaves.items():
        places = places_of([obj])
        waves = np.sin(places[own] @ along.T * (2.0 * math.pi / (LENGTH * radius)) + phase)
        places[own] += waves @ motion * (move * radius * math.sqrt(2.0 / WAVES))
        back = np.array(obj.matrix_world.inverted())
        obj.data.vertices.foreach_set("co", (places @ back[:3, :3].T + back[:3, 3]).ravel())
        obj.data.update()


def unit(random: np.random.Generator) -> Vectors:
    vectors = random.normal(size=(WAVES, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def leaf_vertices(mesh: bpy.types.Mesh) -> NDArray[np.int64]:
    first = first_of_trunk(mesh)
    return np.unique([v for face in mesh.polygons if face.material_index < first for v in face.vertices])


def first_of_trunk(mesh: bpy.types.Mesh) -> int:
    """Return the first material slot of the trunk. The importer makes one of each primitive; the trunk's come last."""
    return int(mesh.get("leafcloud", {}).get("first_trunk_primitive", len(mesh.materials)))


def places_of(objects: list[bpy.types.Object]) -> Vectors:
    """Return all vertices (n, 3) in world space."""
    world = []
    for obj in objects:
        points = np.empty(3 * len(obj.data.vertices))
        obj.data.vertices.foreach_get("co", points)
        matrix = np.array(obj.matrix_world)
        world.append(points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(world)


def sphere_around(places: Vectors) -> tuple[Vectors, float]:
    """Return the middle of the bounding box and the distance of the farthest place from it."""
    centre = (places.min(0) + places.max(0)) / 2.0
    return centre, float(np.linalg.norm(places - centre, axis=1).max())
