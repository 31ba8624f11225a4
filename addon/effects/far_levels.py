"""Far levels: the clouds after level 1, and the cross impostor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.rates import BYTES_PER_TEXEL, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings
from ..settings.effects import AskedEffects

if TYPE_CHECKING:
    import leafcloud

_LEVEL = "base_color"
"""The channel that every level has. The seconds of the others belong to their own effects."""


class FarLevelsEffect(Effect):
    about = (
        "Make the clouds after level 1, and the cross impostor. Wanted unless the camera stays near the tree. Costs "
        "baking time and textures"
    )

    def asked(self, asked: AskedEffects) -> bool | None:
        """Return True for every list but auto: settings of their own choose the levels."""
        if self.name in asked.forced or asked.base == "auto":
            return asked.listed(self.name)
        return True

    def asked_reason(self, settings: BakeSettings) -> str:
        return f"asked for by `levels={settings.levels}` with `effects={settings.effects}`"

    def rule(self, situation: Situation) -> Rule:
        seen = situation.seen
        if seen is None:
            return True, f"{situation.free_camera}, so it may see every level"
        needed = max(seen.last, 1)
        if needed + 1 >= len(seen.soonest):
            return True, f"{situation.where}, and {situation.takes_over(needed)}: every level is seen"
        left = f"only level {needed} is made" if needed == 1 else f"no level after level {needed} is made"
        return False, f"{situation.where}, and {situation.takes_over(needed + 1)}: {left}"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(lambda known: known.far_texels, BYTES_PER_TEXEL, fixed=0.25, seconds=4.6e-7),)

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        return sum(map(_own_seconds, chain.clouds[1:]))


def _own_seconds(level: leafcloud.Level) -> float:
    """Return the seconds of a level without the textures of other effects."""
    whole = level.seconds["fit"] + level.seconds["pack"] + level.seconds["bake"]
    return whole - sum(seconds for channel, seconds in level.channel_seconds.items() if channel != _LEVEL)


EFFECT = FarLevelsEffect()
