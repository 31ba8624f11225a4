"""Shadow proxy: an invisible mesh of level 1's billboards that casts the leaves' shadow in engines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import BYTES_PER_TEXEL, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import bpy

    from ..levels.building import Build

WORTH_A_PROXY = 2000
"""Leaf triangles from which a shadow proxy pays off: some ten times as many as a cloud has."""


class ShadowProxyEffect(Effect):
    about = (
        "Cast the leaves' shadow by an invisible mesh of few billboards. Wanted in engines that draw shadow maps, for "
        "trees of many leaves. Costs a texture, and some leaves are shaded wrongly"
    )
    moving_light = True

    def rule(self, situation: Situation) -> Rule:
        facts = situation.facts
        if situation.unlit is not None:
            return False, situation.unlit
        if situation.settings.chain == "pruning":
            return False, "`chain=pruning` has no cloud that could cast the leaves' shadow"
        if facts.engine == "generic":
            return False, "each level casts its own shadow; a proxy would shade some leaves wrongly"
        if facts.triangles < WORTH_A_PROXY:
            return False, f"{facts.triangles} triangles of leaves cost a shadow map next to nothing"
        return (
            True,
            f"every light in {facts.engine} would draw {facts.triangles} triangles of leaves again for its shadows",
        )

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.first_texels, BYTES_PER_TEXEL, seconds=1.65e-7),)

    def add_to_tree(self, collection: bpy.types.Collection, build: Build) -> None:
        from ..levels.building import own_bytes
        from ..levels.shadow_proxy import add_shadow_proxy

        first = build.chain.clouds[0]
        build.costs.add_bytes(self.name, own_bytes(first, first.base_color))
        add_shadow_proxy(collection, build)


EFFECT = ShadowProxyEffect()
