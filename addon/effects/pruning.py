"""Pruning: fewer and larger leaves with distance. Levels get the rank and the pivot of each leaf."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..plan.camera_visibility import pixels_of, prune_start, share_at_level_1
from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.facts import Facts
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings

if TYPE_CHECKING:
    import leafcloud

_ORDER = Rate(lambda known: known.triangles, fixed=0.065, per_layer=0.028, seconds=2.25e-6)
"""Measuring the visible share of each leaf."""
_GROWTH = Rate(lambda known: known.triangles, fixed=0.11, per_layer=0.0225, seconds=1.45e-6)
"""Rendering pruned leaves to measure their growth."""


class PruningEffect(Effect):
    about = (
        "Draw fewer and larger leaves with distance. Wanted for trees that are seen from far away, and for scenes of "
        "many trees. Costs memory for each vertex"
    )

    def rule(self, situation: Situation) -> Rule:
        facts, settings, camera = situation.facts, situation.settings, situation.facts.camera
        if facts.leaves == 1:
            return False, "the foliage is one leaf, so there is nothing to prune"
        if not levels_prune(settings, facts):
            return _rule_of_scenes(situation)
        if camera is None:
            return True, f"{situation.free_camera}, so it may see {facts.leaves} leaves from far away"
        start = prune_start(settings, facts, camera.view)
        return camera.farthest > start, f"{situation.where}, and pruning starts at {start / facts.radius:.3g}"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        attributes = Rate(lambda known: known.all_vertices, 16.5, seconds=1.0e-8)
        return (attributes, _ORDER) if settings.chain == "billboards" else (attributes, _ORDER, _GROWTH)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"order_by_visibility": bool(on)}

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        return chain.look_seconds["order"] + chain.look_seconds["growth"]


def levels_prune(settings: BakeSettings, facts: Facts) -> bool:
    """Return whether the chain prunes leaves at some distance."""
    return settings.chain == "pruning" or (settings.chain == "both" and share_at_level_1(settings, facts) < 1.0)


def _rule_of_scenes(situation: Situation) -> Rule:
    """Return the state for levels that prune no leaves: a scene of many trees may still prune them."""
    facts, camera = situation.facts, situation.facts.camera
    if camera is None and situation.settings.chain == "both":
        return (
            False,
            f"the error bound {situation.settings.error_bound:g} lets level 1 take over before any leaf is pruned",
        )
    if camera is None:
        return False, "`chain=billboards` keeps all leaves until level 1 takes over"
    pixels = pixels_of(facts.leaf_size, camera.farthest, camera.view)
    if len(camera.spans) > 1 and pixels < 1.0:
        reason = f"where a leaf is {pixels:.2g} pixels wide, so a scene of many trees may prune leaves"
        return True, f"{situation.where}, {reason}"
    return False, f"{situation.where}, where all leaves stay until level 1 takes over"


EFFECT = PruningEffect()
