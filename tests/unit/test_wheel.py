"""The wheel: its arrays, options, jobs and errors. No input may crash Python."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest
from night import rest_at_night

import leafcloud
from leafcloud import Foliage, LeafcloudError, Material


def squares(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return randomly placed and rotated leaves of side 0.2 in the unit cube: positions (4n, 3), triangles (2n, 3)."""
    random = np.random.default_rng(seed)
    places = random.random((count, 3))
    frames = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.1
    positions = places[:, None] + np.einsum("ck,nkd->ncd", corners, frames[:, :2])
    triangles = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(count)[:, None, None]
    return positions.reshape(-1, 3), triangles.reshape(-1, 3)


@pytest.fixture
def foliage() -> Foliage:
    return Foliage(*squares(200))


def test_frame_and_leaves(foliage: Foliage) -> None:
    positions, _ = squares(200)
    centre = (positions.min(0) + positions.max(0)) / 2
    np.testing.assert_allclose(foliage.centre, centre, atol=1e-15)
    assert foliage.radius == pytest.approx(np.linalg.norm(positions - centre, axis=1).max(), rel=1e-12)
    assert (foliage.triangle_count, foliage.leaf_count) == (400, 200)
    np.testing.assert_array_equal(foliage.leaf_ids, np.repeat(np.arange(200), 2))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("index", [np.int32, np.uint32, np.int64])
def test_array_types(dtype: Any, index: Any) -> None:
    positions, triangles = squares(5)
    assert Foliage(positions.astype(dtype), triangles.astype(index)).leaf_count == 5
    assert Foliage(np.asfortranarray(positions.astype(dtype)), triangles.astype(index)[::-1]).leaf_count == 5


@pytest.mark.parametrize("epsilon", [0.02, 0.04, 0.3])
def test_epsilon_holds_for_every_vertex(foliage: Foliage, epsilon: float) -> None:
    cloud = leafcloud.fit(foliage, epsilon=epsilon)
    positions, triangles = squares(200)
    planes = cloud.planes[cloud.parents]
    heights = np.einsum("tcd,td->tc", positions[triangles], planes[:, :3]) - planes[:, 3:]
    assert np.abs(heights).max() <= epsilon * foliage.radius
    np.testing.assert_allclose(np.abs(heights).max(axis=1), cloud.deviations, atol=1e-12)
    assert cloud.max_deviation <= cloud.epsilon == pytest.approx(epsilon)
    np.testing.assert_allclose(np.linalg.norm(cloud.planes[:, :3], axis=1), 1.0, atol=1e-12)


def test_whole_leaves_keeps_both_triangles_of_a_leaf_together(foliage: Foliage) -> None:
    whole = leafcloud.fit(foliage, whole_leaves=True)
    parents = whole.parents.reshape(-1, 2)
    assert (parents[:, 0] == parents[:, 1]).all()
    parted = leafcloud.fit(foliage)
    assert len(parted.planes) <= len(whole.planes)


def test_methods_and_efforts(foliage: Foliage) -> None:
    literal, last = (len(leafcloud.fit(foliage, effort=effort).planes) for effort in ("literal", "final"))
    assert last <= literal
    assert len(leafcloud.fit(foliage, method="density").planes) > 1
    clustered = leafcloud.fit(foliage, method="kmeans", max_billboards=9)
    assert len(clustered.planes) == 9
    assert clustered.max_deviation <= clustered.epsilon


def test_budgets_make_epsilon_the_result(foliage: Foliage) -> None:
    few = leafcloud.fit(foliage, max_billboards=20)
    assert len(few.planes) <= 20
    assert few.epsilon > 0.04
    assert leafcloud.fit(foliage, max_texels=50_000).epsilon > 0.04


def test_shapes_and_preferences(foliage: Foliage) -> None:
    plain = leafcloud.fit(foliage)
    assert len(leafcloud.fit(foliage, max_size=0.3).planes) > len(plain.planes)
    assert len(leafcloud.fit(foliage, compact=0.1).planes) > len(plain.planes)
    upright = leafcloud.fit(foliage, vertical=0.95, facing=0.0)
    assert np.abs(upright.planes[:, 2]).mean() < np.abs(plain.planes[:, 2]).mean()
    seen = leafcloud.fit(foliage, views=[(1, 0, 0)], facing_views=0.95, facing=0.0)
    assert np.abs(seen.planes[:, 0]).mean() > np.abs(plain.planes[:, 0]).mean()
    near = leafcloud.fit(foliage, image_epsilon=0.01, viewing_distance=1.5)
    assert near.max_deviation <= 0.015


def test_a_job_has_an_answer_before_its_end(foliage: Foliage) -> None:
    job = leafcloud.start_fit(foliage, effort="best")
    deadline = time.monotonic() + 60
    while job.best is None and time.monotonic() < deadline:
        time.sleep(0.001)
    job.cancel()
    with contextlib.suppress(leafcloud.CancelledError):
        job.result()
    assert job.best is not None
    assert len(job.best.parents) == 400
    assert job.best.max_deviation <= 0.04


@pytest.mark.parametrize("most", rest_at_night([4, 5, 8]))
def test_polygons_are_convex_and_have_at_most_as_many_corners_as_asked(foliage: Foliage, most: int) -> None:
    chain = leafcloud.build_chain(foliage, epsilon=0.1, texture_size=256, levels=2, max_corners=most)
    first, second, cross = chain.levels
    sizes = first.polygon_sizes
    assert sizes.min() >= 3
    assert sizes.max() <= most
    assert first.corners.shape == (sizes.sum(), 3)
    assert first.uvs.shape == (sizes.sum(), 2)
    assert set(first.polygon_billboards) == set(range(len(first.ranks)))
    assert first.triangles == first.foliage().triangle_count == sizes.sum() - 2 * len(sizes)
    assert second.targets.shape == (first.triangles, 3, 3)
    assert set(cross.polygon_billboards) == {0, 1, 2}
    # They wind around the plane's normal. Overlaps of a tenth of a texel may bend a straight edge.
    assert first.cloud is not None
    normals = first.cloud.planes[first.plane_ids[first.polygon_billboards], :3]
    for corners, normal in zip(np.split(first.corners, np.cumsum(sizes)[:-1]), normals, strict=True):
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(edges, axis=1)
        turns = np.cross(edges, np.roll(edges, -1, axis=0)) @ normal
        assert turns.min() >= -0.1 * first.texel_size * lengths.max()
    # Polygons of one billboard keep one parent.
    assert second.cloud is not None
    owners = np.repeat(first.polygon_billboards, sizes - 2)
    for billboard in range(len(first.ranks)):
        assert len(set(second.cloud.parents[owners == billboard])) == 1


@pytest.mark.parametrize("wished", rest_at_night([12, 40, 200]))
def test_a_wished_number_of_triangles_is_met(foliage: Foliage, wished: int) -> None:
    [level] = leafcloud.build_chain(foliage, levels=1, cross=False, triangles=wished).levels
    assert level.triangles <= wished


@pytest.mark.night
def test_pages_fit_themselves_unless_a_size_is_given(foliage: Foliage) -> None:
    shape: dict[str, Any] = {"levels": 1, "cross": False, "epsilon": 0.1}
    [level] = leafcloud.build_chain(foliage, **shape).levels
    height, width = level.base_color.shape[:2]
    # A texel is at most half a pixel where the deviation appears 8 pixels large, and larger on a page of half the size.
    pixel = level.max_deviation_leaves * foliage.radius / 8.0
    assert 2.0 * level.texel_size <= pixel < 5.0 * level.texel_size
    assert max(width, height) <= 1024
    [given] = leafcloud.build_chain(foliage, texture_size=2048, **shape).levels
    assert given.base_color.shape[:2] == (2048, 2048)


def test_seeds_repeat(foliage: Foliage) -> None:
    first, again, other = (leafcloud.fit(foliage, seed=seed) for seed in (1, 1, 2))
    assert first.planes.tobytes() == again.planes.tobytes()
    assert first.planes.tobytes() != other.planes.tobytes()


def test_chain(foliage: Foliage) -> None:
    chain = leafcloud.build_chain(foliage, texture_size=256, levels=2, min_visibility=0.0)
    first, second, cross = chain.levels
    assert [level.method for level in chain.levels] == ["stochastic", "stochastic", "cross"]
    assert sorted(chain.ranks) == pytest.approx(np.arange(200) / 200)
    assert first.cloud is not None
    assert second.cloud is not None
    assert cross.cloud is None
    assert first.targets.shape == (400, 3, 3)
    assert second.targets.shape == (first.triangles, 3, 3)
    assert cross.targets.shape == (0, 3, 3)
    planes = first.cloud.planes[first.cloud.parents]
    on_plane = np.einsum("tcd,td->tc", first.targets, planes[:, :3]) - planes[:, 3:]
    assert np.abs(on_plane).max() <= 0.04 * foliage.radius / 4096  # what keeps the depth order
    np.testing.assert_allclose(first.pivots, positions_of_leaves(), atol=1e-12)
    assert first.base_color.shape == (256, 256, 4)
    assert second.base_color.shape == (128, 128, 4)
    assert first.uvs.min() >= 0
    assert first.uvs.max() <= 1
    # Billboards lie on their planes and wind around their normals.
    starts = np.cumsum(first.polygon_sizes) - first.polygon_sizes
    a, b, c = (first.corners[starts + i] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, first.cloud.planes[first.plane_ids[first.polygon_billboards], :3], atol=1e-6)
    assert first.foliage().triangle_count == first.triangles
    # Polygons lie in the rectangles of their billboards.
    left, top, width, height = first.regions[np.repeat(first.polygon_billboards, first.polygon_sizes)].T
    columns, rows = 256.0 * first.uvs[:, 0], 256.0 * (1.0 - first.uvs[:, 1])
    assert ((columns >= left - 1e-3) & (columns <= left + width + 1e-3)).all()
    assert ((rows >= top - 1e-3) & (rows <= top + height + 1e-3)).all()


def test_leaf_visibility_is_measured_only_if_it_orders_the_leaves(foliage: Foliage) -> None:
    """If visibility orders the leaves, pruning removes hidden leaves before visible leaves."""
    shape: dict[str, Any] = {"levels": 1, "cross": False, "texture_size": 128, "epsilon": 0.3, "samples": 1}
    seen, unseen = (leafcloud.build_chain(foliage, order_by_visibility=each, **shape) for each in (True, False))
    assert seen.look_seconds["order"] > 0.0
    assert unseen.look_seconds["order"] == 0.0, "visibility was measured"
    assert (seen.ranks != unseen.ranks).any()
    assert sorted(seen.ranks) == sorted(unseen.ranks)


def positions_of_leaves() -> np.ndarray:
    positions, _ = squares(200)
    return np.repeat(positions.reshape(-1, 4, 3).mean(axis=1), 2, axis=0)


def test_ctrl_c_ends_a_long_fit(foliage: Foliage) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # A background process ignores the signal.
    threading.Timer(0.3, signal.raise_signal, [signal.SIGINT]).start()
    with pytest.raises(KeyboardInterrupt):
        leafcloud.fit(foliage, effort="best", epsilon=0.005)
    signal.signal(signal.SIGINT, before)


def test_progress_is_called_on_the_caller_s_thread(foliage: Foliage) -> None:
    threads: set[int] = set()
    leafcloud.fit(foliage, progress=lambda *_: threads.add(threading.get_ident()))
    assert threads == {threading.get_ident()}


def test_progress_is_told_and_cancels(foliage: Foliage) -> None:
    told: list[tuple[str, float]] = []
    leafcloud.fit(foliage, progress=lambda stage, fraction: told.append((stage, fraction)))
    fractions = [fraction for _, fraction in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    with pytest.raises(leafcloud.CancelledError):
        leafcloud.fit(foliage, progress=lambda stage, fraction: False)
    with pytest.raises(ZeroDivisionError):
        leafcloud.fit(foliage, progress=lambda stage, fraction: bool(1 / 0))


def test_other_threads_run_while_the_core_works(foliage: Foliage) -> None:
    ticks = 0
    stop = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not stop.wait(0.001):
            ticks += 1

    thread = threading.Thread(target=tick)
    thread.start()
    leafcloud.fit(foliage, effort="literal", candidates=20_000)
    stop.set()
    thread.join()
    assert ticks > 5


def test_job(foliage: Foliage) -> None:
    job = leafcloud.start_chain(foliage, texture_size=128, epsilon=0.1, levels=2)
    chain = job.result(timeout=60)
    assert job.done
    assert job.fraction == 1.0
    assert job.best is not None
    assert len(chain.levels) == 3
    expected = leafcloud.build_chain(foliage, texture_size=128, epsilon=0.1)
    assert chain.levels[0].base_color.tobytes() == expected.levels[0].base_color.tobytes()


def test_job_cancels_before_its_end_and_times_out(foliage: Foliage) -> None:
    job = leafcloud.start_fit(foliage, effort="literal", candidates=1_000_000)
    with pytest.raises(TimeoutError, match=r"0\.05"):
        job.result(timeout=0.05)
    assert not job.done
    job.cancel()
    job = leafcloud.start_chain(foliage, texture_size=128)
    job.cancel()
    with pytest.raises(leafcloud.CancelledError):
        job.result()
    assert job.fraction < 1.0


def test_job_keeps_its_error(foliage: Foliage) -> None:
    job = leafcloud.start_fit(foliage, epsilon=-1)
    for _ in range(2):
        with pytest.raises(LeafcloudError, match="`epsilon` is -1"):
            job.result(timeout=10)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epsilon": 0}, "`epsilon` is 0"),
        ({"epsilon": float("nan")}, "`epsilon` is NaN"),
        ({"epsilon": "wide"}, "epsilon is 'wide'"),
        ({"candidates": 0}, "`candidates` is 0"),
        ({"candidates": -1}, "candidates is -1"),
        ({"effort": "huge"}, "effort .huge. is unknown"),
        ({"method": "kmeans"}, "`method=kmeans` needs `max_billboards`"),
        ({"max_billboards": 0}, "`max_billboards` is 0"),
        ({"max_texels": 1}, "`max_texels` is 1"),
        ({"max_size": 0.01}, "`max_size` is 0.01"),
        ({"compact": 0.0}, "`compact` is 0"),
        ({"vertical": 2.0}, "`vertical` is 2"),
        ({"views": [(0, 0, 0)]}, "no finite length"),
        ({"views": 3}, "views is 3"),
        ({"image_epsilon": 0.1}, "need each other"),
        ({"image_epsilon": 0.1, "viewing_distance": 0.5}, "`viewing_distance` is 0.5"),
        ({"penalty": -1.0}, "`penalty` is -1"),
        ({"facing": -1}, "`facing` is -1"),
        ({"method": "guess"}, "stochastic"),
        ({"quality": 3}, "unknown option quality"),
    ],
)
def test_wrong_options(foliage: Foliage, options: dict[str, Any], message: str) -> None:
    with pytest.raises(LeafcloudError, match=message):
        leafcloud.fit(foliage, **options)


@pytest.mark.parametrize(
    ("positions", "triangles", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "no triangles"),
        (np.eye(3), [[0, 1, 3]], "index 3"),
        (np.eye(3), [[0, 1, -1]], "index -1"),
        (np.eye(3), [[0.0, 1.0, 2.0]], "integers"),
        (np.eye(3), [[0, 1]], "shape"),
        (np.eye(4), [[0, 1, 2]], "shape"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "vertex 0"),
        (np.full((3, 3), np.inf), [[0, 1, 2]], "not finite"),
        (np.ones((3, 3)), [[0, 1, 2]], "zero area"),
        ("leaves", [[0, 1, 2]], "positions"),
    ],
)
def test_wrong_geometry(positions: Any, triangles: Any, message: str) -> None:
    with pytest.raises(LeafcloudError, match=message):
        Foliage(positions, triangles)


def test_wrong_attributes_and_materials() -> None:
    positions, triangles = np.eye(3), [[0, 1, 2]]
    with pytest.raises(LeafcloudError, match="uvs has the shape"):
        Foliage(positions, triangles, uvs=np.zeros((1, 3)))
    with pytest.raises(LeafcloudError, match="uvs has 2 rows"):
        Foliage(positions, triangles, uvs=np.zeros((2, 2)))
    with pytest.raises(LeafcloudError, match="material id 1"):
        Foliage(positions, triangles, material_ids=[1])
    with pytest.raises(LeafcloudError, match="alpha_mode"):
        Material(alpha_mode="CLIP")  # type: ignore[arg-type]
    with pytest.raises(LeafcloudError, match="3 channels"):
        Material(image=np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(LeafcloudError, match="base color"):
        Material(base_color=(2, 0, 0, 1))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: Material(base_color=(1, 0, 0)), "base_color is .1, 0, 0.; it must be four floats"),
        (
            lambda f: Foliage(np.eye(3), [[0, 1, 2]], materials=["bark"]),
            "materials is .*; it must be a list of Material",
        ),
        (lambda f: leafcloud.fit(f, seed=2**64), "seed is 18446744073709551616; it must be .* between 0 and 2.64 - 1"),
        (lambda f: leafcloud.fit(f, epsilon=1e300), "`epsilon` is 1e300; it must be between"),
        (lambda f: leafcloud.fit(f, progress=3), "progress is 3; it must be a function"),
        (lambda f: leafcloud.build_chain(f, trunk="oak"), "trunk is 'oak'; it must be a Foliage"),
        (lambda f: leafcloud.build_chain(f, levels=0, cross=False), "`levels` is 0 without a cross"),
        (lambda f: leafcloud.build_chain(f, up=(0, 0, 0)), r"^up is \[0.0, 0.0, 0.0\]; it needs a finite length"),
        (lambda f: leafcloud.build_chain(f, quality=1.5), "`quality` is 1.5;"),
        (lambda f: leafcloud.build_chain(f, quality=float("nan")), "`quality` is NaN"),
        (lambda f: leafcloud.build_chain(f, quality=0.5, scene=1.0), "`scene` is 1;"),
        (lambda f: leafcloud.build_chain(f, quality=0.5, sizes=[0.1, 0.5]), "`sizes` is .*the largest first"),
        (lambda f: leafcloud.build_chain(f, sizes=[0.5]), "`sizes` needs `quality`"),
        (lambda f: leafcloud.render([f], (0, 1, 0), -1, centre=(0, 0, 0), radius=1), "size is -1"),
        (lambda f: leafcloud.render([f], (0, 1, 0), 8, centre=(0, 0, 0), radius="wide"), "radius is 'wide'"),
        (
            lambda f: leafcloud.render([f], (0, 1, 0), 8, centre=(0, 0, 0), radius=1, filtered="no"),
            "filtered is 'no'",
        ),
        (lambda f: leafcloud.render([], (0, 1, 0), 8, centre=(0, 0, 0), radius=1), "no parts to render"),
        (lambda f: leafcloud.drawing_cost([], 1.0), "no parts to draw"),
        (lambda f: leafcloud.drawing_cost([f], 0.0), "covers 0.0 pixels"),
        (lambda f: leafcloud.drawing_cost([f], "near"), "scale is 'near'"),
        (lambda f: leafcloud.drawing_cost([f], 1.0, up=(0, 0, 0)), "up is"),
        (lambda f: leafcloud.leaf_scale(1.0, 0.5), "a rank is 1.0"),
        (lambda f: leafcloud.area_scale([0.5], [float("nan")], 0.5), "an area is NaN"),
        (lambda f: leafcloud.switch_distance(float("inf"), 8, 1000, 1), "deviation inf"),
        (lambda f: leafcloud.switch_distance(1, 8, float("inf"), 1), "all finite"),
    ],
)
def test_all_refusals_are_leafcloud_errors(foliage: Foliage, call: Any, message: str) -> None:
    with pytest.raises(LeafcloudError, match=message) as caught:
        call(foliage)
    assert len(str(caught.value)) < 300


def test_a_picture_of_a_square() -> None:
    square = Foliage(
        [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]],
        [[0, 1, 2], [0, 2, 3]],
        materials=[Material(base_color=(1, 0, 0, 1))],
    )
    picture = leafcloud.render([square], (0, -1, 0), 8, centre=(0, 0, 0), radius=2)
    expected = np.zeros((8, 8, 4), np.uint8)
    expected[2:6, 2:6] = (255, 0, 0, 255)
    np.testing.assert_array_equal(picture, expected)


def test_an_unfiltered_picture_is_the_mean_of_its_points() -> None:
    """With three texels per sample, a point shows only the middle texel, in linear light."""
    size, samples = 4, 2
    texels = np.random.default_rng(7).integers(0, 256, (3 * size * samples, 3 * size * samples, 4), dtype=np.uint8)
    texels[..., 3] = 255
    square = Foliage(
        [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]],
        [[0, 1, 2], [0, 2, 3]],
        uvs=[[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]],
        materials=[Material(image=texels)],
    )
    seen = leafcloud.render([square], (0, -1, 0), size, centre=(0, 0, 0), radius=1, samples=samples, filtered=False)
    codes = texels[1::3, 1::3, :3] / 255.0
    light = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    mean = light.reshape(size, samples, size, samples, 3).mean((1, 3))
    expected = np.where(mean <= 0.0031308, mean * 12.92, 1.055 * mean ** (1 / 2.4) - 0.055) * 255.0
    np.testing.assert_allclose(seen[..., :3], expected, atol=0.75)


def test_png_round_trip(tmp_path: Any) -> None:
    import bpy

    pixels = np.random.default_rng(3).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    pixels[..., 3] |= 1  # Blender keeps no color at an alpha of 0.
    path = tmp_path / "picture.png"
    leafcloud.write_png(str(path), pixels)
    image = bpy.data.images.load(str(path))
    read = np.empty(5 * 7 * 4, np.float32)
    image.pixels.foreach_get(read)
    np.testing.assert_allclose(read.reshape(5, 7, 4)[::-1], pixels / 255, atol=1e-6)
    with pytest.raises(LeafcloudError, match=r"nowhere.*picture\.png"):
        leafcloud.write_png(str(tmp_path / "nowhere" / "picture.png"), pixels)


def test_laws() -> None:
    assert leafcloud.keep(20.0, 10.0) == pytest.approx(0.5)
    assert leafcloud.keep(40.0, 10.0, 0.25) == pytest.approx(0.5)
    assert leafcloud.leaf_scale(0.39, 0.4) == pytest.approx(0.5)
    assert leafcloud.area_scale([0.0, 0.25, 0.5, 0.75], [1, 1, 1, 1], 1.0) == 1.0
    # A leaf of rank -1 stays, and the others grow as without it.
    assert leafcloud.leaf_scale(-1.0, 0.5) == 1.0
    assert leafcloud.area_scale([-1.0, 0.25, 0.75], [7, 1, 1], 0.5) == leafcloud.area_scale([0.25, 0.75], [1, 1], 0.5)
    assert leafcloud.transition(3.0, 2.0, 4.0) == 0.5
    assert leafcloud.switch_distance(1.0, 8.0, 1000.0, np.pi / 2) == pytest.approx(62.5)
    for wrong in (lambda: leafcloud.keep(1, 0), lambda: leafcloud.keep(1, 1, 0.6), lambda: leafcloud.leaf_scale(0, 2)):
        with pytest.raises(LeafcloudError):
            wrong()


def test_leaves_are_joined_by_vertices_and_edges_but_not_by_points() -> None:
    """Two triangles share an edge through separate vertices; the third touches it at a point, the fourth is alone."""
    places = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0], [1, 1, 0], [2, 2, 0], [1, 2, 0]]
    positions = np.array([*places, [9, 9, 9], [8, 9, 9], [9, 8, 9]], float)
    triangles = np.array([[9, 10, 11], [0, 1, 2], [3, 4, 5], [6, 7, 8]])
    assert leafcloud.leaf_ids(positions, triangles).tolist() == [0, 1, 1, 2]
    assert leafcloud.Foliage(positions, triangles).leaf_ids.tolist() == [0, 1, 1, 2]
    assert leafcloud.leaf_ids(positions, np.zeros((0, 3), int)).tolist() == []
    with pytest.raises(leafcloud.LeafcloudError, match="triangle index 12 is out of range"):
        leafcloud.leaf_ids(positions, [[0, 1, 12]])


def test_long_strips_and_fans_are_one_leaf_each() -> None:
    order = np.random.default_rng(1).permutation(2000)
    strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
    fan = np.stack([np.full(999, 3000), np.arange(2000, 2999), np.arange(2001, 3000)], axis=1)
    positions = np.arange(3001 * 3).reshape(-1, 3)
    sizes = np.bincount(leafcloud.leaf_ids(positions, np.concatenate([strip, fan])))
    assert sizes.tolist() == [1998, 999]


def test_drawing_costs_are_of_the_world() -> None:
    """A square of 2 × 2 under a scale of 3 has two sides of 36 in the world, and shadows of at most 36 · 10²."""
    square = Foliage(
        [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], [[0, 1, 2], [0, 2, 3]], matrix=np.diag([3.0, 3, 3, 1])
    )
    cost = leafcloud.drawing_cost([square], 10.0)
    assert cost["triangles"] == 2
    assert cost["area"] == pytest.approx(72.0)
    assert cost["layers"] == 1.0
    assert 0.25 * 3600 < cost["fragments"] < 3600
    assert cost["total"] == cost["fragments"] + 2 * leafcloud.FRAGMENTS_PER_TRIANGLE
    both = leafcloud.drawing_cost([square, square], 10.0)
    assert (both["fragments"], both["layers"]) == (2 * cost["fragments"], 2.0)
