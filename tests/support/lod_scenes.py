"""Leaves with the attributes of the LOD nodes, and helpers that evaluate the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Leaves:
    """Triangular leaves without shared points. Leaf i has the points 3i, 3i + 1, 3i + 2."""

    points: NDArray[np.float32]  # (3n, 3)
    targets: NDArray[np.float32]  # (3n, 3)
    ranks: NDArray[np.float32]  # (n,)
    pivots: NDArray[np.float32]  # (n, 3)
    pivot_targets: NDArray[np.float32]  # (n, 3)

    @property
    def areas(self) -> Floats:
        return triangle_areas(self.points)


def triangle_areas(points: NDArray[np.float32]) -> Floats:
    """Return the areas (n,) of triangles, given three points each."""
    a, b, c = points.astype(np.float64).reshape(-1, 3, 3).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0


# Right triangles with the areas ½, ½, 2, 1 and pivots at the right angles. Their billboard is the plane z = 0.
FOUR = Leaves(
    points=np.float32(
        [
            [[0, 0, 1], [1, 0, 1], [0, 1, 1]],
            [[4, 0, 2], [4, 0, 3], [4, 1, 2]],
            [[0, 4, -1], [2, 4, -1], [0, 6, -1]],
            [[4, 4, 0], [6, 4, 0], [4, 5, 0]],
        ]
    ).reshape(-1, 3),
    targets=np.float32(
        [
            [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            [[4, 0, 0], [5, 0, 0], [4, 1, 0]],
            [[0, 4, 0], [2, 4, 0], [0, 6, 0]],
            [[4, 4, 0], [6, 4, 0], [4, 5, 0]],
        ]
    ).reshape(-1, 3),
    ranks=np.float32([0.0, 0.5, 0.25, 0.75]),
    pivots=np.float32([[0, 0, 1], [4, 0, 2], [0, 4, -1], [4, 4, 0]]),
    pivot_targets=np.float32([[0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, 0]]),
)


def many_leaves(count: int) -> Leaves:
    """Return leaves of random sizes in a random order, with ranks i / count."""
    rng = np.random.default_rng(7)
    pivots = rng.normal(size=(count, 3)).astype(np.float32)
    sizes = rng.uniform(0.01, 0.2, size=(count, 1, 1))
    points = (pivots[:, None, :] + sizes * rng.normal(size=(count, 3, 3))).astype(np.float32).reshape(-1, 3)
    flat = np.float32([1.0, 1.0, 0.0])
    return Leaves(points, points * flat, rng.permutation(count).astype(np.float32) / count, pivots, pivots * flat)


def build(leaves: Leaves, *, attributes: bool = True) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("Leaves")
    mesh.from_pydata(leaves.points.tolist(), [], np.arange(len(leaves.points)).reshape(-1, 3).tolist())
    if attributes:
        store(mesh, "leaf_rank", np.repeat(leaves.ranks, 3))
        store(mesh, "leaf_target", leaves.targets)
        store(mesh, "leaf_pivot", np.repeat(leaves.pivots, 3, axis=0))
        store(mesh, "leaf_pivot_target", np.repeat(leaves.pivot_targets, 3, axis=0))
    return mesh


def store(mesh: bpy.types.Mesh, name: str, values: NDArray[np.float32]) -> None:
    kind, field = ("FLOAT", "value") if values.ndim == 1 else ("FLOAT_VECTOR", "vector")
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, np.ascontiguousarray(values).ravel())


def place(mesh: bpy.types.Mesh, name: str = "Tree", matrix: Matrix | None = None) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, mesh)
    obj.matrix_world = matrix or Matrix()
    bpy.context.scene.collection.objects.link(obj)
    return obj


def add_camera(location: tuple[float, float, float]) -> bpy.types.Object:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = location
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def evaluate(obj: bpy.types.Object) -> bpy.types.Mesh:
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def points_of(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    return points
