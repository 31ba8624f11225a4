"""A level at the size at which it is meant to be seen."""

from __future__ import annotations

import math

import bpy
from bpy.props import IntProperty
from mathutils import Vector

from ..bake.pipeline import view_of
from ..levels.results import results_of
from ..levels.root import lod_factor
from ..levels.shown import show_level
from ..mesh.baked_levels import EXTRAS, level_number
from ..nodes.lod import GROUP_NAME
from ..versions import get_modifier_input, has_modifier_input
from .on_tree import OnTree, active_tree

_NEAR = 0.8
"""Height of the leaves in the picture, for framing them: no level tells from which size on they are drawn."""


def picture_share(radius: float, distance: float, scene: bpy.types.Scene) -> float:
    """Return the height of a sphere at a distance from the scene's camera, over the picture's height.

    Both lengths in the same units. 1 at the camera itself.
    """
    half = distance * math.tan(view_of(scene).field_of_view / 2.0)
    return min(radius / half, 1.0) if half > 0.0 else 1.0


def crown_of(tree: bpy.types.Collection) -> tuple[Vector, float]:
    """Return the center and the radius of a baked tree's crown in the world; the radius is 0 without its leaves."""
    leaves = next((obj for obj in tree.all_objects if level_number(obj) == 0), None)
    if leaves is None:
        return Vector(), 0.0
    modifier = leaves.modifiers.get(GROUP_NAME)
    has_centre = modifier is not None and has_modifier_input(modifier, "Centre")
    corners = [Vector(corner) for corner in leaves.bound_box]
    own = Vector(get_modifier_input(modifier, "Centre")) if has_centre else sum(corners, Vector()) / len(corners)
    scale = max(map(abs, leaves.matrix_world.to_scale()))
    return leaves.matrix_world @ own, float(leaves[EXTRAS].get("radius", 0.0)) * scale


class LEAFCLOUD_OT_frame_level(OnTree, bpy.types.Operator):
    """Show this level alone, as large in the view as it is at most in the camera's picture"""

    bl_idname = "leafcloud.frame_level"
    bl_label = "Show at Its Size"
    bl_options = {"REGISTER", "UNDO"}

    level: IntProperty(name="Level", description="Number of the level", min=0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree, view = active_tree(context), getattr(context.space_data, "region_3d", None)
        assert tree is not None, "poll refuses without a tree"
        results = results_of(tree)
        centre, radius = crown_of(tree)
        if view is None or self.level >= len(results) or radius == 0.0:
            self.report({"ERROR"}, f"{tree.name} has no level {self.level} to show in a 3D view")
            return {"CANCELLED"}
        distance = lod_factor(tree) * results[self.level].distance
        share = picture_share(radius, distance, context.scene) if distance > 0.0 else _NEAR
        show_level(tree, self.level, context.view_layer)
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
            view.update()  # Its matrix is the camera's before.
        height = radius * view.window_matrix[1][1] / share
        view.view_location = centre
        view.view_distance = height if view.is_perspective else height * view.view_distance
        return {"FINISHED"}
