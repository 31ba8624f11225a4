"""Contrast: far, pruned leaves mix in the mean color, so that a crown of few large leaves keeps its contrast."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings
from .pruning import EFFECT as PRUNING
from .pruning import levels_prune

if TYPE_CHECKING:
    import bpy

    import leafcloud

    from ..levels.building import Build, BuiltLevel


class ContrastEffect(Effect):
    about = (
        "Mix the crown's mean color into pruned leaves, which would give far crowns too much contrast. Wanted where "
        "leaves of many colors are pruned. Costs baking time"
    )

    def rule(self, situation: Situation) -> Rule:
        if situation.facts.leaves == 1 or not levels_prune(situation.settings, situation.facts):
            return False, "no leaf is pruned before the first cloud takes over"
        if situation.facts.one_color:
            return False, "all leaves have the same color, so there is no contrast to keep"
        pruning = PRUNING.asked(situation.asked)
        if not (PRUNING.rule(situation)[0] if pruning is None else pruning):
            return False, f"{situation.where}, where no leaf is pruned"
        return True, "pruning enlarges the kept leaves, which would give far crowns too much contrast"

    def under_baked_light(self, decision: Decision) -> Rule:
        return False, "the light is baked in, and contrast would change base colors only"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.triangles, fixed=0.03, seconds=4.5e-6, seconds_per_layer=1.05e-6),)

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        return chain.look_seconds["contrast"]

    def add_to_leaves(self, mesh: bpy.types.Mesh, build: Build) -> dict[str, Any]:
        from ..levels.contrast import contrast_material, mean_color

        if not build.prunes_leaves:
            return {}
        mean = mean_color(build.foliage)
        for number, material in enumerate(build.tree.leaves.materials):
            mesh.materials[number] = contrast_material(material, mean)
        return {"contrast": list(build.chain.contrast), "mean_color": list(mean)}

    def as_in_files(self, levels: Sequence[BuiltLevel]) -> AbstractContextManager[None]:
        from ..export.plain_materials import plain_colors

        return plain_colors(levels)


EFFECT = ContrastEffect()
