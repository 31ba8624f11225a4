"""Distances in files: those for a vertical field of view of 50° over 1080 pixels, whatever camera the scene has.

Engines scale the distances to their own view (docs/files.md). In the scene they are those of the scene's camera.
"""

from __future__ import annotations

from typing import Any

from ..plan.camera_visibility import pixels_of
from ..plan.lod_range import View
from .glb_file import Edit, Glb

_DISTANCES = ("switch_distance", "transition_start", "transition_end", "prune_start")


def to_usual_view(view: View) -> float:
    """Return the factor from distances in `view` to those at which things have as many pixels in the usual view."""
    return pixels_of(1.0, 1.0, View()) / pixels_of(1.0, 1.0, view)


def for_usual_view(view: View) -> Edit:
    """Return the edit that converts the distances in the extras of a file's nodes from `view`."""
    factor = to_usual_view(view)

    def convert(numbers: dict[str, Any]) -> None:
        for name in _DISTANCES:
            if name in numbers:
                numbers[name] *= factor

    def edit(glb: Glb) -> None:
        for node in glb.document.get("nodes", []) if factor != 1.0 else []:
            numbers = node.get("extras", {}).get("leafcloud", {})
            convert(numbers)
            convert(numbers.get("octahedral", {}))

    return edit
