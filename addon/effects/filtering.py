"""Filtering: in EEVEE leaves and billboards smaller than a texel keep their coverage and their color."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.situation import Situation

if TYPE_CHECKING:
    import bpy

    from ..levels.building import Build


class FilteringEffect(Effect):
    about = (
        "Keep the coverage and the color of distant leaves in EEVEE, where a cutoff would dissolve them. Wanted where "
        "EEVEE or the Material Preview shows the tree. Costs memory for copies of the leaf textures"
    )

    def rule(self, situation: Situation) -> Rule:
        return True, "EEVEE filters textures before it cuts them out, and would dissolve distant leaves"

    def under_baked_light(self, decision: Decision) -> Rule:
        return False, "the light is baked in, and such materials keep their cutoff"

    def add_to_tree(self, collection: bpy.types.Collection, build: Build) -> None:
        from ..levels.filtering import let_filter

        let_filter(collection, build)


EFFECT = FilteringEffect()
