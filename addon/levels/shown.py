"""The level of a baked tree that is shown: the level for each distance, one at all distances, or the sources."""

from __future__ import annotations

import bpy

from ..errors import SceneError
from ..mesh.baked_levels import levels_and_trunks, record
from ..nodes.lod import GROUP_NAME
from ..versions import set_modifier_input
from .shadow_proxy import shadow_proxy_of

_KEY = "leafcloud_shown"
"""The custom property of a collection of levels: the number of the level at all distances, or `SOURCES`."""

_HIDDEN = "leafcloud_hidden"
"""The custom property of a level or trunk: whether views and renders hide it where the distance decides."""

SOURCES = -2
"""Number in place of a level's: all levels are hidden, because the objects that the tree was baked from are shown."""


def shown_level(collection: bpy.types.Collection) -> int | None:
    """Return the level that is shown at all distances, or `SOURCES`; None if the distance decides."""
    number = collection.get(_KEY)
    return number if isinstance(number, int) else None


def show_level(collection: bpy.types.Collection, number: int | None, layer: bpy.types.ViewLayer) -> None:
    """Show one level with its trunk at all distances, or the sources (`SOURCES`), or let the distance decide (None).

    Raises `SceneError` if the view layer lacks all sources that are to be shown.
    """
    before = shown_level(collection)
    if number == before:
        return
    if number == SOURCES:
        _show(sources_of(collection, layer))
    elif before == SOURCES:
        _hide(_found(collection, layer))
    shadow = shadow_proxy_of(collection)
    if shadow is not None:  # It shades the sources a second time.
        _set_hidden(shadow, None if number != SOURCES else True)
    for own, obj in levels_and_trunks(collection.all_objects):
        if (modifier := obj.modifiers.get(GROUP_NAME)) is not None:
            set_modifier_input(modifier, "Manual", number is not None)
            set_modifier_input(modifier, "Transition", 0.0)
            set_modifier_input(modifier, "Keep", 1.0)
        _set_hidden(obj, None if number is None else own != number)
    if number is None:
        collection.pop(_KEY, None)
    else:
        collection[_KEY] = number


def _set_hidden(obj: bpy.types.Object, hidden: bool | None) -> None:
    """Hide or show an object in views and renders; None: as before the first call."""
    before = obj.get(_HIDDEN, [obj.hide_viewport, obj.hide_render])
    if hidden is None:
        obj.hide_viewport, obj.hide_render = map(bool, before)
        obj.pop(_HIDDEN, None)
    else:
        obj[_HIDDEN] = before
        obj.hide_viewport = obj.hide_render = hidden


def sources_of(collection: bpy.types.Collection, layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """Return the objects of a view layer that a tree was baked from. Raise `SceneError` if there are none."""
    sources = _found(collection, layer)
    if not sources:
        names = ", ".join(map(repr, _names(collection)[:8]))
        raise SceneError(
            f"the view layer lacks the objects that {collection.name!r} was made from, {names}: "
            "restore them, or delete the levels by hand"
        )
    return sources


def _names(collection: bpy.types.Collection) -> tuple[str, ...]:
    made = record(collection)
    return () if made is None else made.sources


def _found(collection: bpy.types.Collection, layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    here = {obj.name_full: obj for obj in layer.objects}
    return [here[name] for name in _names(collection) if name in here]


def _show(sources: list[bpy.types.Object]) -> None:
    for obj in sources:
        obj.hide_set(False)
        obj.hide_render = False


def _hide(sources: list[bpy.types.Object]) -> None:
    for obj in sources:
        obj.hide_set(True)
        obj.hide_render = True
