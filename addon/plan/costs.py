"""What an effect will cost: seconds of baking, and bytes of what it adds to the levels before these are packed.

Each is in proportion to one amount that is known before the bake: vertices, texels, triangles. The constants are means
over measured trees; `make plan` measures them anew, and compares estimates with what was measured.
Seconds are those of the machine that they were measured on.
"""

from __future__ import annotations

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
    texels: int
    """Of the pages of all levels that are made."""
    far_texels: int
    """Of those behind level 1."""


@dataclass(frozen=True)
class Rate:
    """seconds = `fixed` + `seconds` · amount, bytes = `nbytes` · amount."""

    amount: Callable[[Amounts], int]
    fixed: float
    seconds: float
    nbytes: float


def amounts(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> Amounts:
    """What the bake will have of each."""
    clouds, cross = plan_levels(settings, facts, effects)
    pages = [_page_texels(settings, number) for number in range(clouds + cross)]
    return Amounts(facts.vertices, facts.triangles, facts.wood * clouds, sum(pages), sum(pages[1:]))


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
        amount = rate.amount(known)
        seconds, nbytes = rate.fixed + rate.seconds * amount, rate.nbytes * amount
        if effect.name in _SHARING and not paid:
            paid = True
            seconds, nbytes = seconds + _GLOSS.seconds * amount, nbytes + _GLOSS.nbytes * amount
        if effect.name == "pruning" and settings.chain != "billboards":
            seconds += _GROWTH_SECONDS
        result.append(replace(effect, seconds=seconds, bytes=round(nbytes)))
    return tuple(result)


def _page_texels(settings: BakeSettings, number: int) -> int:
    width, height = settings.texture_size, settings.texture_height or settings.texture_size
    return max(width >> number, SMALLEST_TEXTURE) * max(height >> number, SMALLEST_TEXTURE)


def _vertices(known: Amounts) -> int:
    """With those of level 1's billboards, and of leaves that lie on several of them."""
    return known.vertices + BILLBOARD_VERTICES


def _triangles(known: Amounts) -> int:
    return known.triangles


def _wood(known: Amounts) -> int:
    return known.wood


def _texels(known: Amounts) -> int:
    return known.texels


def _first_texels(known: Amounts) -> int:
    return known.texels - known.far_texels


def _far_texels(known: Amounts) -> int:
    return known.far_texels


_SHARING = ("gloss", "occlusion", "self_shadowing")
_GLOSS = Rate(_texels, 0.0, 6.4e-7, BYTES_PER_TEXEL)
_GROWTH_SECONDS = 0.3
"""Looking at pruned leaves."""

RATES: dict[str, Rate] = {
    "transitions": Rate(_vertices, 0.0, 6.0e-7, 40.0),
    "pruning": Rate(_vertices, 0.0, 1.0e-7, 16.0),
    "back_sides": Rate(_texels, 0.0, 0.0, 1.6),
    "trunk_levels": Rate(_wood, 0.0, 2.5e-4, 44.0),
    "far_levels": Rate(_far_texels, 3.0, 2.5e-6, BYTES_PER_TEXEL),
    "normals": Rate(_texels, 0.0, 2.1e-7, BYTES_PER_TEXEL),
    "gloss": Rate(_texels, 0.0, 0.0, 0.0),
    "translucency": Rate(_texels, 0.0, 2.6e-7, BYTES_PER_TEXEL),
    "occlusion": Rate(_texels, 0.6, 0.0, 0.0),
    "self_shadowing": Rate(_texels, 0.0, 5.7e-7, BYTES_PER_TEXEL),
    "shadow_proxy": Rate(_first_texels, 0.0, 1.0e-7, BYTES_PER_TEXEL),
    "leaf_map": Rate(_texels, 0.0, 5.7e-7, 2 * BYTES_PER_TEXEL),
    "contrast": Rate(_triangles, 0.2, 1.4e-5, 0.0),
    "wind": Rate(_vertices, 0.5, 6.0e-7, 20.0),
    "baked_light": Rate(_triangles, 1.0, 1.0e-4, 72.0),
}
