"""Quality: where levels take over, by how they look.

The setting `quality` goes from 0 (fast) to 1 (exact). The core judges each level with a yardstick: in the middle a
level may differ from the leaves as much as they differ when a light breeze has moved them. The core also chooses the
levels for a scene, within a budget of memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import leafcloud

from ..settings.bake import BakeSettings
from ..settings.choices import DRAW_SHARES, Form
from .lod_range import View, shows_trunk

SMALLEST_CROWN = 7.8
"""Smallest diameter of the crown in pixels at which the last level takes over."""


class Wishes(TypedDict, total=False):
    """Options of `leafcloud.build_chain` for the choice of levels by quality."""

    quality: float
    scene: float
    memory_budget: float
    sizes: Sequence[float]
    shares: bool
    form: Form
    twigs: bool


def decides_distances(settings: BakeSettings) -> bool:
    """Return whether quality sets the LOD distances. `pixels` replaces it."""
    return settings.pixels is None


def core_wishes(settings: BakeSettings, form: Form, *, twigs: bool) -> Wishes:
    """Return the options for the choice by quality; empty if `pixels` decides.

    `form`: allowed forms of level 1. `twigs`: clouds may show thin branches.
    """
    if not decides_distances(settings):
        return {}
    return Wishes(
        quality=settings.quality,
        scene=settings.scene,
        memory_budget=settings.memory_budget,
        sizes=settings.sizes,
        shares=settings.engine in DRAW_SHARES,
        form=form,
        twigs=twigs,
    )


def allowed_difference(quality: float) -> float:
    """Return how much a level may differ from the leaves, over leaves that a light breeze has moved."""
    allowed: float = leafcloud.allowed_difference(quality)
    return allowed


def quality_warnings(chain: leafcloud.Chain) -> list[str]:
    """Return a message for each level that looks different from the leaves where it takes over."""
    warnings = []
    for number, (level, taken) in enumerate(zip(chain.levels, chain.takes_over, strict=False), start=1):
        if taken["passes"] or taken["crown_pixels"] <= leafcloud.UNJUDGED_CROWN:
            continue
        judged = taken["judged"]
        remedy = "leave it out with `cross=False`" if shows_trunk(level) else "raise `memory_budget` or `triangles`"
        warnings.append(
            f"level {number} does not look like the leaves even at {View().of_height(taken['crown_pixels'])}, "
            f"by its {judged['by']}: {judged['excess']:.1f} times what `quality` allows; it takes over there: "
            f"lower `quality`, or {remedy}"
        )
    return warnings


def crowns(settings: BakeSettings, taken: Sequence[leafcloud.TakesOver], view: View) -> list[float]:
    """Return the diameter of the crown in pixels of this view where each level takes over."""
    sizes = [each["crown_pixels"] for each in taken]
    wished = [share * view.resolution for share in settings.sizes]
    return [*wished, *sizes[len(wished) :]] if len(sizes) >= len(wished) else sizes


def distance_of(size: float, radius: float, view: View) -> float:
    """Return the distance at which a sphere of this radius is `size` pixels large."""
    distance: float = leafcloud.switch_distance(2.0 * radius, size, view.resolution, view.field_of_view)
    return distance
