"""Normals: a normal map, so that each billboard is lit as its leaves are."""

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

    from ..levels.building import Build
    from ..levels.material import Page


class NormalsEffect(Effect):
    about = (
        "Give billboards a normal map, so that they are lit as their leaves are. Wanted wherever light shines on the "
        "tree. Costs a texture"
    )
    moving_light = True
    reads = ("normals",)
    is_page_texture = True
    channels = ("normal",)

    def rule(self, situation: Situation) -> Rule:
        if situation.unlit is not None:
            return False, situation.unlit
        return True, f"{situation.light}, so the billboards are lit as their leaves would be"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.texels, BYTES_PER_TEXEL, seconds=8.0e-8),)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"normals": settings.bend_normals if on else None}

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        return replace(page, normal=build.image(self.name, f"{page.name}_normal", level.normal, level))


EFFECT = NormalsEffect()
