"""Placed trees: objects that show a baked tree, each the level for its own place (`nodes.placed_tree`).

The node group belongs to the baked tree and is shared by all of its placed trees. A new bake fills it again, so placed
trees follow. Placed trees do not need the levels: a removal of the levels leaves them as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from uuid import uuid4

import bpy
from mathutils import Matrix

from ..mesh.baked_levels import TREE_GROUP, level_number
from ..nodes.laws import LOD_DISTANCE
from ..nodes.placed_tree import Part, Step, fill_tree_group
from ..versions import modifier_inputs, source_of_input
from .root import root_of

_OWN_INPUTS = (LOD_DISTANCE, "Manual", "Transition", "Keep")
"""Inputs of the levels' modifiers that a placed tree sets for all of its levels."""


def placed_tree(collection: bpy.types.Collection) -> bpy.types.Object:
    """Create an object that shows the baked tree in `collection`. It is at the world's origin and in no collection."""
    group = _group_of(collection)
    obj = bpy.data.objects.new(collection.name, bpy.data.meshes.new(collection.name))
    obj.modifiers.new(group.name, "NODES").node_group = group
    return obj


def place_of(collection: bpy.types.Collection) -> Matrix:
    """Return the matrix of a placed tree that coincides with the tree in `collection`."""
    root = root_of(collection)
    if root is not None:
        return root.matrix_world.copy()
    return next(obj.matrix_world.copy() for obj in collection.all_objects if level_number(obj) == 0)


def hand_down(before: bpy.types.Collection, after: bpy.types.Collection) -> None:
    """Make the placed trees of `before` show the tree in `after`, a new bake of the same tree."""
    group = _found(before)
    if group is not None:
        after[TREE_GROUP] = before[TREE_GROUP]
        _fill(group, after)


def _group_of(collection: bpy.types.Collection) -> bpy.types.NodeTree:
    group = _found(collection)
    if group is None:
        group = bpy.data.node_groups.new(f"{collection.name} placed", "GeometryNodeTree")
        # Not a pointer: an appended placed tree would bring the levels along.
        collection[TREE_GROUP] = group[TREE_GROUP] = uuid4().hex
    _fill(group, collection)
    return group


def _found(collection: bpy.types.Collection) -> bpy.types.NodeTree | None:
    identifier = collection.get(TREE_GROUP)
    groups = (each for each in bpy.data.node_groups if each.library is None)
    return next((each for each in groups if identifier is not None and each.get(TREE_GROUP) == identifier), None)


def _fill(group: bpy.types.NodeTree, collection: bpy.types.Collection) -> None:
    before = {node.inputs["Object"].default_value for node in group.nodes if node.bl_idname == "GeometryNodeObjectInfo"}
    group.nodes.clear()
    bpy.data.batch_remove(before)
    fill_tree_group(group, [_part(number, obj) for number, obj in _members(collection)])


def _members(collection: bpy.types.Collection) -> Iterator[tuple[int, bpy.types.Object]]:
    """Yield the tree's levels and their trunks that are ever drawn, each with the level's number."""
    root = root_of(collection)
    own: Iterable[bpy.types.Object] = collection.all_objects if root is None else root.children_recursive
    for obj in own:
        level = obj if level_number(obj) is not None else obj.parent
        number = None if level is None else level_number(level)
        follows = any(each.type == "NODES" for each in obj.modifiers)
        if number is not None and obj.type == "MESH" and (follows or not obj.hide_render):
            yield number, obj


def _part(number: int, obj: bpy.types.Object) -> Part:
    fading = [
        (mesh_material, slot.material)
        for slot, mesh_material in zip(obj.material_slots, obj.data.materials, strict=True)
        if slot.link == "OBJECT" and mesh_material is not None and slot.material is not None
    ]
    steps = [_step(modifier) for modifier in obj.modifiers if modifier.type == "NODES" and modifier.node_group]
    return Part(number, bpy.data.objects.new(f"{obj.name} placed", obj.data), tuple(fading), tuple(steps))


def _step(modifier: bpy.types.NodesModifier) -> Step:
    names = [name for name in modifier_inputs(modifier) if name not in _OWN_INPUTS]
    values = modifier_inputs(modifier)
    sources = {name: source_of_input(modifier, name) for name in names}
    driven = {name: source for name, source in sources.items() if source is not None}
    return Step(modifier.node_group, {name: values[name] for name in names}, driven)
