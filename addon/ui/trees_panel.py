"""A table of all baked trees of the scene: what became of each."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from bpy.props import StringProperty

from ..levels.results import LevelResult, results_of, warnings_of
from ..levels.root import root_of
from ..mesh.baked_levels import record
from .on_tree import mode_problem

MOST_ROWS = 40
"""Trees in the table. Blender draws it with every change of the sidebar."""


class LEAFCLOUD_OT_select_tree(bpy.types.Operator):
    """Select this baked tree"""

    bl_idname = "leafcloud.select_tree"
    bl_label = "Select Baked Tree"
    bl_options = {"REGISTER", "UNDO"}

    tree: StringProperty(name="Tree", description="Name of the baked tree's collection")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context)
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = (tree for tree in baked_trees(context.scene) if tree.name == self.tree)
        root = next((root_of(tree) for tree in found), None)
        if root is None or root.name not in context.view_layer.objects:
            self.report({"ERROR"}, f"the view layer has no baked tree {self.tree!r}")
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        root.select_set(True)
        context.view_layer.objects.active = root
        return {"FINISHED"}


class LEAFCLOUD_PT_trees(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_trees"
    bl_label = "All Baked Trees"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        trees = baked_trees(context.scene)
        return next(trees, None) is not None and next(trees, None) is not None

    def draw(self, context: bpy.types.Context) -> None:
        trees = list(baked_trees(context.scene))
        grid = self.layout.grid_flow(row_major=True, columns=4, align=True)
        for heading in ("Tree", "Triangles", "At last", "Error"):
            grid.label(text=heading)
        for tree in trees[:MOST_ROWS]:
            icon = "ERROR" if warnings_of(tree) else "NONE"
            grid.operator("leafcloud.select_tree", text=tree.name, icon=icon, emboss=False).tree = tree.name
            for text in row_of(results_of(tree)):
                grid.label(text=text)
        if len(trees) > MOST_ROWS:
            self.layout.label(text=f"and {len(trees) - MOST_ROWS} more")


def baked_trees(scene: bpy.types.Scene) -> Iterator[bpy.types.Collection]:
    """Yield the collections of the baked trees in a scene."""
    for collection in scene.collection.children_recursive:
        if record(collection) is not None and root_of(collection) is not None:
            yield collection


def row_of(results: tuple[LevelResult, ...]) -> tuple[str, str, str]:
    """Return the triangles of the leaves and of the last level, and the largest image error of all levels."""
    if not results:
        return "", "", ""
    error = max(result.image_error for result in results)
    return f"{results[0].triangles:,}", f"{results[-1].triangles:,}", f"{error:.3f}"
