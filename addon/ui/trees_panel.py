"""A table of all baked trees of the scene: triangles of the leaves and of the last level, and the largest error of its
levels. A click selects a tree."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from ..levels.results import LevelResult, results_of, warnings_of
from ..levels.root import root_of
from ..mesh.baked_levels import record
from .on_tree import InObjectMode, active_tree
from .selection import select_only

MOST_ROWS = 40
"""Trees in the table. Blender draws it with every change of the sidebar."""


class LEAFCLOUD_OT_select_tree(InObjectMode, bpy.types.Operator):
    """Select this baked tree"""

    bl_idname = "leafcloud.select_tree"
    bl_label = "Select Baked Tree"
    bl_options = {"REGISTER", "UNDO"}

    tree: StringProperty(name="Tree", description="Name of the baked tree's collection")

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = (tree for tree in baked_trees(context.scene) if tree.name == self.tree)
        root = next((root_of(tree) for tree in found), None)
        if root is None or root.name not in context.view_layer.objects or not root.visible_get():
            self.report({"ERROR"}, f"the baked tree {self.tree!r} is hidden or gone: show its root in the Outliner")
            return {"CANCELLED"}
        select_only(context, [root])
        return {"FINISHED"}


class LEAFCLOUD_PT_trees(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_trees"
    bl_label = "Baked Trees"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Show one tree alone only while its own panel is hidden."""
        return len(baked_trees(context.scene)) > (active_tree(context) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        trees = baked_trees(context.scene)
        grid = self.layout.grid_flow(row_major=True, columns=4, align=True)
        for heading in ("Tree", "Triangles", "Farthest", "Error"):
            grid.label(text=heading)
        for tree in trees[:MOST_ROWS]:
            icon = "ERROR" if warnings_of(tree) else "NONE"
            grid.operator("leafcloud.select_tree", text=tree.name, icon=icon, emboss=False).tree = tree.name
            for text in row_of(results_of(tree)):
                grid.label(text=text)
        if len(trees) > MOST_ROWS:
            self.layout.label(text=f"and {len(trees) - MOST_ROWS} more")


def baked_trees(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Return the collections of the baked trees in a scene, each once."""
    collections = dict.fromkeys(scene.collection.children_recursive)
    return [each for each in collections if record(each) is not None and root_of(each) is not None]


def row_of(results: tuple[LevelResult, ...]) -> tuple[str, str, str]:
    """Return the triangles of the leaves and of the last level, and the largest image error of all levels."""
    if not results:
        return "", "", ""
    error = max(result.image_error for result in results)
    return f"{results[0].triangles:,}", f"{results[-1].triangles:,}", f"{error:.3f}"
