"""What an effect will cost: seconds of baking, and bytes of what it adds to the levels before these are packed.

Each is in proportion to an amount that is known before the bake: vertices, texels, triangles; and what looks through
the crown takes longer the more leaves stand behind one another. The constants are fitted to measured trees; `make plan`
measures them anew, and compares estimates with what was measured. Seconds are those of the machine that they were
measured on. Known limit: how much wood can be left out, and in how many pieces billboards are cut that are blended,
shows when it is tried; here it is told by what goes with it, seams of the wood's texture and the size of leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ..settings import SMALLEST_TEXTURE, BakeSettings
from .effects import Effect, plan_levels
from .facts import Facts

BYTES_PER_TEXEL = 4
BILLBOARD_VERTICES = 1000
"""About as many vertices are there beside the leaves' own."""


@dataclass(frozen=True)
class Amounts:
    """What costs are in proportion to."""

    vertices: int
    """Of the leaves."""
    triangles: int
    """Of the leaves."""
    wood: int
    """Triangles beside all clouds, before they are simplified."""
    wood_left: int
    """Of them, about, when they are: seams hold triangles in place."""
    texels: int
    """Of the pages of all levels that are made."""
    far_texels: int
    """Of those behind level 1."""
    depth: float
    """Leaves that a line of sight meets."""
    leaf_size: float
    """Of a leaf, over R."""


@dataclass(frozen=True)
class Rate:
    """seconds = `fixed` + `per_layer` · depth + (`seconds` + `seconds_per_layer` · depth) · amount, bytes = `nbytes` ·
    amount; depth is that of the crown."""

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
    """What the bake will have of each."""
    clouds, cross = plan_levels(settings, facts, effects)
    pages = [_page_texels(settings, number) for number in range(clouds)]
    pages += [min(_cross_texels(settings), _page_texels(settings, clouds))] if cross else []
    wood, left = facts.wood * clouds, min(max(4.0 * facts.wood_seams**1.5, 0.1), 1.0)
    texels, leaf_size = (sum(pages), sum(pages[1:])), facts.leaf_size / facts.radius
    return Amounts(facts.vertices, facts.triangles, wood, round(left * wood), *texels, facts.depth, leaf_size)


def with_costs(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects with what each is expected to cost: nothing where it is off, all it may where it is undecided.

    Occlusion shares an image with gloss, and self-shadowing with both: the first of them that is on pays for it.
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
            rates.append(_WOOD_LEFT)
        if effect.name == "pruning":
            rates += [_ORDER] if settings.chain == "billboards" else [_ORDER, _GROWTH]
        seconds, nbytes = sum(each.time(known) for each in rates), sum(each.size(known) for each in rates)
        result.append(replace(effect, seconds=seconds, bytes=round(nbytes)))
    return tuple(result)


def _page_texels(settings: BakeSettings, number: int) -> int:
    width, height = settings.texture_size, settings.texture_height or settings.texture_size
    return max(width >> number, SMALLEST_TEXTURE) * max(height >> number, SMALLEST_TEXTURE)


def _cross_texels(settings: BakeSettings) -> int:
    """Of the cross, whose page has two texels a pixel where the cross takes over, at a deviation of half of R."""
    side: int = 2 ** math.ceil(math.log2(16.0 * settings.pixels))
    return side * side


def _vertices(known: Amounts) -> int:
    """With those of level 1's billboards, and of leaves that lie on several of them."""
    return known.vertices + BILLBOARD_VERTICES


def _triangles(known: Amounts) -> int:
    return known.triangles


def _wood(known: Amounts) -> int:
    return known.wood


def _wood_left(known: Amounts) -> int:
    return known.wood_left


def _texels(known: Amounts) -> int:
    return known.texels


def _first_texels(known: Amounts) -> int:
    return known.texels - known.far_texels


def _far_texels(known: Amounts) -> int:
    return known.far_texels


def _pieces(known: Amounts) -> int:
    """Of billboards that are blended: large leaves take more of them, but files hardly more than the leaves have."""
    return min(4_000 + min(round(100_000 * known.leaf_size), 2 * known.triangles), 7 * known.triangles)


_SHARING = ("gloss", "occlusion", "self_shadowing")
_GLOSS = Rate(_texels, BYTES_PER_TEXEL, seconds=1.65e-7, seconds_per_layer=8.3e-9)
_WOOD_LEFT = Rate(_wood_left, 87.0)
_ORDER = Rate(_triangles, fixed=0.065, per_layer=0.028, seconds=2.25e-6)
"""Looking how much of each leaf is seen."""
_GROWTH = Rate(_triangles, fixed=0.11, per_layer=0.0225, seconds=1.45e-6)
"""Looking at pruned leaves."""

RATES: dict[str, Rate] = {
    "transitions": Rate(_vertices, 41.0, seconds=1.0e-7),
    "pruning": Rate(_vertices, 16.5, seconds=1.0e-8),
    "back_sides": Rate(_texels, 1.64),
    "trunk_levels": Rate(_wood, fixed=0.04, seconds=2.8e-5),
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
