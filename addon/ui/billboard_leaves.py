"""Selection of a billboard's leaves by a click, for edits to the morph or to the leaves of one billboard."""

from __future__ import annotations

import bmesh
import bpy

from ..mesh.baked_levels import level_number
from ..nodes.laws import PARENT
from .on_tree import active_tree

_NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE"}


def select_billboards(obj: bpy.types.Object) -> int:
    """Extend the selection in Edit Mode to all leaves on the billboards of the selected vertices.

    Return the number of these billboards.
    """
    mesh = bmesh.from_edit_mesh(obj.data)
    layer = mesh.verts.layers.int[PARENT]
    chosen = {vertex[layer] for vertex in mesh.verts if vertex.select and vertex[layer] >= 0}
    for vertex in mesh.verts:
        if vertex[layer] in chosen:
            vertex.select = True
    mesh.select_mode |= {"VERT"}
    mesh.select_flush_mode()
    bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)
    return len(chosen)


class LEAFCLOUD_OT_select_billboard(bpy.types.Operator):
    """Click a leaf to select all leaves on its billboard. With Shift, add them to the selection"""

    bl_idname = "leafcloud.select_billboard"
    bl_label = "Select a Billboard's Leaves"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        level, problem = _level(context), ""
        if context.mode not in {"OBJECT", "EDIT_MESH"}:
            problem = "Switch to Object Mode or Edit Mode first"
        elif level is None:
            problem = "Make a baked tree active, or one of its levels that morphs onto billboards"
        elif context.mode == "OBJECT" and not level.visible_get():
            problem = f"{level.name} is hidden: press Auto"
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Extend the selection of Edit Mode."""
        self._edit(context)
        count = select_billboards(context.active_object)
        if not count:
            self.report({"WARNING"}, "No selected leaf lies on a billboard: select one first")
            return {"CANCELLED"}
        self.report({"INFO"}, f"Selected the leaves of {count} billboard{'s' if count > 1 else ''}")
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for a click on a leaf. Outside of a 3D view, extend the selection."""
        if bpy.app.background or context.area is None or context.area.type != "VIEW_3D":
            return self.execute(context)
        self._edit(context)
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set("Click a leaf: select its billboard    Shift: add    Esc: cancel")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in {"ESC", "RIGHTMOUSE"}:
            self._stop(context)
            return {"CANCELLED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"} if event.type in _NAVIGATION else {"RUNNING_MODAL"}
        self._stop(context)
        region = next(each for each in context.area.regions if each.type == "WINDOW")
        with context.temp_override(region=region):
            place = (event.mouse_x - region.x, event.mouse_y - region.y)
            bpy.ops.view3d.select(extend=event.shift, deselect_all=not event.shift, location=place)
        return self.execute(context)

    def _edit(self, context: bpy.types.Context) -> None:
        """Enter Edit Mode, with the level active."""
        if context.mode != "EDIT_MESH":
            level = _level(context)
            for obj in context.selected_objects:
                obj.select_set(obj == level)
            context.view_layer.objects.active = level
            bpy.ops.object.mode_set(mode="EDIT")

    def _stop(self, context: bpy.types.Context) -> None:
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)


def _level(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active level if it morphs onto billboards, or the first such level of the active tree; else None."""
    active = context.active_object
    tree = None if context.mode == "EDIT_MESH" else active_tree(context)
    levels = [active] if active is not None and level_number(active) is not None else []
    if not levels and tree is not None:
        levels = sorted((obj for obj in tree.objects if level_number(obj) is not None), key=lambda obj: obj.name)
    return next((obj for obj in levels if PARENT in obj.data.attributes), None)
