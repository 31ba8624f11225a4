"""Plants that move by a skeleton, by shape keys or by keys of their own. Animated skeletons are baked in rest pose.

A pose without keys is what an artist wants to see, and stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy


@contextmanager
def at_rest(layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Show the animated skeletons of a layer in their rest pose while the block runs."""
    skeletons = (obj for obj in layer.objects if obj.type == "ARMATURE" and _is_animated(obj))
    posed = {obj.data for obj in skeletons if obj.data.pose_position == "POSE"}
    if not posed:
        yield
        return
    _pose(posed, "REST", layer)
    try:
        yield
    finally:
        _pose(posed, "POSE", layer)


def _pose(skeletons: set[bpy.types.Armature], position: str, layer: bpy.types.ViewLayer) -> None:
    for skeleton in skeletons:
        skeleton.pose_position = position
    layer.update()


def lost_motion(objects: Sequence[bpy.types.Object]) -> list[str]:
    """Return a sentence if objects of a tree move otherwise than by wind: the levels do not."""
    ways = {
        "a skeleton": [obj.name for obj in objects if any(map(_is_animated, _skeletons(obj)))],
        "shape keys": [obj.name for obj in objects if _keys(obj) is not None and _is_animated(_keys(obj))],
        "keys of their own": [obj.name for obj in objects if any(map(_is_animated, _with_parents(obj)))],
    }
    found = [f"{', '.join(map(repr, names[:3]))} by {way}" for way, names in ways.items() if names]
    if not found:
        return []
    return [
        f"moving in the source: {'; '.join(found)}. The levels keep none of it: each is one mesh of all leaves, "
        f"baked with skeletons at rest and all else as this frame shows it. All levels sway together by the wind "
        f"effect (`effects=+wind`)"
    ]


def _skeletons(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Yield the skeletons that move an object, by modifiers or as parents."""
    yield from (each.object for each in obj.modifiers if each.type == "ARMATURE" and each.object is not None)
    parent = obj.parent
    while parent is not None:
        if parent.type == "ARMATURE":
            yield parent
        parent = parent.parent


def _keys(obj: bpy.types.Object) -> bpy.types.Key | None:
    return obj.data.shape_keys if obj.type == "MESH" else None


def _is_animated(block: bpy.types.ID | None) -> bool:
    data = None if block is None else block.animation_data
    return data is not None and (data.action is not None or len(data.nla_tracks) > 0 or len(data.drivers) > 0)


def _with_parents(obj: bpy.types.Object | None) -> Iterator[bpy.types.Object]:
    while obj is not None and obj.type != "ARMATURE":
        yield obj
        obj = obj.parent
