"""Roughness and metallic as a texture of the clouds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..plan import orm
from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import leafcloud

    from ..levels.building import Build
    from ..levels.material import Page


class RoughnessMetallicEffect(Effect):
    about = (
        "Give billboards a texture of roughness and metallic. Wanted where these differ among the leaves, as for wet "
        "or waxy ones. Costs a texture"
    )
    moving_light = True
    reads = ("orm",)
    is_page_texture = True

    def rule(self, situation: Situation) -> Rule:
        glossy = situation.facts.glossy
        if glossy is None:
            return False, "roughness and metallic do not vary visibly, so no texture is needed"
        if situation.unlit is not None:
            return False, situation.unlit
        return True, f"roughness and metallic vary in the material {glossy!r}, or differ from the other materials'"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (orm.RATE,) if orm.pays(self.name, decisions) else ()

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"orm": bool(on)}

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        return orm.seconds(self.name, chain, decisions)

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        return build.with_orm(self.name, page, level)


EFFECT = RoughnessMetallicEffect()
