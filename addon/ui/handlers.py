"""The extension's handlers: functions that Blender calls on loading, saving, undo and changes of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy
from bpy.app.handlers import persistent

Handlers = Sequence[tuple[str, Callable[..., None]]]
"""Names of lists in `bpy.app.handlers`, each with a function for that list."""

_added: list[tuple[str, Callable[..., None]]] = []


def add_handlers(*groups: Handlers) -> None:
    """Add the handlers. They stay when another file is loaded, until `remove_handlers`."""
    for name, function in [entry for group in groups for entry in group]:
        getattr(bpy.app.handlers, name).append(persistent(function))
        _added.append((name, function))


def remove_handlers() -> None:
    """Remove all handlers that were added."""
    while _added:
        name, function = _added.pop()
        functions = getattr(bpy.app.handlers, name)
        if function in functions:
            functions.remove(function)
