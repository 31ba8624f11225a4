"""All that differs between the Blenders that Leafcloud runs in, 4.2 LTS and later. Nothing else asks the version."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

InputValue: TypeAlias = bool | int | float | Sequence[float] | bpy.types.Object

_FREE_NORMALS = bpy.app.version >= (4, 5, 0)


def eevee_engine() -> str:
    """The identifier of EEVEE for `scene.render.engine`."""
    return "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"


def blend_relative_path() -> set[str]:
    """The options of a property of paths that may begin with //, the folder of the .blend file."""
    known = "is_path_supports_blend_relative" in bpy.types.Property.bl_rna.properties  # 4.5 and later
    return {"ANIMATABLE", *(["PATH_SUPPORTS_BLEND_RELATIVE"] if known else [])}


def set_modifier_input(modifier: bpy.types.NodesModifier, name: str, value: InputValue) -> None:
    """Sets the input called `name` of a geometry-node modifier, in the type that its socket wants.

    Tags the object, because Blender does not notice that the values of a modifier changed.
    Raises `KeyError` when the modifier's group has no such input.
    """
    socket = _input_socket(modifier, name)
    converted = _convert(socket, value)
    if hasattr(modifier, "properties"):  # 5.2 and later
        getattr(modifier.properties.inputs, socket.identifier).value = converted
    else:
        modifier[socket.identifier] = converted
    modifier.id_data.update_tag()


def get_modifier_input(modifier: bpy.types.NodesModifier, name: str) -> Any:
    """The value of the input called `name`: a bool, an int, a float, or a tuple of floats for a vector.

    Raises `KeyError` when the modifier's group has no such input.
    """
    socket = _input_socket(modifier, name)
    if hasattr(modifier, "properties"):  # 5.2 and later
        stored = getattr(modifier.properties.inputs, socket.identifier).value
    else:
        stored = modifier[socket.identifier]
    return _convert(socket, stored)


def drive_modifier_input(modifier: bpy.types.NodesModifier, name: str, source: bpy.types.ID, path: str) -> None:
    """Makes the input called `name` follow the number at `path` of `source`, by a driver that needs no Python.

    Raises `KeyError` when the modifier's group has no such input.
    """
    identifier = _input_socket(modifier, name).identifier
    if hasattr(modifier, "properties"):  # 5.2 and later
        driven = f'modifiers["{modifier.name}"].properties.inputs.{identifier}.value'
    else:
        driven = f'modifiers["{modifier.name}"]["{identifier}"]'
    driver = modifier.id_data.driver_add(driven).driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = source, path


def set_corner_normals(mesh: bpy.types.Mesh, normals: NDArray[np.float32]) -> None:
    """Gives the mesh custom normals: `normals` (corners, 3), unit vectors in the order of `mesh.loops`.

    From Blender 4.5 on they are stored free, as vectors: `mesh.corner_normals` gives them back bit for bit, and they
    stay when points move. Before, Blender keeps them as two 16-bit angles against the normal that the mesh has by
    itself: they come back within some 1e-4 (1e-2 where they nearly oppose it), and turn with the faces.
    Raises `ValueError` when the array's shape does not fit the mesh.
    """
    expected = (len(mesh.loops), 3)
    if normals.shape != expected:
        raise ValueError(
            f"normals of mesh {mesh.name!r} have shape {normals.shape}, expected {expected}: one per corner"
        )
    if not _FREE_NORMALS:
        mesh.normals_split_custom_set(normals)
        return
    # An attribute of this name that is there already may be the encoded kind (INT16_2D).
    existing = mesh.attributes.get("custom_normal")
    if existing is not None:
        mesh.attributes.remove(existing)
    attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", np.ascontiguousarray(normals, dtype=np.float32).ravel())
    mesh.update()


def clear_terminator(obj: bpy.types.Object) -> None:
    """Makes Cycles cast shadows on `obj` where it is, and not where it would be if it were as round as its normals.

    Since 4.5 that is said to objects, before it was to Cycles.
    """
    if hasattr(obj, "shadow_terminator_geometry_offset"):
        obj.shadow_terminator_geometry_offset = obj.shadow_terminator_shading_offset = 0.0
    else:
        obj.cycles.shadow_terminator_geometry_offset = obj.cycles.shadow_terminator_offset = 0.0


def _input_socket(modifier: bpy.types.NodesModifier, name: str) -> bpy.types.NodeTreeInterfaceSocket:
    sockets = [
        item
        for item in modifier.node_group.interface.items_tree
        if item.item_type == "SOCKET" and item.in_out == "INPUT"
    ]
    for socket in sockets:
        if socket.name == name:
            return socket
    raise KeyError(f"node group {modifier.node_group.name!r} has no input {name!r}, it has {[s.name for s in sockets]}")


def _convert(socket: bpy.types.NodeTreeInterfaceSocket, value: Any) -> Any:
    """`value` in the type that the socket stores, so that numpy's scalars and arrays may be given, too."""
    match socket.socket_type:
        case "NodeSocketFloat":
            return float(value)
        case "NodeSocketBool":
            return bool(value)
        case "NodeSocketInt":
            return int(value)
        case "NodeSocketVector":
            return tuple(float(component) for component in value)
        case _:
            return value
