"""Nodes that swap the leaf textures of a cloud, for example for another season, without baking again.

A level's material gets two label textures: the leaf that each texel shows, and the position in that leaf's texture. A
node group, shared by the whole file, decodes them. The nodes look up the leaves' own images at these coordinates. The
result is the node Season, which is not linked. To change a tree's leaves, swap an image and link Season to Base Color.
Until then renderers and exporters ignore these nodes.

A level's own colors are corrected slightly to match the leaves' mean color. Season shows the images uncorrected.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..material.surface import Surface, read_surface
from ..nodes.builder import Section

GROUP_NAME = "Leafcloud Leaf Map"
UV_NODE, ID_NODE = "Leafcloud Leaf UV", "Leafcloud Leaf ID"
SEASON_NODE = "Leafcloud Season"

_LAYOUT_KEY = "leafcloud_leaf_map_layout"
_LAYOUT = 1
"""Version stored in the group. Increase it when sockets or laws change: files baked earlier then keep their group."""

_MOST = 16
"""Maximum number of distinct materials, so that the nodes stay readable. Further materials share the last image."""
_TRUNK = 255
"""Material number of texels that show no leaf."""
_FAINT = 1.0 / 16.0
"""Minimum alpha of a usable texel. Renderers multiply colors by alpha before the lookup, so fainter ones lose color."""


def add_leaf_map(
    material: bpy.types.Material,
    uv: bpy.types.Image,
    leaf: bpy.types.Image,
    leaves: Sequence[bpy.types.Material | None],
) -> None:
    """Add the label textures (`leafcloud.Level.leaf_uv` and `leaf_id`) and the node Season to a level's material.

    `leaves`: the leaves' own materials by number. The trunk keeps the color of the atlas page.
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
    """Return the node group of the current file that decodes the labels. Create it if it is missing.

    UV = (16 · red + ⌊blue / 16⌋ + ½, 16 · green + blue mod 16 + ½) / 4096, from the codes 0 … 255 of `leaf_uv`.
    Leaf = red + 256 · green, the leaf's number modulo 65536, and Material = blue, from the codes of `leaf_id`.
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
    place = Section(tree, "Position in the leaf's texture", (-1600.0, 0.0))
    uv = _place(place, *_codes(place, place.group_input("Leaf UV")))
    which = Section(tree, "Leaf and material number", (-1600.0, -700.0))
    low, high, material = _codes(which, which.group_input("Leaf ID"))
    leaf = which.math("MULTIPLY_ADD", high, 256.0, low, label="Leaf")
    Section(tree, "Decoded labels", (200.0, 0.0)).node("NodeGroupOutput", uv, leaf, material)
    return tree


def _codes(section: Section, color: bpy.types.NodeSocket) -> list[bpy.types.NodeSocket]:
    """Return red, green and blue as codes from 0 to 255."""
    parts = section.node("ShaderNodeSeparateColor", color).outputs
    return [section.math("ROUND", section.math("MULTIPLY", part, 255.0), label=part.name) for part in parts]


def _place(
    section: Section, red: bpy.types.NodeSocket, green: bpy.types.NodeSocket, blue: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return the texture coordinates at the middle of their cell, 1/4096 wide."""
    of_u = section.math("FLOOR", section.math("DIVIDE", blue, 16.0), label="Lower bits of u")
    of_v = section.math("MODULO", blue, 16.0, label="Lower bits of v")
    u, v = (section.math("MULTIPLY_ADD", high, 16.0, low) for high, low in ((red, of_u), (green, of_v)))
    middles = [section.math("DIVIDE", section.math("ADD", x, 0.5), 4096.0) for x in (u, v)]
    return section.result("ShaderNodeCombineXYZ", *middles, label="UV")


def _label(section: Section, name: str, image: bpy.types.Image) -> bpy.types.NodeSocket:
    """Add a label texture, which must be sampled with nearest filtering. Return its color."""
    node = section.node(
        "ShaderNodeTexImage", label=name.removeprefix("Leafcloud "), image=image, interpolation="Closest"
    )
    node.name = name
    return node.outputs["Color"]


def _is_number(section: Section, material: bpy.types.NodeSocket, number: int, *, last: bool) -> bpy.types.NodeSocket:
    """Return 1 where `material` equals `number`, else 0. With `last` larger numbers match, too, except the trunk's."""
    end = _TRUNK - 1 if last else number
    middle, reach = (number + end) / 2.0, (end - number) / 2.0 + 0.25
    return section.math("COMPARE", material, middle, reach, label=f"Material {number}")


def _leaf_color(
    section: Section,
    behind: bpy.types.NodeSocket,
    uv: bpy.types.NodeSocket,
    chosen: bpy.types.NodeSocket,
    surface: Surface,
) -> bpy.types.NodeSocket:
    """Return the color of leaves with this `surface` where `chosen` is 1, elsewhere `behind`."""
    factor = (*surface.color, 1.0)
    if surface.gaps:
        # A rendered material has no image. Its leaves keep the colors of the atlas page until an artist sets an image.
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
