"""Transitions: each leaf morphs onto its billboard, and levels cross-fade where one takes over from another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import bpy

    from ..levels.building import Build
    from ..plan.lod_range import LodRange


class TransitionsEffect(Effect):
    about = (
        "Morph the leaves onto their billboards, and let each level take over bit by bit, so that no change of level "
        "is visible. Wanted where a camera moves past the distance of such a change. Costs memory for each vertex"
    )

    def rule(self, situation: Situation) -> Rule:
        seen = situation.seen
        if seen is None:
            return True, f"{situation.free_camera}, so it may see one level take over from another"
        where, takes_over = situation.where, situation.takes_over
        if seen.passed:
            return True, f"{where}, and {takes_over(seen.passed[0])}"
        if seen.first != seen.last:
            return False, f"{where}, and no tree is seen changing levels"
        if seen.last + 1 < len(seen.soonest):
            return False, f"{where}, and {takes_over(seen.last + 1)}"
        return False, f"{where}, past the last change of level: {takes_over(seen.last)}"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.all_vertices, 41.0, seconds=1.0e-7),)

    def add_to_member(self, obj: bpy.types.Object, lod_range: LodRange, build: Build) -> None:
        from ..levels.fading import fades_by_material, let_fade
        from ..mesh.baked_levels import level_number

        if fades_by_material(obj.data, lod_range):
            number = level_number(obj)
            is_cloud = number is not None and number >= build.first_cloud
            let_fade(obj, is_cloud=is_cloud, to_cross=build.chain.levels[-1].method == "cross")


EFFECT = TransitionsEffect()
