"""Shared atlas pages for levels of several trees: each billboard keeps its texels at a new place."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import leafcloud


def tree(seed: int, color: tuple[float, float, float, float], size: int, **options: bool) -> leafcloud.Chain:
    random = np.random.default_rng(seed)
    places, along, across = random.uniform(-1.0, 1.0, (3, 150, 3))
    corners = np.stack([places - 0.1 * across, places + 0.1 * across, places + 0.3 * along], axis=1)
    image = random.integers(0, 256, (16, 16, 4), np.uint8)
    material = leafcloud.Material(base_color=color, image=image, alpha_mode="MASK", alpha_cutoff=0.3)
    uvs = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]], np.float32), (150, 1, 1))
    foliage = leafcloud.Foliage(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), uvs=uvs, materials=[material])
    return leafcloud.build_chain(foliage, levels=1, texture_size=size, back_sides=False, **options)


def regions(level: leafcloud.Level, page: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the region of the page that each billboard shows."""
    height, width = page.shape[:2]
    found = []
    owners = np.repeat(level.polygon_billboards, level.polygon_sizes)
    for billboard in range(len(level.ranks)):
        uvs = np.asarray(level.uvs[owners == billboard], np.float64)
        left, right = np.floor(uvs[:, 0].min() * width + 1e-3), np.ceil(uvs[:, 0].max() * width - 1e-3)
        top, bottom = (
            np.floor((1.0 - uvs[:, 1].max()) * height + 1e-3),
            np.ceil((1.0 - uvs[:, 1].min()) * height - 1e-3),
        )
        found.append(page[int(top) : int(bottom), int(left) : int(right)])
    return found


def test_billboards_show_the_same_texels_on_the_shared_page() -> None:
    chains = [tree(1, (1.0, 0.5, 0.2, 1.0), 256), tree(2, (0.2, 0.9, 0.4, 1.0), 128)]
    shared = leafcloud.share_pages(chains)
    for number in (0, 1):
        first, second = (chain.levels[number] for chain in shared)
        assert np.array_equal(first.base_color, second.base_color)
        assert first.ktx2("base_color") == second.ktx2("base_color")
        assert all(side % 4 == 0 for side in first.base_color.shape[:2])
        own = [chain.levels[number] for chain in chains]
        assert first.base_color.size <= 1.7 * sum(level.base_color.size for level in own)
        for level, after in zip(own, (first, second), strict=True):
            assert np.array_equal(level.corners, after.corners)
            assert after.alpha_cutoff == level.alpha_cutoff
            pairs = zip(regions(level, level.base_color), regions(after, after.base_color), strict=True)
            assert all(np.array_equal(old, new) for old, new in pairs)
        assert sum(level.page_share for level in (first, second)) == pytest.approx(1.0)
        assert [level.page_share for level in own] == [1.0, 1.0]


def test_mips_of_a_shared_page_keep_the_share_of_each_tree() -> None:
    """One tree has faint leaves, the other one strong ones: each keeps its own share above its own cutoff."""
    chains = [tree(1, (1.0, 0.5, 0.2, 1.0), 256), tree(2, (0.2, 0.9, 0.4, 1.0), 256)]
    shared = leafcloud.share_pages(chains)
    for level in (chain.levels[0] for chain in shared):
        shares = []
        for mip in level.mips("base_color")[:3]:
            scale = len(level.base_color) // len(mip)
            code = 255.0 * level.alpha_cutoff - 1e-3
            ends = ((x, y, x + width, y + height) for x, y, width, height in level.regions)
            sides = (tuple(side // scale for side in each) for each in ends)
            parts = [mip[top:bottom, left:right, 3] for left, top, right, bottom in sides]
            shares.append(float((np.concatenate([part.ravel() for part in parts]) >= code).mean()))
        assert shares[1:] == pytest.approx(2 * [shares[0]], rel=0.15)


def test_regions_do_not_overlap() -> None:
    chains = leafcloud.share_pages([tree(seed, (1.0, 1.0, 1.0, 1.0), 128) for seed in (1, 2, 3)])
    page = chains[0].levels[0].base_color
    owners = np.zeros(page.shape[:2], int)
    for chain in chains:
        for region in regions(chain.levels[0], owners):
            region += 1
    assert owners.max() == 1


def test_levels_of_different_channels_are_refused() -> None:
    chains = [tree(1, (1.0, 1.0, 1.0, 1.0), 128), tree(2, (1.0, 1.0, 1.0, 1.0), 128, leaf_map=True)]
    with pytest.raises(leafcloud.LeafcloudError, match="bake all trees with the same effects"):
        leafcloud.share_pages(chains)
    assert leafcloud.share_pages([]) == []
