"""Custom properties that mark baked levels, so that a later bake recognizes them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from uuid import uuid4

import bpy

EXTRAS = "leafcloud"
"""The custom property of objects and meshes. It is also the key in the glTF extras."""

TREE_GROUP = "leafcloud_tree_group"
"""The custom property that a baked tree's collection and the node group of its placed trees share: an identifier."""

PLAIN = "leafcloud_plain"
"""The custom property of an octahedral impostor's object: the mesh that files have instead."""

_BAKE = "leafcloud_bake"
"""The custom property of a collection of levels: a `Record` as JSON."""

_ID = "leafcloud_source"
"""The custom property of a baked object: its identifier in the records of bakes."""


@dataclass(frozen=True)
class Record:
    """Record of how a bake made a collection of levels. Names are full names (`full_names`), sorted.

    name: the name of the collection; the names of its levels begin with it. sources: the baked objects, also if they
    were renamed since.
    made: the objects and collections that the bake put into the collection.
    """

    name: str
    sources: tuple[str, ...]
    made: tuple[str, ...]


def remember(collection: bpy.types.Collection, sources: Iterable[bpy.types.Object], *, identify: bool = True) -> None:
    """Store on a collection of levels how a bake made it. Call this while the collection holds only the bake's objects.

    The record holds names, not pointers. A pointer would keep deleted objects in the file, and appending the
    collection would append them, too. With `identify` each source gets an identifier, by which it is found under
    another name.
    """
    made, sources = [*collection.all_objects, *collection.children_recursive], list(sources)
    own = [obj for obj in sources if identify and obj.library is None]  # Linked objects cannot be changed.
    for obj in own:
        obj[_ID] = obj.get(_ID) or uuid4().hex
    ids = {obj.name_full: obj[_ID] for obj in own}
    kept = Record(collection.name, full_names(sources), full_names(made))
    collection[_BAKE] = json.dumps({**asdict(kept), "ids": ids})


def record(collection: bpy.types.Collection) -> Record | None:
    """Return how a bake made a collection of levels; None for any other collection."""
    if _BAKE not in collection:
        return None
    found = json.loads(collection[_BAKE])
    ids = found.get("ids", {})
    sources = sorted(_name_now(name, ids.get(name)) for name in found["sources"])
    return Record(found["name"], tuple(sources), tuple(found["made"]))


def _name_now(name: str, identifier: str | None) -> str:
    """Return the present name of an object that had a name when it was baked; the same name if it is not found."""
    if identifier is None or name in bpy.data.objects:
        return name
    found = [obj.name_full for obj in bpy.data.objects if obj.get(_ID) == identifier]
    return found[0] if len(found) == 1 else name  # A copy of an object has the same identifier.


def full_names(blocks: Iterable[bpy.types.ID]) -> tuple[str, ...]:
    """Return the names of data-blocks, sorted. The name of a linked data-block ends with its library's name."""
    return tuple(sorted(block.name_full for block in blocks))


def level_number(obj: bpy.types.Object) -> int | None:
    """Return the number of a baked level; None for any other object, including a level's trunk."""
    extras = obj.get(EXTRAS)
    number = extras.get("level") if obj.type == "MESH" and hasattr(extras, "get") else None
    return number if isinstance(number, int) else None


def levels_and_trunks(objects: Iterable[bpy.types.Object]) -> Iterator[tuple[int, bpy.types.Object]]:
    """Yield the levels and their trunks among the objects, each with the level's number."""
    # Blender makes the list of a collection anew where the visibility of an object changes.
    for obj in list(objects):
        level = obj if level_number(obj) is not None else obj.parent
        number = None if level is None or obj.type != "MESH" or is_placed_tree(obj) else level_number(level)
        if number is not None:
            yield number, obj


def plain_mesh(obj: bpy.types.Object) -> bpy.types.Mesh:
    """Return the mesh of a level as files have it."""
    mesh = obj.get(PLAIN)
    return mesh if isinstance(mesh, bpy.types.Mesh) else obj.data


def follows_a_bake(obj: bpy.types.Object) -> bool:
    """Return whether an object is a baked level or a placed tree, which cannot be baked again.

    Level 0 imported from a glTF file counts as ordinary leaves: it has no modifiers and is in no collection of levels.
    """
    if is_placed_tree(obj):
        return True
    number = level_number(obj)
    return number is not None and (number > 0 or len(obj.modifiers) > 0 or record_of(obj) is not None)


def record_of(obj: bpy.types.Object) -> Record | None:
    """Return how a bake made a part of a tree, or the part that `obj` is a copy of; None for any other object."""
    found = (record(collection) for collection in obj.users_collection)
    is_part = belongs_to_bake(obj)
    return next((each for each in found if each is not None and (is_part or obj.name_full in each.made)), None)


def belongs_to_bake(block: bpy.types.ID) -> bool:
    """Return whether a data-block is a root, a level, its trunk or a shadow proxy, or a copy of one."""
    if not isinstance(block, bpy.types.Object):
        return False
    return EXTRAS in block or (block.parent is not None and level_number(block.parent) is not None and _is_trunk(block))


def _is_trunk(obj: bpy.types.Object) -> bool:
    # Trunks have no custom property, because files would have it, too. An artist's own meshes have other names.
    return obj.type == "MESH" and "_trunk" in obj.name


def is_placed_tree(obj: bpy.types.Object) -> bool:
    """Return whether an object shows a baked tree at its own place (`levels.placed_tree`)."""
    groups = [modifier.node_group for modifier in obj.modifiers if modifier.type == "NODES"]
    return any(group is not None and TREE_GROUP in group for group in groups)


def is_source(obj: bpy.types.Object) -> bool:
    """Return whether an object was baked."""
    return _ID in obj
