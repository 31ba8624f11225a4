"""What a bake leaves on its levels, by which they are known again: custom properties."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import bpy

EXTRAS = "leafcloud"
"""The custom property, and so the key in glTF's extras, of objects and meshes."""

_BAKE = "leafcloud_bake"
"""The custom property of a collection of levels: a `Record` as JSON."""


@dataclass(frozen=True)
class Record:
    """How a collection of levels was made. All names are full ones, sorted.

    name: of the collection, with which the names of its levels begin. sources: the objects that the levels were made
    of. made: the objects and collections that the bake has put into the collection.
    """

    name: str
    sources: tuple[str, ...]
    made: tuple[str, ...]


def remember(collection: bpy.types.Collection, sources: Iterable[bpy.types.Object]) -> None:
    """Note how a collection of levels was made, as long as only the bake has put anything into it.

    It remembers names, not objects: a pointer would keep objects in the file that an artist has deleted, and would
    bring them along wherever the collection is appended.
    """
    made = [*collection.all_objects, *collection.children_recursive]
    collection[_BAKE] = json.dumps(asdict(Record(collection.name, full_names(sources), full_names(made))))


def record(collection: bpy.types.Collection) -> Record | None:
    """How a collection of levels was made; None for any other."""
    if _BAKE not in collection:
        return None
    found = json.loads(collection[_BAKE])
    return Record(found["name"], tuple(found["sources"]), tuple(found["made"]))


def full_names(blocks: Iterable[bpy.types.ID]) -> tuple[str, ...]:
    """The names of data-blocks, sorted; those that are linked from a library have its name behind theirs."""
    return tuple(sorted(block.name_full for block in blocks))


def level_number(obj: bpy.types.Object) -> int | None:
    """The number of the baked level that the object is; None for any other object, a level's trunk too."""
    extras = obj.get(EXTRAS)
    number = extras.get("level") if obj.type == "MESH" and hasattr(extras, "get") else None
    return number if isinstance(number, int) else None


def follows_a_bake(obj: bpy.types.Object) -> bool:
    """Whether the object is a baked level and no tree to bake.

    Level 0 as a glTF file has it is leaves like any others: nothing moves it, and no other levels stand beside it.
    """
    number = level_number(obj)
    return number is not None and (number > 0 or len(obj.modifiers) > 0 or record_of(obj) is not None)


def record_of(obj: bpy.types.Object) -> Record | None:
    """How a level, its trunk or its shadow was made; None for any other object."""
    found = (record(collection) for collection in obj.users_collection)
    return next((each for each in found if each is not None and obj.name_full in each.made), None)
