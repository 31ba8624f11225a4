"""What a .blend holds, in words: every property of every data-block, so that two files can be compared."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator
from typing import Any

import bpy

_SKIPPED = {
    "rna_type",
    "bl_rna",
    "id_data",
    "original",
    "session_uid",
    "tag",
    "is_evaluated",
    "pixels",
    "depsgraph",
    "select",
    "tool_settings",
}
"""What says nothing of a file, or leads back; what is selected, which Blender 5.0 leaves to chance for edges; settings
of tools, whose brushes Blender 4.2 may have freed."""
_INTERFACE = {"screens", "workspaces", "window_managers", "brushes", "palettes", "texts", "libraries"}


def dump() -> list[str]:
    """A line for each property of all data-blocks but those of the interface, by collection, name and path."""
    lines: list[str] = []
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION" and prop.identifier not in _INTERFACE:
            for block in sorted(getattr(bpy.data, prop.identifier), key=lambda block: block.name_full):
                name = f"{prop.identifier} {block.name_full}"
                lines += [f"{name} is there", *_struct(block, name, set())]
    return lines


def _struct(struct: Any, path: str, seen: set[tuple[str, int]]) -> Iterator[str]:
    key = (type(struct).__name__, struct.as_pointer())
    if key in seen:
        return
    seen.add(key)
    for prop in sorted(struct.bl_rna.properties, key=lambda prop: prop.identifier):
        if prop.identifier in _SKIPPED:
            continue
        with warnings.catch_warnings():  # Blender deprecates properties that it still has.
            warnings.simplefilter("ignore", DeprecationWarning)
            value = getattr(struct, prop.identifier, None)
        here = f"{path} {prop.identifier}"
        if prop.type == "COLLECTION":
            items = (item for item in value or () if not _name(item, 0).startswith(".select"))
            for number, item in enumerate(items):
                yield from _value(item, f"{here} {_name(item, number)}", seen)
        else:
            yield from _value(value, here, seen)
    if hasattr(struct, "keys"):
        for name in _keys(struct):
            value = struct[name]
            yield f"{path} [{name}] = {value.to_dict() if hasattr(value, 'to_dict') else _plain(value)}"
    if isinstance(struct, bpy.types.PackedFile):
        yield f"{path} content = {hashlib.sha256(struct.data).hexdigest()}"


def _value(value: Any, path: str, seen: set[tuple[str, int]]) -> Iterator[str]:
    if isinstance(value, bpy.types.ID) and not value.is_embedded_data:
        yield f"{path} = {type(value).__name__} {value.name_full}"
    elif isinstance(value, bpy.types.bpy_struct):
        yield f"{path} is there"
        yield from _struct(value, path, seen)
    elif value is not None:
        yield f"{path} = {_plain(value)}"


def _keys(struct: Any) -> list[str]:
    try:
        return sorted(struct.keys())
    except TypeError:  # of a kind that has no custom properties
        return []


def _name(item: Any, number: int) -> str:
    return getattr(item, "name", "") or str(number)


def _plain(value: Any) -> str:
    """Arrays as tuples, however deep; the contents of an image as a digest."""
    if isinstance(value, bytes):
        return hashlib.sha256(value).hexdigest()
    if isinstance(value, (str, int, float, bool, set)):
        return repr(sorted(value) if isinstance(value, set) else value)
    try:
        return repr([_plain(each) for each in value])
    except TypeError:
        return type(value).__name__
