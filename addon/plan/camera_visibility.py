"""Camera visibility: an estimate, before the bake, of the levels that the cameras of a scene see.

Switch distances depend on the levels' deviations. Before the bake only upper bounds of these are known, so a level may
take over sooner than estimated. The plan leaves out only coarser levels, so no picture lacks detail.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import leafcloud

from ..settings.bake import BakeSettings
from .facts import Camera, Facts, Span
from .lod_range import LodRange, View, lod_ranges, rising
from .pruning import cut_off_distance, share_left

CROSS_DEVIATION = 0.5
"""Typical deviation of the cross impostor from the leaves as a fraction of R: 0.48 to 0.56 on the measured trees."""

STILL = 1e-3
"""Maximum changes of a still camera: place and distance as fractions of the distance, direction in radians, zoom as a
fraction."""


@dataclass(frozen=True)
class CameraVisibility:
    """The levels and the changes of level that the cameras see, over all trees.

    switches: the switch distance of each level, LOD 0 first, in world units. first, last: the nearest and the farthest
    level seen. passed: the numbers of the levels that some tree visibly changes to, or back from.
    """

    switches: tuple[float, ...]
    first: int
    last: int
    passed: tuple[int, ...]


def camera_visibility(settings: BakeSettings, facts: Facts) -> CameraVisibility | None:
    """Return the camera visibility; None if the viewer may be anywhere."""
    if facts.camera is None:
        return None
    spans = facts.camera.spans
    switches = expected_switches(settings, facts, facts.camera.view)
    clouds = _clouds(settings)
    ranges = lod_ranges(switches, [0 < number <= clouds for number in range(len(switches))], transitions=True)
    first = min(level_at(near, ranges) for near, _ in spans)
    last = max(level_at(far, ranges) for _, far in spans)
    into = range(1, len(ranges))
    passed = tuple(number for number in into if any(_passes(span, *ranges[number - 1 : number + 1]) for span in spans))
    return CameraVisibility(switches, first, last, passed)


def stands_still(camera: Camera) -> bool:
    """Return whether the distance from the camera to every tree is constant, and the camera itself does not move.

    A still camera does not tell from which other distances the trees will be seen.
    """
    return not camera.moves and not any(far - near > STILL * far for near, far in camera.spans)


def seen_as_set(settings: BakeSettings, facts: Facts) -> Facts:
    """Return the facts with the settings' engine, and with the camera that the plan uses.

    The plan uses the scene's camera if the settings allow it, except a still camera with the viewer `auto`.
    """
    camera = facts.scene_camera if settings.by_cameras else None
    if camera is not None and settings.viewer == "auto" and stands_still(camera):
        camera = None
    return replace(facts, engine=settings.engine, camera=camera)


def expected_switches(settings: BakeSettings, facts: Facts, view: View) -> tuple[float, ...]:
    """Return the estimated switch distances before the bake, LOD 0's 0 first, in world units."""
    clouds = _clouds(settings)
    errors = [min(settings.epsilon * leafcloud.EPSILON_STEP**number, 1.0) for number in range(clouds)]
    deviations = [min(sum(errors[: number + 1]), 1.0) for number in range(clouds)]
    deviations += [CROSS_DEVIATION] if settings.cross else []
    distances = [far_off(deviation * facts.radius, settings.pixels, view) for deviation in deviations]
    if settings.chain == "pruning":
        distances = [max(*distances, cut_off_distance(prune_start(settings, facts, view), settings.prune_half))]
    return rising([0.0, *distances])


def prune_start(settings: BakeSettings, facts: Facts, view: View) -> float:
    """Return d₀, the distance beyond which a leaf is smaller than the setting `prune_pixels`, in world units."""
    return far_off(facts.leaf_size, settings.prune_pixels, view)


def share_at_level_1(settings: BakeSettings, facts: Facts) -> float:
    """Return λ where level 1 takes over: 1 if that happens before any leaf is pruned.

    λ is independent of the camera: both distances scale with the same factor.
    """
    start = facts.leaf_size / settings.prune_pixels
    switch = settings.epsilon * facts.radius / settings.pixels
    return share_left(start, switch, settings.prune_half)


def far_off(length: float, pixels: float, view: View) -> float:
    """Return the distance at which `length` covers `pixels`."""
    return leafcloud.switch_distance(length, pixels, view.resolution, view.field_of_view)


def pixels_of(length: float, away: float, view: View) -> float:
    """Return the number of pixels that `length` covers at the distance `away`; infinite at 0."""
    return far_off(length, 1.0, view) / away if away > 0.0 else math.inf


def level_at(away: float, ranges: Sequence[LodRange]) -> int:
    """Return the number of the level that is drawn at the distance `away`."""
    return max(number for number, lod_range in enumerate(ranges) if number == 0 or lod_range.appear <= away)


def _clouds(settings: BakeSettings) -> int:
    return 0 if settings.chain == "pruning" else settings.levels


def _passes(span: Span, before: LodRange, behind: LodRange) -> bool:
    """Return whether a moving camera sees part of the morph before a level, or the level's appearance."""
    near, far = span
    return far - near > STILL * far and far > min(before.start, behind.appear) and near < behind.appear
