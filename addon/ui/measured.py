"""The last measured cost curve with its chart, and predictions from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import bpy.utils.previews
import numpy as np

import leafcloud

from ..bake.drawing import LevelDrawing, drawing_costs, level_results
from ..bake.pipeline import chain_options
from ..bake.values import Baked, Prepared
from ..levels.results import keep_results
from ..levels.thumbnails import keep_thumbnails
from ..plan.camera_visibility import seen_as_set
from ..plan.effects import plan_effects
from ..plan.facts import Facts
from ..settings.bake import BakeSettings
from ..settings.levels import WISHES

CHART_SIZE = (640, 480)
"""Width and height in pixels: about twice those of a sidebar, for high-resolution screens."""
_SHOWN = 8
"""Approximate number of points in the list."""
_TEXT = 2.4
"""Size of the chart's letters relative to a printed page: about the size of the panel's own text."""


Shape = tuple[int, int, float, float]
"""Triangle count, leaf count, radius and area of a tree's leaves. They identify the tree."""


def shape_of(foliage: leafcloud.Foliage) -> Shape:
    """Return the numbers that identify a tree."""
    return foliage.triangle_count, foliage.leaf_count, foliage.radius, foliage.area


@dataclass
class Measured:
    """The curve of one tree, with its chart in a preview collection of its own."""

    curve: leafcloud.Curve
    offers: list[leafcloud.Offer]
    presets: dict[leafcloud.Preset, leafcloud.Offer]
    shown: list[leafcloud.Offer]
    """The offers in the panel's list: all presets, and others spread evenly over the logarithm of the error."""
    title: str
    """Name of the tree."""
    tree: Shape
    facts: Facts
    """Scene facts at the time of the measurement."""
    previews: bpy.utils.previews.ImagePreviewCollection
    icon: int
    """Icon of the chart; 0 if Blender cannot show previews."""


_last: list[Measured] = []


def last() -> Measured | None:
    """Return the last measured curve, or None."""
    return _last[-1] if _last else None


def keep(curve: leafcloud.Curve, title: str, prepared: Prepared) -> None:
    """Store the curve of a tree and its chart in place of the previous one."""
    width, height = CHART_SIZE
    picture = curve.picture("offers", title=title, width=width, height=height, text=_TEXT)
    shown = _some(curve)
    forget()
    previews = bpy.utils.previews.new()
    preview = previews.new("chart")
    preview.image_size = (width, height)
    # Blender stores rows from bottom to top.
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
    """Free the stored curve and its chart."""
    while _last:
        bpy.utils.previews.remove(_last.pop().previews)


def can_predict(settings: BakeSettings) -> bool:
    """Return whether a curve applies to such a bake: unpruned leaves, the stochastic method, a fixed error bound."""
    wished = any(getattr(settings, wish) is not None for wish in WISHES)
    bounds = (settings.max_billboards, settings.max_texels, settings.image_epsilon)
    free = settings.method == "stochastic" and bounds == (None, None, None)
    return settings.chain == "billboards" and free and not wished


def expected(measured: Measured, settings: BakeSettings) -> leafcloud.Prediction:
    """Predict a bake of the measured tree with these settings. Plan the effects anew from the stored facts."""
    facts = seen_as_set(settings, measured.facts)
    return measured.curve.predict(**chain_options(settings, facts, plan_effects(settings, facts)))


def predicted(prepared: Prepared) -> Prepared:
    """Add the curve's prediction to a prepared bake, if the last curve was measured on the same tree."""
    measured = last()
    if measured is None or measured.tree != shape_of(prepared.foliage) or not can_predict(prepared.settings):
        return prepared
    options = chain_options(prepared.settings, prepared.facts, prepared.effects)
    return replace(prepared, predicted=measured.curve.predict(**options))


_told: list[str] = []


def told() -> tuple[str, ...]:
    """Return the lines about the last bake: time and error beside the prediction, and what each level saves.

    Empty before the first bake.
    """
    return tuple(_told)


def tell_nothing() -> None:
    """Clear the result of the last bake."""
    _told.clear()


def keep_figures(tree: Baked) -> list[LevelDrawing]:
    """Store figures and pictures of the levels with the tree's collection. Return the costs of drawing them."""
    costs = drawing_costs(tree)
    keep_results(tree.collection, level_results(tree, costs))
    keep_thumbnails([level.object for level in tree.levels], tree.chain.levels)
    return costs


def tell(tree: Baked) -> None:
    """Store the result of a finished bake, for the cost curve and with the tree's collection."""
    prepared, chain = tree.prepared, tree.chain
    expected = prepared.predicted if chain.chosen is None else chain.chosen["predicted"]
    beside = "" if expected is None else f" (expected {expected['seconds']:.1f} s, {expected['image_error']:.3f})"
    _told[:] = [f"Baked: {chain.seconds:.1f} s, error {chain.levels[0].image_error:.3f}{beside}"]
    for number, cost in enumerate(keep_figures(tree)[1:], start=1):
        times = f"{cost.cheaper:.1f} × cheaper" if cost.cheaper >= 1.0 else f"{1.0 / cost.cheaper:.1f} × dearer"
        _told.append(f"Level {number}: {times} to draw than the leaves at {tree.view.of_height(cost.crown_pixels)}")
    if chain.left_out:
        _told.append(f"Left out, no cheaper: {len(chain.left_out)} of {len(chain.left_out) + len(chain.levels)} levels")
