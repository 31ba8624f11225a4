"""The selection in a few words, for the first line of the panel: "Oak: 5,320 leaves, trunk".

Leaves are counted in the objects' own meshes, when the selection changes; of large meshes their faces, where names tell
the leaves. A selection with modifiers or instances is told by its number of objects: evaluating it would stop the
interface.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector

from ..errors import SceneError
from ..material.surface import read_surface
from ..mesh.baked_levels import record_of
from ..mesh.meshes import names_around
from ..mesh.pieces import Piece, divided, ground_of, shape_of
from ..plan.leaves import LeavesError, MaterialPart, Shape, choose_by_names, choose_by_shape
from ..plan.other_levels import coarser
from .handlers import Handlers
from .properties import leaf_names
from .selection import with_children

_MOST_FACES, _MOST_OBJECTS = 30_000, 150
"""Most faces and objects of a selection whose leaves are counted. Counting takes a tenth of a second."""

_MOST_NAMED = 3_000_000
"""Most faces of a selection that are counted by material. Counting takes a tenth of a second."""

_NO_LEAVES = "no leaves found, name them in Levels"

_last: list[tuple[object, str]] = []
"""The last selection and its parts in words, or empty."""


def selection_words(context: bpy.types.Context) -> str:
    """Return the name of the selected tree, its number of leaves and its trunk; empty without a selection."""
    parts = _selected_parts(context)
    return f"{_name(context)}: {parts}" if parts else ""


def leaves_problem(context: bpy.types.Context) -> str:
    """Return why the selection cannot be baked, with the remedy, if it has no leaves; empty if it may have some."""
    if context.scene.leafcloud.trees != "one" or _selected_parts(context) != _NO_LEAVES:
        return ""
    return f"No leaves are found in {_name(context)}: select a tree, or name its leaves under Levels › Leaves"


def _selected_parts(context: bpy.types.Context) -> str:
    """Return what the selection consists of in words; empty without a selection."""
    objects = with_children(context)
    if not objects:
        return ""
    names = leaf_names(context.scene.leafcloud)
    key = [(obj.name_full, len(obj.modifiers), _faces(obj), _materials(obj)) for obj in objects], names
    if not _last or _last[0][0] != key:
        _last[:] = [(key, _parts(objects, names))]
    return _last[0][1]


def forget_selection() -> None:
    """Forget the last selection, as when another file opens."""
    _last.clear()


def _on_change(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Look at the selection anew where a material or a selected object has changed."""
    if _last and any(_tells(update.id.original) for update in graph.updates):
        _last.clear()


def _tells(block: bpy.types.ID) -> bool:
    return isinstance(block, bpy.types.Material) or (isinstance(block, bpy.types.Object) and block.select_get())


HANDLERS: Handlers = (("depsgraph_update_post", _on_change),)


def _name(context: bpy.types.Context) -> str:
    active = context.view_layer.objects.active
    obj = active if active is not None and active.select_get() else context.selected_objects[0]
    made = record_of(obj)
    return obj.name if made is None else made.name


def _faces(obj: bpy.types.Object) -> int:
    return len(obj.data.polygons) if obj.type == "MESH" else 0


def _materials(obj: bpy.types.Object) -> list[str]:
    """Return the names of the materials in the object's slots, at least one; empty for a slot without material."""
    return ["" if slot.material is None else slot.material.name for slot in obj.material_slots] or [""]


def _parts(objects: Sequence[bpy.types.Object], names: Sequence[str] | None) -> str:
    if any(record_of(obj) is not None for obj in objects):
        return "baked"
    count = len(objects)
    meshes = [obj for obj in objects if _faces(obj)]
    plain = all(obj.type in ("MESH", "EMPTY") and not obj.modifiers and obj.instance_type == "NONE" for obj in objects)
    left_out = set(coarser([(obj.name, *names_around(obj)) for obj in meshes]))
    meshes = [obj for number, obj in enumerate(meshes) if number not in left_out]
    faces, unknown = sum(map(_faces, meshes)), f"{count} object{'s' if count > 1 else ''}"
    if not plain or not meshes or faces > _MOST_NAMED or len(meshes) > _MOST_OBJECTS:
        return unknown
    if faces > _MOST_FACES:
        return _named_faces(meshes, names) or unknown
    corners = [[(obj.matrix_world @ Vector(corner)).z for corner in obj.bound_box] for obj in meshes]
    ground = ground_of(list(map(min, corners)), list(map(max, corners)))
    try:
        pieces = [piece for obj in meshes for piece in _pieces(obj, ground)]
    except SceneError:  # A material with too many nodes: the bake tells.
        return unknown
    parts, shapes = [part for part, _ in pieces], [shape for _, shape in pieces]
    try:
        choice = choose_by_names(parts, names) or choose_by_shape(parts, shapes)
    except LeavesError:
        return "no leaves of that name" if names else _NO_LEAVES
    leaves = sum(len(shapes[i].sizes) for i in choice.indices)
    return f"{leaves:,} {'leaf' if leaves == 1 else 'leaves'}{', trunk' if len(choice.indices) < len(pieces) else ''}"


def _named_faces(meshes: Sequence[bpy.types.Object], names: Sequence[str] | None) -> str:
    """Return the number of the leaves' faces in words; empty where no name tells the leaves."""
    parts = [part for obj in meshes for part in _slots(obj)]
    try:
        choice = choose_by_names(parts, names)
    except LeavesError:
        return "no leaves of that name"
    if choice is None:
        return ""
    faces = sum(parts[i].triangles for i in choice.indices)
    return f"leaves of {faces:,} faces{', trunk' if len(choice.indices) < len(parts) else ''}"


def _slots(obj: bpy.types.Object) -> list[MaterialPart]:
    """Return the parts of a mesh object by materials, with their faces for triangles."""
    materials = _materials(obj)
    numbers = np.zeros(len(obj.data.polygons), np.int32)
    obj.data.polygons.foreach_get("material_index", numbers)
    faces = np.bincount(numbers.clip(0, len(materials) - 1), minlength=len(materials)).tolist()
    return [MaterialPart(obj.name, name, count) for name, count in zip(materials, faces, strict=True) if count]


def _pieces(obj: bpy.types.Object, ground: float) -> list[tuple[MaterialPart, Shape]]:
    """Return the parts of a mesh object by materials and components, each with its shape."""
    mesh = obj.data
    mesh.calc_loop_triangles()
    points, triangles = np.empty((len(mesh.vertices), 3)), np.empty((len(mesh.loop_triangles), 3), np.int32)
    numbers = np.empty(len(triangles), np.int32)
    mesh.vertices.foreach_get("co", points.ravel())
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    mesh.loop_triangles.foreach_get("material_index", numbers)
    materials, slots = _materials(obj), obj.material_slots
    numbers = numbers.clip(0, len(materials) - 1)
    matrix = np.array(obj.matrix_world)[None]
    parts, pieces = divided(points.astype(np.float32), triangles, numbers, matrix[0], ground)

    def described(number: int, piece: Piece) -> tuple[MaterialPart, Shape]:
        own = triangles[parts == number]
        material = slots[piece.slot].material if piece.slot < len(slots) else None
        shape = shape_of(points.astype(np.float32), own, matrix, piece, read_surface(material))
        return MaterialPart(obj.name, materials[piece.slot], len(own)), shape

    return [described(number, piece) for number, piece in enumerate(pieces)]
