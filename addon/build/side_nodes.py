"""The node group that holds the two of a pair of billboards apart, each toward who sees it.

Where the two sides of a level differ, each billboard is two, back to back in one place. Rasterisers draw the one that
faces the viewer. Ray tracers meet both, and a ray that passes the back of one, which is transparent, passes what lies
exactly there, too: the other. So they are parted, but in Blender only, where Cycles needs it: by a modifier after all
that moves them, for a level that collapses onto the next brings its own pairs together again. The meshes, and the
files that are made of them, lie exactly on the planes that other levels morph to.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .node_laws import LENGTH, add_modifier, declare, group_of_layout
from .sections import Section

GROUP_NAME = "Leafcloud Sides"
_LAYOUT_KEY = "leafcloud_sides_layout"
_LAYOUT = 1

_SHARE = 1.0 / 16384.0
"""Of the level's whole extent: some 30 units in the last place of what a camera at 60 radii measures."""


def apart(corners: NDArray[np.float64], number: int) -> float:
    """How far each of the billboards with these corners (b, c, 3), of the level `number` ≥ 1, is moved, in their unit.

    Each level lies in front of the one that has morphed to it, so that it is lit while the two cross-fade.
    """
    return number * float(np.ptp(corners.reshape(-1, 3), axis=0).max()) * _SHARE


def add_side_modifier(obj: bpy.types.Object, apart: float) -> bpy.types.NodesModifier:
    """Moves every face of `obj` along its normal by `apart` > 0, in the object's own unit."""
    return add_modifier(obj, GROUP_NAME, side_group(), {"Apart": apart})


def side_group() -> bpy.types.NodeTree:
    """The node group of this file: the one that is there, else a new one."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _fill)


def _fill(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    declare(tree, "Apart", "Float", "How far a billboard lies in front of its place", default_value=0.0, **LENGTH)
    section = Section(tree, "Toward who sees it", (0.0, 0.0))
    normal = section.result("GeometryNodeInputNormal")
    step = section.vector("SCALE", normal, section.group_input("Apart"), label="Step")
    moved = section.result("GeometryNodeSetPosition", section.group_input("Geometry"), None, None, step, label="Part")
    section.node("NodeGroupOutput", moved)
