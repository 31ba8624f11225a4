"""Wind: attributes and a node group by which leaves and billboards sway together."""

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


class WindEffect(Effect):
    about = (
        "Let the wind move all levels alike. Wanted where a force field blows on the tree. Costs memory for each "
        "vertex, and evaluation on every frame"
    )

    def rule(self, situation: Situation) -> Rule:
        wind = situation.facts.wind
        if wind is None:
            return False, "no force field blows on the tree"
        blows = "turbulence shakes" if wind.field is None else f"the force field {wind.field!r} blows on"
        return True, f"{blows} the tree"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.all_vertices, 20.0, fixed=0.16),)

    def add_to_member(self, obj: bpy.types.Object, lod_range: LodRange, build: Build) -> None:
        from ..levels.wind import add_wind

        add_wind(obj, lod_range, build)


EFFECT = WindEffect()
