"""Baked light: the scene's light in the levels' colors, for targets that draw them unlit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings
from ..settings.effects import AskedEffects, asked_effects

if TYPE_CHECKING:
    import bpy

    from ..levels.building import Build, BuiltLevel

_BY_NAME = "baked light is right only while no light changes, so it must be asked for by name or by `unlit`"


class BakedLightEffect(Effect):
    about = (
        "Bake the scene's light into the levels. Wanted for targets that draw without lighting, such as phones, while "
        "no light moves. Costs baking time"
    )

    def asked(self, asked: AskedEffects) -> bool | None:
        """Return False for the list all, which is for moving light."""
        return asked.named(self.name) if asked.base == "all" else asked.listed(self.name)

    def asked_reason(self, settings: BakeSettings) -> str:
        if asked_effects(settings.effects).base == "all":
            return f"{_BY_NAME}, not by `effects={settings.effects}`"
        return super().asked_reason(settings)

    def rule(self, situation: Situation) -> Rule:
        lights = situation.facts.lights
        if situation.facts.unlit:
            return False, "the leaves show their colors without light"
        if not situation.settings.unlit:
            return False, _BY_NAME
        if not lights.names:
            return False, "the target is unlit, but the scene has no light to bake"
        if lights.changing is not None:
            return False, f"the target is unlit, but {lights.changing}"
        shining = ", ".join(repr(name) for name in lights.names[:3]) + (" and others" if len(lights.names) > 3 else "")
        return True, f"the target is unlit, and the scene's lights do not change: {shining}"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.triangles, 72.0, fixed=0.07, seconds=1.35e-4, seconds_per_layer=1.25e-4),)

    def add_to_leaves(self, mesh: bpy.types.Mesh, build: Build) -> dict[str, Any]:
        from ..levels.baked_light import lit_material

        if build.light is not None:
            for number, material in enumerate(build.tree.leaves.materials):
                mesh.materials[number] = lit_material(material, build.light_strength)
        return {}

    def as_in_files(self, levels: Sequence[BuiltLevel]) -> AbstractContextManager[None]:
        from ..export.unlit import mean_light

        return mean_light(levels)


EFFECT = BakedLightEffect()
