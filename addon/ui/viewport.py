"""The switch that shows baked levels as they are seen from the 3D view instead of from the scene's camera."""

from __future__ import annotations

from contextlib import suppress

import bpy

from ..viewport.draw import Preview, levels_in

_handles: list[object] = []
_hidden: list[bpy.types.Object] = []
"""What Blender itself does not draw meanwhile."""


def stop_preview() -> None:
    """Draws nothing more; nothing happens when nothing is drawn."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    while _hidden:
        with suppress(ReferenceError):  # Deleted meanwhile.
            _hidden.pop().hide_set(False)


def is_previewed() -> bool:
    return bool(_handles)


def _draw(preview: Preview) -> None:
    try:
        preview.draw()
    except ReferenceError:  # Another file was opened, or a level deleted.
        stop_preview()


class LEAFCLOUD_OT_preview(bpy.types.Operator):
    """Draw the baked levels over the 3D views, each as it is seen from there: orbit, and leaves move to billboards"""

    bl_idname = "leafcloud.preview"
    bl_label = "Preview from the View"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.background:
            cls.poll_message_set("There is no view to draw in")
            return False
        if not _handles and not levels_in(context.scene):
            cls.poll_message_set("No level follows the camera here: bake some, with transitions or pruning")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if _handles:
            stop_preview()
        else:
            shown = [obj for obj in levels_in(context.scene) if obj.visible_get()]
            preview = Preview()
            preview.read(shown)
            _handles.append(bpy.types.SpaceView3D.draw_handler_add(_draw, (preview,), "WINDOW", "POST_VIEW"))
            for obj in shown:
                obj.hide_set(True)
            _hidden.extend(shown)
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
        return {"FINISHED"}
