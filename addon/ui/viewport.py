"""The switch that shows baked levels as they are seen from the 3D view instead of from the scene's camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent

from ..viewport.draw import Preview, levels_in
from ..viewport.hiding import hide, reveal_all

Drawer = Callable[[list[bpy.types.Object]], Callable[[], None]]


@dataclass(frozen=True)
class _Running:
    """A preview: its draw handler, and the levels that Blender itself does not draw meanwhile, in a view layer.

    The view layer is known by name: undo replaces it. `drawer` makes a draw function for levels.
    """

    handle: object
    drawer: Drawer
    levels: list[bpy.types.Object]
    scene: str
    layer: str


_running: list[_Running] = []
"""The preview, if there is one."""


def start_preview(layer: bpy.types.ViewLayer, drawer: Drawer) -> None:
    """Hide the visible levels of a view layer, and draw them in every 3D view by what `drawer` makes for them.

    Nothing starts without a visible level.
    """
    stop_preview()
    scene = layer.id_data
    levels = [obj for obj in levels_in(scene) if obj.visible_get(view_layer=layer)]
    if not levels:
        return
    draw = drawer(levels)
    hide(layer, levels)
    handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_VIEW")
    _running.append(_Running(handle, drawer, levels, scene.name, layer.name))


def stop_preview() -> None:
    """Draw nothing more, and show what was hidden; nothing happens when nothing is drawn."""
    while _running:
        bpy.types.SpaceView3D.draw_handler_remove(_running.pop().handle, "WINDOW")
        reveal_all()


def is_previewed() -> bool:
    return bool(_running)


def _before_loading(*_: object) -> None:
    stop_preview()


def _before_saving(*_: object) -> None:
    """Files have all levels visible."""
    reveal_all()


def _hide_again(*_: object) -> None:
    """Hide the levels that the preview draws, and no others: undo and files bring back the eyes of another time.

    Blender saves automatically from the latest undo step, without `save_pre`: such a file may have levels hidden.
    """
    reveal_all()
    for preview in list(_running):
        scene = bpy.data.scenes.get(preview.scene)
        layer = None if scene is None else scene.view_layers.get(preview.layer)
        if layer is None:
            stop_preview()
            continue
        try:
            hide(layer, preview.levels)
        except (ReferenceError, RuntimeError):  # Undo replaces objects that differ; others were deleted or moved away.
            start_preview(layer, preview.drawer)


_HANDLERS = {
    "load_pre": _before_loading,
    "load_post": _hide_again,
    "save_pre": _before_saving,
    "save_post": _hide_again,
    "save_post_fail": _hide_again,
    "undo_post": _hide_again,
    "redo_post": _hide_again,
}


def add_handlers() -> None:
    """Let previews follow files and undo."""
    for name, function in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(persistent(function))


def remove_handlers() -> None:
    for name, function in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(function)


def _drawn_by_shader(levels: list[bpy.types.Object]) -> Callable[[], None]:
    preview = Preview()
    preview.read(levels)
    return preview.draw


class LEAFCLOUD_OT_preview(bpy.types.Operator):
    """Draw the baked levels over the 3D views, each as it is seen from there: orbit, and leaves move to billboards"""

    bl_idname = "leafcloud.preview"
    bl_label = "Preview from the View"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.background:
            cls.poll_message_set("There is no view to draw in")
            return False
        if not is_previewed() and not levels_in(context.scene):
            cls.poll_message_set("No level follows the camera here: bake some, with transitions or pruning")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if is_previewed():
            stop_preview()
        else:
            start_preview(context.view_layer, _drawn_by_shader)
            if not is_previewed():
                self.report({"WARNING"}, "All levels are hidden in this view layer: show some in the Outliner")
                return {"CANCELLED"}
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
        return {"FINISHED"}
