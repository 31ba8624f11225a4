"""Placed trees: objects that show a baked tree, each the level for its own place (`nodes.placed_tree`).

The node group belongs to the baked tree and is shared by all of its placed trees. A new bake fills it again, so placed
trees follow. Placed trees do not need the levels: a removal of the levels leaves them as they are. They keep the
levels' inputs at the time when the group was filled, with simple drivers but without animation.
"""

from __future__ import annotations

from uuid import uuid4

import bpy
from mathutils import Matrix

from ..mesh.baked_levels import TREE_GROUP, level_number, levels_and_trunks, record
from ..nodes.laws import LOD_DISTANCE, STAGGER, is_own_group
from ..nodes.placed_tree import LevelModifier, Part, fill_tree_group
from ..versions import modifier_inputs, source_of_input
from .root import root_of

_OWN_INPUTS = (LOD_DISTANCE, STAGGER, "Manual", "Transition", "Keep")
"""Inputs of the levels' modifiers that a placed tree sets for all of its levels."""


def tree_group(collection: bpy.types.Collection) -> bpy.types.NodeTree:
    """Return the node group that draws the baked tree in `collection`, with its present levels.

    Raises `ValueError` for a collection without levels.
    """
    parts = _parts_of(collection)
    group = _found(collection)
    if group is None:
        group = bpy.data.node_groups.new(f"{collection.name} placed", "GeometryNodeTree")
        # Not a pointer: an appended placed tree would bring the levels along.
        collection[TREE_GROUP] = group[TREE_GROUP] = uuid4().hex
    _fill(group, parts)
    return group


def placed_tree(name: str, group: bpy.types.NodeTree) -> bpy.types.Object:
    """Create an object that draws a tree's `group`. It is at the world's origin and in no collection."""
    obj = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    obj.modifiers.new(group.name, "NODES").node_group = group
    return obj


def is_placeable(collection: bpy.types.Collection) -> bool:
    """Return whether the collection has levels to place."""
    return any(True for _ in levels_and_trunks(collection.all_objects))


def place_of(collection: bpy.types.Collection) -> Matrix:
    """Return the matrix of a placed tree that coincides with the tree in `collection`, which has levels."""
    root = root_of(collection)
    if root is not None:
        return root.matrix_world.copy()
    return next(obj.matrix_world.copy() for obj in collection.all_objects if level_number(obj) == 0)


def tree_of(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the collection of the baked tree that a placed tree shows; None for other objects, or if it is gone."""
    groups = (modifier.node_group for modifier in obj.modifiers if modifier.type == "NODES")
    identifiers = {group[TREE_GROUP] for group in groups if group is not None and TREE_GROUP in group}
    return next((each for each in bpy.data.collections if each.get(TREE_GROUP) in identifiers), None)


def blocks_of_placed(collection: bpy.types.Collection) -> set[bpy.types.ID]:
    """Return the node group of a tree's placed trees, and the objects that it reads."""
    group = _found(collection)
    return set() if group is None else {group, *_sources(group)}


def hand_down(before: bpy.types.Collection, after: bpy.types.Collection) -> None:
    """Make the placed trees of `before` show the tree in `after`, a new bake of the same tree."""
    group = _found(before)
    if group is not None:
        after[TREE_GROUP] = before[TREE_GROUP]
        _fill(group, _parts_of(after))


def _found(collection: bpy.types.Collection) -> bpy.types.NodeTree | None:
    """Return the group of the collection's tree; None if it has none of its own, as a copy of the collection."""
    identifier, made = collection.get(TREE_GROUP), record(collection)
    if identifier is None:
        return None
    shared = any(each.get(TREE_GROUP) == identifier for each in bpy.data.collections if each != collection)
    if shared and made is not None and made.name != collection.name:
        return None
    groups = (each for each in bpy.data.node_groups if each.library is None)
    return next((each for each in groups if each.get(TREE_GROUP) == identifier), None)


_Parts = list[tuple[int, bpy.types.Object]]


def _fill(group: bpy.types.NodeTree, parts: _Parts) -> None:
    before = _sources(group)
    group.nodes.clear()
    bpy.data.batch_remove(before)
    fill_tree_group(group, [_part(number, obj) for number, obj in parts])


def _sources(group: bpy.types.NodeTree) -> set[bpy.types.Object]:
    nodes = [node for node in group.nodes if node.bl_idname == "GeometryNodeObjectInfo"]
    return {node.inputs["Object"].default_value for node in nodes} - {None}


def _parts_of(collection: bpy.types.Collection) -> _Parts:
    """Return the tree's levels and their trunks that are ever drawn, each with the level's number."""
    root = root_of(collection)
    below = list(levels_and_trunks(() if root is None else root.children_recursive))
    parts = below or list(levels_and_trunks(collection.all_objects))
    if not parts:
        raise ValueError(f"collection {collection.name!r} has no levels: bake the tree again")
    return [
        (number, obj)
        for number, obj in parts
        if not obj.hide_render or any(modifier.type == "NODES" for modifier in obj.modifiers)
    ]


def _part(number: int, obj: bpy.types.Object) -> Part:
    fading = [
        (mesh_material, slot.material)
        for slot, mesh_material in zip(obj.material_slots, obj.data.materials, strict=True)
        if slot.link == "OBJECT" and mesh_material is not None and slot.material is not None
    ]
    own = [each for each in obj.modifiers if each.type == "NODES" and is_own_group(each.node_group)]
    source = bpy.data.objects.new(f"{obj.name} placed", obj.data)
    return Part(number, source, tuple(fading), tuple(map(_read, own)))


def _read(modifier: bpy.types.NodesModifier) -> LevelModifier:
    values = {name: value for name, value in modifier_inputs(modifier).items() if name not in _OWN_INPUTS}
    sources = {name: source_of_input(modifier, name) for name in values}
    driven = {name: source for name, source in sources.items() if source is not None}
    return LevelModifier(modifier.node_group, values, driven)
