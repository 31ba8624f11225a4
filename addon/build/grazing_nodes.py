"""Fading of billboards that are seen edge-on: the node group *Leafcloud Grazing* and nodes for the material.

The group follows all modifiers that move the billboards. At every point x with the normal n it stores the hidden
fraction as the attribute `leaf_grazing_share`:

    1 − smoothstep(0, width, |n·v|)                              v: from x to the camera, |v| = 1

(Lacewell et al., "Stochastic Billboard Clouds for Interactive Foliage Rendering", 2006, describe the idea; their
|1 − n·v| ≪ 1 is a slip for |n·v| ≪ 1.) The material mixes in as much transparency, except for shadow rays: a billboard
that the camera sees edge-on still casts its shadow.

Known limit: only this copy fades correctly. The camera sees other copies, as in a forest, from other directions, so
they have no fade.
"""

from __future__ import annotations

import bpy

from .fading import fade_by
from .node_builder import Section
from .node_laws import SHARE, TINY, Camera, add_modifier, declare, group_of_layout

GROUP_NAME = "Leafcloud Grazing"
_LAYOUT_KEY = "leafcloud_grazing_layout"
_LAYOUT = 1

GRAZING_SHARE = "leaf_grazing_share"
"""Point attribute: hidden fraction of a billboard seen edge-on. 0 or missing: fully visible."""

WIDTH = 0.2
"""Billboards fade where |cos| of the angle between normal and view is below this: within 12° of their plane."""


def add_grazing_modifier(obj: bpy.types.Object) -> bpy.types.NodesModifier:
    """Add the modifier that computes the fade of `obj`'s billboards. Their material needs `add_grazing_fade`."""
    return add_modifier(obj, GROUP_NAME, grazing_group(), {"Width": WIDTH})


def grazing_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _fill)


def add_grazing_fade(tree: bpy.types.NodeTree) -> None:
    """Make a material fade by `leaf_grazing_share` in each renderer. The material must have an output."""
    share, path, shown = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "LightPath", "Math"))
    share.attribute_name, share.label = GRAZING_SHARE, "Edge-on: hidden fraction"
    shown.operation = "MULTIPLY"
    light = tree.nodes.new("ShaderNodeMath")
    light.operation, light.inputs[0].default_value = "SUBTRACT", 1.0
    x, y = tree.get_output_node("ALL").location
    for node, column, row in ((share, 3, 0), (path, 3, 1), (light, 2, 1), (shown, 1, 0)):
        node.location = (x - 200.0 * column, y + 1200.0 + 200.0 * row)
    tree.links.new(path.outputs["Is Shadow Ray"], light.inputs[1])
    tree.links.new(share.outputs["Fac"], shown.inputs[0])
    tree.links.new(light.outputs[0], shown.inputs[1])
    fade_by(tree, shown.outputs[0])


def _fill(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    steep = "Cosine of the angle between normal and view below which billboards fade out; 0: no fade"
    declare(tree, "Width", "Float", steep, default_value=0.0, **SHARE)
    section = Section(tree, "Hidden fraction 1 − smoothstep(0, width, |n·v|)", (0.0, 0.0))
    camera, width = Camera(section), section.group_input("Width")
    to_camera = section.vector("SUBTRACT", camera.location, section.result("GeometryNodeInputPosition"))
    view = section.vector("NORMALIZE", to_camera, label="v")
    steep = section.math("ABSOLUTE", section.vector("DOT_PRODUCT", section.result("GeometryNodeInputNormal"), view))
    ends = (0.0, section.math("MAXIMUM", width, TINY), 1.0, 0.0)
    hidden = section.result("ShaderNodeMapRange", steep, *ends, label="Hidden", interpolation_type="SMOOTHSTEP")
    fades = section.logic(section.compare(width, "GREATER_THAN", 0.0), "AND", camera.exists, label="Fades?")
    geometry, stored = section.group_input("Geometry"), {"data_type": "FLOAT", "domain": "POINT"}
    told = section.result("GeometryNodeStoreNamedAttribute", geometry, None, GRAZING_SHARE, hidden, **stored)
    section.node("NodeGroupOutput", section.switch("GEOMETRY", fades, geometry, told, label="Store for materials"))
