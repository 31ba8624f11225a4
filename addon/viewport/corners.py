"""A level's triangles as input of the shader: for each material an array per attribute, with a row per corner."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..material.textures import transform_matrix
from ..mesh.baked_levels import plain_mesh
from ..mesh.meshes import Copies, own_mesh
from .paint import Paint, paint_of

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class MaterialTriangles:
    """The triangles of one material: the attributes (c, …) by name, and the `paint`."""

    attributes: dict[str, Floats]
    paint: Paint


def parts_of(obj: bpy.types.Object) -> list[MaterialTriangles]:
    """Return the parts of an object's own mesh, one for each used material slot.

    The shader does not draw octahedral impostors; in their place it draws the cross impostor of the files.
    """
    mesh = own_mesh(obj, plain_mesh(obj))
    by_vertex = _by_vertex(mesh)
    result = []
    for slot in np.unique(mesh.slots):
        paint = paint_of(mesh.materials[slot])
        chosen = mesh.slots == slot
        vertices = mesh.triangles[chosen].ravel()
        by_corner = {"normal": mesh.normals, "uv": _uvs(mesh, paint)} | _colors(mesh, paint)
        attributes = {name: values[vertices] for name, values in by_vertex.items()}
        attributes |= {name: values[chosen].reshape(-1, values.shape[2]) for name, values in by_corner.items()}
        result.append(MaterialTriangles(attributes, paint))
    return result


def _by_vertex(mesh: Copies) -> dict[str, Floats]:
    """Return the attributes for morph and pruning. A mesh without them neither morphs nor is pruned."""
    positions = mesh.positions
    pivots = _attribute(mesh, "leaf_pivot", positions)
    return {
        "position": positions,
        "target": _attribute(mesh, "leaf_target", positions),
        "pivot": pivots,
        "pivot_target": _attribute(mesh, "leaf_pivot_target", pivots),
        "rank": _attribute(mesh, "leaf_rank", np.full(len(positions), -1.0, np.float32)),
    }


def _attribute(mesh: Copies, name: str, missing: Floats) -> Floats:
    """Return an attribute (v,) or (v, 3) in the shape of `missing`; `missing` itself if the mesh lacks it."""
    attribute = mesh.mesh.attributes.get(name)
    if attribute is None:
        return missing
    values = np.empty_like(missing)
    attribute.data.foreach_get("value" if missing.ndim == 1 else "vector", values.ravel())
    return values


def _uvs(mesh: Copies, paint: Paint) -> Floats:
    """Return the images' coordinates, (t, 3, 2); zeros if the mesh has none."""
    uvs = mesh.uvs("" if paint.layout is None else paint.layout.uv_map)
    if uvs is None:
        return np.zeros((len(mesh.triangles), 3, 2), np.float32)
    transform = transform_matrix(paint.layout)
    return (uvs @ transform[:, :2].T + transform[:, 2]).astype(np.float32)


def _colors(mesh: Copies, paint: Paint) -> dict[str, Floats]:
    """Return the colors, (t, 3, 4), that multiply front and back, with the baked light of each side."""
    color = np.ones((len(mesh.triangles), 3, 4), np.float32)
    color[..., :3] = _color(mesh, paint.color_name)[..., :3]
    color[..., 3] = _color(mesh, paint.alpha_name)[..., 3]
    front, back = (_color(mesh, name) for name in paint.light_names or (None, None))
    return {"front_color": color * front, "back_color": color * back}


def _color(mesh: Copies, name: str | None) -> Floats:
    """Return a color attribute, (t, 3, 4); white for None or a missing one."""
    found = None if name is None else mesh.colors(name)
    return np.ones((1, 1, 4), np.float32) if found is None else found
