"""The entry *Leafcloud* in the 3D view's *Object* menu, by which Blender's search (F3) finds the operators."""

from __future__ import annotations

import bpy


class LEAFCLOUD_MT_object(bpy.types.Menu):
    bl_idname = "LEAFCLOUD_MT_object"
    bl_label = "Leafcloud"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        for group in _GROUPS:
            for name in group:
                layout.operator(f"leafcloud.{name}")
            layout.separator()


_GROUPS = (
    ("sample", "import_folder"),
    ("bake", "labels", "export", "remove"),
    ("place", "asset", "place_instances", "select_billboard"),
    ("curve", "forest", "scene"),
)


def add_menu() -> None:
    bpy.types.VIEW3D_MT_object.append(_draw_entry)


def remove_menu() -> None:
    bpy.types.VIEW3D_MT_object.remove(_draw_entry)


def _draw_entry(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(LEAFCLOUD_MT_object.bl_idname)
