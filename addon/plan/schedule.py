"""The schedule of a chain: at which distances each level is drawn, morphs, fades and prunes. World units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import leafcloud

from ..settings.bake import BakeSettings
from .camera_visibility import camera_visibility, far_off, level_at, share_at_level_1
from .decision import Decision, is_on
from .facts import Facts
from .lod_range import HandOverKind, LodRange, View, hand_over_to, lod_ranges, rising
from .pruning import PruneDistances, cut_off_distance, start_for
from .quality import crowns, decides_distances, distance_of


@dataclass(frozen=True)
class Schedule:
    """Switch distances and LOD ranges of all levels, the leaves first.

    drawn: the levels that the camera sees. A single one is always shown if no level follows the camera.
    trunk_pixels: side of a pixel on the tree where each level after LOD 0 appears; empty: trunks are not simplified.
    crowns: diameter of the crown in pixels where each level after LOD 0 takes over; empty if quality does not decide.
    triangles: wished maximum of level 1 with its trunk.
    plain_distances: switch distances in files, where a cross impostor stands in for an octahedral one.
    """

    switch_distances: tuple[float, ...]
    lod_ranges: tuple[LodRange, ...]
    drawn: range = range(1)
    pruning: PruneDistances = field(default_factory=PruneDistances)
    trunk_pixels: tuple[float, ...] = ()
    crowns: tuple[float, ...] = ()
    triangles: int | None = None
    plain_distances: tuple[float, ...] = ()


def schedule(
    settings: BakeSettings, facts: Facts, effects: Sequence[Decision], chain: leafcloud.Chain, view: View
) -> Schedule:
    """Return the schedule of a finished chain. `view` sets the switch distances."""
    levels = chain.levels
    taken = chain.takes_over if decides_distances(settings) else []
    plain_taken = taken if chain.plain_takes_over is None else [*taken[:-1], chain.plain_takes_over]
    by_looks = crowns(settings, taken, view)
    start = far_off(facts.leaf_size, settings.prune_pixels, view)
    switch_distances = _switch_distances(settings, facts, levels, by_looks, view)
    plain = [level.cross if isinstance(level, leafcloud.OctahedralLevel) else level for level in levels]
    plain_distances = _switch_distances(settings, facts, plain, crowns(settings, plain_taken, view), view)
    hand_overs = [HandOverKind.FADE, *map(hand_over_to, levels)]
    ranges = lod_ranges(switch_distances, hand_overs, transitions=bool(is_on(effects, "transitions")))
    simplified = is_on(effects, "trunk_levels")
    return Schedule(
        switch_distances,
        ranges,
        _drawn(settings, facts, ranges, levels),
        _prune_distances(settings, facts, effects, start, ranges[1].appear),
        tuple(each.appear / far_off(1.0, 1.0, view) for each in ranges[1:]) if simplified else (),
        tuple(by_looks),
        settings.triangles,
        plain_distances,
    )


def _switch_distances(
    settings: BakeSettings,
    facts: Facts,
    levels: Sequence[leafcloud.AnyLevel],
    by_looks: Sequence[float],
    view: View,
) -> tuple[float, ...]:
    """Return the distance of each level, LOD 0's first.

    A level takes over where it looks like the leaves (`by_looks`: diameters of the crown in pixels). If quality does
    not decide: where its deviation appears smaller than `pixels` pixels, and its texels are smaller than a pixel.
    """
    if by_looks:
        distances = [distance_of(size, facts.radius, view) for size in by_looks]
    else:
        deviations = [level.max_deviation_leaves * facts.radius for level in levels]
        distances = [
            max(far_off(deviation, settings.switch_pixels, view), far_off(level.texel_size, 1.0, view))
            for deviation, level in zip(deviations, levels, strict=True)
        ]
    if settings.chain == "pruning":
        start = far_off(facts.leaf_size, settings.prune_pixels, view)
        distances = [max(*distances, cut_off_distance(start, settings.prune_half))]
    return rising([0.0, *distances])


def keep_at_switch(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> float | None:
    """Return λ, the fraction of leaves kept where level 1 takes over; None if no leaves are pruned before."""
    if settings.chain == "billboards" or not is_on(effects, "pruning"):
        return None
    if settings.chain == "pruning":
        return 1.0
    return share_at_level_1(settings, facts)


def _drawn(
    settings: BakeSettings, facts: Facts, ranges: Sequence[LodRange], levels: Sequence[leafcloud.AnyLevel]
) -> range:
    """Return the levels that the scene's cameras see; level 0 alone if the viewer may be anywhere.

    The range never begins or ends at a coarser level than camera visibility estimated before the bake.
    """
    seen, camera = camera_visibility(settings, facts), facts.camera
    if seen is None or camera is None:
        return range(1)
    first, last = (level_at(away, ranges) for away in (camera.nearest, camera.farthest))
    # The plan does not know of leaf levels before the clouds.
    clouds_after = sum(isinstance(level, leafcloud.LeafLevel) for level in levels)
    return range(min(first, seen.first), min(last, seen.last + clouds_after) + 1)


def _prune_distances(
    settings: BakeSettings, facts: Facts, effects: Sequence[Decision], start: float, hand_over: float
) -> PruneDistances:
    """Return the distances of pruning: infinite without pruned leaves.

    start: distance where a leaf appears `prune_pixels` long. hand_over: distance where level 1 appears. If level 1 was
    made of kept leaves, exactly these remain at `hand_over`.
    """
    half, keep = settings.prune_half, keep_at_switch(settings, facts, effects)
    if settings.chain == "both" and keep is not None and keep < 1.0:
        return PruneDistances(start_for(keep, hand_over, half), half)
    return PruneDistances(math.inf if keep is None or settings.chain != "pruning" else start, half)
