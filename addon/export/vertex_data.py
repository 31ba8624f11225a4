"""Vertex attributes for shaders in GLB files: rank, pivots and wind attributes. A file holds each of them once.

By default Blender's exporter writes custom attributes: `_LEAF_RANK` (rank, phase, freedom), `_LEAF_PIVOT`,
`_LEAF_PIVOT_TARGET` and `_LEAF_BILLBOARD_PIVOT`. All have three components, because Blender's own importer (4.2 to 5.1)
fails at random on attributes of different widths.

The engines in `BY_COORDINATES` drop custom attributes. They get the numbers of `_coordinates` as texture coordinates
from TEXCOORD_2 on, two numbers in each set. Godot (`GLTFDocument::_parse_meshes`, 4.6) makes CUSTOM0 of TEXCOORD_2 and
_3, CUSTOM1 of _4 and _5, CUSTOM2 of _6 and _7, in single precision and unchanged. glTF requires the lower sets, too. A
set that the level lacks uses the accessor of its first set.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..levels.building import BuiltLevel
from ..levels.morphs import add_point_attribute
from ..mesh.baked_levels import EXTRAS
from .glb_file import Glb
from .gltf import y_up

BY_COORDINATES = ("babylon", "godot", "unity", "unreal")
FIRST_SET = 2


@contextmanager
def engine_attributes(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Add custom attributes to each level that has pivots while the block runs."""
    meshes = [level.object.data for level in levels if "leaf_pivot" in level.object.data.attributes]
    added: list[tuple[bpy.types.Mesh, str]] = []
    try:
        for mesh in meshes:
            for name, vectors in _engine_values(mesh).items():
                add_point_attribute(mesh, name, "FLOAT_VECTOR", vectors)
                added.append((mesh, name))
        yield
    finally:
        for mesh, name in added:
            mesh.attributes.remove(mesh.attributes[name])


class VertexData:
    """Converter of custom attributes in GLB files to texture coordinates, for engines that drop custom attributes."""

    def __init__(self, engine: str) -> None:
        self._by_coordinates = engine in BY_COORDINATES

    def add_to(self, glb: Glb) -> None:
        """Convert the attributes, unless the engine reads custom attributes."""
        if not self._by_coordinates:
            return
        moved = [
            (mesh, primitive)
            for mesh in glb.document.get("meshes", [])
            for primitive in mesh["primitives"]
            if "_LEAF_PIVOT" in primitive["attributes"]
        ]
        if not moved:
            return
        for mesh, primitive in moved:
            _move_to_coordinates(glb, primitive)
            mesh.setdefault("extras", {}).setdefault(EXTRAS, {})["first_texcoord"] = FIRST_SET
        glb.remove_unused()


def _engine_values(mesh: bpy.types.Mesh) -> dict[str, NDArray[np.float32]]:
    """Return the attributes (v, 3) by name, Y-up. A level without ranks has the rank −1, which is never pruned."""
    values = {}
    if "leaf_rank" in mesh.attributes or "leaf_phase" in mesh.attributes:
        names = {"leaf_rank": -1.0, "leaf_phase": 0.0, "leaf_flutter": 0.0}
        values["_LEAF_RANK"] = np.column_stack([_numbers(mesh, name, missing) for name, missing in names.items()])
    for name in ("leaf_pivot", "leaf_pivot_target", "leaf_billboard_pivot"):
        if name in mesh.attributes:
            values[f"_{name.upper()}"] = _vectors(mesh, name)
    return values


def _numbers(mesh: bpy.types.Mesh, name: str, missing: float) -> NDArray[np.float32]:
    """Return the attribute `name`, (v,); filled with `missing` if the mesh lacks it."""
    numbers = np.full(len(mesh.vertices), missing, np.float32)
    if name in mesh.attributes:
        mesh.attributes[name].data.foreach_get("value", numbers)
    return numbers


def _vectors(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32]:
    """Return the attribute `name`, (v, 3), Y-up."""
    vectors = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get("vector", vectors)
    return y_up(vectors.reshape(-1, 3))


def _move_to_coordinates(glb: Glb, primitive: dict[str, Any]) -> None:
    attributes = primitive["attributes"]
    custom = {
        name: glb.values(attributes.pop(name)) for name in [name for name in attributes if name.startswith("_LEAF_")]
    }
    # All sets of a level are equal: its materials may use one UV map under several names.
    for name in [name for name in attributes if name.startswith("TEXCOORD_") and name != "TEXCOORD_0"]:
        del attributes[name]
    if "material" in primitive:
        _use_first_set(glb.materials[primitive["material"]])
    numbers = _coordinates(custom)
    for number, pair in enumerate(np.hsplit(numbers, numbers.shape[1] // 2), start=FIRST_SET):
        attributes[f"TEXCOORD_{number}"] = glb.append_accessor(pair)
    spare = attributes.get("TEXCOORD_0", attributes[f"TEXCOORD_{FIRST_SET}"])
    for number in range(FIRST_SET):
        attributes.setdefault(f"TEXCOORD_{number}", spare)


def _coordinates(custom: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
    """Return (v, 4), (v, 8) or (v, 12) numbers: rank, pivot; pivot target, phase; billboard pivot, freedom.

    The width is the smallest that holds the level's attributes. Missing ones are a rank of −1, the pivot, or 0.
    """
    pivot = custom["_LEAF_PIVOT"]
    unranked = np.repeat(np.array([[-1.0, 0.0, 0.0]], np.float32), len(pivot), axis=0)
    rank, phase, freedom = np.hsplit(custom.get("_LEAF_RANK", unranked), 3)
    target, carrier = (custom.get(name, pivot) for name in ("_LEAF_PIVOT_TARGET", "_LEAF_BILLBOARD_PIVOT"))
    numbers = np.hstack([rank, pivot, target, phase, carrier, freedom]).astype(np.float32)
    if "_LEAF_BILLBOARD_PIVOT" in custom or freedom.any():
        return numbers
    return numbers[:, :8] if "_LEAF_PIVOT_TARGET" in custom else numbers[:, :4]


def _use_first_set(material: Any) -> None:
    """Make all textures of a material use TEXCOORD_0, at any depth of its JSON."""
    if isinstance(material, dict):
        material.pop("texCoord", None)
    inner = material.values() if isinstance(material, dict) else material if isinstance(material, list) else ()
    for value in inner:
        _use_first_set(value)
