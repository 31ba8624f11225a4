"""Lines of the tree's panel about settings that show the tree wrongly, and the button that mends them."""

from __future__ import annotations

import bpy
from mathutils import Vector

from ..levels.placed_tree import place_of
from ..levels.root import root_of
from ..mesh.baked_levels import levels_and_trunks
from ..scene.rendering import Fault, faults
from .on_tree import OnTree, active_tree
from .wrapped import add_text


class LEAFCLOUD_OT_mend_rendering(OnTree, bpy.types.Operator):
    """Change the settings that show this tree wrongly"""

    bl_idname = "leafcloud.mend_rendering"
    bl_label = "Mend"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        for fault in _faults_of(tree, context.scene):
            fault.mend()
        return {"FINISHED"}


def draw_faults(layout: bpy.types.UILayout, context: bpy.types.Context, tree: bpy.types.Collection) -> None:
    """Add a line for each fault, and the button below them."""
    found = _faults_of(tree, context.scene)
    for fault in found:
        add_text(layout, context, fault.text, "ERROR")
    if found:
        layout.operator("leafcloud.mend_rendering")


def _faults_of(tree: bpy.types.Collection, scene: bpy.types.Scene) -> list[Fault]:
    if root_of(tree) is None:
        return []  # Of an earlier version.
    objects = [obj for _, obj in levels_and_trunks(tree.all_objects)]
    materials = [slot.material for obj in objects for slot in obj.material_slots]
    place = place_of(tree)
    corners = [place.to_3x3() @ Vector(corner) for obj in objects for corner in obj.bound_box]
    return faults(scene, place.translation, max((corner.length for corner in corners), default=0.0), materials)
