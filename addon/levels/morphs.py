"""Storage of a level's transition and pruning data: attributes for nodes and engines, vertex groups, a shape key."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..nodes.laws import PARENT

SHAPE_KEY = "Billboards"
GROUP_PREFIX = "LC_"

_FIELDS = {"FLOAT": "value", "INT": "value", "FLOAT_VECTOR": "vector"}


@dataclass(frozen=True)
class Pruning:
    """Pruning data per vertex: the rank (v,) of its leaf in [0, 1), negative if protected, and the leaf's pivot (v, 3)
    in the tree's coordinates."""

    rank: NDArray[np.float32]
    pivot: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        return self.rank.nbytes + self.pivot.nbytes


@dataclass(frozen=True)
class Transition:
    """Transition data per vertex: its billboard (v,) on the next level, −1 for none, and the positions of the vertex
    and of its leaf's pivot at a = 1 (v, 3), in the tree's coordinates."""

    billboard: NDArray[np.int32]
    target: NDArray[np.float32]
    pivot_target: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Bytes of the attributes and of the shape key, which stores the targets again."""
        return self.billboard.nbytes + 2 * self.target.nbytes + self.pivot_target.nbytes


def add_pruning(mesh: bpy.types.Mesh, pruning: Pruning) -> None:
    """Store the attributes `leaf_rank` and `leaf_pivot`."""
    add_point_attribute(mesh, "leaf_rank", "FLOAT", pruning.rank)
    add_point_attribute(mesh, "leaf_pivot", "FLOAT_VECTOR", pruning.pivot)


def add_transition(obj: bpy.types.Object, transition: Transition) -> None:
    """Store `leaf_billboard`, `leaf_target` and `leaf_pivot_target`, a vertex group per billboard, and the shape key.

    The shape key holds the morph for editing and export. It has the value 0 and no driver.
    """
    mesh = obj.data
    add_point_attribute(mesh, PARENT, "INT", transition.billboard)
    add_point_attribute(mesh, "leaf_target", "FLOAT_VECTOR", transition.target)
    add_point_attribute(mesh, "leaf_pivot_target", "FLOAT_VECTOR", transition.pivot_target)
    _add_groups(obj, transition.billboard)
    obj.shape_key_add(name="Basis", from_mix=False)
    key = obj.shape_key_add(name=SHAPE_KEY, from_mix=False)
    key.points.foreach_set("co", transition.target.ravel())
    key.value = 0.0  # Blender 5.0 adds keys with the value 1.


def add_point_attribute(mesh: bpy.types.Mesh, name: str, kind: str, values: NDArray[np.generic]) -> None:
    """Store `values`, one per vertex, as the point attribute `name`. `kind` is FLOAT, INT or FLOAT_VECTOR."""
    attribute = mesh.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(_FIELDS[kind], np.ascontiguousarray(values).ravel())


def _add_groups(obj: bpy.types.Object, billboard: NDArray[np.int32]) -> None:
    order = np.argsort(billboard, kind="stable")
    order = order[np.count_nonzero(billboard < 0) :]
    ends = np.cumsum(np.bincount(billboard[order]))
    for number, members in enumerate(np.split(order, ends[:-1])):
        group = obj.vertex_groups.new(name=f"{GROUP_PREFIX}{number:03d}")
        group.add(members.tolist(), 1.0, "REPLACE")
        group.lock_weight = True  # Painting and smoothing of weights leave it alone.
