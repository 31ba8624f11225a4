"""Trunk levels: for each cloud a trunk with the triangles that are seen through its leaves.

Where quality decides, clouds may show thin branches themselves (`leafcloud.build_chain`, `twigs`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings


class TrunkLevelsEffect(Effect):
    about = (
        "Simplify trunk and branches for each cloud; thin branches may be on the clouds themselves. Wanted where a "
        "tree with a trunk is seen from far away. Off: all clouds have the trunk of LOD 0"
    )

    def rule(self, situation: Situation) -> Rule:
        trunk = situation.facts.trunk
        if trunk == 0:
            return False, "the tree has no trunk or branches"
        if situation.only_leaves:
            return False, f"{situation.where}, and {situation.takes_over(1)}: only LOD 0's trunk is seen"
        if situation.seen is not None:
            return True, f"{situation.where}, and sees {trunk} trunk triangles beside billboards"
        return True, f"{situation.free_camera}, so it may see {trunk} trunk triangles from far away"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        simplify = Rate(lambda known: known.trunk, fixed=0.3, seconds=8.0e-6)
        return simplify, Rate(lambda known: known.trunk_left, 87.0)


EFFECT = TrunkLevelsEffect()
