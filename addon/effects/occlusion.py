"""Occlusion: the fraction of ambient light that the crown keeps from each leaf, as a texture of the clouds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..plan import orm
from ..plan.decision import Decision, first_on
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import leafcloud

    from ..levels.building import Build
    from ..levels.material import Page


class OcclusionEffect(Effect):
    about = (
        "Give billboards a texture of ambient occlusion, which darkens the inside of the crown. The leaves have none, "
        "so levels differ where they take over. Wanted only on request"
    )
    moving_light = True
    reads = ("orm",)
    is_page_texture = True

    def rule(self, situation: Situation) -> Rule:
        return False, "the leaves have no occlusion, so billboards would differ where they take over"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        measure = Rate(lambda known: known.triangles, fixed=0.023, per_layer=0.05, seconds=1.15e-6)
        return (measure, orm.RATE) if orm.pays(self.name, decisions) else (measure,)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"occlusion": bool(on)}

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        return orm.seconds(self.name, chain, decisions) + sky_seconds(self.name, chain, decisions)

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        return replace(build.with_orm(self.name, page, level), occluded=True)


def sky_seconds(name: str, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
    """Return the core's seconds for looking at the sky, if they are charged to the effect `name`; else 0."""
    return chain.look_seconds["sky"] if first_on(decisions, ("occlusion", "self_shadowing")) == name else 0.0


EFFECT = OcclusionEffect()
