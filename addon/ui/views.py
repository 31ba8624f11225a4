"""Levels in 3D views: they follow the view, and labels tell which level each tree shows."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..nodes.eye import forget_view
from ..viewport.labels import draw_labels, levels_in
from .handlers import Handlers

_drawn: list[object] = []
"""The handle by which labels are drawn, or empty."""


def are_labelled() -> bool:
    return bool(_drawn)


def stop_labels() -> None:
    while _drawn:
        bpy.types.SpaceView3D.draw_handler_remove(_drawn.pop(), "WINDOW")


class LEAFCLOUD_OT_labels(bpy.types.Operator):
    """Show beside each tree which level is drawn, its distance and its triangles"""

    bl_idname = "leafcloud.labels"
    bl_label = "Label Levels"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not are_labelled() and not levels_in(context.scene):
            cls.poll_message_set("No level follows the view: bake levels first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if are_labelled():
            stop_labels()
        else:
            draw: Callable[[], None] = draw_labels
            _drawn.append(bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL"))
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
        return {"FINISHED"}


def _before_saving(*_: object) -> None:
    forget_view()


HANDLERS: Handlers = (("save_pre", _before_saving),)
"""A file holds nothing of the view, so that it opens without the extension, too."""
