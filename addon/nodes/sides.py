"""The node group *Leafcloud Sides*. It draws each pair of a front and a back billboard as one polygon.

If front and back have textures of their own, each billboard is a pair in the same place. Rasterizers cull the one that
faces away. A ray tracer cannot: a ray meets both, and tests twice as many triangles. So in Blender the group removes
the backs and gives the fronts a material with both textures (`levels.sides`). Meshes and files keep the pairs, which
engines draw in one call with one texture.
"""

from __future__ import annotations

import bpy

from .builder import Section
from .laws import add_modifier, declare, group_of_layout

GROUP_NAME = "Leafcloud Sides"
BACK = "leaf_back"
"""Name of the face attribute: whether a face is the back of a pair."""
_LAYOUT_KEY = "leafcloud_sides_layout"
_LAYOUT = 2


def add_side_modifier(obj: bpy.types.Object, material: bpy.types.Material) -> bpy.types.NodesModifier:
    """Add the modifier that removes the backs of `obj` and draws the fronts with the two-sided `material`."""
    return add_modifier(obj, GROUP_NAME, side_group(), {"Material": material})


def side_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _fill)


def _fill(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    declare(tree, "Material", "Material", "Material of the fronts, with the textures of both sides")
    section = Section(tree, "One polygon for each pair", (0.0, 0.0))
    back = section.attribute("BOOLEAN", BACK)
    fronts = section.result("GeometryNodeDeleteGeometry", section.group_input("Geometry"), back, domain="FACE")
    drawn = section.result("GeometryNodeSetMaterial", fronts, None, section.group_input("Material"))
    section.node("NodeGroupOutput", drawn)
