"""Another season for a cloud, without baking again: nodes that know which leaf a texel shows, and where in its texture.

Two images of labels on a level's material are decoded by a node group, the same for the whole file, and the leaves' own
images are looked up with what it says. All of it ends in a node that is called Season and leads nowhere: to swap an
image, and to link Season to Base Color, is the whole work of changing a tree's leaves. Until then renderers and
exporters see nothing of it.

A level's colours are moved a little so that its mean is that of the leaves; Season shows the images as they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..scene.surface import Surface, read_surface
from .sections import Section

GROUP_NAME = "Leafcloud Leaf Map"
UV_NODE, ID_NODE = "Leafcloud Leaf UV", "Leafcloud Leaf ID"
SEASON_NODE = "Leafcloud Season"

_LAYOUT_KEY = "leafcloud_leaf_map_layout"
_LAYOUT = 1
"""Written into the group; raised when its sockets or its law change, so that a file baked earlier keeps its own."""

_MOST = 16
"""Materials that are told apart: so many nodes an artist can still read. Those beyond share the last one's image."""
_WOOD = 255
"""The number of what is no leaf."""
_FAINT = 1.0 / 16.0
"""Renderers multiply an image's colours by its alpha before they look them up: below this little is left of them."""


def add_leaf_map(
    material: bpy.types.Material,
    uv: bpy.types.Image,
    leaf: bpy.types.Image,
    leaves: Sequence[bpy.types.Material | None],
) -> None:
    """Adds the images of labels (see `leafcloud.Level.leaf_uv` and `leaf_id`) to a level's material, and a Season.

    `leaves` are the leaves' own materials by their number. Wood keeps the page's colour.
    """
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    color = surface.inputs["Base Color"].links[0].from_socket
    section = Section(tree, "Another season: link its end to Base Color", (-220.0 * (min(len(leaves), _MOST) + 9), 0.0))
    labels = [_label(section, UV_NODE, uv), _label(section, ID_NODE, leaf)]
    seen = section.node("ShaderNodeGroup", *labels, label=GROUP_NAME, node_tree=leaf_map_group()).outputs
    for number, own in enumerate(leaves[:_MOST]):
        chosen = _is_number(section, seen["Material"], number, last=number == _MOST - 1)
        color = _leaf_color(section, color, seen["UV"], chosen, read_surface(own))
    season = section.node("NodeReroute", color, label="Season")
    season.name = SEASON_NODE


def leaf_map_group() -> bpy.types.NodeTree:
    """The node group of this file that decodes the labels: the one that is there, else a new one.

    UV = (16 · red + ⌊blue / 16⌋ + ½, 16 · green + blue mod 16 + ½) / 4096 of one image's codes from 0 to 255;
    Leaf = red + 256 · green, its number modulo 65536, and Material = blue of the other's.
    """
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(_LAYOUT_KEY) == _LAYOUT:
            return tree
    tree = bpy.data.node_groups.new(GROUP_NAME, "ShaderNodeTree")
    tree[_LAYOUT_KEY] = _LAYOUT
    for name in ("Leaf UV", "Leaf ID"):
        tree.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketColor")
    for name, kind in (("UV", "Vector"), ("Leaf", "Float"), ("Material", "Float")):
        tree.interface.new_socket(name, in_out="OUTPUT", socket_type=f"NodeSocket{kind}")
    place = Section(tree, "Where in its texture", (-1600.0, 0.0))
    uv = _place(place, *_codes(place, place.group_input("Leaf UV")))
    which = Section(tree, "Which leaf", (-1600.0, -700.0))
    low, high, material = _codes(which, which.group_input("Leaf ID"))
    leaf = which.math("MULTIPLY_ADD", high, 256.0, low, label="Leaf")
    Section(tree, "What is seen", (200.0, 0.0)).node("NodeGroupOutput", uv, leaf, material)
    return tree


def _codes(section: Section, color: bpy.types.NodeSocket) -> list[bpy.types.NodeSocket]:
    """Red, green and blue from 0 to 255."""
    parts = section.node("ShaderNodeSeparateColor", color).outputs
    return [section.math("ROUND", section.math("MULTIPLY", part, 255.0), label=part.name) for part in parts]


def _place(
    section: Section, red: bpy.types.NodeSocket, green: bpy.types.NodeSocket, blue: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """The texture coordinates in the middle of their 4096th."""
    of_u = section.math("FLOOR", section.math("DIVIDE", blue, 16.0), label="Lower bits of u")
    of_v = section.math("MODULO", blue, 16.0, label="Lower bits of v")
    u, v = (section.math("MULTIPLY_ADD", high, 16.0, low) for high, low in ((red, of_u), (green, of_v)))
    middles = [section.math("DIVIDE", section.math("ADD", x, 0.5), 4096.0) for x in (u, v)]
    return section.result("ShaderNodeCombineXYZ", *middles, label="UV")


def _label(section: Section, name: str, image: bpy.types.Image) -> bpy.types.NodeSocket:
    """The colour of an image of labels, of which only the nearest says anything."""
    node = section.node(
        "ShaderNodeTexImage", label=name.removeprefix("Leafcloud "), image=image, interpolation="Closest"
    )
    node.name = name
    return node.outputs["Color"]


def _is_number(section: Section, material: bpy.types.NodeSocket, number: int, *, last: bool) -> bpy.types.NodeSocket:
    """1 where the `material` is this number, or, of the `last` that is told apart, one behind it; else 0."""
    end = _WOOD - 1 if last else number
    middle, reach = (number + end) / 2.0, (end - number) / 2.0 + 0.25
    return section.math("COMPARE", material, middle, reach, label=f"Material {number}")


def _leaf_color(
    section: Section,
    behind: bpy.types.NodeSocket,
    uv: bpy.types.NodeSocket,
    chosen: bpy.types.NodeSocket,
    surface: Surface,
) -> bpy.types.NodeSocket:
    """The colour of leaves with this `surface` where they are `chosen`, elsewhere what is `behind`."""
    factor = (*surface.color, 1.0)
    if surface.gaps:
        # There is no image of what had to be rendered: its leaves keep the page's colours until they are given one.
        color = behind
    elif surface.color_texture is None:
        color = section.result("ShaderNodeRGB", label=surface.name)
        color.default_value = factor
    else:
        image = section.node("ShaderNodeTexImage", uv, label=surface.name, image=surface.color_texture.image).outputs
        drawn = section.math("GREATER_THAN", image["Alpha"], _FAINT)
        color, chosen = image["Color"], section.math("MULTIPLY", chosen, drawn)
        if factor != (1.0, 1.0, 1.0, 1.0):
            color = _mix(section, "MULTIPLY", 1.0, color, factor, label="Factor")
    return _mix(section, "MIX", chosen, behind, color, label=surface.name)


def _mix(
    section: Section,
    kind: str,
    factor: bpy.types.NodeSocket | float,
    first: bpy.types.NodeSocket,
    second: bpy.types.NodeSocket | tuple[float, ...],
    label: str,
) -> bpy.types.NodeSocket:
    return section.result("ShaderNodeMix", factor, first, second, label=label, data_type="RGBA", blend_type=kind)
