"""The level of a baked tree that is shown: the level for each distance, or one at all distances."""

from __future__ import annotations

import bpy

from ..mesh.baked_levels import levels_and_trunks
from ..nodes.lod import GROUP_NAME
from ..versions import set_modifier_input

_KEY = "leafcloud_shown"
"""The custom property of a collection of levels: the number of the level that is shown at all distances."""

_HIDDEN = "leafcloud_hidden"
"""The custom property of a level or trunk: whether views and renders hide it where the distance decides."""


def shown_level(collection: bpy.types.Collection) -> int | None:
    """Return the level that is shown at all distances; None if the distance decides."""
    number = collection.get(_KEY)
    return number if isinstance(number, int) else None


def show_level(collection: bpy.types.Collection, number: int | None) -> None:
    """Show one level with its trunk at all distances, or let the distance decide."""
    if number == shown_level(collection):
        return
    for own, obj in levels_and_trunks(collection.all_objects):
        if (modifier := obj.modifiers.get(GROUP_NAME)) is not None:
            set_modifier_input(modifier, "Manual", number is not None)
            set_modifier_input(modifier, "Transition", 0.0)
            set_modifier_input(modifier, "Keep", 1.0)
        before = obj.get(_HIDDEN, [obj.hide_viewport, obj.hide_render])
        if number is None:
            obj.hide_viewport, obj.hide_render = map(bool, before)
            obj.pop(_HIDDEN, None)
        else:
            obj[_HIDDEN] = before
            obj.hide_viewport = obj.hide_render = own != number
    if number is None:
        collection.pop(_KEY, None)
    else:
        collection[_KEY] = number
