"""The view that levels in 3D views are seen from: the one that was turned or moved last.

A level belongs to the scene, so all 3D views show the same levels. A view through the scene's camera shows those of the
camera, as a render does.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from mathutils import Vector

from ..nodes.eye import eye_groups, forget_view, look_from, place_of_eye

_PERIOD, _IDLE = 0.1, 1.0
"""Seconds between two looks at the views; without any level."""

_STEP = 0.02
"""Least move of the eye, as a share of its distance from the middle of the view: each one evaluates all levels."""

_seen: dict[int, tuple[object, ...]] = {}
"""How each 3D view stood, by the address of its area. The last one is the view that is followed."""


def follow_views() -> None:
    """Begin to look for changes of the 3D views. Do nothing without a window."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=_PERIOD, persistent=True)


def stop_following() -> None:
    """Let the camera decide in 3D views, as without the extension."""
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    forget_view()
    _seen.clear()


def _look() -> float:
    """Timer: move the eye to the view that changed."""
    if not eye_groups():
        return _IDLE
    if not bpy.app.is_job_running("RENDER"):  # A render reads the scene meanwhile.
        view = _followed(list(_views()))
        place = None if view is None else place_of(view)
        if view is None or place is None or _is_elsewhere(place, view.view_distance):
            look_from(place)
    return _PERIOD


def _views() -> Iterator[tuple[int, bpy.types.RegionView3D]]:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield area.as_pointer(), area.spaces.active.region_3d


def _followed(views: list[tuple[int, bpy.types.RegionView3D]]) -> bpy.types.RegionView3D | None:
    """Return the view that changed since the last call, or else the one that was followed; None without views."""
    here = dict(views)
    for gone in _seen.keys() - here.keys():
        del _seen[gone]
    for address, view in here.items():
        # A view through a camera that moves is not turned by anybody.
        through = view.view_perspective == "CAMERA"
        stands = ("CAMERA",) if through else (view.view_matrix.copy(), view.view_distance)
        if _seen.get(address) != stands:
            _seen.pop(address, None)
            _seen[address] = stands
    return here[next(reversed(_seen))] if _seen else None


def place_of(view: bpy.types.RegionView3D) -> Vector | None:
    """Return the place from which a view sees the scene; None for a view through the camera.

    A view without perspective sees it as if from as far away as it turns about.
    """
    if view.view_perspective == "CAMERA":
        return None
    if view.view_perspective == "ORTHO":
        return view.view_location + view.view_rotation @ Vector((0.0, 0.0, view.view_distance))
    return view.view_matrix.inverted().translation


def _is_elsewhere(place: Vector, distance: float) -> bool:
    before = place_of_eye()
    return before is None or (before - place).length > _STEP * distance
