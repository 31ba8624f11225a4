"""Cost estimates of the effects: seconds of baking, and uncompressed bytes added to the levels.

A cost is proportional to an amount that is known before the bake: vertices, texels or triangles. Effects that look
through the crown take longer the more leaves overlap along a line of sight. The constants of each effect are fitted to
measured trees; docs/decisions/plan.md compares measured with estimated costs. Seconds apply to the measuring machine.

Known limit: two amounts are only known after the bake. The trunk triangles left after simplification are estimated as
their maximum, the pieces of blended billboards from the leaf size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import leafcloud

from ..settings.bake import BakeSettings
from .decision import Decision
from .effects import plan_levels
from .facts import Facts
from .pages import page_size
from .quality import decides_distances
from .rates import Amounts
from .registry import effect_named
from .trunk_limits import FAR_TRIANGLES, NEAR_TRIANGLES

_PAGE_SHARE = 6.0
"""Texels of a page over the pixels of the square around the crown: 3 to 7 on the measured trees."""

_LATER = 5.0
"""Ratio of the sizes for which consecutive clouds are built by quality."""

_CROSS_PIXELS = 8.0
"""Deviation in pixels for which the cross impostor's page is made."""


def amounts(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> Amounts:
    """Return the amounts of the bake, known or estimated."""
    clouds, cross = plan_levels(settings, facts, effects)
    pages = [_page_texels(settings, number) for number in range(clouds)]
    pages += [min(_cross_texels(settings), _page_texels(settings, clouds))] if cross else []
    left = [min(facts.trunk, limit) for limit in (NEAR_TRIANGLES, *[FAR_TRIANGLES] * (clouds - 1))[:clouds]]
    texels, leaf_size = (sum(pages), sum(pages[1:])), facts.leaf_size / facts.radius
    return Amounts(facts.vertices, facts.triangles, facts.trunk * clouds, sum(left), *texels, facts.depth, leaf_size)


def with_costs(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> tuple[Decision, ...]:
    """Return the decisions with estimated costs. An effect that is off costs nothing, an undecided one its maximum."""
    known = amounts(settings, facts, effects)

    def with_cost(decision: Decision) -> Decision:
        on = decision.on is not False
        rates = effect_named(decision.name).rates(settings, effects) if on else ()
        seconds, nbytes = sum(rate.time(known) for rate in rates), sum(rate.size(known) for rate in rates)
        return replace(decision, seconds=float(seconds), bytes=round(nbytes))

    return tuple(map(with_cost, effects))


def _page_texels(settings: BakeSettings, number: int) -> int:
    """Return the number of texels of a cloud's atlas page: of the set size, or with texels of half a pixel where the
    cloud takes over, estimated from the square around the crown there."""
    width, height = page_size(settings, number)
    if settings.texture_size is not None or settings.texture_height is not None:
        return width * height
    if decides_distances(settings):
        within = leafcloud.page_side(settings.memory_budget) >> number
        crown = leafcloud.LARGEST_CROWN / _LATER**number
        return min(width * height, within * within, round(_PAGE_SHARE * (2.0 * crown) ** 2))
    deviation = sum(settings.error_bound * leafcloud.EPSILON_STEP**finer for finer in range(number + 1))
    return min(width * height, round(_PAGE_SHARE * (2.0 * settings.switch_pixels / deviation) ** 2))


def _cross_texels(settings: BakeSettings) -> int:
    """Return the number of texels of the cross impostor's atlas page.

    A side has two texels for each pixel at the distance where the impostor takes over, if it deviates by R / 2 there.
    """
    side: int = 2 ** math.ceil(math.log2(16.0 * (_CROSS_PIXELS if settings.pixels is None else settings.pixels)))
    return side * side
