"""The trees of which `scene_nodes` makes a scene: copies of the leaves, and of the wood, of all that were baked.

The copies share the meshes of the levels, have no modifiers, and lie in a collection that is in no scene; so the node
group sees them as they are, wherever the camera is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy
from mathutils import Matrix

from .baked_trees import level_number, woods


@dataclass(frozen=True)
class SharedTrees:
    """`trees` is what is drawn, `sources` the objects that show the same, and all other levels of it, until now.

    leaves: the LOD 0 of each kind of tree, in the order of their names. count: of the trees.
    """

    trees: bpy.types.Collection
    sources: tuple[bpy.types.Object, ...]
    leaves: tuple[bpy.types.Object, ...]
    count: int


def shared_trees(objects: Iterable[bpy.types.Object], name: str) -> SharedTrees:
    """The baked trees among the `objects`, and those in the collections that these are instances of.

    Raises `ValueError` where there is none.
    """
    wood = woods()
    placed: list[tuple[bpy.types.Object, Matrix]] = []
    sources: list[bpy.types.Object] = []
    for obj in objects:
        shown = list(levels_shown(obj))
        placed += [(level, matrix) for level, matrix in shown if level_number(level) == 0]
        sources += [obj] if shown else []
    if not placed:
        raise ValueError("no baked tree is there: bake one first, or unhide it")
    trees = bpy.data.collections.new(name)
    for level, matrix in placed:
        _add(trees, level, matrix)
        if (own := wood.get(level)) is not None:
            _add(trees, own, matrix @ level.matrix_world.inverted() @ own.matrix_world)
    sources += [wood[obj] for obj in sources if obj in wood]
    kinds = {level.data: level for level, _ in reversed(placed)}
    leaves = tuple(sorted(kinds.values(), key=lambda level: level.name))
    return SharedTrees(trees, tuple(sources), leaves, len(placed))


def levels_shown(obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, Matrix]]:
    """The levels that the object is or, as an instance of a collection, shows, and where."""
    if level_number(obj) is not None:
        yield obj, obj.matrix_world
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        there = obj.matrix_world @ Matrix.Translation(-obj.instance_collection.instance_offset)
        for level in obj.instance_collection.all_objects:
            if level_number(level) is not None:
                yield level, there @ level.matrix_world


def _add(trees: bpy.types.Collection, source: bpy.types.Object, matrix: Matrix) -> None:
    copy = bpy.data.objects.new(source.name, source.data)
    copy.matrix_world = matrix
    trees.objects.link(copy)
