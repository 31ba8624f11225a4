"""The cost curve in the sidebar: measuring it, its chart and buttons for its points."""

from __future__ import annotations

import math

import bpy
from bpy.props import IntProperty

import leafcloud

from ..bake.pipeline import layer_of, prepare, start_curve
from ..errors import SceneError
from ..settings.bake import BakeSettings
from ..settings.levels import LARGEST_TEXTURE, SMALLEST_TEXTURE
from ..settings.setting import SettingsError
from ..steps import Steps
from . import measured
from .job_operator import JobOperator
from .properties import bake_settings, with_labels
from .selection import selected_trees

_CHOSEN = ("epsilon", "texture_size", "samples", "effort")
"""Settings that a point of the curve sets."""


def forget_curve() -> None:
    """Free the chart and clear the result of the last bake."""
    measured.forget()
    measured.tell_nothing()


class LEAFCLOUD_OT_curve(JobOperator, bpy.types.Operator):
    """Measure image error and time of some settings on a sample of the selected leaves. Takes seconds"""

    bl_idname = "leafcloud.curve"
    bl_label = "Measure Cost Curve"
    bl_options = {"REGISTER"}

    def begin(self, context: bpy.types.Context) -> leafcloud.Job[leafcloud.Curve]:
        settings = bake_settings(context.scene.leafcloud)
        with selected_trees(context) as trees:
            if len(trees) > 1:
                raise SceneError(
                    f"{len(trees)} trees are selected, but a cost curve measures one: select the objects of one tree"
                )
            [(self._name, tree)] = trees.items()
            self._prepared = prepare(tree, settings, layer_of(context.scene))
        return start_curve(self._prepared, quick=True)

    def end(self, context: bpy.types.Context, curve: leafcloud.Curve) -> Steps[set[str]]:
        yield
        measured.keep(curve, self._name, self._prepared)
        self.report({"INFO"}, f"Measured {len(curve.rows)} settings on {self._name}")
        return {"FINISHED"}


class LEAFCLOUD_OT_pick(bpy.types.Operator):
    """Use the settings of this point of the cost curve"""

    bl_idname = "leafcloud.pick"
    bl_label = "Use These Settings"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Point", description="Number of the point on the cost curve; the fastest is 0", min=0)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if measured.last() is None:
            cls.poll_message_set("No cost curve has been measured yet")
            return False
        return True

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Return the tooltip: the settings of this point."""
        last = measured.last()
        if last is None or properties.index >= len(last.offers):
            return ""
        chosen = last.offers[properties.index]["settings"]
        return (
            f"Use the settings of this point: error bound {chosen['epsilon']:g}, {chosen['texture_size']} texels, "
            f"{chosen['samples']} samples, effort {chosen['effort']}"
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        last = measured.last()
        assert last is not None
        if self.index >= len(last.offers):
            self.report({"ERROR"}, f"The curve has {len(last.offers)} points, there is no point {self.index}")
            return {"CANCELLED"}
        settings, chosen = context.scene.leafcloud, last.offers[self.index]["settings"]
        if settings.texture_height:  # Keep the proportions of the atlas page.
            height = settings.texture_height * chosen["texture_size"] // (settings.texture_size or LARGEST_TEXTURE)
            settings.texture_height = max(height, SMALLEST_TEXTURE)
        for name in _CHOSEN:
            setattr(settings, name, chosen[name])
        settings.max_billboards, settings.seconds, settings.image_error = 0, 0.0, 0.0
        return {"FINISHED"}


def describe(offer: leafcloud.Offer) -> str:
    """Return a short text for a point. The sidebar is narrow."""
    predicted = offer["predicted"]
    return f"{predicted['seconds']:.1f} s, error {predicted['image_error']:.3f}"


def _is_used(settings: bpy.types.PropertyGroup, offer: leafcloud.Offer) -> bool:
    """Return whether a bake would use this point: its settings, and no wish."""
    if settings.max_billboards or settings.seconds or settings.image_error:
        return False
    chosen = offer["settings"]
    return math.isclose(settings.epsilon, chosen["epsilon"], rel_tol=1e-6) and (
        (settings.texture_size, settings.samples, settings.effort)
        == (chosen["texture_size"], chosen["samples"], chosen["effort"])
    )


class LEAFCLOUD_PT_curve(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_curve"
    bl_label = "Cost Curve"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings, last = self.layout, context.scene.leafcloud, measured.last()
        layout.operator("leafcloud.curve")
        if last is not None:
            layout.template_icon(icon_value=last.icon, scale=_icon_scale(context))
            row = layout.row(align=True)
            for preset, offer in last.presets.items():
                _add_point(row, last, settings, offer, preset.title())
            column = layout.column(align=True)
            for offer in last.shown:
                _add_point(column, last, settings, offer, describe(offer))
            _add_label(layout, expected(settings))
        column = layout.column(align=True)
        for line in measured.told():
            column.label(text=line)
        column = layout.column(align=True)
        column.use_property_split, column.use_property_decorate = True, False
        for name in ("seconds", "image_error"):
            column.prop(settings, name)


def _add_label(layout: bpy.types.UILayout, text: str) -> None:
    if text:
        layout.label(text=text)


def _add_point(
    layout: bpy.types.UILayout,
    last: measured.Measured,
    settings: bpy.types.PropertyGroup,
    offer: leafcloud.Offer,
    text: str,
) -> None:
    """Add a button that uses a point. It looks pressed while the settings equal the point's."""
    button = layout.operator("leafcloud.pick", text=text, depress=_is_used(settings, offer))
    button.index = last.offers.index(offer)


_UNIT = 20
"""Side of an icon at scale 1 in an unscaled interface, in pixels."""


def _icon_scale(context: bpy.types.Context) -> float:
    """Return the icon scale that makes the chart as wide as the panel."""
    if context.region is None:
        return 12.0
    return min(max(context.region.width / (context.preferences.system.ui_scale * _UNIT) - 2.5, 8.0), 30.0)


def expected(properties: bpy.types.PropertyGroup) -> str:
    """Return the prediction for the current settings, or why they are invalid; empty without a prediction."""
    last = measured.last()
    if last is None:
        return ""
    try:
        settings = bake_settings(properties)
    except SettingsError as error:
        return with_labels(str(error))
    if measured.can_predict(settings):
        predicted = measured.expected(last, settings)
        return f"{last.title}: expected {predicted['seconds']:.1f} s, error {predicted['image_error']:.3f}"
    offer = _wished(last.offers, settings)
    return "" if offer is None else f"{last.title}: expected about {describe(offer)}"


def _wished(offers: list[leafcloud.Offer], settings: BakeSettings) -> leafcloud.Offer | None:
    """Return about the point from which a bake starts to satisfy a wish for an error or for seconds."""
    if settings.image_error is not None:
        most = settings.image_error
        return next((offer for offer in offers if offer["predicted"]["image_error"] <= most), None)
    if settings.seconds is not None:
        time = settings.seconds
        return next((offer for offer in reversed(offers) if offer["predicted"]["seconds"] <= time), None)
    return None
