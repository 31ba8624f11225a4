"""The sample tree that comes with the extension."""

from __future__ import annotations

from pathlib import Path

import bpy

from .on_tree import InObjectMode

_ADDON = Path(__file__).resolve().parents[1]
_PLACES = (_ADDON / "samples" / "shrub.glb", _ADDON.parent / "examples" / "shrub.glb")
"""In the extension's folder, and in the repository."""


class LEAFCLOUD_OT_sample(InObjectMode, bpy.types.Operator):
    """Add a small tree at the 3D cursor to try Leafcloud on, and select it"""

    bl_idname = "leafcloud.sample"
    bl_label = "Add Sample Tree"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = next((each for each in _PLACES if each.is_file()), None)
        if path is None:
            self.report({"ERROR"}, f"{_PLACES[0]} is missing: install the extension again")
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        before = set(context.scene.objects)
        bpy.ops.import_scene.gltf(filepath=str(path))
        made = [obj for obj in context.scene.objects if obj not in before]
        for obj in made:
            obj.select_set(True)
            if obj.parent is None:
                obj.location += context.scene.cursor.location
        leaves = next(obj for obj in made if obj.name.startswith("leaves"))
        leaves.name = "Shrub"
        context.view_layer.objects.active = leaves
        return {"FINISHED"}
