"""Pages as engines read them in `make bench-refine`: the mip level for a slant, and the mix of two levels."""

from __future__ import annotations

import numpy as np
import pytest

from bench.read_pages import fans, mixed, slants


def test_billboards_that_slant_are_read_coarser() -> None:
    eye = np.array([0.0, -1.0, 0.0])
    turned, diagonal = np.sqrt(0.75), np.sqrt(0.375)
    normals = np.array([[0.0, 1.0, 0.0], [turned, 0.5, 0.0], [0.0, -0.5, turned], [diagonal, 0.5, diagonal]])
    # At 60° a texture is half as wide: one level. Slanted along a diagonal, both steps are √2.5 texels long.
    assert slants(normals, eye) == pytest.approx([0.0, 1.0, 1.0, 0.5 * np.log2(2.5)])


def test_a_mip_level_is_mixed_with_the_next_in_linear_light() -> None:
    fine = np.full((4, 4, 4), 255, np.uint8)
    coarse = np.zeros((2, 2, 4), np.uint8)
    assert (mixed(fine, coarse, 0.25)[..., 3] == 191).all()
    assert (mixed(fine, coarse, 0.5)[..., 0] == 188).all(), "half the light is the code 188"
    coarse[:, 1] = 255
    columns = mixed(np.zeros_like(fine), coarse, 1.0)[0, :, 3]
    assert columns.tolist() == [0, 64, 191, 255], "centers lie at 0, 1/4, 3/4 and 1 of the way between texels"


def test_polygons_become_fans() -> None:
    triangles, owners = fans(np.array([3, 5], np.uint32))
    assert triangles.tolist() == [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7]]
    assert owners.tolist() == [0, 1, 1, 1]
