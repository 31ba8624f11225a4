"""Differences between Blender versions from 4.2 LTS on. No other module reads the version."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

InputValue: TypeAlias = bool | int | float | Sequence[float] | bpy.types.Object | bpy.types.Material

_FREE_NORMALS = bpy.app.version >= (4, 5, 0)


def eevee_engine() -> str:
    """Return the identifier of EEVEE for `scene.render.engine`."""
    return "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"


def blend_relative_path() -> set[str]:
    """Return the options of a path property that accepts //, the folder of the .blend file."""
    known = "is_path_supports_blend_relative" in bpy.types.Property.bl_rna.properties  # 4.5 and later
    return {"ANIMATABLE", *(["PATH_SUPPORTS_BLEND_RELATIVE"] if known else [])}


def set_modifier_input(modifier: bpy.types.NodesModifier, name: str, value: InputValue) -> None:
    """Set the input `name` of a geometry-node modifier, converted to the type of its socket.

    Tag the object for an update, because Blender does not notice changed values of a modifier.
    Raise `KeyError` if the modifier's group has no such input.
    """
    socket = _input_socket(modifier, name)
    converted = _convert(socket, value)
    if hasattr(modifier, "properties"):  # 5.2 and later
        getattr(modifier.properties.inputs, socket.identifier).value = converted
    else:
        modifier[socket.identifier] = converted
    modifier.id_data.update_tag()


def get_modifier_input(modifier: bpy.types.NodesModifier, name: str) -> Any:
    """Return the value of the input `name`: a bool, an int, a float, or a tuple of floats for a vector.

    Raise `KeyError` if the modifier's group has no such input.
    """
    socket = _input_socket(modifier, name)
    if hasattr(modifier, "properties"):  # 5.2 and later
        stored = getattr(modifier.properties.inputs, socket.identifier).value
    else:
        stored = modifier[socket.identifier]
    return _convert(socket, stored)


def has_modifier_input(modifier: bpy.types.NodesModifier, name: str) -> bool:
    """Return whether the modifier has a group with an input of this name."""
    return modifier.node_group is not None and any(socket.name == name for socket in _input_sockets(modifier))


def draw_modifier_input(
    layout: bpy.types.UILayout, modifier: bpy.types.NodesModifier, name: str, text: str | None = None
) -> None:
    """Add a field for the input `name` to the layout. `text`: its label, if it is not the name."""
    identifier = _input_socket(modifier, name).identifier
    label = name if text is None else text
    if hasattr(modifier, "properties"):  # 5.2 and later
        layout.prop(getattr(modifier.properties.inputs, identifier), "value", text=label)
    else:
        layout.prop(modifier, f'["{identifier}"]', text=label)


def modifier_inputs(modifier: bpy.types.NodesModifier) -> dict[str, Any]:
    """Return the values of all inputs by name, except the geometry."""
    return {
        socket.name: get_modifier_input(modifier, socket.name)
        for socket in _input_sockets(modifier)
        if socket.socket_type != "NodeSocketGeometry"
    }


def drive_modifier_input(modifier: bpy.types.NodesModifier, name: str, source: bpy.types.ID, path: str) -> None:
    """Drive the input `name` by the number at `path` of `source`, with a driver that needs no Python.

    A driver that the input has gets the new source. Raise `KeyError` if the modifier's group has no such input.
    """
    driven = _input_path(modifier, name)
    owner = modifier.id_data
    found = owner.animation_data.drivers.find(driven) if owner.animation_data else None
    set_source((found or owner.driver_add(driven)).driver, source, path)


def set_source(driver: bpy.types.Driver, source: bpy.types.ID, path: str) -> None:
    """Make the driver return the number at `path` of `source`, without Python."""
    driver.type = "SUM"
    variable = driver.variables[0] if driver.variables else driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = source, path


def source_of_input(modifier: bpy.types.NodesModifier, name: str) -> tuple[bpy.types.ID, str] | None:
    """Return the data-block and the path that drive the input `name` as `drive_modifier_input` does; None if none."""
    data = modifier.id_data.animation_data
    found = data.drivers.find(_input_path(modifier, name)) if data else None
    if found is None or not found.driver.variables:
        return None
    target = found.driver.variables[0].targets[0]
    return None if target.id is None else (target.id, target.data_path)


def _input_path(modifier: bpy.types.NodesModifier, name: str) -> str:
    """Return the path of an input's value from the modifier's object."""
    identifier = _input_socket(modifier, name).identifier
    if hasattr(modifier, "properties"):  # 5.2 and later
        return f'modifiers["{modifier.name}"].properties.inputs.{identifier}.value'
    return f'modifiers["{modifier.name}"]["{identifier}"]'


def set_corner_normals(mesh: bpy.types.Mesh, normals: NDArray[np.float32]) -> None:
    """Set custom normals of a mesh: `normals` (corners, 3), unit vectors in the order of `mesh.loops`.

    Blender 4.5 and later store free vectors: `mesh.corner_normals` returns them bit for bit, and they stay when points
    move. Earlier versions store two 16-bit angles relative to the mesh's own normal. Those are accurate to about 1e-4
    (1e-2 if nearly opposite to that normal), and turn with the faces.
    Raise `ValueError` if the array's shape does not fit the mesh.
    """
    expected = (len(mesh.loops), 3)
    if normals.shape != expected:
        raise ValueError(
            f"normals of mesh {mesh.name!r} have shape {normals.shape}, expected {expected}: one per corner"
        )
    if not _FREE_NORMALS:
        mesh.normals_split_custom_set(normals)
        return
    # An existing attribute of this name may be of the encoded type (INT16_2D).
    existing = mesh.attributes.get("custom_normal")
    if existing is not None:
        mesh.attributes.remove(existing)
    attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", np.ascontiguousarray(normals, dtype=np.float32).ravel())
    mesh.update()


def clear_terminator(obj: bpy.types.Object) -> None:
    """Turn off the shadow terminator offsets of `obj`: Cycles then casts shadows on the flat faces themselves.

    The offsets are properties of the object since Blender 4.5, and of `obj.cycles` before.
    """
    if hasattr(obj, "shadow_terminator_geometry_offset"):
        obj.shadow_terminator_geometry_offset = obj.shadow_terminator_shading_offset = 0.0
    else:
        obj.cycles.shadow_terminator_geometry_offset = obj.cycles.shadow_terminator_offset = 0.0


def _input_socket(modifier: bpy.types.NodesModifier, name: str) -> bpy.types.NodeTreeInterfaceSocket:
    sockets = _input_sockets(modifier)
    for socket in sockets:
        if socket.name == name:
            return socket
    raise KeyError(f"node group {modifier.node_group.name!r} has no input {name!r}, it has {[s.name for s in sockets]}")


def _input_sockets(modifier: bpy.types.NodesModifier) -> list[bpy.types.NodeTreeInterfaceSocket]:
    items = modifier.node_group.interface.items_tree
    return [item for item in items if item.item_type == "SOCKET" and item.in_out == "INPUT"]


def _convert(socket: bpy.types.NodeTreeInterfaceSocket, value: Any) -> Any:
    """Convert `value` to the type that the socket stores. NumPy scalars and arrays are allowed."""
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
