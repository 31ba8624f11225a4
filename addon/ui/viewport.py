"""The preview of baked levels in 3D views, each level chosen by the view instead of the scene's camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy

from ..levels.shown import show_level
from ..viewport.draw import Preview, levels_in
from ..viewport.hiding import hide, reveal_all
from ..viewport.labels import Labels
from .handlers import Handlers

Draws = dict[str, Callable[[], None]]
"""Functions that draw into a 3D view, by their time: POST_VIEW in the scene, POST_PIXEL on top in pixels."""
Drawer = Callable[[list[bpy.types.Object]], Draws]


@dataclass(frozen=True)
class _Running:
    """A running preview: its draw handlers, and the levels of a view layer that are hidden from Blender's own drawing.

    The view layer is stored by name, because undo replaces the layer. `drawer` makes the draw functions for levels.
    """

    handles: list[object]
    drawer: Drawer
    levels: list[bpy.types.Object]
    scene: str
    layer: str


_running: list[_Running] = []
"""The running preview, or empty."""


def start_preview(layer: bpy.types.ViewLayer, drawer: Drawer) -> None:
    """Hide the visible levels of a view layer, and draw them in every 3D view with the functions that `drawer` returns.

    Do nothing without a visible level.
    """
    stop_preview()
    scene = layer.id_data
    levels = [obj for obj in levels_in(scene) if obj.visible_get(view_layer=layer)]
    if not levels:
        return
    draws = drawer(levels)
    hide(layer, levels)
    add = bpy.types.SpaceView3D.draw_handler_add
    handles = [add(draw, (), "WINDOW", time) for time, draw in draws.items()]
    _running.append(_Running(handles, drawer, levels, scene.name, layer.name))


def stop_preview() -> None:
    """Stop the preview, and show the hidden levels. Do nothing without a preview."""
    while _running:
        for handle in _running.pop().handles:
            bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        reveal_all()


def draw_new_levels(layer: bpy.types.ViewLayer) -> None:
    """Restart a running preview with the levels that are visible now, as after a bake. Do nothing without a preview."""
    if _running:
        start_preview(layer, _running[-1].drawer)


def is_previewed() -> bool:
    return bool(_running)


def _before_loading(*_: object) -> None:
    stop_preview()


def _before_saving(*_: object) -> None:
    """Show all levels, so that saved files have them visible."""
    reveal_all()


def _hide_again(*_: object) -> None:
    """Hide exactly the levels that the preview draws. Undo and files restore an earlier state of visibility.

    Blender auto-saves from the latest undo step, without `save_pre`: such a file may have hidden levels.
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
        except (ReferenceError, RuntimeError):  # Undo replaced the objects, or they were deleted or moved.
            start_preview(layer, preview.drawer)


HANDLERS: Handlers = (
    ("load_pre", _before_loading),
    ("load_post", _hide_again),
    ("save_pre", _before_saving),
    ("save_post", _hide_again),
    ("save_post_fail", _hide_again),
    ("undo_post", _hide_again),
    ("redo_post", _hide_again),
)
"""They update a preview on loading, saving and undo."""


def _drawn_by_shader(levels: list[bpy.types.Object]) -> Draws:
    preview = Preview()
    preview.read(levels)
    return {"POST_VIEW": preview.draw, "POST_PIXEL": Labels(levels).draw}


class LEAFCLOUD_OT_preview(bpy.types.Operator):
    """Draw the baked levels in 3D views by the distance of each view. Zoom out to see leaves move onto billboards"""

    bl_idname = "leafcloud.preview"
    bl_label = "Preview in 3D Views"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.background:
            cls.poll_message_set("Needs a 3D view: start Blender with its interface")
            return False
        if not is_previewed() and not levels_in(context.scene):
            cls.poll_message_set("No level follows the camera: bake levels with the effect transitions or pruning")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if is_previewed():
            stop_preview()
        else:
            for tree in context.scene.collection.children_recursive:
                show_level(tree, None, context.view_layer)  # The preview draws levels by distance.
            start_preview(context.view_layer, _drawn_by_shader)
            if not is_previewed():
                self.report({"WARNING"}, "All levels are hidden in this view layer: show some in the Outliner")
                return {"CANCELLED"}
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
        return {"FINISHED"}
