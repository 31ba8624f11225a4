"""Tree sets for `nodes.scene`: copies of the leaves and trunks of all baked trees.

The copies share the levels' meshes, have no modifiers, and are in a collection outside all scenes. So the node group
reads the original leaves from any camera position.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy
from mathutils import Matrix

from ..mesh.baked_levels import level_number
from .baked_trees import trunks
from .placed_tree import tree_of
from .root import is_root, root_of


@dataclass(frozen=True)
class SharedTrees:
    """A tree set.

    trees: the collection to draw. sources: the objects that the tree set replaces: levels, trunks, roots and instances.
    leaves: the LOD 0 of each kind of tree, sorted by name. count: the number of trees.
    """

    trees: bpy.types.Collection
    sources: tuple[bpy.types.Object, ...]
    leaves: tuple[bpy.types.Object, ...]
    count: int


def shared_trees(objects: Iterable[bpy.types.Object], name: str) -> SharedTrees:
    """Return a tree set of the baked trees among the `objects`, including trees in instanced collections.

    name: of the new collection. Raises `ValueError` if there is no baked tree.
    """
    trunk = trunks()
    placed: list[tuple[bpy.types.Object, Matrix]] = []
    sources: list[bpy.types.Object] = []
    for obj in objects:
        shown = list(levels_shown(obj))
        placed += [(level, matrix) for level, matrix in shown if level_number(level) == 0]
        sources += [obj] if shown else []
    if not placed:
        raise ValueError("there is no baked tree: bake one first, or unhide it")
    trees = bpy.data.collections.new(name)
    for level, matrix in placed:
        _add(trees, level, matrix)
        if (own := trunk.get(level)) is not None:
            _add(trees, own, matrix @ level.matrix_world.inverted() @ own.matrix_world)
    sources += [trunk[obj] for obj in sources if obj in trunk]
    sources += dict.fromkeys(obj.parent for obj in sources if obj.parent is not None and is_root(obj.parent))
    kinds = {level.data: level for level, _ in reversed(placed)}
    leaves = tuple(sorted(kinds.values(), key=lambda level: level.name))
    return SharedTrees(trees, tuple(sources), leaves, len(placed))


def levels_shown(obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, Matrix]]:
    """Yield the levels that the object shows, and their world matrices.

    An object shows itself if it is a level, the levels of the collection that it instances, or those of the tree that
    is placed by it.
    """
    placed = tree_of(obj)
    if level_number(obj) is not None:
        yield obj, obj.matrix_world
    elif placed is not None and (root := root_of(placed)) is not None:
        there = obj.matrix_world @ root.matrix_world.inverted_safe()
        for level in root.children:
            if level_number(level) is not None:
                yield level, there @ level.matrix_world
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        there = obj.matrix_world @ Matrix.Translation(-obj.instance_collection.instance_offset)
        for level in obj.instance_collection.all_objects:
            if level_number(level) is not None:
                yield level, there @ level.matrix_world


def _add(trees: bpy.types.Collection, source: bpy.types.Object, matrix: Matrix) -> None:
    copy = bpy.data.objects.new(source.name, source.data)
    copy.matrix_world = matrix
    trees.objects.link(copy)
