"""Which levels the cameras of a scene ever see: estimated before the bake, from how far each level takes over.

The deviations that decide that are not known yet, but bounds of them are. A level may take over sooner than estimated;
what is left out because of the estimate is only what is coarser, so it is never missed in a picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import leafcloud

from ..settings import BakeSettings
from .facts import Camera, Facts, Span
from .reach import Reach, View, reaches, rising
from .thinning import cut_off_distance

EPSILON_STEP = 2.5
"""How much coarser each cloud is than the one before: the core's own."""

CROSS_DEVIATION = 0.5
"""How far the cross deviates from the leaves, as a share of R: 0.48 to 0.56 on the measured trees."""

STILL = 1e-3
"""A camera whose distance changes by no more than this share of it stands still. So does one that moves by no more than
this share of its distance, turns by no more than this many radians, and zooms by no more than this share."""


@dataclass(frozen=True)
class Sight:
    """What the cameras see: the levels `first` to `last`, over all trees, and what they see of hand-overs.

    switches: from how far each level is drawn, the leaves first; world units. passed: the numbers of the levels that
    some tree is seen to go over into, or back from.
    """

    switches: tuple[float, ...]
    first: int
    last: int
    passed: tuple[int, ...]


def sight(settings: BakeSettings, facts: Facts) -> Sight | None:
    """What the cameras see; None when the viewer may be anywhere."""
    if facts.camera is None:
        return None
    spans = facts.camera.spans
    switches = expected_switches(settings, facts, facts.camera.view)
    clouds = _clouds(settings)
    reached = reaches(switches, [0 < number <= clouds for number in range(len(switches))], transitions=True)
    first = min(level_at(near, reached) for near, _ in spans)
    last = max(level_at(far, reached) for _, far in spans)
    into = range(1, len(reached))
    passed = tuple(number for number in into if any(_passes(span, *reached[number - 1 : number + 1]) for span in spans))
    return Sight(switches, first, last, passed)


def stands_still(camera: Camera) -> bool:
    """Whether neither the camera nor any tree before it moves: then it says nothing about other distances."""
    return not camera.moves and not any(far - near > STILL * far for near, far in camera.spans)


def seen_as_set(settings: BakeSettings, facts: Facts) -> Facts:
    """The facts for the settings' engine and viewer: these decide whether the levels are planned by a camera."""
    camera = facts.scene_camera if settings.by_cameras else None
    if camera is not None and settings.viewer == "auto" and stands_still(camera):
        camera = None
    return replace(facts, engine=settings.engine, camera=camera)


def expected_switches(settings: BakeSettings, facts: Facts, view: View) -> tuple[float, ...]:
    """From how far each level is drawn, the leaves' 0 first, as far as it can be known before the bake; world units."""
    clouds = _clouds(settings)
    errors = [min(settings.epsilon * EPSILON_STEP**number, 1.0) for number in range(clouds)]
    deviations = [min(sum(errors[: number + 1]), 1.0) for number in range(clouds)]
    deviations += [CROSS_DEVIATION] if settings.cross else []
    distances = [far_off(deviation * facts.radius, settings.pixels, view) for deviation in deviations]
    if settings.chain == "pruning":
        distances = [max(*distances, cut_off_distance(prune_start(settings, facts, view), settings.prune_half))]
    return rising([0.0, *distances])


def prune_start(settings: BakeSettings, facts: Facts, view: View) -> float:
    """From where a leaf is seen smaller than the settings' pixels; world units."""
    return far_off(facts.leaf_size, settings.prune_pixels, view)


def far_off(length: float, pixels: float, view: View) -> float:
    """From how far `length` is seen so many pixels large."""
    return leafcloud.switch_distance(length, pixels, view.resolution, view.field_of_view)


def pixels_of(length: float, away: float, view: View) -> float:
    """How many pixels large `length` is seen from so far away."""
    return far_off(length, 1.0, view) / away if away > 0.0 else math.inf


def level_at(away: float, reached: Sequence[Reach]) -> int:
    """The number of the level that is drawn from so far away."""
    return max(number for number, reach in enumerate(reached) if number == 0 or reach.appear <= away)


def _clouds(settings: BakeSettings) -> int:
    return 0 if settings.chain == "pruning" else settings.levels


def _passes(span: Span, before: Reach, behind: Reach) -> bool:
    """Whether a camera is seen to go through a part of what a level goes through before the next one appears."""
    near, far = span
    return far - near > STILL * far and far > min(before.start, behind.appear) and near < behind.appear
