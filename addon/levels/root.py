"""The root of a baked tree: an empty with all of its levels below, so that they move, rotate and scale together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
from mathutils import Matrix, Vector

from ..mesh.baked_levels import EXTRAS
from ..nodes.laws import ABOUT_LOD_DISTANCE, LOD_DISTANCE, NEAREST, is_own_group
from ..versions import drive_modifier_input, has_modifier_input
from .building import Build
from .rollback import left_out

_KEY = "root"
"""Custom property of a root, under `EXTRAS`: the rows of its matrix when it was made."""

_SIZE = 0.5
"""Length of the root's axes, as a fraction of R."""


def add_root(collection: bpy.types.Collection, build: Build) -> bpy.types.Object:
    """Add a root to the collection of a tree, at the tree's place."""
    root = bpy.data.objects.new(f"{build.name}_tree", None)
    root.matrix_world = Matrix(build.tree.matrix.tolist())
    root.empty_display_size = _SIZE * build.radius
    root[EXTRAS] = {_KEY: build.tree.matrix.ravel().tolist()}
    _add_distance(root)
    collection.objects.link(root)
    return root


def put_below(root: bpy.types.Object, obj: bpy.types.Object) -> None:
    """Make `obj` a child of the root, at the root's place."""
    obj.parent = root
    # The dependency graph computes matrix_world later. The steps after this one read it now.
    obj.matrix_world = root.matrix_world
    obj.location, obj.rotation_euler, obj.scale = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def _add_distance(root: bpy.types.Object) -> None:
    root[LOD_DISTANCE] = 1.0
    shown = root.id_properties_ui(LOD_DISTANCE)
    shown.update(min=NEAREST, soft_min=0.1, soft_max=10.0, description=ABOUT_LOD_DISTANCE)


def follow_distance(root: bpy.types.Object, obj: bpy.types.Object) -> None:
    """Make the modifiers of a level or trunk follow the custom property LOD Distance of the root."""
    for modifier in obj.modifiers:
        is_own = modifier.type == "NODES" and is_own_group(modifier.node_group)
        if is_own and has_modifier_input(modifier, LOD_DISTANCE):
            drive_modifier_input(modifier, LOD_DISTANCE, root, f'["{LOD_DISTANCE}"]')


@contextmanager
def without_root(collection: bpy.types.Collection, location: Vector | None = None) -> Iterator[None]:
    """Take the root out of the collection during the block, for exports: the levels stand alone in files.

    location: where they stand; None: where the root is.
    """
    root = root_of(collection)
    if root is None:
        yield
        return
    place, below = root.matrix_world.copy(), root.children
    if location is not None:
        place.translation = location
    with left_out(collection, root):
        for obj in below:
            obj.parent = None
            obj.matrix_world = place
        try:
            yield
        finally:
            for obj in below:
                put_below(root, obj)


def root_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """Return the root in the collection of a baked tree; None if it has none, as in files of earlier versions."""
    return next(filter(is_root, collection.objects), None)


def lod_factor(collection: bpy.types.Collection) -> float:
    """Return LOD Distance of a baked tree's root; 1 without one."""
    root = root_of(collection)
    return 1.0 if root is None else float(root.get(LOD_DISTANCE, 1.0))


def keep_root(before: bpy.types.Object, root: bpy.types.Object) -> None:
    """Put the levels below `root` below the root of the bake before, and remove `root`.

    So parents, animation and constraints of the tree stay. It moves as the tree's sources moved since the bake before.
    """
    made = Matrix([before[EXTRAS][_KEY][4 * row : 4 * row + 4] for row in range(4)])
    place, extras, name = root.matrix_world.copy(), root[EXTRAS].to_dict(), root.name
    levels, collections = root.children, root.users_collection
    bpy.data.objects.remove(root)
    for collection in collections:
        collection.objects.link(before)
    before.name, before[EXTRAS] = name, extras
    if made != place:
        before.matrix_world = before.matrix_world @ made.inverted() @ place
    if LOD_DISTANCE not in before:  # Made by an earlier version.
        _add_distance(before)
    for level in levels:
        put_below(before, level)
    for obj in before.children_recursive:
        follow_distance(before, obj)


def is_root(obj: bpy.types.Object) -> bool:
    return obj.type == "EMPTY" and _KEY in obj.get(EXTRAS, {})
