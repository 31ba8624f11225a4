"""Camera visibility: an estimate, before the bake, of the levels that the cameras of a scene see.

Switch distances depend on the deviations and the texels of the levels. Before the bake only bounds of these are known:
a level takes over between its *soonest* and its *latest* distance. A level counts as seen if it may be seen. The plan
leaves out only coarser levels, so no picture lacks detail.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import leafcloud

from ..settings.bake import BakeSettings
from ..settings.levels import LARGEST_TEXTURE
from .facts import Camera, Facts, Span
from .lod_range import HandOverKind, LodRange, View, lod_ranges, rising
from .pruning import cut_off_distance, share_left
from .quality import SMALLEST_CROWN, decides_distances, distance_of

CROSS_DEVIATION = 0.5
"""Typical deviation of the cross impostor from the leaves as a fraction of R: 0.48 to 0.56 on the measured trees."""

LARGEST_TEXEL = 8.0
"""Greatest width of a texel of level 1, as a fraction of R, times the width of the atlas in texels: 4 to 8 on the
measured trees."""

STILL = 1e-3
"""Maximum changes of a still camera: place and distance as fractions of the distance, direction in radians, zoom as a
fraction."""


@dataclass(frozen=True)
class CameraVisibility:
    """The levels and the changes of level that the cameras see, over all trees.

    soonest, latest: bounds on the switch distance of each level, LOD 0 first, in world units. first, last: the nearest
    and the farthest level seen. passed: the numbers of the levels that some tree visibly changes to, or back from.
    """

    soonest: tuple[float, ...]
    latest: tuple[float, ...]
    first: int
    last: int
    passed: tuple[int, ...]


def camera_visibility(settings: BakeSettings, facts: Facts) -> CameraVisibility | None:
    """Return the camera visibility; None if the viewer may be anywhere."""
    if facts.camera is None:
        return None
    spans = facts.camera.spans
    soonest = soonest_switches(settings, facts, facts.camera.view)
    latest = latest_switches(settings, facts, facts.camera.view)
    is_cloud = [0 < number <= _clouds(settings) for number in range(len(soonest))]
    hand_overs = [HandOverKind.MORPH_AND_FADE if each else HandOverKind.FADE for each in is_cloud]
    soon, late = (lod_ranges(switches, hand_overs, transitions=True) for switches in (soonest, latest))
    first = min(level_at(near, late) for near, _ in spans)
    last = max(level_at(far, soon) for _, far in spans)
    passed = tuple(
        number
        for number in range(1, len(soon))
        if any(_passes(span, min(soon[number - 1].start, soon[number].appear), late[number].appear) for span in spans)
    )
    return CameraVisibility(soonest, latest, first, last, passed)


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


def soonest_switches(settings: BakeSettings, facts: Facts, view: View) -> tuple[float, ...]:
    """Return the switch distances that follow from ε, LOD 0's 0 first, in world units.

    Deviations are near their bounds, so a level takes over at most a little sooner.
    """
    clouds = _clouds(settings)
    if decides_distances(settings) and settings.chain != "pruning":
        sizes = [share * view.resolution for share in settings.sizes]
        sizes = sizes or [leafcloud.LARGEST_CROWN, *([leafcloud.LATER_CROWN] * (clouds - 1))]
        sizes += [sizes[-1]] if settings.cross else []
        return rising([0.0, *(distance_of(size, facts.radius, view) for size in sizes)])
    errors = [min(settings.error_bound * leafcloud.EPSILON_STEP**number, 1.0) for number in range(clouds)]
    return _switches(settings, facts, view, [min(sum(errors[: number + 1]), 1.0) for number in range(clouds)])


def latest_switches(settings: BakeSettings, facts: Facts, view: View) -> tuple[float, ...]:
    """Return the latest switch distances, LOD 0's 0 first, in world units.

    A level with large texels takes over later. A budget of triangles, billboards or texels leaves the deviation open,
    up to R. By quality, every level takes over before the crown is smaller than the smallest measured picture.
    """
    count = _clouds(settings)
    if decides_distances(settings):
        last = distance_of(SMALLEST_CROWN, facts.radius, view)
        return rising([0.0, *([last] * (len(soonest_switches(settings, facts, view)) - 1))])
    is_open = any(budget is not None for budget in (settings.triangles, settings.max_billboards, settings.max_texels))
    accurate = _switches(settings, facts, view, [1.0] * count) if is_open else soonest_switches(settings, facts, view)
    # Each cloud's atlas has half the width of the one before.
    texels = [
        LARGEST_TEXEL * facts.radius * 2**number / (settings.texture_size or LARGEST_TEXTURE) for number in range(count)
    ]
    sharp = [0.0, *(far_off(texel, 1.0, view) for texel in texels)]
    return rising([max(pair) for pair in zip_longest(accurate, sharp, fillvalue=0.0)])


def _switches(settings: BakeSettings, facts: Facts, view: View, deviations: Sequence[float]) -> tuple[float, ...]:
    """Return the switch distances for the clouds' deviations, as fractions of R."""
    known = [*deviations, CROSS_DEVIATION] if settings.cross else deviations
    distances = [far_off(deviation * facts.radius, settings.switch_pixels, view) for deviation in known]
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
    switch = settings.error_bound * facts.radius / settings.switch_pixels
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
    return 0 if settings.chain == "pruning" else len(settings.sizes) or settings.levels


def _passes(span: Span, begin: float, end: float) -> bool:
    """Return whether a moving camera is at some time between the begin of a morph and the end of a change of level."""
    near, far = span
    return far - near > STILL * far and far > begin and near < end
