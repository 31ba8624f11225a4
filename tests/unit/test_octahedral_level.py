"""The last level as an octahedral impostor: its pages, drawn by the law, and its place in the tree's coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from octahedral import Impostor, axes, shown, unit

import leafcloud

SIDE = 48


def crown(**more: Any) -> leafcloud.Foliage:
    """Return 300 square leaves of side 0.2 at random in an upright box of 1 × 1 × 2."""
    random = np.random.default_rng(3)
    places = random.random((300, 3)) * [1.0, 1.0, 2.0]
    frames = np.linalg.qr(random.normal(size=(300, 3, 3)))[0]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.1
    positions = (places[:, None] + np.einsum("ck,nkd->ncd", corners, frames[:, :2])).reshape(-1, 3)
    triangles = (np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(300)[:, None, None]).reshape(-1, 3)
    green = leafcloud.Material(base_color=(0.1, 0.4, 0.05, 1.0))
    return leafcloud.Foliage(positions, triangles, materials=[green], **more)


def chain_of(foliage: leafcloud.Foliage, **options: Any) -> leafcloud.Chain:
    return leafcloud.build_chain(foliage, **{"levels": 1, "texture_size": 256, "last": "octahedral", **options})


@pytest.fixture(scope="module")
def level() -> leafcloud.OctahedralLevel:
    last = chain_of(crown()).levels[-1]
    assert isinstance(last, leafcloud.OctahedralLevel)
    return last


def reference(level: leafcloud.OctahedralLevel) -> Impostor:
    numbers = {"extent": level.extent, "grid": level.grid, "texels": level.view_texels}
    return Impostor.of(level.color, level.normal_depth, numbers)


def test_the_level_replaces_the_cross_impostor() -> None:
    chain = chain_of(crown())
    assert [each.method for each in chain.levels] == ["stochastic", "octahedral"]
    assert [each.method for each in chain.clouds] == ["stochastic", "cross"]
    last = chain.levels[-1]
    assert isinstance(last, leafcloud.OctahedralLevel)
    assert last.cross.method == "cross"
    assert (last.triangles, last.cloud, last.color.shape) == (2, None, (1024, 1024, 4))
    assert last.seconds["bake"] > 0.0


def test_it_is_half_as_far_from_the_leaves_as_the_cross_impostor(level: leafcloud.OctahedralLevel) -> None:
    own, cross = level.image_errors(), level.cross.image_errors()
    [number] = [i for i, size in enumerate(own.sizes) if 60.0 < size < 65.0]
    assert own.errors[number] <= 0.5 * cross.errors[number]
    assert level.coverage == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("direction", [(1.0, 0.2, 0.3), (-0.4, 0.7, 0.9), (0.1, -1.0, -0.2), (0.3, 0.3, -1.0)])
def test_it_is_drawn_by_the_law(level: leafcloud.OctahedralLevel, direction: tuple[float, ...]) -> None:
    """The pictures of the core and of the reference, which has the pages alone, are equal to a code and a half."""
    foliage = crown()
    centre, radius = np.asarray(foliage.world_centre), 1.1 * foliage.radius
    picture = level.render(direction, SIDE, centre=centre.tolist(), radius=radius, samples=1)
    eye = unit(np.array(direction))
    right, up = axes(eye)
    steps = 2.0 * (np.arange(SIDE) + 0.5) / SIDE - 1.0
    across, upward = np.meshgrid(steps, -steps)
    world = centre + radius * (across[..., None] * right + upward[..., None] * up).reshape(-1, 3)
    points = world @ level.to_layout[:, :3].T + level.to_layout[:, 3]
    found, _, _ = shown(reference(level), points, np.tile(eye, (len(points), 1)))
    assert np.abs(found[:, 3] * 255.0 - picture[..., 3].ravel()).max() <= 1.5
    solid = found[:, 3] > 0.1
    encoded = np.where(found <= 0.0031308, 12.92 * found, 1.055 * np.maximum(found, 1e-9) ** (1.0 / 2.4) - 0.055)
    assert np.abs(encoded[solid, :3] * 255.0 - picture.reshape(-1, 4)[solid, :3]).max() <= 1.5
    assert solid.mean() > 0.2


@pytest.mark.night
def test_the_transform_is_that_of_the_trees_coordinates() -> None:
    """A tree that is moved, turned, mirrored and scaled has the same impostor; only its transform differs."""
    turn = np.array([[0.0, -3.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 0.0, 3.0]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, (10.0, -20.0, 5.0)
    [plain, placed] = [chain_of(crown(**more)).levels[-1] for more in ({}, {"matrix": matrix})]
    assert isinstance(plain, leafcloud.OctahedralLevel)
    assert isinstance(placed, leafcloud.OctahedralLevel)
    assert placed.extent == pytest.approx(plain.extent)
    point = np.array([0.3, 0.9, 1.2])
    there, its = (each.to_layout[:, :3] @ point + each.to_layout[:, 3] for each in (plain, placed))
    # The world's axes stay the layout's, so a turned tree is turned there: (x, y) of the tree is (−y, −x).
    assert its == pytest.approx([-there[1], -there[0], there[2]], abs=1e-9)
    assert placed.texel_size == pytest.approx(3.0 * plain.texel_size)


def test_wrong_options_are_refused() -> None:
    with pytest.raises(leafcloud.LeafcloudError, match=r'last is "sphere"; use "auto", "cross" or "octahedral"'):
        chain_of(crown(), last="sphere")
    with pytest.raises(leafcloud.LeafcloudError, match="cross"):
        chain_of(crown(), cross=False)


def test_auto_needs_a_target() -> None:
    assert chain_of(crown(), last="auto").levels[-1].method == "cross"


def test_cost(level: leafcloud.OctahedralLevel) -> None:
    [one, twice] = [level.drawing_cost(scale) for scale in (10.0, 20.0)]
    assert twice["fragments"] == pytest.approx(4.0 * one["fragments"])
    assert one["triangles"] == 2


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ({"direction": (0, 0, 0)}, "direction"),
        ({"radius": -1.0}, "the radius -1.0"),
        ({"radius": float("nan")}, "the radius NaN"),
        ({"centre": (0, float("inf"), 0)}, "the view's centre is"),
        ({"up": (0, 0, float("nan"))}, "the view's up is"),
    ],
)
def test_a_picture_of_no_view_is_refused(level: leafcloud.OctahedralLevel, view: dict[str, Any], message: str) -> None:
    with pytest.raises(leafcloud.LeafcloudError, match=message):
        level.render(**{"direction": (1, 0, 0), "size": 8, "centre": (0, 0, 0), "radius": 1.0, **view})


def test_a_cost_needs_a_size_and_a_direction(level: leafcloud.OctahedralLevel) -> None:
    with pytest.raises(leafcloud.LeafcloudError, match="covers NaN pixels"):
        level.drawing_cost(float("nan"))
    with pytest.raises(leafcloud.LeafcloudError, match="up is"):
        level.drawing_cost(10.0, up=(0, 0, 0))


def test_a_picture_of_too_many_samples_is_refused(level: leafcloud.OctahedralLevel) -> None:
    with pytest.raises(leafcloud.LeafcloudError, match=r"8192 samples there.*lower `size` or `samples`"):
        level.render((1, 0, 0), 2048, centre=(0, 0, 0), radius=1.0, samples=4)
    level.render((1, 0, 0), 128, centre=(0, 0, 0), radius=1.0, samples=4)
