"""Blend order: triangles of alpha-blended clouds, cut where they cross and sorted from back to front in files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..plan.decision import Decision
from ..plan.effect import Effect, Rule
from ..plan.facts import Facts
from ..plan.rates import Amounts, Rate
from ..plan.situation import Situation
from ..settings.bake import BakeSettings
from ..settings.effects import AskedEffects, asked_effects


class BlendOrderEffect(Effect):
    about = (
        "Keep leaves alpha blended instead of cut out, and sort their billboards in files. Wanted for leaves that are "
        "mostly semi-transparent. Costs many triangles"
    )

    def asked(self, asked: AskedEffects) -> bool | None:
        """Return None for the list all: the transparency of the leaves decides."""
        if self.name not in asked.forced and asked.base == "all":
            return None
        return asked.listed(self.name)

    def rule(self, situation: Situation) -> Rule:
        facts = situation.facts
        if not facts.blended:
            return False, "no leaf material is alpha blended, and cutouts need no draw order"
        if not facts.see_through:
            return False, f"too few leaves are known to be semi-transparent, so {facts.blended[0]!r} is cut out"
        if situation.only_leaves:
            return False, situation.before_level_1
        return True, f"the material {facts.see_through[0]!r} is semi-transparent, so it is drawn back to front"

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        return (Rate(_pieces, 125.0, fixed=0.06, seconds=6.0e-6),)

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        return {"blended": bool(on)}


def blended_leaves(settings: BakeSettings, facts: Facts) -> tuple[str, ...]:
    """Return the names of the leaf materials that stay alpha blended in files.

    By default the mostly semi-transparent ones; if `effects` forces `blend_order`, all blended ones or none.
    """
    asked = asked_effects(settings.effects).forced.get(EFFECT.name)
    if asked is None:
        return facts.see_through
    return facts.blended if asked else ()


def _pieces(known: Amounts) -> int:
    """Return the estimated number of pieces of blended billboards.

    It grows with the leaf size. Files limit it to about the triangles of the leaves.
    """
    return min(4_000 + min(round(100_000 * known.leaf_size), 2 * known.triangles), 7 * known.triangles)


EFFECT = BlendOrderEffect()
