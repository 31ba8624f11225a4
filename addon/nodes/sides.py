"""The node group *Leafcloud Sides*. It moves front and back billboards apart along their normals.

If front and back have textures of their own, each billboard is a pair: a front and a back billboard in the same place.
Rasterizers draw the one that faces the viewer. A ray tracer's ray hits both. When it passes the transparent back of
one, it also passes the other one at exactly the same distance.

So the pairs are moved apart, only in Blender, where Cycles needs it. The modifier follows all others that move the
billboards, because a level that morphs onto the next would bring its own pairs together again. Meshes and exported
files stay exactly on the planes that other levels morph to.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .builder import Section
from .laws import LENGTH, add_modifier, declare, group_of_layout

GROUP_NAME = "Leafcloud Sides"
_LAYOUT_KEY = "leafcloud_sides_layout"
_LAYOUT = 1

_SHARE = 1.0 / 16384.0
"""Offset as a fraction of the level's extent: about 30 ulp of the distance to a camera at 60 radii."""


def apart(corners: NDArray[np.float64], number: int) -> float:
    """Return the offset of each billboard of the level `number` ≥ 1, in the unit of its `corners` (c, 3).

    The offset grows with the number. So each level lies in front of the one that has morphed to it, and stays lit while
    the two cross-fade.
    """
    return number * float(np.ptp(corners, axis=0).max()) * _SHARE


def add_side_modifier(obj: bpy.types.Object, apart: float) -> bpy.types.NodesModifier:
    """Add the modifier that moves every face of `obj` along its normal by `apart` > 0, in the object's own units."""
    return add_modifier(obj, GROUP_NAME, side_group(), {"Apart": apart})


def side_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _fill)


def _fill(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    declare(tree, "Apart", "Float", "Offset of each billboard along its normal", default_value=0.0, **LENGTH)
    section = Section(tree, "Offset along the normal", (0.0, 0.0))
    normal = section.result("GeometryNodeInputNormal")
    step = section.vector("SCALE", normal, section.group_input("Apart"), label="Step")
    moved = section.result("GeometryNodeSetPosition", section.group_input("Geometry"), None, None, step, label="Apart")
    section.node("NodeGroupOutput", moved)
