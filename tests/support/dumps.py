"""A dump of a .blend file as text lines, one for each property of every data-block, to compare two files."""

from __future__ import annotations

import hashlib
import warnings
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
"""Properties to skip: those that do not belong to the file's content, references back to the owner, the selection (in
Blender 5.0 the selection of edges is random), and tool settings (Blender 4.2 may have freed their brushes)."""
_INTERFACE = {"screens", "workspaces", "window_managers", "brushes", "palettes", "texts", "libraries"}


def dump() -> list[str]:
    """Return one line for each property of all data-blocks, without the interface, sorted by collection, name, path."""
    with warnings.catch_warnings():  # Blender deprecates properties that it still has.
        warnings.simplefilter("ignore", DeprecationWarning)
        return _Dump().lines


class _Dump:
    """The lines of all data-blocks. A list is faster than nested generators for hundreds of thousands of lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._properties: dict[type, list[tuple[str, bool]]] = {}
        for prop in bpy.data.bl_rna.properties:
            if prop.type == "COLLECTION" and prop.identifier not in _INTERFACE:
                for block in sorted(getattr(bpy.data, prop.identifier), key=lambda block: block.name_full):
                    name = f"{prop.identifier} {block.name_full}"
                    self.lines.append(f"{name} is there")
                    self._struct(block, name, set())

    def _properties_of(self, struct: Any) -> list[tuple[str, bool]]:
        """Return the sorted identifiers of the type's properties, and whether each is a collection."""
        kind = type(struct)
        if kind not in self._properties:
            found = {prop.identifier: prop.type == "COLLECTION" for prop in struct.bl_rna.properties}
            self._properties[kind] = sorted(item for item in found.items() if item[0] not in _SKIPPED)
        return self._properties[kind]

    def _struct(self, struct: Any, path: str, seen: set[tuple[str, int]]) -> None:
        key = (type(struct).__name__, struct.as_pointer())
        if key in seen:
            return
        seen.add(key)
        for identifier, is_collection in self._properties_of(struct):
            value = getattr(struct, identifier, None)
            here = f"{path} {identifier}"
            if is_collection:
                items = (item for item in value or () if not _name(item, 0).startswith(".select"))
                for number, item in enumerate(items):
                    self._value(item, f"{here} {_name(item, number)}", seen)
            else:
                self._value(value, here, seen)
        if hasattr(struct, "keys"):
            for name in _keys(struct):
                value = struct[name]
                content = value.to_dict() if hasattr(value, "to_dict") else _plain(value)
                self.lines.append(f"{path} [{name}] = {content}")
        if isinstance(struct, bpy.types.PackedFile):
            self.lines.append(f"{path} content = {hashlib.sha256(struct.data).hexdigest()}")

    def _value(self, value: Any, path: str, seen: set[tuple[str, int]]) -> None:
        if value is None:
            return
        if not isinstance(value, bpy.types.bpy_struct):
            self.lines.append(f"{path} = {_plain(value)}")
        elif isinstance(value, bpy.types.ID) and not value.is_embedded_data:
            self.lines.append(f"{path} = {type(value).__name__} {value.name_full}")
        else:
            self.lines.append(f"{path} is there")
            self._struct(value, path, seen)


def _keys(struct: Any) -> list[str]:
    try:
        return sorted(struct.keys())
    except TypeError:  # This type has no custom properties.
        return []


def _name(item: Any, number: int) -> str:
    return getattr(item, "name", "") or str(number)


def _plain(value: Any) -> str:
    """Return the value as text: nested arrays as lists, bytes as a digest."""
    if isinstance(value, bytes):
        return hashlib.sha256(value).hexdigest()
    if isinstance(value, (str, int, float, bool, set)):
        return repr(sorted(value) if isinstance(value, set) else value)
    try:
        return repr([_plain(each) for each in value])
    except TypeError:
        return type(value).__name__
