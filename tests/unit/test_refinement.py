"""Warnings about levels that the setting `refine` does not change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import leafcloud
from addon.plan.refinement import refine_warnings


def levels(alpha_mode: str, **options: Any) -> list[leafcloud.AnyLevel]:
    """Return the levels of 40 triangles at random."""
    random = np.random.default_rng(5)
    corners = random.random((40, 1, 3)) + 0.1 * random.random((40, 3, 3))
    material = leafcloud.Material(base_color=(0.1, 0.4, 0.05, 0.4), alpha_mode=alpha_mode)
    foliage = leafcloud.Foliage(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3), materials=[material])
    return leafcloud.build_chain(foliage, **{"levels": 1, "texture_size": 64, "last": "cross", **options}).levels


@pytest.mark.parametrize(
    ("alpha_mode", "options", "warning"),
    [
        ("OPAQUE", {}, None),
        ("BLEND", {"blended": True}, "`refine` has no effect on level 1: its billboards are alpha-blended"),
        ("OPAQUE", {"levels": 0}, "`refine` has no effect: no level has billboards"),
    ],
)
def test_levels_that_refine_does_not_change_get_a_warning(
    alpha_mode: str, options: dict[str, Any], warning: str | None
) -> None:
    made = levels(alpha_mode, **options)
    assert refine_warnings("short", made) == ([] if warning is None else [warning])
    assert refine_warnings("off", made) == []
