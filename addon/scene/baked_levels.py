"""What a bake leaves on its levels, by which they are known again: custom properties."""

from __future__ import annotations

import json

import bpy

EXTRAS = "leafcloud"
"""The custom property, and so the key in glTF's extras, of objects and meshes."""

BAKE = "leafcloud_bake"
"""The custom property of a collection of levels: JSON, with the full names of the `sources` and of all that was `made`."""


def level_number(obj: bpy.types.Object) -> int | None:
    """The number of the baked level that the object is; None for any other object, a level's trunk too."""
    extras = obj.get(EXTRAS)
    number = extras.get("level") if obj.type == "MESH" and hasattr(extras, "get") else None
    return number if isinstance(number, int) else None


def source_names(collection: bpy.types.Collection) -> tuple[str, ...]:
    """The full names of the objects that the levels in the collection were made of; empty for any other collection."""
    return tuple(json.loads(collection[BAKE])["sources"]) if BAKE in collection else ()


def made_names(collection: bpy.types.Collection) -> tuple[str, ...]:
    """The full names of the objects and collections that the bake made in the collection; empty for any other."""
    return tuple(json.loads(collection[BAKE])["made"]) if BAKE in collection else ()


def levels_with(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """The collection of levels that the object was made for: a level, its trunk or its shadow; None for any other."""
    return next((each for each in obj.users_collection if obj.name_full in made_names(each)), None)
