"""Tangents in a GLB file, only on primitives with a normal map or a bent-normal occlusion texture.

Blender's exporter writes tangents for all meshes or for none. Without tangents engines compute their own, and
validators warn. A billboard is flat and evenly mapped, so its tangent is unambiguous: the direction of the texture's u.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .glb_file import Glb


def add_tangents(glb: Glb) -> None:
    """Add TANGENT to the primitives that need tangents.

    Their materials have a texture in tangent space: a normal map, or a bent-normal occlusion texture.
    """
    maps = {number: _map(material) for number, material in enumerate(glb.materials)}
    mapped = {number: texture for number, texture in maps.items() if texture is not None}
    wanting = [p for p in glb.primitives if p.get("material") in mapped and "TANGENT" not in p["attributes"]]
    for primitive in wanting:
        attributes = primitive["attributes"]
        texture = mapped[primitive["material"]]
        names = ("POSITION", "NORMAL", f"TEXCOORD_{texture.get('texCoord', 0)}")
        if not {*names} <= {*attributes}:
            continue  # without texture coordinates no map is drawn on the mesh
        positions, normals, uvs = (glb.values(attributes[name]) for name in names)
        triangles = glb.values(primitive["indices"]).reshape(-1, 3)
        attributes["TANGENT"] = glb.append_accessor(_tangents(positions, normals, uvs, triangles))


def _map(material: dict[str, Any]) -> dict[str, Any] | None:
    bent_normal = material.get("extras", {}).get("leafcloud", {}).get("bentNormalTexture")
    return material.get("normalTexture", bent_normal)


def _tangents(
    positions: NDArray[Any], normals: NDArray[Any], uvs: NDArray[Any], triangles: NDArray[Any]
) -> NDArray[np.float32]:
    """Return (v, 4): unit tangents along u, perpendicular to the normals, and the sign of the bitangent.

    sign · cross(normal, tangent) points up in the texture. glTF's v runs down; a normal map's green points up.
    """
    points, places = positions.astype(np.float64)[triangles], uvs.astype(np.float64)[triangles]
    (e1, e2), (d1, d2) = (np.moveaxis(values[:, 1:] - values[:, :1], 1, 0) for values in (points, places))
    turn = np.where(d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1] < 0.0, -1.0, 1.0)[:, None]
    along_u = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) * turn
    up_v = (e1 * d2[:, :1] - e2 * d1[:, :1]) * turn
    tangents, upward = np.zeros((2, len(positions), 3))
    for corner in range(3):
        np.add.at(tangents, triangles[:, corner], along_u)
        np.add.at(upward, triangles[:, corner], up_v)
    normal = normals.astype(np.float64)
    tangents -= normal * np.einsum("vi,vi->v", normal, tangents)[:, None]
    length = np.linalg.norm(tangents, axis=1, keepdims=True)
    # If the texture coordinates are degenerate, any direction perpendicular to the normal will do.
    other = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    tangents = np.where(length > 1e-20, tangents / np.maximum(length, 1e-20), other)
    sign = np.where(np.einsum("vi,vi->v", np.cross(normal, tangents), upward) < 0.0, -1.0, 1.0)
    return np.hstack([tangents, sign[:, None]]).astype(np.float32)
