"""glTF export by Blender's own exporter, with changes to materials before it and additions to its files after it."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import ExportError
from ..levels.baked_light import FRONT
from ..levels.building import BuiltLevel
from ..levels.material import TRANSLUCENCY_NODE
from .errors import reason
from .glb_file import Edit, Glb
from .optional_textures import OPTIONAL_NODES, add_optional_textures
from .tangents import add_tangents
from .translucency import add_leaf_translucency, add_translucency
from .unlit import COLOR_OPTIONS, add_unlit

_OPTIONS = {
    "export_format": "GLB",
    "export_yup": True,
    "export_attributes": True,
    "export_extras": True,
    "export_morph": True,
    "export_morph_normal": False,  # Normals do not morph.
    "export_morph_tangent": False,
    "export_try_sparse_sk": False,  # Not every engine reads sparse accessors.
    "export_tangents": False,
    "export_animations": False,
    "export_skins": False,
    "export_apply": False,
    "export_current_frame": True,  # Otherwise the exporter goes to frame 0.
}


def export_collection(collection: bpy.types.Collection, path: Path, edits: Sequence[Edit] = ()) -> None:
    """Write all objects of `collection` and its children as a GLB file. The current scene must contain it.

    `edits` complete the file after Blender's exporter and this module.

    Raises `ExportError` if the complete file cannot be written.
    """
    lit = any(FRONT in obj.data.color_attributes for obj in collection.all_objects)
    try:
        bpy.ops.export_scene.gltf(
            filepath=str(path), collection=collection.name, **_OPTIONS, **(COLOR_OPTIONS if lit else {})
        )
    except RuntimeError as error:
        raise ExportError(f"{path.name}: {reason(error)}") from error
    if not _is_whole(path):
        raise ExportError(f"{path.name}: Blender's glTF exporter wrote no complete file")
    nodes = _node_names(collection)
    glb = Glb.read(path)
    if nodes & set(OPTIONAL_NODES):
        add_optional_textures(glb, collection)
    if TRANSLUCENCY_NODE in nodes:
        add_translucency(glb, collection)
    add_leaf_translucency(glb, collection)
    if lit:
        add_unlit(glb, collection)
    for edit in (add_tangents, *edits):
        edit(glb)
    glb.write(path)


def _node_names(collection: bpy.types.Collection) -> set[str]:
    """Return the names of all material nodes in `collection`. Some hold data that Blender's exporter does not write."""
    materials = {material for obj in collection.all_objects for material in obj.data.materials if material is not None}
    return {node.name for material in materials if material.node_tree for node in material.node_tree.nodes}


def export_level(level: BuiltLevel, path: Path) -> None:
    """Write one level with its trunk as a GLB file. Raises `ExportError` if the complete file cannot be written."""
    export_objects([obj for obj in (level.object, level.trunk) if obj is not None], path, level.object.name)


def export_objects(
    objects: Sequence[bpy.types.Object], path: Path, scene_name: str, edits: Sequence[Edit] = ()
) -> None:
    """Write only these objects as a GLB file with a scene of the given name. `edits`: see `export_collection`.

    Raises `ExportError` if the complete file cannot be written.
    """
    collection = bpy.data.collections.new(scene_name)
    bpy.context.scene.collection.children.link(collection)
    try:
        for obj in objects:
            collection.objects.link(obj)
        export_collection(collection, path, edits)
    finally:
        bpy.data.collections.remove(collection)


def y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert vectors (…, 3) from Blender's Z-up coordinates to glTF's: (x, z, −y).

    Blender's exporter converts known attributes only, not custom ones.
    """
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def _is_whole(path: Path) -> bool:
    """Return whether `path` is a GLB file of the length in its header."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        header = file.read(12)
    return len(header) == 12 and struct.unpack("<4sII", header)[::2] == (b"glTF", path.stat().st_size)
