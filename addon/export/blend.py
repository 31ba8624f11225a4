"""NAME.blend: the levels, with the camera and the lights of the scene that they were baked in."""

from __future__ import annotations

from pathlib import Path

import bpy

from .errors import ExportError, reason

_KEPT_TYPES = {"CAMERA", "LIGHT", "EMPTY"}


def clear_scene(scene: bpy.types.Scene) -> None:
    """Removes all objects but cameras, lights and the empties that hold them, and all other scenes, from the open file.

    For a process of its own only. Materials and images stay until `make_self_contained`.
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
        bpy.data.meshes.remove(mesh)  # A tree that was baked before has the names that its levels are to get.
    for collection in list(bpy.data.collections):
        bpy.data.collections.remove(collection)


def make_self_contained() -> None:
    """Removes what nothing uses, takes over what is linked from libraries, and packs images that lie in files: what is
    saved then needs nothing beside it."""
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
    """Saves the open file, as it is, as `path`. Raises `ExportError` when it could not be written."""
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True, relative_remap=False)
    except RuntimeError as error:
        raise ExportError(f"{path.name}: {reason(error)}") from error
