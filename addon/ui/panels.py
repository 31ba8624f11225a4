"""The main panel in the 3D view's sidebar, and the panels of settings and effects below it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..plan.quality import allowed_difference
from ..settings.bake import BakeSettings
from ..settings.effects import EFFECTS
from .presets import LEAFCLOUD_PT_presets
from .properties import AUTO, OFF, ON, effect_label, effect_property
from .selected_tree import selection_words
from .views import are_labelled
from .wrapped import add_text


class LEAFCLOUD_PT_bake(bpy.types.Panel):
    """The first panel: the selection, its purpose, the quality, and the button."""

    bl_idname = "LEAFCLOUD_PT_bake"
    bl_label = "Levels of Detail"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        LEAFCLOUD_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        settings, status = context.scene.leafcloud, context.window_manager.leafcloud
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        words = selection_words(context)
        if words:
            add_text(layout, context, words, "OUTLINER_OB_MESH")
        else:
            layout.label(text="Select leaves and trunk of a tree", icon="INFO")
            layout.operator("leafcloud.sample")
            layout.operator("leafcloud.import_folder")
        column = layout.column(align=True)
        column.prop(settings, "engine")
        if settings.engine != BakeSettings.engine:
            column.prop(settings, "directory")
            if not settings.directory:
                column.label(text="Choose a folder for the engine's files", icon="ERROR")
        column = layout.column(align=True)
        column.prop(settings, "quality", slider=True)
        if not settings.pixels:
            column.label(text=_consequence(settings.quality), icon="BLANK1")
        row = layout.row(align=True)
        row.scale_y = 1.5
        if status.stage:
            row.progress(factor=status.fraction, text=f"{status.stage}{status.left}")
            row.operator("leafcloud.cancel", text="", icon="X")
        else:
            row.operator("leafcloud.bake")
        if status.note and status.viewer != settings.viewer:
            _add_note(layout, context)
        layout.operator("leafcloud.labels", depress=are_labelled())


class _Settings:
    """A closed panel below the first, with groups of settings."""

    bl_parent_id = "LEAFCLOUD_PT_bake"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_options = frozenset({"DEFAULT_CLOSED"})
    groups: tuple[tuple[str, ...], ...] = ()

    if TYPE_CHECKING:
        layout: bpy.types.UILayout

    def draw(self, context: bpy.types.Context) -> None:
        settings, layout = context.scene.leafcloud, self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for group in self.groups:
            column = layout.column(align=True)
            for name in group:
                if name not in _OF_PRUNING or settings.chain != "billboards":
                    column.prop(settings, name)


_OF_PRUNING = ("prune_pixels", "prune_half")
"""Settings of chains that prune leaves."""


class LEAFCLOUD_PT_levels(_Settings, bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_levels"
    bl_label = "Levels"
    groups = (
        ("leaves", "trees"),
        ("form", "epsilon", "triangles", "levels", "cross", "last", "every_level"),
        ("sizes", "scene", "memory_budget"),
        ("pixels", "viewer"),
        ("chain", *_OF_PRUNING),
    )


class LEAFCLOUD_PT_textures(_Settings, bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_textures"
    bl_label = "Textures"
    groups = (("texture_size", "texture_height", "samples"), ("refine", "close_gaps", "bend_normals", "unlit"))


class LEAFCLOUD_PT_search(_Settings, bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_search"
    bl_label = "Search"
    groups = (("effort", "candidates", "seed"), ("max_billboards", "max_corners", "min_visibility"))


class LEAFCLOUD_PT_output(_Settings, bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_output"
    bl_label = "Output"
    groups = (("directory", "files", "compress"),)


class LEAFCLOUD_PT_effects(bpy.types.Panel):
    """A row for each effect: its planned state and a choice that overrides the plan. Below it: cost and reason."""

    bl_idname = "LEAFCLOUD_PT_effects"
    bl_label = "Effects"
    bl_parent_id = "LEAFCLOUD_PT_bake"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings, planned = context.scene.leafcloud, context.window_manager.leafcloud.plan
        layout = self.layout
        layout.operator("leafcloud.plan")
        for name in EFFECTS:
            row = planned.get(name)
            column = layout.column(align=True)
            line = column.row(align=True)
            line.label(text=effect_label(name), icon="BLANK1" if row is None else _ICONS[row.state])
            line.prop(settings, effect_property(name), text="")
            if row is None:
                continue
            below = column.column(align=True)
            below.active = row.state != OFF
            if row.cost:
                below.label(text=row.cost, icon="BLANK1")
            add_text(below, context, row.reason)


def _consequence(quality: float) -> str:
    """Return the difference that a quality allows, in a word and a number."""
    word = "Fast" if quality < 0.4 else "Exact" if quality > 0.6 else "Balanced"
    return f"{word}: {allowed_difference(quality):.1f} × a light breeze"


_REMEDIES = {"anywhere": "Make All Levels", "camera": "Only for This View"}
"""Label of the button that bakes with this value of the setting Viewer."""


def _add_note(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Add a box with the note on the camera, and a button that bakes with the other value of Viewer, if it has one."""
    status = context.window_manager.leafcloud
    box = layout.box()
    add_text(box, context, status.note, "INFO")
    if status.viewer:
        box.operator("leafcloud.bake", text=_REMEDIES[status.viewer]).viewer = status.viewer


_ICONS = {ON: "CHECKBOX_HLT", OFF: "CHECKBOX_DEHLT", AUTO: "QUESTION"}
