"""The cost curve that was measured last, and its chart: what the panel shows and predicts by."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import bpy.utils.previews
import numpy as np

import leafcloud

from ..baked import Prepared
from ..pipeline import chain_options
from ..plan.effects import plan_effects
from ..plan.facts import Facts
from ..plan.sight import seen_as_set
from ..settings import WISHES, BakeSettings

CHART_SIZE = (640, 480)
"""In pixels: about twice as many as a sidebar has, for fine screens."""
_SHOWN = 8
"""Points that are listed, about."""
_TEXT = 2.4
"""So much larger are its letters than on a page: as large, about, as the panel's own."""


Shape = tuple[int, int, float, float]
"""Triangles, leaves, radius and area of a tree's leaves: by these it is known again."""


def shape_of(foliage: leafcloud.Foliage) -> Shape:
    """What a tree is known again by."""
    return foliage.triangle_count, foliage.leaf_count, foliage.radius, foliage.area


@dataclass
class Measured:
    """A curve of one tree, in a preview collection of its own."""

    curve: leafcloud.Curve
    offers: list[leafcloud.Offer]
    presets: dict[leafcloud.Preset, leafcloud.Offer]
    shown: list[leafcloud.Offer]
    """Some of the offers, even in error, the presets among them: as many as a panel has room for."""
    title: str
    """What the tree was called."""
    tree: Shape
    facts: Facts
    """Of the scene that the tree was measured in."""
    previews: bpy.utils.previews.ImagePreviewCollection
    icon: int
    """Of the chart; 0 where Blender has no previews to show."""


_last: list[Measured] = []


def last() -> Measured | None:
    """What was measured last."""
    return _last[-1] if _last else None


def keep(curve: leafcloud.Curve, title: str, prepared: Prepared) -> None:
    """Keeps the curve of a tree and its chart in place of the one before."""
    width, height = CHART_SIZE
    picture = curve.picture("offers", title=title, width=width, height=height, text=_TEXT)
    shown = _some(curve)
    forget()
    previews = bpy.utils.previews.new()
    preview = previews.new("chart")
    preview.image_size = (width, height)
    # Blender's rows go up.
    preview.image_pixels_float.foreach_set(np.ascontiguousarray(picture[::-1], np.float32).ravel() / 255.0)
    tree, facts = shape_of(prepared.foliage), prepared.facts
    _last.append(Measured(curve, curve.offers, curve.presets, shown, title, tree, facts, previews, preview.icon_id))


def _some(curve: leafcloud.Curve) -> list[leafcloud.Offer]:
    def error(offer: leafcloud.Offer) -> float:
        return max(offer["predicted"]["image_error"], 1e-6)

    offers = curve.offers
    wanted = np.geomspace(error(offers[0]), error(offers[-1]), _SHOWN)
    nearest = [min(offers, key=lambda offer: abs(np.log(error(offer) / each))) for each in wanted]
    return [offer for offer in offers if offer in nearest or offer in curve.presets.values()]


def forget() -> None:
    """Frees what is kept."""
    while _last:
        bpy.utils.previews.remove(_last.pop().previews)


def can_predict(settings: BakeSettings) -> bool:
    """Whether a curve says anything of such a bake: of clouds of all leaves, whose bound is as it is set."""
    wished = any(getattr(settings, wish) is not None for wish in WISHES)
    bounds = (settings.max_billboards, settings.max_texels, settings.image_epsilon)
    free = settings.method == "stochastic" and bounds == (None, None, None)
    return settings.chain == "billboards" and free and not wished


def expected(measured: Measured, settings: BakeSettings) -> leafcloud.Prediction:
    """Of a bake with these settings of the tree in the scene that was measured, planned anew."""
    facts = seen_as_set(settings, measured.facts)
    return measured.curve.predict(**chain_options(settings, facts, plan_effects(settings, facts)))


def predicted(prepared: Prepared) -> Prepared:
    """With what the curve says of it, where that of the same tree was measured."""
    measured = last()
    if measured is None or measured.tree != shape_of(prepared.foliage) or not can_predict(prepared.settings):
        return prepared
    options = chain_options(prepared.settings, prepared.facts, prepared.effects)
    return replace(prepared, predicted=measured.curve.predict(**options))


_told: list[str] = []


def told() -> str:
    """What the last bake took and came to, beside what was expected; empty before one."""
    return _told[-1] if _told else ""


def tell_nothing() -> None:
    """As before any bake."""
    _told.clear()


def tell(prepared: Prepared, chain: leafcloud.Chain) -> None:
    """Keeps that of a bake that is done."""
    expected = prepared.predicted if chain.chosen is None else chain.chosen["predicted"]
    beside = "" if expected is None else f" (expected {expected['seconds']:.1f} s, {expected['image_error']:.3f})"
    _told[:] = [f"Baked: {chain.seconds:.1f} s, error {chain.levels[0].image_error:.3f}{beside}"]
