"""Quality: the image error that a level may have where it takes over.

The setting `quality` goes from 0 (fast) to 1 (exact); its middle is the error that nobody notices at the hand-over.
Later levels may have more error, because the tree is smaller where they take over. The core chooses the error bound of
level 1 by the target, and each level takes over at the largest size at which its measured error is within its target.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import leafcloud

from ..settings.bake import BakeSettings
from .lod_range import View, shows_trunk

UNNOTICED = 0.06
"""Image error of level 1 that nobody notices where it takes over: FLIP within the silhouette."""

RANGE = 3.0
"""Factor on the error from the middle of the setting to its ends."""

TYPICAL_PIXELS = 2.0
"""Typical deviation in pixels where a level takes over at the default quality: 1 to 4 on the measured trees."""

LARGEST_CROWN = 400.0
"""Largest diameter of the crown in pixels at which a level takes over by its picture. Larger pictures are not measured,
and single leaves are seen in them."""

SMALLEST_CROWN = 7.8
"""Diameter of the crown in pixels, in the smallest pictures that the core measures."""

FINEST_BOUND = 0.014
"""The smallest error bound that the core chooses by quality."""


class SwitchSize(NamedTuple):
    """The size at which a level takes over by its picture.

    size: diameter of the crown in pixels, at most `LARGEST_CROWN`. target: image error that quality allows. measured:
    image errors by size.
    """

    size: float
    target: float
    measured: leafcloud.ImageErrors

    @property
    def least_error(self) -> float:
        """The image error at the smallest measured size."""
        return self.measured.errors[0]

    @property
    def is_reached(self) -> bool:
        """True if the level is within its target at some size."""
        return self.least_error <= self.target


def target_error(quality: float, number: int = 1) -> float:
    """Return the image error that level `number` may have where it takes over."""
    error = UNNOTICED * RANGE ** (1.0 - 2.0 * quality)
    return error if number == 1 else leafcloud.LATER_ERROR * error


def decides_distances(settings: BakeSettings) -> bool:
    """Return whether quality sets the LOD distances. `pixels` replaces it."""
    return settings.pixels is None


def core_target(settings: BakeSettings) -> float | None:
    """Return the option `target_error` of the core; None if other settings decide."""
    if not decides_distances(settings) or settings.wish is not None or settings.chain != "billboards":
        return None
    return target_error(settings.quality)


def switch_sizes(settings: BakeSettings, levels: Sequence[leafcloud.AnyLevel]) -> tuple[SwitchSize, ...]:
    """Measure the size at which each level takes over by its picture; empty if quality does not decide."""
    if not decides_distances(settings):
        return ()
    found = []
    for number, level in enumerate(levels, start=1):
        target = target_error(settings.quality, number)
        errors = level.image_errors(target)
        size = errors.largest_size(target)
        largest = errors.sizes[0] if size is None else min(size, LARGEST_CROWN)
        found.append(SwitchSize(largest, target, errors))
    return tuple(found)


def measure(settings: BakeSettings, levels: Sequence[leafcloud.AnyLevel]) -> None:
    """Measure the errors of all levels, which the levels keep.

    For a thread of its own: a large tree takes a second, which would stop the interface.
    """
    for level in levels:
        level.image_error  # noqa: B018 the levels keep it
    switch_sizes(settings, levels)
    switch_sizes(settings, plain_levels(levels))


def plain_levels(levels: Sequence[leafcloud.AnyLevel]) -> list[leafcloud.AnyLevel]:
    """Return the levels as files have them: a cross impostor in place of an octahedral one."""
    return [level.cross if isinstance(level, leafcloud.OctahedralLevel) else level for level in levels]


def quality_warnings(found: Sequence[SwitchSize], levels: Sequence[leafcloud.AnyLevel]) -> list[str]:
    """Return a message for each level whose image error exceeds its target at every size.

    found: the switch sizes of all levels, or empty if quality does not decide.
    """
    if not found:
        return []
    warnings = []
    for number, (each, level) in enumerate(zip(found, levels, strict=True), start=1):
        if each.is_reached:
            continue
        remedy = "leave it out with `cross=False`" if shows_trunk(level) else "raise `triangles`"
        warnings.append(
            f"level {number} has an image error of {each.least_error:.3g} even where the crown is {each.size:.0f} "
            f"pixels large, and `quality` allows {each.target:.3g}; it takes over there: lower `quality`, or {remedy}"
        )
    return warnings


def distance_of(size: float, radius: float, view: View) -> float:
    """Return the distance at which a sphere of this radius is `size` pixels large."""
    distance: float = leafcloud.switch_distance(2.0 * radius, size, view.resolution, view.field_of_view)
    return distance
