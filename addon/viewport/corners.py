"""A level's triangles as the shader takes them: an array per attribute, a row per corner, by material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..scene.surface import read_surface

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Part:
    """The triangles of one material: `attributes` (c, …), the image if any, its factor, what alpha is cut at."""

    attributes: dict[str, Floats]
    image: bpy.types.Image | None
    tint: tuple[float, float, float, float]
    cutoff: float


def parts_of(mesh: bpy.types.Mesh) -> list[Part]:
    """A mesh with or without what lets it move and thin out."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    loops, materials = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangles.foreach_get("material_index", materials)
    vertices = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertices)
    normals = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", normals.ravel())
    by_vertex = _by_vertex(mesh)
    result = []
    for number in np.unique(materials):
        surface = read_surface(mesh.materials[number] if number < len(mesh.materials) else None)
        corners = loops.reshape(-1, 3)[materials == number].ravel()
        attributes = {name: values[vertices[corners]] for name, values in by_vertex.items()}
        attributes["normal"] = normals[corners]
        texture = surface.texture
        attributes["uv"] = _uvs(mesh, "" if texture is None else texture.uv_map)[corners]
        image = None if texture is None else texture.image
        cutoff = {"MASK": surface.alpha_cutoff, "BLEND": 0.0, "OPAQUE": -1.0}[surface.alpha_mode]
        result.append(Part(attributes, image, (*surface.color, surface.alpha), cutoff))
    return result


def _by_vertex(mesh: bpy.types.Mesh) -> dict[str, Floats]:
    positions = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", positions.ravel())
    pivots = _attribute(mesh, "leaf_pivot", positions)
    return {
        "position": positions,
        "target": _attribute(mesh, "leaf_target", positions),
        "pivot": pivots,
        "pivot_target": _attribute(mesh, "leaf_pivot_target", pivots),
        "rank": _attribute(mesh, "leaf_rank", np.full(len(positions), -1.0, np.float32)),
    }


def _attribute(mesh: bpy.types.Mesh, name: str, missing: Floats) -> Floats:
    """(v,) or (v, 3) like `missing`, which stands for an attribute that is not there."""
    attribute = mesh.attributes.get(name)
    if attribute is None:
        return missing
    values = np.empty_like(missing)
    attribute.data.foreach_get("value" if missing.ndim == 1 else "vector", values.ravel())
    return values


def _uvs(mesh: bpy.types.Mesh, name: str) -> Floats:
    """(loops, 2) of the named map, or of the one that renders; zeros without any."""
    layers: Any = mesh.uv_layers
    layer = layers.get(name) or next((layer for layer in layers if layer.active_render), None)
    uvs = np.zeros((len(mesh.loops), 2), np.float32)
    if layer is not None:
        layer.uv.foreach_get("vector", uvs.ravel())
    return uvs
