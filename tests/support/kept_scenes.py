"""Scenes in which many tests start: each is made once in a process, and opened from its file afterwards."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

_folder = tempfile.TemporaryDirectory(prefix="leafcloud-scenes-")
_made: dict[str, tuple[Path, Any]] = {}


def open_scene(name: str, make: Callable[[], Any]) -> Any:
    """Open the scene `name`. The first call makes the scene from the open one with `make`, and saves its file.

    Return the result of `make`, which may hold no data-blocks: they end with the scene of the first call.
    """
    if name not in _made:
        result = make()
        file = Path(_folder.name) / f"{len(_made)}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True)
        _made[name] = (file, result)
    file, result = _made[name]
    bpy.ops.wm.open_mainfile(filepath=str(file))
    return result
