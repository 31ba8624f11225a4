"""Writer of NAME.blend: the levels, with the cameras and lights of the baked scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..errors import ExportError
from .errors import reason

_KEPT_TYPES = {"CAMERA", "LIGHT", "EMPTY"}


def clear_scene(scene: bpy.types.Scene) -> None:
    """Remove all other scenes, all collections, and all objects except cameras, lights and plain empties.

    For a separate process only. Materials and images stay until `make_self_contained`.
    """
    for other in [other for other in bpy.data.scenes if other != scene]:
        bpy.data.scenes.remove(other)
    kept = [obj for obj in scene.objects if obj.type in _KEPT_TYPES and obj.instance_collection is None]
    for obj in kept:
        if obj.parent is not None and obj.parent not in kept:
            world = obj.matrix_world.copy()
            obj.parent = None
            obj.matrix_world = world
        if obj.name not in scene.collection.objects:
            scene.collection.objects.link(obj)
    for obj in [obj for obj in bpy.data.objects if obj not in kept]:
        bpy.data.objects.remove(obj)
    for mesh in [mesh for mesh in bpy.data.meshes if mesh.users == 0]:
        bpy.data.meshes.remove(mesh)  # An earlier bake's meshes have the names that the new levels need.
    for collection in list(bpy.data.collections):
        bpy.data.collections.remove(collection)


def make_self_contained() -> None:
    """Make the open file independent of other files.

    Remove unused data, make linked library data local, and pack images that are files.
    """
    bpy.data.orphans_purge(do_recursive=True)
    for block in bpy.data.user_map():
        if block.library is not None:
            block.make_local()
    for library in list(bpy.data.libraries):
        bpy.data.libraries.remove(library)
    for image in bpy.data.images:
        if image.packed_file is None and image.source == "FILE" and Path(bpy.path.abspath(image.filepath)).is_file():
            image.pack()


def save_blend(path: Path) -> None:
    """Save a copy of the open file as `path`. Raises `ExportError` if it cannot be written."""
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True, relative_remap=False)
    except RuntimeError as error:
        raise ExportError(f"{path.name}: {reason(error)}") from error
