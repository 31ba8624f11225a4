"""Translucency: the color of light that shines through the leaves, as a texture of the clouds."""

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


class TranslucencyEffect(Effect):
    about = (
        "Let light shine through the billboards as through their leaves. Wanted for translucent leaves against the "
        "light. Costs a texture"
    )
    moving_light = True
    reads = ("translucency",)
    is_page_texture = True
    channels = ("translucency",)

    def rule(self, situation: Situation) -> Rule:
        translucent = situation.facts.translucent
        if translucent is None:
            return False, "no leaf material is translucent"
        if situation.unlit is not None:
            return False, situation.unlit
        return True, f"{situation.light}, and the material {translucent!r} is translucent"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.texels, BYTES_PER_TEXEL, seconds=1.0e-7),)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"translucency": bool(on)}

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        from ..levels.material import with_opaque_parts

        if level.translucency is None:
            return page
        pixels = with_opaque_parts(level.translucency, level.base_color)
        image = build.image(self.name, f"{page.name}_translucency", pixels, level, data=False)
        opaque_parts = bool((pixels[..., 3] == 0).any())
        return replace(page, translucency=image, share=build.shading.share, opaque_parts=opaque_parts)


EFFECT = TranslucencyEffect()
