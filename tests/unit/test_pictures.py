"""Pictures of the wheel: FLIP of each pixel, text, PNG files in memory, a level during its transition."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from apng import durations_of, frames_of
from numpy.typing import NDArray
from PIL import Image

import leafcloud
from leafcloud import Foliage, LeafcloudError

RANDOM = np.random.default_rng(7)


def picture(columns: int) -> NDArray[np.uint8]:
    """Return a picture (32, 48, 4) with green columns at the left."""
    image = np.zeros((32, 48, 4), np.uint8)
    image[:, :columns] = (20, 200, 40, 255)
    return image


# FLIP


def test_the_map_shows_missing_columns() -> None:
    errors = leafcloud.flip_map(picture(24), picture(12))
    assert (errors.shape, errors.dtype) == ((32, 48), np.float32)
    assert errors.min() >= 0.0
    assert errors.max() <= 1.0
    assert errors[:, 17:20].mean() > 10.0 * max(errors[:, :2].mean(), errors[:, 45:].mean())
    assert not leafcloud.flip_map(picture(24), picture(24)).any()


def test_pictures_of_different_sizes_are_refused() -> None:
    with pytest.raises(LeafcloudError, match="48 × 32 and 48 × 31 pixels"):
        leafcloud.flip_map(picture(3), picture(3)[:31])


# Text


def test_a_line_of_text_has_ink_and_one_height() -> None:
    short, long = (leafcloud.draw_text(text, 14) for text in ("Level 1", "Level 1 → Cross impostor, gj"))
    assert short.dtype == np.uint8
    assert short.shape[0] == long.shape[0]
    assert short.shape[1] < long.shape[1]
    assert short.max() > 200
    assert not short[0].any()


@pytest.mark.parametrize("size", [3.9, 201, float("nan"), "large"])
def test_a_size_of_text_out_of_range_is_refused(size: float) -> None:
    with pytest.raises(LeafcloudError, match="size"):
        leafcloud.draw_text("leaf", size)


# PNG files


def test_an_animation_has_its_frames_and_durations() -> None:
    frames = [picture(columns) for columns in (4, 20, 40)]
    for frame in frames:
        frame[..., 3] = 255
    png = leafcloud.encode_png(frames, milliseconds=[500, 90, 900], colors=8)
    assert durations_of(png) == [0.5, 0.09, 0.9]
    for shown, frame in zip(frames_of(png), frames, strict=True):
        assert np.array_equal(shown, frame[..., :3]), "two colors fit into the palette"
    assert leafcloud.encode_png(frames, milliseconds=[500, 90, 900], colors=8) == png


def test_a_palette_is_close_to_many_colors() -> None:
    colors = RANDOM.integers(40, 90, (32, 32, 4)).astype(np.uint8)
    (shown,) = frames_of(leafcloud.encode_png([colors], colors=256))
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) <= 256
    assert np.abs(shown.astype(int) - colors[..., :3]).max() <= 16


@pytest.mark.parametrize(
    ("count", "options", "said"),
    [
        (0, {}, "0 frames"),
        (2, {}, "2 frames and 0 durations"),
        (1, {"colors": 257}, "257 colors"),
        (2, {"milliseconds": [1, 70000]}, "milliseconds"),
    ],
)
def test_wrong_animations_are_refused(count: int, options: dict, said: str) -> None:
    with pytest.raises(LeafcloudError, match=said):
        leafcloud.encode_png([picture(1)] * count, **options)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "RGB", "P", "L"])
def test_image_files_are_decoded_as_by_pillow(mode: str) -> None:
    """Pillow chooses other filters for smooth rows than for noise."""
    smooth = np.add.outer(np.arange(61), 2 * np.arange(47)).astype(np.uint8)
    rows = np.where(np.arange(61)[:, None] % 3 == 0, RANDOM.integers(0, 256, (61, 47)), smooth).astype(np.uint8)
    image = Image.fromarray(np.stack([rows, rows[::-1], rows, rows[:, ::-1]], axis=2)).convert(mode)
    saved = io.BytesIO()
    image.save(saved, "PNG")
    np.testing.assert_array_equal(leafcloud.decode_image(saved.getvalue()), np.asarray(image.convert("RGBA")))
    with pytest.raises(LeafcloudError, match="cannot be decoded"):
        leafcloud.decode_image(saved.getvalue()[:200])


def test_a_small_file_that_claims_many_pixels_is_refused() -> None:
    saved = io.BytesIO()
    Image.new("RGBA", (1, 1)).save(saved, "PNG")
    header = b"IHDR" + struct.pack(">II", 30_000, 30_000) + saved.getvalue()[24:29]
    content = saved.getvalue()[:12] + header + struct.pack(">I", zlib.crc32(header)) + saved.getvalue()[33:]
    with pytest.raises(LeafcloudError, match="cannot be decoded"):
        leafcloud.decode_image(content)


# Transitions


def leaves(count: int = 300) -> Foliage:
    places, along, across = RANDOM.uniform(-0.5, 0.5, (3, count, 3))
    corners = np.stack([places, places + 0.2 * along, places + 0.2 * across], axis=1)
    return Foliage(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def shown(foliage: Foliage, like: Foliage) -> NDArray[np.int64]:
    centre = like.world_centre.tolist()
    return leafcloud.render([foliage], (1.0, 0.3, 0.2), 64, centre=centre, radius=like.radius)[..., 3].astype(int)


@pytest.mark.parametrize("keep", [None, 0.5])
def test_leaves_morph_from_their_places_to_their_planes(keep: float | None) -> None:
    foliage = leaves()
    chain = leafcloud.build_chain(foliage, levels=2, cross=True, texture_size=256, every_level=True, keep=keep)
    first, second, cross = chain.levels
    begin, middle, end = (first.morphed(foliage, a) for a in (0.0, 0.5, 1.0))
    kept = 300 if chain.kept is None else len(chain.kept[0])
    assert begin.triangle_count == end.triangle_count == kept
    if keep is None:
        assert np.array_equal(shown(begin, foliage), shown(foliage, foliage))
    near, far = (np.abs(shown(each, foliage) - shown(begin, foliage)).sum() for each in (middle, end))
    assert 0 < near < far
    on_planes = end.area
    assert on_planes == pytest.approx(areas(first.targets).sum(), rel=1e-6)
    assert second.morphed(first.foliage(), 0.5).triangle_count == first.triangles
    with pytest.raises(LeafcloudError, match="cross impostor"):
        cross.morphed(second.foliage(), 0.5)


def areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.linalg.norm(np.cross(first, second), axis=1) / 2.0


def test_another_foliage_and_wrong_transitions_are_refused() -> None:
    foliage = leaves()
    level = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=256, every_level=True).levels[0]
    with pytest.raises(LeafcloudError, match="7 triangles"):
        level.morphed(leaves(7), 0.5)
    for a in (-0.1, 1.1, float("nan")):
        with pytest.raises(LeafcloudError, match="a is"):
            level.morphed(foliage, a)
