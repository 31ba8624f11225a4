"""Leafcloud: levels of detail for foliage that do not pop."""

from __future__ import annotations

import atexit


def register() -> None:
    from . import ui

    ui.register()
    # Classes and handlers that are left when Python ends crash bpy 4.2 and hang bpy 4.5. Blender itself unregisters.
    atexit.register(unregister)


def unregister() -> None:
    from . import ui

    atexit.unregister(unregister)
    ui.unregister()
