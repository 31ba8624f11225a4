"""Cost estimates of the effects: seconds of baking, and uncompressed bytes added to the levels.

A cost is proportional to an amount that is known before the bake: vertices, texels or triangles. Effects that look
through the crown take longer the more leaves overlap along a line of sight. The constants are fitted to measured trees.
`make bench-plan` measures the costs again and compares them with the estimates. Seconds apply to the measuring machine.

Known limit: two amounts are only known after the bake. The trunk triangles left after simplification are estimated from
the seams of the trunk's texture, the pieces of blended billboards from the leaf size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ..settings.bake import BakeSettings
from .effects import Effect, plan_levels
from .facts import Facts
from .pages import page_size

BYTES_PER_TEXEL = 4
BILLBOARD_VERTICES = 1000
"""Typical number of vertices that level 1's billboards and leaves split between billboards add."""


@dataclass(frozen=True)
class Amounts:
    """The amounts that costs are proportional to."""

    vertices: int
    """Vertices of the leaves."""
    triangles: int
    """Triangles of the leaves."""
    trunk: int
    """Trunk triangles of all clouds together, before simplification."""
    trunk_left: int
    """Estimated trunk triangles after simplification. Texture seams hold triangles in place."""
    texels: int
    """Texels of the atlas pages of all levels."""
    far_texels: int
    """Texels of the atlas pages after level 1's."""
    depth: float
    """Mean number of leaves along a line of sight."""
    leaf_size: float
    """Size of a leaf as a fraction of R."""


@dataclass(frozen=True)
class Rate:
    """The cost of an effect as a function of an amount, with `depth` from `Amounts`.

    seconds = `fixed` + `per_layer` · depth + (`seconds` + `seconds_per_layer` · depth) · amount
    bytes = `nbytes` · amount
    """

    amount: Callable[[Amounts], int]
    nbytes: float = 0.0
    fixed: float = 0.0
    per_layer: float = 0.0
    seconds: float = 0.0
    seconds_per_layer: float = 0.0

    def time(self, known: Amounts) -> float:
        each = self.seconds + self.seconds_per_layer * known.depth
        return self.fixed + self.per_layer * known.depth + each * self.amount(known)

    def size(self, known: Amounts) -> float:
        return self.nbytes * self.amount(known)


def amounts(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> Amounts:
    """Return the amounts of the bake, known or estimated."""
    clouds, cross = plan_levels(settings, facts, effects)
    pages = [_page_texels(settings, number) for number in range(clouds)]
    pages += [min(_cross_texels(settings), _page_texels(settings, clouds))] if cross else []
    trunk, left = facts.trunk * clouds, min(max(4.0 * facts.trunk_seams**1.5, 0.1), 1.0)
    texels, leaf_size = (sum(pages), sum(pages[1:])), facts.leaf_size / facts.radius
    return Amounts(facts.vertices, facts.triangles, trunk, round(left * trunk), *texels, facts.depth, leaf_size)


def with_costs(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with their estimated costs. An effect that is off costs nothing, an undecided one its maximum.

    Roughness and metallic, occlusion and self-shadowing share an image. The first of them that is on pays for it.
    """
    known = amounts(settings, facts, effects)
    result = []
    paid = False
    for effect in effects:
        rate = RATES.get(effect.name)
        if effect.on is False or rate is None:
            result.append(replace(effect, seconds=0.0, bytes=0))
            continue
        rates = [rate]
        if effect.name in _SHARING and not paid:
            paid = True
            rates.append(_GLOSS)
        if effect.name == "trunk_levels":
            rates.append(_TRUNK_LEFT)
        if effect.name == "pruning":
            rates += [_ORDER] if settings.chain == "billboards" else [_ORDER, _GROWTH]
        seconds, nbytes = sum(each.time(known) for each in rates), sum(each.size(known) for each in rates)
        result.append(replace(effect, seconds=seconds, bytes=round(nbytes)))
    return tuple(result)


def _page_texels(settings: BakeSettings, number: int) -> int:
    width, height = page_size(settings, number)
    return width * height


def _cross_texels(settings: BakeSettings) -> int:
    """Return the texels of the cross impostor's atlas page: two per pixel at its switch, for a deviation of R / 2."""
    side: int = 2 ** math.ceil(math.log2(16.0 * settings.pixels))
    return side * side


def _vertices(known: Amounts) -> int:
    """Return the vertices of the leaves and of level 1's billboards."""
    return known.vertices + BILLBOARD_VERTICES


def _triangles(known: Amounts) -> int:
    return known.triangles


def _trunk(known: Amounts) -> int:
    return known.trunk


def _trunk_left(known: Amounts) -> int:
    return known.trunk_left


def _texels(known: Amounts) -> int:
    return known.texels


def _first_texels(known: Amounts) -> int:
    return known.texels - known.far_texels


def _far_texels(known: Amounts) -> int:
    return known.far_texels


def _pieces(known: Amounts) -> int:
    """Return the estimated number of pieces of blended billboards.

    It grows with the leaf size. Files limit it to about the triangles of the leaves.
    """
    return min(4_000 + min(round(100_000 * known.leaf_size), 2 * known.triangles), 7 * known.triangles)


_SHARING = ("gloss", "occlusion", "self_shadowing")
_GLOSS = Rate(_texels, BYTES_PER_TEXEL, seconds=1.65e-7, seconds_per_layer=8.3e-9)
_TRUNK_LEFT = Rate(_trunk_left, 87.0)
_ORDER = Rate(_triangles, fixed=0.065, per_layer=0.028, seconds=2.25e-6)
"""Measuring how much of each leaf is visible."""
_GROWTH = Rate(_triangles, fixed=0.11, per_layer=0.0225, seconds=1.45e-6)
"""Rendering pruned leaves to measure their growth."""

RATES: dict[str, Rate] = {
    "transitions": Rate(_vertices, 41.0, seconds=1.0e-7),
    "pruning": Rate(_vertices, 16.5, seconds=1.0e-8),
    "back_sides": Rate(_texels, 1.64),
    "trunk_levels": Rate(_trunk, fixed=0.04, seconds=2.8e-5),
    "far_levels": Rate(_far_texels, BYTES_PER_TEXEL, fixed=0.25, seconds=4.6e-7),
    "normals": Rate(_texels, BYTES_PER_TEXEL, seconds=8.0e-8),
    "gloss": Rate(_texels),
    "translucency": Rate(_texels, BYTES_PER_TEXEL, seconds=1.0e-7),
    "blend_order": Rate(_pieces, 125.0, fixed=0.06, seconds=6.0e-6),
    "occlusion": Rate(_triangles, fixed=0.023, per_layer=0.05, seconds=1.15e-6),
    "self_shadowing": Rate(_texels, BYTES_PER_TEXEL, seconds=1.55e-7, seconds_per_layer=7.3e-9),
    "shadow_proxy": Rate(_first_texels, BYTES_PER_TEXEL, seconds=1.65e-7),
    "leaf_map": Rate(_texels, 2 * BYTES_PER_TEXEL, seconds=1.63e-7, seconds_per_layer=6.4e-9),
    "contrast": Rate(_triangles, fixed=0.03, seconds=4.5e-6, seconds_per_layer=1.05e-6),
    "wind": Rate(_vertices, 20.0, fixed=0.16),
    "baked_light": Rate(_triangles, 72.0, fixed=0.07, seconds=1.35e-4, seconds_per_layer=1.25e-4),
}
