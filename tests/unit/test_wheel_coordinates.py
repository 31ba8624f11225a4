"""Foliage with a matrix equals foliage moved to the world beforehand, with results moved back by numpy in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from night import rest_at_night
from numpy.typing import NDArray

import leafcloud
from leafcloud import Foliage, LeafcloudError, Material

Array = NDArray[Any]
LEAVES = 60
OPTIONS: dict[str, Any] = {
    "levels": 2,
    "texture_size": 256,
    "epsilon": 0.2,
    "candidates": 60,
    "samples": 2,
    "normals": 0.5,
    "back_sides": True,
}


def tree() -> tuple[Array, Array, dict[str, Any]]:
    """Single-sided leaves of two triangles: positions, triangles and values per corner."""
    random = np.random.default_rng(7)
    frames = np.linalg.qr(random.normal(size=(LEAVES, 3, 3)))[0]
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.15
    corners = random.random((LEAVES, 1, 3)) + np.einsum("ck,nkd->ncd", square, frames[:, :2])
    triangles = (np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(LEAVES)[:, None, None]).reshape(-1, 3)
    image = random.integers(0, 256, (8, 8, 4), np.uint8)
    image[..., 3] = 255
    per_corner = {
        "uvs": np.tile((square / 0.3 + 0.5)[triangles[:2]], (LEAVES, 1, 1)),
        "normals": random.normal(size=(2 * LEAVES, 3, 3)),
        "colors": random.random((2 * LEAVES, 3, 4)),
        "back_colors": random.random((2 * LEAVES, 3, 3)),
    }
    more = {"materials": [Material(image=image, double_sided=False)]}
    return corners.reshape(-1, 3).astype(np.float32), triangles, {**per_corner, **more}


def affine(linear: Array, place: tuple[float, float, float] = (3.0, -2.0, 5.0)) -> Array:
    """Return a matrix (4, 4) of single-precision values, as those of Blender's objects. Then all products with
    single-precision positions are exact in float64, and numpy and the core get the same world bit for bit."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, place
    return matrix.astype(np.float32).astype(np.float64)


TURNED = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURNED *= np.sign(np.linalg.det(TURNED))
MATRICES = {
    "identity": np.eye(4),
    "turned and scaled": affine(2.5 * TURNED),
    "mirrored": affine(TURNED @ np.diag([-2.0, 2.0, 2.0])),
    "far": affine(TURNED, (1e6, -1e6, 5e5)),
    "uneven": affine(TURNED @ np.diag([1.0, 2.0, 0.5])),
    "sheared": affine(np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.3, -2.0]])),
}


def in_world(matrix: Array) -> Foliage:
    """Return the same leaves moved to the world by numpy. A mirror swaps the last two corners of each triangle."""
    positions, triangles, values = tree()
    order = [0, 2, 1] if np.linalg.det(matrix) < 0.0 else [0, 1, 2]
    values["normals"] = values["normals"] @ np.linalg.inv(matrix[:3, :3])
    values["normals"] /= np.linalg.norm(values["normals"], axis=2, keepdims=True)
    per_corner = {name: value[:, order] for name, value in values.items() if name != "materials"}
    moved = positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return Foliage(moved, triangles[:, order], materials=values["materials"], **per_corner)


@pytest.fixture(scope="module", params=rest_at_night(sorted(MATRICES, reverse=True)))
def pair(request: pytest.FixtureRequest) -> tuple[Array, Foliage, Foliage, leafcloud.Chain, leafcloud.Chain]:
    """The matrix, the foliage with it and without, and the chain of each."""
    matrix = MATRICES[request.param]
    positions, triangles, values = tree()
    own, moved = Foliage(positions, triangles, matrix=matrix, **values), in_world(matrix)
    return matrix, own, moved, *(leafcloud.build_chain(each, **OPTIONS) for each in (own, moved))


def test_bounds_are_of_the_world_and_the_center_of_the_tree(pair: Any) -> None:
    matrix, own, moved, *_ = pair
    assert own.radius == moved.radius
    assert own.area == moved.area
    assert own.world_centre.tolist() == moved.centre.tolist() == moved.world_centre.tolist()
    assert own.mirrored == (np.linalg.det(matrix) < 0.0)
    assert not moved.mirrored
    np.testing.assert_allclose(own.centre, back(matrix, moved.centre), atol=rounding(matrix))


def test_levels_come_out_in_the_trees_coordinates(pair: Any) -> None:
    matrix, own, _, chain, expected = pair
    same = {"rtol": 0.0, "atol": rounding(matrix)}
    np.testing.assert_allclose(chain.pivots, back(matrix, expected.pivots), **same)
    for number, (level, wanted) in enumerate(zip(chain.levels, expected.levels, strict=True)):
        for name in ("corners", "pivots", "pivot_targets"):
            np.testing.assert_allclose(getattr(level, name), back(matrix, getattr(wanted, name)), **same)
        targets = wanted.targets[:, [0, 2, 1]] if own.mirrored and number == 0 else wanted.targets
        np.testing.assert_allclose(level.targets, back(matrix, targets), **same)


def test_textures_and_lengths_are_those_of_the_world(pair: Any) -> None:
    *_, chain, expected = pair
    assert chain.ranks.tolist() == expected.ranks.tolist()
    for level, wanted in zip(chain.levels, expected.levels, strict=True):
        for name in ("base_color", "normal", "uvs", "ranks", "plane_ids"):
            np.testing.assert_array_equal(getattr(level, name), getattr(wanted, name))
        for name in ("texel_size", "mean_deviation", "max_deviation_leaves", "in_plane_motion", "coverage"):
            assert getattr(level, name) == getattr(wanted, name)


def test_planes_are_those_of_the_tree(pair: Any) -> None:
    matrix, _, _, chain, expected = pair
    for level, wanted in zip(chain.levels[:2], expected.levels[:2], strict=True):
        assert level.cloud is not None
        assert wanted.cloud is not None
        assert level.cloud.parents.tolist() == wanted.cloud.parents.tolist()
        assert level.cloud.deviations.tolist() == wanted.cloud.deviations.tolist()
        # Planes are row vectors, so they transform by the matrix from the right. Then their normals get length 1.
        planes = np.column_stack([wanted.cloud.planes[:, :3], -wanted.cloud.planes[:, 3]]) @ matrix
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        np.testing.assert_allclose(level.cloud.planes[:, :3], planes[:, :3], atol=1e-12)
        np.testing.assert_allclose(level.cloud.planes[:, 3], -planes[:, 3], atol=rounding(matrix))
        owners = np.repeat(level.polygon_billboards, level.polygon_sizes)
        normals = level.cloud.planes[level.plane_ids[owners]]
        heights = np.einsum("cd,cd->c", level.corners, normals[:, :3]) - normals[:, 3]
        assert np.abs(heights).max() <= rounding(matrix)


def test_a_fit_alone_has_the_same_planes(pair: Any) -> None:
    matrix, own, *_ = pair
    again = leafcloud.fit(own, epsilon=0.2, candidates=60)
    positions, triangles, _ = tree()
    planes = again.planes[again.parents]
    heights = np.einsum("tcd,td->tc", positions[triangles], planes[:, :3]) - planes[:, 3:]
    # Heights in the world are heights in the tree, divided by the length of the transformed normal.
    length = np.linalg.norm(planes[:, :3] @ np.linalg.inv(matrix[:3, :3]), axis=1)
    np.testing.assert_allclose(np.abs(heights).max(axis=1) / length, again.deviations, atol=rounding(matrix))


def test_billboards_as_foliage_stay_in_the_tree(pair: Any) -> None:
    matrix, own, _, chain, expected = pair
    for level, wanted in zip(chain.levels, expected.levels, strict=True):
        shown, other = level.foliage(), wanted.foliage()
        assert shown.mirrored == own.mirrored
        assert shown.world_centre.tolist() == other.centre.tolist()
        np.testing.assert_allclose(shown.centre, back(matrix, other.centre), atol=rounding(matrix))


def test_renders_are_of_the_world(pair: Any) -> None:
    _, own, moved, *_ = pair
    view = {"direction": (1.0, 0.5, 0.2), "size": 48, "centre": own.world_centre.tolist(), "radius": own.radius}
    np.testing.assert_array_equal(leafcloud.render([own], **view), leafcloud.render([moved], **view))


@pytest.mark.night
def test_the_trunk_may_have_a_matrix_of_its_own() -> None:
    positions, triangles, values = tree()
    matrix = MATRICES["mirrored"]
    trunk = np.array([[0.0, 0.0, -1.0], [0.2, 0.0, -1.0], [0.1, 0.1, 1.0]])
    world = trunk @ matrix[:3, :3].T + matrix[:3, 3]
    leaves = Foliage(positions, triangles, matrix=matrix, **values)
    own = leafcloud.build_chain(leaves, trunk=Foliage(trunk, [[0, 1, 2]], matrix=matrix), **OPTIONS)
    moved = leafcloud.build_chain(leaves, trunk=Foliage(world, [[0, 2, 1]]), **OPTIONS)
    np.testing.assert_array_equal(own.levels[-1].base_color, moved.levels[-1].base_color)
    np.testing.assert_array_equal(own.levels[-1].corners, moved.levels[-1].corners)


def changed(row: int, column: int, value: float) -> Array:
    matrix = np.eye(4)
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (changed(0, 0, np.nan), "matrix has the value NaN"),
        (changed(1, 3, np.inf), "matrix has the value inf"),
        (changed(2, 2, 0.0), "matrix has the condition number inf.* must not be singular"),
        (changed(2, 2, 1e-9), "the limit is 1e8"),
        (np.zeros((4, 4)), "last row"),
        (changed(0, 1, 1e200), "matrix has the condition number"),
        (changed(3, 3, 2.0), r"last row \[0.0, 0.0, 0.0, 2.0\]"),
        (affine(np.eye(3)).T, "last row"),
        (np.eye(3), r"shape \[3, 3\]; it must be \(4, 4\)"),
        (np.eye(4)[None], "matrix must be an array of floats of shape"),
        ("identity", "matrix must be an array of floats of shape"),
    ],
)
def test_other_matrices_are_refused(matrix: Any, message: str) -> None:
    positions, triangles, _ = tree()
    with pytest.raises(LeafcloudError, match=message):
        Foliage(positions, triangles, matrix=matrix)


def test_a_matrix_hides_no_value_that_is_not_finite() -> None:
    positions, triangles, values = tree()
    matrix = MATRICES["turned and scaled"]
    for value in (np.nan, np.inf):
        normals = values["normals"].copy()
        normals[0, 0, 0] = value
        with pytest.raises(LeafcloudError, match="normals has a value that is not finite"):
            Foliage(positions, triangles, matrix=matrix, normals=normals)
        with pytest.raises(LeafcloudError, match="vertex 0 lies at"):
            Foliage(np.where(np.arange(3) == 1, value, positions), triangles, matrix=matrix)


def test_a_matrix_may_scale_far_up_and_down() -> None:
    positions, triangles, _ = tree()
    for size in (1e-30, 1e30):
        own = Foliage(positions, triangles, matrix=affine(size * np.eye(3), (0.0, 0.0, 0.0)))
        assert own.radius == pytest.approx(size * Foliage(positions, triangles).radius)
    with pytest.raises(LeafcloudError, match="farther than 1e37"):
        Foliage(positions, triangles, matrix=affine(1e38 * np.eye(3)))


def back(matrix: Array, points: Array) -> Array:
    """Return points (…, 3) of the world in the tree's coordinates."""
    return (points - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T


def rounding(matrix: Array) -> float:
    """Return a bound of the rounding of coordinates in float64, here and in the core."""
    return 1e-14 * (1.0 + np.abs(matrix).max()) * float(np.linalg.cond(matrix[:3, :3]))
