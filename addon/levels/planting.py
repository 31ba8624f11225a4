"""How many trees an object holds: by its area, and by the widths of the trees."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..mesh.baked_levels import level_number
from ..nodes.laws import is_own_group

MOST = 10_000
"""Trees that the widths ask for at most: a larger ground gets a thinner forest, and not a slower one."""


def width_of(collection: bpy.types.Collection) -> float:
    """Return the mean horizontal extent of a baked tree's leaves, in world units; 0 without leaves."""
    leaves = next((obj for obj in collection.all_objects if level_number(obj) == 0), None)
    if leaves is None:
        return 0.0
    corners = [leaves.matrix_world @ corner for corner in _box_of(leaves.data)]
    extents = (max(corner[axis] for corner in corners) - min(corner[axis] for corner in corners) for axis in (0, 1))
    return sum(extents) / 2.0


def _box_of(mesh: bpy.types.Mesh) -> list[Vector]:
    """Return the corners of the box around all vertices of a mesh.

    The property `bound_box` of an object has the box of the evaluated mesh, from which the view may have pruned leaves.
    """
    key = mesh.session_uid, len(mesh.vertices)
    if key not in _boxes:
        points = np.empty((len(mesh.vertices), 3), np.float32)
        mesh.vertices.foreach_get("co", points.ravel())
        low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        _boxes[key] = [Vector(corner) for corner in product(*zip(low, high, strict=True))]
    return _boxes[key]


_boxes: dict[tuple[int, int], list[Vector]] = {}
"""Boxes that were measured, by the mesh and its number of vertices."""


def usual_density(area: float, widths: Sequence[float]) -> float:
    """Return trees per square unit that touch their neighbors on the average, at most `MOST` of them on the area."""
    apart = [width for width in widths if width > 0.0]
    if not apart or area <= 0.0:
        return 0.0
    return min(len(apart) / sum(width * width for width in apart), MOST / area)


def area_of(obj: bpy.types.Object) -> float:
    """Return the area of a mesh's faces in the world, by its own mesh and without a shear; 0 for other objects."""
    if obj.type != "MESH" or not obj.data.polygons:
        return 0.0
    corners = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", corners.ravel())
    obj.data.calc_loop_triangles()
    triangles = np.empty((len(obj.data.loop_triangles), 3), np.int32)
    obj.data.loop_triangles.foreach_get("vertices", triangles.ravel())
    a, b, c = (corners * np.float32(obj.matrix_world.to_scale()))[triangles].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def is_ground(obj: bpy.types.Object) -> bool:
    """Return whether trees are usually scattered on an object's faces: it has some, and makes no instances itself."""
    return obj.type == "MESH" and len(obj.data.polygons) > 0 and not any(map(_scatters, _foreign_modifiers(obj)))


def _foreign_modifiers(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    return [each for each in obj.modifiers if not (each.type == "NODES" and is_own_group(each.node_group))]


def _scatters(modifier: bpy.types.Modifier) -> bool:
    """Return whether a modifier makes instances."""
    if modifier.type == "PARTICLE_SYSTEM":
        return modifier.particle_system.settings.render_type in ("OBJECT", "COLLECTION")
    return modifier.type == "NODES" and _has_instances(modifier.node_group, set())


def _has_instances(group: bpy.types.NodeTree | None, seen: set[bpy.types.NodeTree]) -> bool:
    if group is None or group in seen:
        return False
    seen.add(group)
    nodes = list(group.nodes)
    return any(
        node.bl_idname == "GeometryNodeInstanceOnPoints"
        or (node.type == "GROUP" and _has_instances(node.node_tree, seen))
        for node in nodes
    )


def is_scaled(obj: bpy.types.Object) -> bool:
    """Return whether an object has a scale, which would stretch the trees on it."""
    return any(abs(factor - 1.0) > 1e-4 for factor in obj.matrix_world.to_scale())


def may_apply_scale(obj: bpy.types.Object) -> bool:
    """Return whether `apply_scale` changes nothing that one sees."""
    is_alone = obj.parent is None and not obj.children and obj.animation_data is None
    own_scale = all(abs(a - b) <= 1e-4 for a, b in zip(obj.scale, obj.matrix_world.to_scale(), strict=True))
    if obj.type != "MESH" or obj.data.users > 1 or obj.data.library is not None or not (is_alone and own_scale):
        return False
    return obj.data.shape_keys is None and not _foreign_modifiers(obj)  # They work in units of the mesh.


def apply_scale(obj: bpy.types.Object) -> None:
    """Move the scale of an object into its mesh."""
    obj.data.transform(Matrix.Diagonal((*obj.scale, 1.0)))
    obj.scale = (1.0, 1.0, 1.0)


def free_place(beside: Vector, step: float, taken: Sequence[Vector]) -> Vector:
    """Return a place at `step`, 2 · `step` … along +X, the nearest one that is half a step from all taken ones."""
    for number in range(1, len(taken) + 2):
        place = beside + Vector((number * step, 0.0, 0.0))
        if all((place - other).length > 0.5 * step for other in taken):
            break
    return place
