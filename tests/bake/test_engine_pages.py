"""Base color for engines, which use box-filtered mips: a crown keeps its density at a distance.

The oracle computes means of 2 × 2 texels, and bilinear alpha on a grid that is six times as fine.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake
from glb import read_glb
from numpy.typing import NDArray

import leafcloud


def bilinear(alpha: NDArray[np.float64], fine: int = 6) -> NDArray[np.float64]:
    """Return bilinear samples of the tiling texture `alpha` on a grid that is `fine` times as fine."""
    for axis in (0, 1):
        places = (np.arange(fine * alpha.shape[axis]) + 0.5) / fine - 0.5
        low = np.floor(places).astype(int)
        shape = [-1 if i == axis else 1 for i in (0, 1)]
        share = (places - low).reshape(shape)
        first, second = (np.take(alpha, (low + i) % alpha.shape[axis], axis) for i in (0, 1))
        alpha = first * (1.0 - share) + second * share
    return alpha


def area(pixels: NDArray[np.uint8], cutoff: float, level: int) -> float:
    """Return the fraction of the atlas above the cutoff at a box-filtered mip level."""
    alpha = pixels[..., 3] / 255.0
    for _ in range(level):
        alpha = (alpha[::2, ::2] + alpha[1::2, ::2] + alpha[::2, 1::2] + alpha[1::2, 1::2]) / 4.0
    return float((bilinear(alpha) >= cutoff).mean())


@pytest.fixture(scope="module")
def level() -> leafcloud.Level:
    """Return level 1 of slender leaves in all directions."""
    random = np.random.default_rng(5)
    places, along = random.uniform(-1.0, 1.0, (2, 400, 3))
    across = np.cross(along, random.uniform(-1.0, 1.0, (400, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    corners = np.stack([places - 0.06 * across, places + 0.06 * across, places + 0.3 * along], axis=1)
    foliage = leafcloud.Foliage(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    [level] = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=512).levels
    return level


def test_mip_levels_keep_the_area_above_the_cutoff(level: leafcloud.Level) -> None:
    page, cutoff = level.for_engines()
    near = area(level.base_color, level.alpha_cutoff, 0)
    assert area(page, cutoff, 0) == pytest.approx(near, rel=0.03)
    plain = [area(level.base_color, level.alpha_cutoff, number) / near for number in (1, 2, 3)]
    kept = [area(page, cutoff, number) / near for number in (1, 2, 3)]
    assert np.mean(plain) < 0.8, "without it much is lost"
    assert np.mean(kept) == pytest.approx(1.0, abs=0.06)
    assert np.array_equal(page[..., :3], level.base_color[..., :3])


def test_only_files_for_engines_have_the_adjusted_cutoff(tmp_path: Path, shrub: Path) -> None:
    out = tmp_path / "out"
    bake(shrub, out, *QUICK, "--levels", 1, "--no-cross")
    [primitive] = read_glb(out / "shrub_LOD1.glb")["shrub_LOD1"].primitives
    bpy.ops.wm.open_mainfile(filepath=str(out / "shrub.blend"))
    nodes = bpy.data.materials["shrub_LOD1"].node_tree.nodes
    assert [image.name for image in bpy.data.images if "Blender" in image.name] == []
    assert nodes["Leafcloud Page"].image.name == "shrub_LOD1"
    own = nodes["Leafcloud Cutoff"].inputs[1].default_value
    assert 0.1 <= primitive.material["alphaCutoff"] < own
