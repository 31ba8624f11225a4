"""Levels with separate textures for front and back: what Blender needs to draw a pair of billboards as one polygon.

Each front polygon stores the UVs of the back polygon behind it, and a material reads them where it is seen from behind.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..nodes.sides import BACK
from .material import BACK_NODE
from .mesh import PolygonFaces

BACK_UV = "leaf_back_uv"
"""Name of the corner attribute: UVs of the back, where a front has the corner. A vector, as exporters write all UVs."""


def add_sides(mesh: bpy.types.Mesh, level: leafcloud.Level, faces: PolygonFaces) -> None:
    """Store on the mesh of `level`, a cloud of pairs, which faces are backs and the UVs of the backs."""
    backs = back_polygons(level)
    is_back = np.isin(faces.polygons, backs[backs >= 0])
    mesh.attributes.new(BACK, "BOOLEAN", "FACE").data.foreach_set("value", is_back)
    uvs = np.zeros((len(faces.corners), 3), np.float32)
    uvs[:, :2] = _back_uvs(level, backs)[faces.corners]
    mesh.attributes.new(BACK_UV, "FLOAT_VECTOR", "CORNER").data.foreach_set("vector", uvs.ravel())


def back_polygons(level: leafcloud.Level) -> NDArray[np.int64]:
    """Return (p,) the polygon behind each polygon of a front, -1 for those of backs.

    The billboards of a pair follow each other, and their polygons are the same in the same order, wound the other way.
    """
    planes = level.plane_ids
    is_back = np.zeros(len(planes), bool)
    is_back[1:] = planes[1:] == planes[:-1]
    counts = np.bincount(level.polygon_billboards, minlength=len(planes))
    behind = np.arange(len(level.polygon_sizes)) + counts[level.polygon_billboards]
    return np.where(is_back[level.polygon_billboards], -1, behind)


def _back_uvs(level: leafcloud.Level, backs: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return (c, 2) the UVs of the back at each corner of a front."""
    starts = np.cumsum(level.polygon_sizes, dtype=np.int64) - level.polygon_sizes
    polygons = np.repeat(np.arange(len(backs)), level.polygon_sizes)
    places = np.arange(len(polygons)) - starts[polygons]
    mirrored = starts[backs[polygons]] + level.polygon_sizes[polygons] - 1 - places
    is_front = backs[polygons] >= 0
    uvs = level.uvs.copy()
    uvs[is_front] = level.uvs[mirrored[is_front]]
    return uvs


def two_sided_material(material: bpy.types.Material) -> bpy.types.Material:
    """Return a copy of a single-sided level's material that shows the texture of the back from behind.

    `material`: of `material.atlas_material` or `baked_light.unlit_material`.
    """
    both = material.copy()
    both.name = f"{material.name}_sides"
    both.use_backface_culling = False
    tree = both.node_tree
    hidden = tree.nodes[BACK_NODE]
    for link in list(hidden.outputs[0].links):
        tree.links.new(hidden.inputs[1].links[0].from_socket, link.to_socket)
    tree.nodes.remove(hidden)
    behind = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    place = _mixed(tree, behind, _front_uv(tree), _attribute(tree), "VECTOR")
    for node in [node for node in tree.nodes if node.type == "TEX_IMAGE"]:
        tree.links.new(place, node.inputs["Vector"])
    for node in [node for node in tree.nodes if node.type == "NORMAL_MAP"]:
        _turn_normals(tree, behind, node.inputs["Color"])
    return both


def _turn_normals(tree: bpy.types.NodeTree, behind: bpy.types.NodeSocket, color: bpy.types.NodeSocket) -> None:
    """Turn the back's normals to the axes of the front.

    The back's first axis is opposite to the front's, and so is its normal; its second axis is the same. From behind, a
    renderer turns the whole normal around. So only the second coordinate needs another sign.
    """
    link = color.links[0]
    parts, whole = tree.nodes.new("ShaderNodeSeparateColor"), tree.nodes.new("ShaderNodeCombineColor")
    tree.links.new(link.from_socket, parts.inputs[0])
    flipped = tree.nodes.new("ShaderNodeMath")
    flipped.operation = "SUBTRACT"
    flipped.inputs[0].default_value = 1.0
    tree.links.new(parts.outputs["Green"], flipped.inputs[1])
    tree.links.new(parts.outputs["Red"], whole.inputs["Red"])
    tree.links.new(_mixed(tree, behind, parts.outputs["Green"], flipped.outputs[0], "FLOAT"), whole.inputs["Green"])
    tree.links.new(parts.outputs["Blue"], whole.inputs["Blue"])
    tree.links.new(whole.outputs[0], color)


def _front_uv(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    return tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]


def _attribute(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = BACK_UV
    return node.outputs["Vector"]


def _mixed(
    tree: bpy.types.NodeTree,
    behind: bpy.types.NodeSocket,
    front: bpy.types.NodeSocket,
    back: bpy.types.NodeSocket,
    kind: str,
) -> bpy.types.NodeSocket:
    """Return `back` where a face is seen from behind, else `front`. kind: "FLOAT" or "VECTOR"."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type = kind
    ends = [socket for socket in node.inputs if socket.enabled]
    for source, target in zip((behind, front, back), ends, strict=True):
        tree.links.new(source, target)
    return next(socket for socket in node.outputs if socket.enabled)
