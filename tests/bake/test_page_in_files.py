"""Files hold the baked atlas page. Its coverage holds on box-filtered mips, for fractional alpha and for cutouts.

The oracle computes means of 2 × 2 texels, and pictures from sides that no tuning uses.
"""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path
from typing import Literal

import bpy
import numpy as np
import pytest
from bakes import kept
from box_mips import box_filtered, linear
from command_line import report_in
from glb import read_chunks, read_glb
from numpy.typing import NDArray
from PIL import Image

import leafcloud


def ball(leaves: int) -> leafcloud.Foliage:
    """Return triangles in all directions in a ball: dark ones within, bright ones outside."""
    random = np.random.default_rng(11)
    middles = random.normal(size=(leaves, 3))
    middles *= (random.uniform(0.3, 1.0, leaves) / np.linalg.norm(middles, axis=1))[:, None]
    along, across = random.normal(size=(2, leaves, 3))
    sides = [0.25 * each / np.linalg.norm(each, axis=1)[:, None] for each in (along, across)]
    corners = np.stack([middles, middles + sides[0], middles + sides[1]], axis=1).reshape(-1, 3)
    dark, bright = (leafcloud.Material(base_color=(*color, 1.0)) for color in ((0.02, 0.1, 0.02), (0.3, 0.5, 0.1)))
    outside = (np.linalg.norm(middles, axis=1) > 0.7).astype(int).tolist()
    triangles = np.arange(3 * leaves).reshape(-1, 3)
    return leafcloud.Foliage(corners, triangles, material_ids=outside, materials=[dark, bright])


def blades() -> leafcloud.Foliage:
    """Return slender leaves in all directions."""
    random = np.random.default_rng(5)
    middles, along = random.uniform(-1.0, 1.0, (2, 400, 3))
    across = np.cross(along, random.uniform(-1.0, 1.0, (400, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    corners = np.stack([middles - 0.03 * across, middles + 0.03 * across, middles + 0.3 * along], axis=1)
    return leafcloud.Foliage(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))


def pictured(foliage: leafcloud.Foliage, base: leafcloud.Foliage) -> tuple[float, NDArray[np.float64]]:
    """Return the covered pixels and the mean linear color of pictures from 24 sides."""
    random, covered, light = np.random.default_rng(7), 0.0, np.zeros(3)
    for direction in random.normal(size=(24, 3)):
        sphere = {"centre": base.world_centre.tolist(), "radius": 1.1 * base.radius}
        codes = leafcloud.render([foliage], direction.tolist(), 96, samples=4, **sphere) / 255.0
        covered += codes[..., 3].sum()
        light += (linear(codes[..., :3]) * codes[..., 3:]).sum(axis=(0, 1))
    return covered, light / covered


def drawn(level: leafcloud.Level, image: NDArray[np.uint8], mode: Literal["MASK", "BLEND"]) -> leafcloud.Foliage:
    """Return the billboards with another image, cut out at the level's cutoff or drawn as a share."""
    sizes = level.polygon_sizes.tolist()
    firsts = itertools.accumulate(sizes[:-1], initial=0)
    fans = [(a, a + i, a + i + 1) for a, n in zip(firsts, sizes, strict=True) for i in range(1, n - 1)]
    leaf = leafcloud.Material(image=image, alpha_mode=mode, alpha_cutoff=level.alpha_cutoff)
    return leafcloud.Foliage(level.corners, np.array(fans), uvs=level.uvs, materials=[leaf])


@pytest.fixture(scope="module", params=["ball", "blades"])
def pair(request: pytest.FixtureRequest) -> tuple[leafcloud.Foliage, leafcloud.Level]:
    """Return leaves and their level 1, with two texels a pixel where it takes over. Blades are a pixel wide there."""
    leaves = ball(500) if request.param == "ball" else blades()
    [level] = leafcloud.build_chain(leaves, levels=1, cross=False, epsilon=0.08, pixels=6.0).levels
    return leaves, level


def test_shares_cover_as_much_as_the_leaves_on_all_mips(pair: tuple[leafcloud.Foliage, leafcloud.Level]) -> None:
    leaves, level = pair
    wanted, color = pictured(leaves, leaves)
    for number, mip in enumerate(box_filtered(level.base_color)[:4]):
        covered, light = pictured(drawn(level, mip, "BLEND"), leaves)
        # Mips 1 and 2 are seen where the level takes over, mip 3 at half or a quarter of that size.
        assert covered / wanted == pytest.approx(1.0, abs=[0.08, 0.04, 0.04, 0.12][number]), number
        assert light / color == pytest.approx(1.0, abs=0.05), number


def test_cut_out_pages_cover_as_much_as_the_leaves_where_they_take_over(
    pair: tuple[leafcloud.Foliage, leafcloud.Level],
) -> None:
    """With many samples of the page itself, and with one sample at a mip level; less and less on the ones behind."""
    leaves, level = pair
    wanted, _ = pictured(leaves, leaves)
    mips = box_filtered(level.base_color)[:4]
    found = [pictured(drawn(level, mip, "MASK"), leaves)[0] / wanted for mip in mips]
    assert found[0] == pytest.approx(1.0, abs=0.04)
    assert found[1] == pytest.approx(1.0, abs=0.06)
    assert 0.3 <= level.alpha_cutoff <= 0.6


def test_mips_of_ktx2_keep_the_share_above_the_cutoff(pair: tuple[leafcloud.Foliage, leafcloud.Level]) -> None:
    _, level = pair
    mips, cutoff = level.mips("base_color"), level.alpha_cutoff
    assert np.array_equal(mips[0], level.base_color)
    filtered = box_filtered(level.base_color)
    plain, kept = ([places_above(level, image, cutoff) for image in images[:4]] for images in (filtered, mips))
    assert plain[3] < 0.9 * plain[0], "without them much is lost"
    # The texels of regions count here, those on polygons in the core.
    assert kept[1:] == pytest.approx(3 * [kept[0]], rel=0.25)


def test_alpha_pivots_tell_the_share_that_alpha_stands_for(pair: tuple[leafcloud.Foliage, leafcloud.Level]) -> None:
    _, level = pair
    cutoff = level.alpha_cutoff
    mips, pivots = level.mips("base_color"), level.alpha_pivots()
    assert (len(pivots), pivots[0]) == (len(mips), pytest.approx(cutoff, abs=1e-3))
    inside = mips[2][..., 3] > 0  # Polygons' regions with their gutters; alpha lies nowhere else.
    alpha, pivot = mips[2][..., 3][inside] / 255.0, pivots[2]
    below, above = pivot * alpha / cutoff, pivot + (1.0 - pivot) * (alpha - cutoff) / (1.0 - cutoff)
    share = np.where(alpha < cutoff, below, above)
    assert np.abs(share - box_filtered(level.base_color)[2][..., 3][inside] / 255.0).max() < 0.02


def places_above(level: leafcloud.Level, image: NDArray[np.uint8], cutoff: float) -> float:
    """Count the texels of all billboards with alpha at or above the cutoff, and return their share."""
    scale = len(level.base_color) // len(image)
    above = count = 0
    for left, top, width, height in level.regions.astype(int):
        part = image[top // scale : -(-(top + height) // scale), left // scale : -(-(left + width) // scale), 3]
        above, count = above + int((part >= 255.0 * cutoff).sum()), count + part.size
    return above / count


def test_files_hold_the_page_of_the_blend_file() -> None:
    """All channels, bit for bit, and the cutoff; also the size that was asked for."""
    folder = kept("--texture-size", 256, "--epsilon", 0.1, "--levels", 1, "--no-cross", "--effects", "all")
    [primitive] = read_glb(folder / "shrub.glb")["shrub_LOD1"].primitives
    files = {name: image for name, image in images_in(folder / "shrub.glb").items() if "LOD1" in name}
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shrub.blend"))
    nodes = bpy.data.materials["shrub_LOD1"].node_tree.nodes
    assert primitive.material["alphaCutoff"] == pytest.approx(nodes["Leafcloud Cutoff"].inputs[1].default_value)
    assert {"shrub_LOD1", "shrub_LOD1_normal", "shrub_LOD1_orm", "shrub_LOD1_translucency"} <= set(files)
    for name, image in files.items():
        if "leaf" in name or "octahedral" in name:
            continue
        blend = np.array(bpy.data.images[name].pixels[:]).reshape(256, 256, 4)[::-1]
        shown = image[..., 3] > 0
        assert image.shape == (256, 256, 4), name
        assert np.abs(blend - image / 255.0)[shown].max() < 1e-6, name


def test_texels_in_files_are_about_half_a_pixel_large_where_the_level_takes_over() -> None:
    folder = kept("--epsilon", 0.1, "--pixels", 3, "--levels", 1, "--no-cross")
    report = report_in(folder)
    content, binary = read_chunks(folder / "shrub.glb")
    level = report["levels"][1]
    [page] = [image for image in content["images"] if image["name"] == "shrub_LOD1"]
    start = content["bufferViews"][page["bufferView"]].get("byteOffset", 0)
    size = [int.from_bytes(binary[start + at : start + at + 4], "big") for at in (16, 20)]
    pixel = 2.0 * level["switch_distance"] * math.tan(math.radians(25.0)) / 1080.0
    assert 0.25 < texel_size(folder / "shrub.glb", size) / pixel <= 0.51


def texel_size(file: Path, size: list[int]) -> float:
    """Return the side of a texel on the billboards of a level, from positions and texture coordinates."""
    [primitive] = read_glb(file)["shrub_LOD1"].primitives
    corners = primitive.attributes["POSITION"].astype(float)[primitive.indices]
    uvs = primitive.attributes["TEXCOORD_0"].astype(float)[primitive.indices] * size
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    first, second = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    texels = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return math.sqrt(areas.sum() / texels.sum())


def images_in(file: Path) -> dict[str, NDArray[np.uint8]]:
    """Return the images (h, w, 4) in a file by name."""
    content, binary = read_chunks(file)
    found = {}
    for image in content["images"]:
        view = content["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        with Image.open(io.BytesIO(binary[start : start + view["byteLength"]])) as picture:
            found[image["name"]] = np.asarray(picture.convert("RGBA"))
    return found
