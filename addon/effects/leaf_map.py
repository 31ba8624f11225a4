"""Leaf map: label textures by which the leaf textures of a cloud can be swapped later."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import BYTES_PER_TEXEL, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import leafcloud

    from ..levels.building import Build, BuiltLevel


class LeafMapEffect(Effect):
    about = (
        "Give billboards label textures, so that leaf textures can be swapped later, for another season. Wanted only "
        "on request. Costs two textures"
    )
    is_page_texture = True
    channels = ("leaf_uv", "leaf_id")

    def rule(self, situation: Situation) -> Rule:
        return False, "only needed to swap the leaf textures later, for another season"

    def under_baked_light(self, decision: Decision) -> Rule:
        return False, "the light is baked in, and a swapped leaf texture would have none"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.texels, 2 * BYTES_PER_TEXEL, seconds=1.63e-7, seconds_per_layer=6.4e-9),)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"leaf_map": bool(on)}

    def add_to_cloud(self, built: BuiltLevel, level: leafcloud.Level, build: Build) -> BuiltLevel:
        """Add the label textures and the nodes that read the leaves' own images by them."""
        from ..levels.leaf_map import add_leaf_map

        name = built.object.name
        uv = build.image(self.name, f"{name}_leaf_uv", level.leaf_uv, level)
        leaf = build.image(self.name, f"{name}_leaf_id", level.leaf_id, level)
        if uv is not None and leaf is not None:
            add_leaf_map(built.object.data.materials[0], uv, leaf, build.leaf_materials)
        return built


EFFECT = LeafMapEffect()
