"""Back sides: a second texture for the back of each billboard, on levels of single-sided leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import BYTES_PER_TEXEL, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import leafcloud

    from ..levels.building import Build, BuiltLevel


class BackSidesEffect(Effect):
    about = (
        "Give billboards a second texture for the back. Wanted where leaves show on one side only. Doubles the "
        "billboards and their texels"
    )

    def rule(self, situation: Situation) -> Rule:
        if situation.only_leaves:
            return False, situation.before_level_1
        return None, "billboards have a second texture for the back if leaves show on one side only"

    def under_baked_light(self, decision: Decision) -> Rule:
        return True, "the light is baked in, and differs on the two sides of a leaf"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.texels, 1.64),)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"back_sides": on}

    def settled(self, decision: Decision, chain: leafcloud.Chain) -> Decision:
        if decision.on is not None:
            return decision
        two_sided = [str(number) for number, level in enumerate(chain.levels, start=1) if level.two_sided]
        if not two_sided:
            return replace(decision, on=False, reason="the leaves show on both sides, so one texture serves both")
        return replace(decision, on=True, reason=f"leaves show on one side only on level {', '.join(two_sided)}")

    def texture_bytes(self, chain: leafcloud.Chain) -> int:
        return sum(level.texels // 2 for level in chain.clouds if level.two_sided) * BYTES_PER_TEXEL

    def add_to_cloud(self, built: BuiltLevel, level: leafcloud.Level, build: Build) -> BuiltLevel:
        """Draw each pair as one polygon in Blender, where a ray tracer's rays would meet both."""
        from ..levels.sides import two_sided_material
        from ..nodes.sides import add_side_modifier

        if not level.two_sided:
            return built
        material = two_sided_material(built.object.data.materials[0])
        add_side_modifier(built.object, material)
        return replace(built, two_sided=material)


EFFECT = BackSidesEffect()
