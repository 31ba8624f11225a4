"""Base color for engines, which make box-filtered mips: a crown keeps its density at a distance.

The oracle computes means of 2 × 2 texels, and bilinear alpha at random places on the drawn triangles.
"""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from box_mips import box_filtered, linear
from command_line import QUICK, bake
from glb import read_chunks, read_glb
from numpy.typing import NDArray
from PIL import Image

import leafcloud

PLACES = 100_000


def places(level: leafcloud.Level) -> NDArray[np.float64]:
    """Return places on the drawn triangles (n, 2): columns and rows from the top left, as shares of the page."""
    sizes = level.polygon_sizes.tolist()
    firsts = itertools.accumulate(sizes[:-1], initial=0)
    spans = zip(firsts, sizes, strict=True)
    fans = [(start, start + i, start + i + 1) for start, size in spans for i in range(1, size - 1)]
    uvs = np.asarray(level.uvs, np.float64)
    corners = np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)[np.array(fans)]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    random = np.random.default_rng(1)
    chosen = random.choice(len(areas), PLACES, p=areas / areas.sum())
    shares = random.random((PLACES, 2))
    beyond = shares.sum(axis=1) > 1.0
    shares[beyond] = 1.0 - shares[beyond]
    return corners[chosen, 0] + (sides[chosen] * shares[:, :, None]).sum(axis=1)


def bilinear(alpha: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return alpha at places, between texel centers."""
    height, width = alpha.shape
    place = at * (width, height) - 0.5
    low = np.floor(place).astype(int)
    share = place - low
    columns, rows = (np.clip([low[:, i], low[:, i] + 1], 0, size - 1) for i, size in enumerate((width, height)))
    near, far = (alpha[row, columns[0]] * (1 - share[:, 0]) + alpha[row, columns[1]] * share[:, 0] for row in rows)
    return near * (1 - share[:, 1]) + far * share[:, 1]


def shown(pixels: NDArray[np.uint8], cutoff: float, level: leafcloud.Level, mips: int = 0) -> list[float]:
    """Return the share of the drawn triangles above the cutoff, for the page and so many box-filtered mips."""
    alpha, at, found = pixels[..., 3] / 255.0, places(level), []
    for _ in range(mips + 1):
        found.append(float((bilinear(alpha, at) >= cutoff).mean()))
        alpha = (alpha[::2, ::2] + alpha[1::2, ::2] + alpha[::2, 1::2] + alpha[1::2, 1::2]) / 4.0
    return found


@pytest.fixture(scope="module")
def level() -> leafcloud.Level:
    """Return level 1 of slender leaves in all directions."""
    random = np.random.default_rng(5)
    middles, along = random.uniform(-1.0, 1.0, (2, 400, 3))
    across = np.cross(along, random.uniform(-1.0, 1.0, (400, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    corners = np.stack([middles - 0.03 * across, middles + 0.03 * across, middles + 0.3 * along], axis=1)
    foliage = leafcloud.Foliage(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    [level] = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=512).levels
    return level


@pytest.mark.parametrize("halvings", [0, 1, 2])
def test_mip_levels_keep_the_area_above_the_cutoff(level: leafcloud.Level, halvings: int) -> None:
    page, cutoff = level.for_engines(halvings)
    assert page.shape == (512 >> halvings, 512 >> halvings, 4)
    [own] = shown(level.base_color, level.alpha_cutoff, level)
    plain = shown(level.base_color, level.alpha_cutoff, level, 3)
    assert plain[3] < 0.3 * own, "without it most is lost"
    kept = np.array(shown(page, cutoff, level, 3)) / own
    assert np.abs(kept[:3] - 1.0).max() < 0.35, kept
    assert kept[3] > 0.3, kept


def pictured(foliage: leafcloud.Foliage, base: leafcloud.Foliage) -> tuple[float, NDArray[np.float64]]:
    """Return the covered pixels and the mean linear color of pictures from 24 sides."""
    random, covered, light = np.random.default_rng(7), 0.0, np.zeros(3)
    for direction in random.normal(size=(24, 3)):
        sphere = {"centre": base.world_centre.tolist(), "radius": 1.1 * base.radius}
        codes = leafcloud.render([foliage], direction.tolist(), 96, samples=4, **sphere) / 255.0
        covered += codes[..., 3].sum()
        light += (linear(codes[..., :3]) * codes[..., 3:]).sum(axis=(0, 1))
    return covered, light / covered


def test_mip_levels_cover_as_much_as_the_page_itself_in_its_mean_color() -> None:
    # Dark leaves within, bright ones outside: blocks of texels show more of one of them.
    random = np.random.default_rng(11)
    middles = random.normal(size=(500, 3))
    middles *= (random.uniform(0.3, 1.0, 500) / np.linalg.norm(middles, axis=1))[:, None]
    along, across = random.normal(size=(2, 500, 3))
    sides = [0.25 * each / np.linalg.norm(each, axis=1)[:, None] for each in (along, across)]
    corners = np.stack([middles, middles + sides[0], middles + sides[1]], axis=1).reshape(-1, 3)
    dark, bright = (leafcloud.Material(base_color=(*color, 1.0)) for color in ((0.02, 0.1, 0.02), (0.3, 0.5, 0.1)))
    outside = (np.linalg.norm(middles, axis=1) > 0.7).astype(int).tolist()
    leaves = leafcloud.Foliage(corners, np.arange(1500).reshape(-1, 3), material_ids=outside, materials=[dark, bright])
    [level] = leafcloud.build_chain(leaves, levels=1, cross=False, texture_size=512, max_billboards=40).levels
    page, cutoff = level.for_engines(1)
    found, wanted = [], pictured(level.foliage(), leaves)
    for mip in box_filtered(page)[:3]:
        leaf = leafcloud.Material(image=mip, alpha_mode="MASK", alpha_cutoff=cutoff)
        sizes = level.polygon_sizes.tolist()
        firsts = itertools.accumulate(sizes[:-1], initial=0)
        fans = [(a, a + i, a + i + 1) for a, n in zip(firsts, sizes, strict=True) for i in range(1, n - 1)]
        shown = leafcloud.Foliage(level.corners, np.array(fans), uvs=level.uvs, materials=[leaf])
        found.append(pictured(shown, leaves))
    coverage = np.mean([covered for covered, _ in found]) / wanted[0]
    color = np.mean([light for _, light in found], axis=0) / wanted[1]
    assert coverage == pytest.approx(1.0, abs=0.03)
    assert color == pytest.approx(1.0, abs=0.03)


def test_only_files_for_engines_have_the_adjusted_cutoff(tmp_path: Path, shrub: Path) -> None:
    out = tmp_path / "out"
    bake(shrub, out, *QUICK, "--levels", 1, "--no-cross")
    [primitive] = read_glb(out / "shrub_LOD1.glb")["shrub_LOD1"].primitives
    bpy.ops.wm.open_mainfile(filepath=str(out / "shrub.blend"))
    nodes = bpy.data.materials["shrub_LOD1"].node_tree.nodes
    assert [image.name for image in bpy.data.images if "Blender" in image.name] == []
    assert nodes["Leafcloud Page"].image.name == "shrub_LOD1"
    own = nodes["Leafcloud Cutoff"].inputs[1].default_value
    assert primitive.material["alphaCutoff"] != pytest.approx(own, abs=1e-3)


def test_texels_in_files_are_about_a_pixel_large_where_the_level_takes_over(tmp_path: Path, shrub: Path) -> None:
    """Of pages with fine texels the file has a smaller mip level."""
    report = bake(shrub, tmp_path, "--texture-size", 256, "--epsilon", 0.1, "--levels", 1, "--no-cross")
    content, binary = read_chunks(tmp_path / "shrub_LOD1.glb")
    level = report["levels"][1]
    [page] = [image for image in content["images"] if image["name"] == "shrub_LOD1"]
    start = content["bufferViews"][page["bufferView"]].get("byteOffset", 0)
    side = int.from_bytes(binary[start + 16 : start + 20], "big")
    assert side in (128, 64, 32)
    pixel = 2.0 * level["switch_distance"] * math.tan(math.radians(25.0)) / 1080.0
    texel = texel_size(tmp_path / "shrub_LOD1.glb", side)
    assert 0.55 < texel / pixel < 1.25


def texel_size(file: Path, side: int) -> float:
    """Return the side of a texel on the billboards of a level, from positions and texture coordinates."""
    [primitive] = read_glb(file)["shrub_LOD1"].primitives
    corners = primitive.attributes["POSITION"].astype(float)[primitive.indices]
    uvs = primitive.attributes["TEXCOORD_0"].astype(float)[primitive.indices] * side
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


def means(codes: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
    """Return the means of blocks of texels."""
    height, width, channels = codes.shape
    return codes.reshape(height // steps, steps, width // steps, steps, channels).mean(axis=(1, 3))


def test_other_channels_in_files_are_as_small_as_the_base_color(tmp_path: Path, shrub: Path) -> None:
    """Their texels are means of those in the .blend: of codes, of light for colors, of directions for normals."""
    bake(shrub, tmp_path, "--texture-size", 256, "--epsilon", 0.1, "--levels", 1, "--no-cross", "--effects", "all")
    small = {name: image for name, image in images_in(tmp_path / "shrub_LOD1.glb").items() if "LOD1" in name}
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shrub.blend"))
    sides = {image.shape[0] for name, image in small.items() if "leaf" not in name}
    steps = 256 // sides.pop()
    assert not sides, "one size"
    assert steps >= 2
    checked = set()
    for name, image in small.items():
        kind = name.removeprefix("shrub_LOD1")
        pixels = np.array(bpy.data.images[name].pixels[:]).reshape(256, 256, 4)[::-1]
        if kind in ("_normal", "_bent_normal", "_orm", "_translucency"):
            blocks = means(light(pixels) if kind == "_translucency" else pixels, steps)[..., :3]
            if kind == "_normal":
                blocks = 2.0 * blocks - 1.0
                lengths = np.linalg.norm(blocks, axis=-1, keepdims=True)
                near = (lengths > 0.5)[..., 0]  # Directions that cancel out have no mean.
                blocks = 0.5 * blocks / np.maximum(lengths, 1e-9) + 0.5
            else:
                near = np.ones(blocks.shape[:2], bool)
            got = light(image / 255.0) if kind == "_translucency" else image / 255.0
            assert np.abs(got[..., :3] - blocks)[near].max() < 3.0 / 255.0, name
            checked.add(kind)
    assert checked == {"_normal", "_bent_normal", "_orm", "_translucency"}


def light(codes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the linear light of sRGB codes in [0, 1]."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
