"""Hard cases in Blender: mirroring, shearing and singular matrices, missing cameras, formulas at their limits."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from hard_cases import holds, refuses
from lod_scenes import FOUR, add_camera, build, evaluate, many_leaves, place, points_of
from mathutils import Matrix
from scenes import SQUARE, add_mesh, read

import leafcloud
from addon.errors import SceneError
from addon.geometry import world_positions
from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual

GROUP = "In Blender"
CORNERS = [*SQUARE, (0.3, 0.2, 0.7)]
FACES = [(0, 1, 4), (1, 2, 4)]

SHEAR = Matrix(((1.0, 0.7, 0.0, 3.0), (0.0, 1.0, 0.2, 0.0), (0.0, 0.0, 1.0, -2.0), (0.0, 0.0, 0.0, 1.0)))


def put(obj: bpy.types.Object, matrix: Matrix) -> None:
    """Give an object any matrix. Parents add the shear that the object's own transform cannot have."""
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    obj.parent = parent
    obj.matrix_parent_inverse = matrix
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    ("name", "matrix"),
    [
        ("non-uniform scale of 1 : 10⁶ in an object's matrix", Matrix.Diagonal((1e3, 1.0, 1e-3, 1.0))),
        ("an object's matrix that mirrors", Matrix.Diagonal((-1.0, 1.0, 1.0, 1.0))),
        ("an object's matrix that turns everything inside out", Matrix.Diagonal((-2.0, -3.0, -0.5, 1.0))),
        ("an object's matrix that shears (under a parent)", SHEAR),
        ("an object at 10⁶", Matrix.Translation((1e6, -1e6, 1e6))),
        ("an object of size 10⁻⁶", Matrix.Scale(1e-6, 4)),
    ],
)
@pytest.mark.parametrize("second", [False, True], ids=["frame", "part"])
def test_matrices(name: str, matrix: Matrix, second: bool) -> None:
    """World positions equal the matrix times the mesh's positions, with each object as the frame."""
    put(add_mesh("leaf a", CORNERS, FACES), Matrix() if second else matrix)
    put(add_mesh("leaf b", CORNERS, FACES), matrix)
    tree = read()
    found = world_positions(tree.leaves, tree.matrix).reshape(2, -1, 3)
    used = np.array([CORNERS[i] for i in sorted({corner for face in FACES for corner in face})], np.float32).astype(
        np.float64
    )
    expected = used @ np.array(matrix, np.float64)[:3, :3].T + np.array(matrix, np.float64)[:3, 3]
    size, scale = np.abs(expected).max(), np.abs(np.array(matrix)[:3, :3]).max()
    if second:
        # A part stores vertices in single precision in the frame's coordinates.
        worst, allowed = np.abs(found[1] - expected).max() / (size + scale), 4 * 2.0**-24
    else:
        # The frame's own vertices stay unchanged. Only the transform to the world rounds, in f64.
        worst, allowed = np.abs(found[0] - expected).max() / size, 4 * 2.0**-53
    place_of = "as a part" if second else "as the frame"
    holds(GROUP, f"{name}, {place_of}, relative error", "the matrix times the vertices, f64", float(worst), allowed)


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("a matrix that flattens one axis", (1, 1, 0)),
        ("a matrix that flattens two", (0, 1, 0)),
        ("a matrix of zeros", (0, 0, 0)),
    ],
)
def test_singular_matrices(name: str, scale: tuple[float, float, float]) -> None:
    add_mesh("leaf", CORNERS, FACES, matrix=Matrix.Diagonal((*scale, 1.0)))
    with pytest.raises(SceneError) as caught:
        read()
    refuses(GROUP, name, caught.value, "'leaf' is singular")


@pytest.mark.parametrize(
    ("name", "location", "transition"),
    [
        ("a camera inside the tree", (0.0, 0.0, 0.0), 0.0),
        ("a camera at 10³⁰", (1e30, 0.0, 0.0), 1.0),
        ("a camera whose place is not a number", (math.nan, 0.0, 0.0), 0.0),
    ],
)
def test_cameras(name: str, location: tuple[float, float, float], transition: float) -> None:
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(start=2.0, end=4.0))
    add_camera(location)
    points = points_of(evaluate(obj)).astype(np.float64)
    expected = FOUR.targets if transition else FOUR.points
    worst = float(np.abs(points - expected).max()) if points.shape == expected.shape else math.inf
    holds(GROUP, name, f"closed form: all leaves, a = {transition:g}", math.inf if math.isnan(worst) else worst, 0.0)


def test_a_camera_at_infinity() -> None:
    """Infinity times zero is not a number. Leaves must be at rest or on the billboards, and complete."""
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(start=2.0, end=4.0))
    add_camera((math.inf, 0.0, 0.0))
    points = points_of(evaluate(obj))
    whole = points.shape == FOUR.points.shape and any((points == ends).all() for ends in (FOUR.points, FOUR.targets))
    holds(GROUP, "a camera at infinity", "definition: all leaves, a = 0 or a = 1", float(not whole), 0.0)


@pytest.mark.parametrize("keep", [0.0, 1e-30, 1e-3, 0.5, 1.0 - 2.0**-24, 1.0])
def test_pruning_by_nodes_beside_the_law(keep: float) -> None:
    """The nodes use single precision. The core's formula is the reference for the drawn leaves and their area."""
    leaves = many_leaves(1000)
    obj = place(build(leaves))
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0)), transition=0.0, keep=keep)
    points = points_of(evaluate(obj)).astype(np.float64)
    drawn = np.linalg.norm(np.cross(*np.moveaxis(np.diff(points.reshape(-1, 3, 3), axis=1), 1, 0)), axis=1) / 2.0
    scale = leafcloud.area_scale(leaves.ranks, leaves.areas, keep=float(np.float32(keep)))
    ramp = np.array([leafcloud.leaf_scale(float(rank), float(np.float32(keep))) for rank in leaves.ranks])
    expected = float((leaves.areas * (scale * ramp) ** 2).sum())
    worst = abs(drawn.sum() - expected) / leaves.areas.sum() if np.isfinite(points).all() else math.inf
    holds(GROUP, f"area drawn by nodes at λ = {keep:g}, share of all", "the law in f64", float(worst), 5e-5)


def test_one_leaf() -> None:
    leaves = many_leaves(1)
    obj = place(build(leaves))
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0)), transition=0.3, keep=0.01)
    found = points_of(evaluate(obj)).astype(np.float64)
    expected = 0.7 * leaves.points.astype(np.float64) + 0.3 * leaves.targets
    holds(
        GROUP,
        "a tree of one leaf at λ·N < 1",
        "closed form: the leaf at its own size",
        float(np.abs(found - expected).max()),
        1e-5,
    )
    assert bpy.context.scene.camera is None
