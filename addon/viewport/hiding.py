"""Hiding of levels in the 3D views while a preview draws them. Hidden levels can always be found and shown again.

Only the eye in the Outliner takes an object out of all 3D views, and Blender stores the eye in files and undo steps.
The view layer keeps a list of the objects in the same data-block: whatever brings back their eyes brings back the list.
Renders do not look at the eye.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy

KEY = "leafcloud_previewed"
"""The custom property of a view layer that lists the objects which a preview has hidden there."""

SELECTED = "leafcloud_previewed_selection"
"""The custom property of a view layer that lists the selected ones among these objects."""


def hide(layer: bpy.types.ViewLayer, objects: Iterable[bpy.types.Object]) -> None:
    """Hide objects of the view layer.

    Raises `ReferenceError` for one that was deleted, `RuntimeError` for one that is not in the view layer;
    `reveal_all` shows the others again.
    """
    # Blender crashes where a property is given a deleted object; to read the name of one raises an error before.
    listed = {str(number): obj for number, obj in enumerate(objects) if obj.name}
    layer[KEY] = listed
    # Hiding an object deselects it.
    layer[SELECTED] = {key: obj for key, obj in listed.items() if obj.select_get(view_layer=layer)}
    for obj in listed.values():
        obj.hide_set(True, view_layer=layer)


def reveal_all() -> None:
    """Show all objects that previews have hidden, in all view layers of the file."""
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            _reveal(layer)


def _reveal(layer: bpy.types.ViewLayer) -> None:
    if KEY not in layer:
        return
    # The lists have None for an object that was deleted.
    for obj in layer[KEY].values():
        if obj is not None and layer.objects.get(obj.name) == obj:
            obj.hide_set(False, view_layer=layer)
    for obj in layer.get(SELECTED, {}).values():
        if obj is not None and layer.objects.get(obj.name) == obj:
            obj.select_set(True, view_layer=layer)
    del layer[KEY]
    layer.pop(SELECTED, None)
