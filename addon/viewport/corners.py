"""A level's triangles as the shader takes them: an array per attribute, a row per corner, by material."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..scene.meshes import Copies, own_mesh
from ..scene.textures import transform_matrix
from .paint import Paint, paint_of

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Part:
    """The triangles of one material: `attributes` (c, …) by name, and what is drawn on them."""

    attributes: dict[str, Floats]
    paint: Paint


def parts_of(obj: bpy.types.Object) -> list[Part]:
    """An object's own mesh, with or without what lets it move and thin out, in the materials of its slots."""
    mesh = own_mesh(obj)
    by_vertex = _by_vertex(mesh)
    result = []
    for slot in np.unique(mesh.slots):
        paint = paint_of(mesh.materials[slot])
        chosen = mesh.slots == slot
        vertices = mesh.triangles[chosen].ravel()
        by_corner = {"normal": mesh.normals, "uv": _uvs(mesh, paint)} | _colors(mesh, paint)
        attributes = {name: values[vertices] for name, values in by_vertex.items()}
        attributes |= {name: values[chosen].reshape(-1, values.shape[2]) for name, values in by_corner.items()}
        result.append(Part(attributes, paint))
    return result


def _by_vertex(mesh: Copies) -> dict[str, Floats]:
    """What moves the vertices and thins them out; they stay and are all drawn where it is missing."""
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
    """(v,) or (v, 3) like `missing`, which stands for an attribute that is not there."""
    attribute = mesh.mesh.attributes.get(name)
    if attribute is None:
        return missing
    values = np.empty_like(missing)
    attribute.data.foreach_get("value" if missing.ndim == 1 else "vector", values.ravel())
    return values


def _uvs(mesh: Copies, paint: Paint) -> Floats:
    """(t, 3, 2) the images' coordinates; zeros without any."""
    uvs = mesh.uvs("" if paint.layout is None else paint.layout.uv_map)
    if uvs is None:
        return np.zeros((len(mesh.triangles), 3, 2), np.float32)
    transform = transform_matrix(paint.layout)
    return (uvs @ transform[:, :2].T + transform[:, 2]).astype(np.float32)


def _colors(mesh: Copies, paint: Paint) -> dict[str, Floats]:
    """(t, 3, 4) the colors that multiply both sides, with the light that was baked for each."""
    color = np.ones((len(mesh.triangles), 3, 4), np.float32)
    color[..., :3] = _color(mesh, paint.color_name)[..., :3]
    color[..., 3] = _color(mesh, paint.alpha_name)[..., 3]
    front, back = (_color(mesh, name) for name in paint.light_names or (None, None))
    return {"front_color": color * front, "back_color": color * back}


def _color(mesh: Copies, name: str | None) -> Floats:
    """(t, 3, 4) a color attribute; white for None, and where it is missing."""
    found = None if name is None else mesh.colors(name)
    return np.ones((1, 1, 4), np.float32) if found is None else found
