"""The baked tree in the sidebar: the shown level, the figures of each level, and the removal of all levels."""

from __future__ import annotations

from dataclasses import replace

import bpy
from bpy.props import IntProperty

from ..errors import SceneError
from ..levels.earlier import remove_levels
from ..levels.results import LevelResult, results_of, warnings_of
from ..levels.root import lod_factor, root_of
from ..levels.shown import SOURCES, show_level, shown_level, sources_of
from ..levels.thumbnails import thumbnail_of
from ..mesh.baked_levels import level_number, record
from ..nodes.laws import LOD_DISTANCE
from ..viewport.labels import length_words
from .framing import crown_of, picture_share
from .job_operator import refuse
from .on_tree import OnTree, active_tree
from .rendering import draw_faults
from .wrapped import add_text

_PICTURE, _SCALE = 0.32, 4.0
"""Width of a level's picture as a share of the sidebar's, and its height in lines."""

AUTO = -1
"""Number in place of a level's: the distance decides."""


class LEAFCLOUD_OT_show_level(OnTree, bpy.types.Operator):
    """Show this level at all distances. Auto shows the level for each distance, Sources the objects before the bake"""

    bl_idname = "leafcloud.show_level"
    bl_label = "Show Level"
    bl_options = {"REGISTER", "UNDO"}

    level: IntProperty(
        name="Level",
        description="Number of the level. −1: the distance decides. −2: the objects that the tree was baked from",
        default=AUTO,
        min=SOURCES,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        numbers = level_numbers(tree)
        if self.level >= 0 and self.level not in numbers:
            self.report({"ERROR"}, f"{tree.name} has no level {self.level}; it has the levels 0 to {max(numbers)}")
            return {"CANCELLED"}
        try:
            show_level(tree, None if self.level == AUTO else self.level, context.view_layer)
        except SceneError as error:
            return refuse(self, error)
        _keep_active(context, tree)
        return {"FINISHED"}


class LEAFCLOUD_OT_remove(OnTree, bpy.types.Operator):
    """Remove the levels of the baked tree and of its copies in the collection, and show the sources"""

    bl_idname = "leafcloud.remove"
    bl_label = "Remove Levels"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        made, name = record(tree), tree.name
        assert made is not None, "an active tree has a record"
        try:
            sources = sources_of(tree, context.view_layer)
        except SceneError as error:
            return refuse(self, error)
        remove_levels(tree)
        for obj in sources:
            obj.hide_set(False)
            obj.hide_render = False
            obj.select_set(True)
        context.view_layer.objects.active = next((obj for obj in sources if obj.name == made.name), sources[0])
        self.report({"INFO"}, f"Removed the levels of {name}, and showed its sources")
        return {"FINISHED"}


def _keep_active(context: bpy.types.Context, tree: bpy.types.Collection) -> None:
    """Select the root if the active object is hidden now, so that the panel stays."""
    root, active = root_of(tree), context.view_layer.objects.active
    if root is not None and root.visible_get() and (active is None or not active.visible_get()):
        root.select_set(True)
        context.view_layer.objects.active = root


class LEAFCLOUD_PT_tree(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_tree"
    bl_label = "Baked Tree"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return active_tree(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, tree = self.layout, active_tree(context)
        assert tree is not None, "poll hides the panel without a tree"
        shown = shown_level(tree)
        layout.label(text=tree.name, icon="OUTLINER_COLLECTION")
        row = layout.row(align=True)
        for number in [AUTO, *level_numbers(tree)]:
            text = "Auto" if number == AUTO else str(number)
            is_shown = number == (AUTO if shown is None else shown)
            row.operator("leafcloud.show_level", text=text, depress=is_shown).level = number
        row = layout.row(align=True)
        row.operator("leafcloud.show_level", text="Sources", depress=shown == SOURCES).level = SOURCES
        row.operator("leafcloud.export")
        root = root_of(tree)
        if root is not None and LOD_DISTANCE in root:
            layout.prop(root, f'["{LOD_DISTANCE}"]', text=LOD_DISTANCE)
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator("leafcloud.place")
        row.operator("leafcloud.asset")
        row = column.row(align=True)
        row.operator("leafcloud.bake", text="Bake Again")
        row.operator("leafcloud.remove")
        column.operator("leafcloud.select_billboard")
        for warning in warnings_of(tree):
            add_text(layout, context, warning, "ERROR")
        draw_faults(layout, context, [tree])
        draw_figures(layout, context, tree)


def draw_figures(layout: bpy.types.UILayout, context: bpy.types.Context, tree: bpy.types.Collection) -> None:
    """Draw the picture and the figures of each level."""
    objects = {level_number(obj): obj for obj in tree.all_objects}
    _, radius = crown_of(tree)
    factor = lod_factor(tree)
    for number, result in enumerate(results_of(tree)):
        row = layout.split(factor=_PICTURE)
        picture = thumbnail_of(objects[number]) if number in objects else 0
        row.template_icon(icon_value=picture, scale=_SCALE)
        column = row.column(align=True)
        heading = column.row(align=True)
        heading.label(text=result.name)
        if active_tree(context) == tree:
            heading.operator("leafcloud.frame_level", text="", icon="ZOOM_SELECTED", emboss=False).level = number
        result = replace(result, distance=factor * result.distance)
        for text in figures_of(result, picture_share(radius, result.distance, context.scene)):
            column.label(text=text)


def figures_of(result: LevelResult, share: float) -> tuple[str, ...]:
    """Return the figures of a level as short lines: the sidebar is narrow.

    share: the largest height of the level in the camera's picture, over the picture's height.
    """
    triangles = f"{result.triangles:,} triangles"
    if result.distance == 0.0:
        return (triangles,)
    width, height = result.texture
    texture = (f"texture {width} × {height}",) if width else ()
    times = f"{result.cheaper:.1f} × cheaper" if result.cheaper >= 1.0 else f"{1.0 / result.cheaper:.1f} × dearer"
    percent = f"{100.0 * share:.0f}" if share >= 0.095 else f"{100.0 * share:.1f}"
    return (
        f"from {length_words(result.distance)} on",
        f"{percent} % of picture height",
        triangles,
        times,
        f"error {result.image_error:.3f} at 128 px",
        *texture,
    )


def level_numbers(tree: bpy.types.Collection) -> list[int]:
    """Return the numbers of a baked tree's levels, ascending."""
    return sorted({number for obj in tree.all_objects if (number := level_number(obj)) is not None})
