"""Self-shadowing: bent-normal occlusion, by which a shader dims each light where the crown hides it from a leaf."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..plan import orm
from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import BYTES_PER_TEXEL, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings
from .occlusion import sky_seconds

if TYPE_CHECKING:
    import leafcloud

    from ..levels.building import Build
    from ..levels.material import Page


class SelfShadowingEffect(Effect):
    about = (
        "Give billboards a texture by which a custom shader dims lights inside the crown, without shadow maps. Wanted "
        "only on request, for such a shader. Costs a texture"
    )
    moving_light = True
    reads = ("orm",)
    is_page_texture = True
    channels = ("bent_normal",)

    def rule(self, situation: Situation) -> Rule:
        return False, "renderers cast shadows themselves, and only a custom shader reads the texture"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        own = Rate(lambda known: known.texels, BYTES_PER_TEXEL, seconds=1.55e-7, seconds_per_layer=7.3e-9)
        return (own, orm.RATE) if orm.pays(self.name, decisions) else (own,)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"bent_normal": bool(on)}

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        own = super().core_seconds(chain, decisions)
        return own + orm.seconds(self.name, chain, decisions) + sky_seconds(self.name, chain, decisions)

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        image = build.image(self.name, f"{page.name}_bent_normal", level.bent_normal, level)
        return replace(build.with_orm(self.name, page, level), bent_normal=image)


EFFECT = SelfShadowingEffect()
