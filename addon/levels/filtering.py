"""Materials that EEVEE may filter: an output of its own without the cutoff, and leaf textures without foreign colors.

EEVEE averages texels in mip levels and cuts out after that: of leaves that cover less than half of a pixel nothing is
left, and the colors under transparent texels, often white, are mixed in. So its output gets the alpha as it is, which
EEVEE dithers, and leaf materials a copy of their texture whose transparent texels have the colors around them. Cycles
does not filter; it and exporters keep the cutoff and the texture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import bpy

import leafcloud

from ..material.images import pixels_of
from ..material.node_links import follow
from ..material.surface import cut, principled_of, read_surface
from ..mesh.baked_levels import level_number
from ..nodes.builder import Section
from .building import Build
from .fading import output_for
from .material import atlas_image

_COPIED = {
    *("BSDF_PRINCIPLED", "BSDF_TRANSLUCENT", "BSDF_TRANSPARENT", "MIX_SHADER", "ADD_SHADER"),
    *("MATH", "MIX", "REROUTE", "TEX_IMAGE"),
}
"""Types of nodes that may lie between a cutoff and the output."""
_OPTIONS = (
    *("operation", "use_clamp", "distribution", "subsurface_method", "data_type", "blend_type", "clamp_factor"),
    *("clamp_result", "image", "interpolation", "extension", "projection"),
)

_Node: TypeAlias = bpy.types.Node


def let_filter(collection: bpy.types.Collection, build: Build) -> None:
    """Let EEVEE filter the materials of all levels and trunks. Those of the tree itself are replaced by copies.

    The copies are linked to the objects: files, and other objects, use the artist's materials of the meshes.
    """
    copies: dict[bpy.types.Material, bpy.types.Material] = {}
    for obj in (each for each in collection.all_objects if each.type == "MESH"):
        number = level_number(obj)
        own = number is not None and number >= build.first_cloud
        for slot in obj.material_slots:
            material = slot.material
            if material is None or material.node_tree is None or _cutoff(material) is None:
                continue
            if own:
                _show_shares(material, None)
                continue
            if material not in copies:
                copies[material] = material.copy()
                copies[material].name = f"{material.name}_filtered"
                filled = _filled(material)
                build.costs.add_bytes("filtering", 4 * math.prod(filled.size) if filled is not None else 0)
                _show_shares(copies[material], filled)
            slot.link, slot.material = "OBJECT", copies[material]


def _cutoff(material: bpy.types.Material) -> tuple[_Node, bpy.types.NodeSocket, float] | None:
    """Return the node that cuts out, the alpha before it and its cutoff; None if there is none that can be passed."""
    principled = principled_of(material)
    if principled is None or principled.groups:
        return None
    alpha = principled.input("Alpha")
    before, cutoff = cut(alpha)
    if cutoff is None or not 0.0 < cutoff < 1.0 or before.groups or not follow(before).kind:
        return None
    return follow(alpha).node, follow(before).socket, cutoff


def _filled(material: bpy.types.Material) -> bpy.types.Image | None:
    """Return a copy of a leaf texture with colors under its transparent texels; None without transparent texels."""
    surface = read_surface(material)
    color, alpha = surface.color_texture, surface.alpha_texture
    if color is None or alpha is None or color.image != alpha.image or surface.alpha_channel != "alpha":
        return None
    name = f"{color.image.name}_filled"
    pixels = pixels_of(color.image, material.name)
    return bpy.data.images.get(name) or atlas_image(name, leafcloud.fill_transparent(pixels, surface.alpha_cutoff))


def _show_shares(material: bpy.types.Material, filled: bpy.types.Image | None) -> None:
    """Give EEVEE an output of its own, for which the nodes behind the cutoff, and those behind a texture that is
    replaced by `filled`, are copied. Materials with other nodes there stay as they are."""
    found = _cutoff(material)
    assert found is not None, "only materials that are cut out"
    step, alpha, cutoff = found
    tree = material.node_tree
    everywhere, output = tree.get_output_node("ALL"), output_for(tree, "EEVEE")
    textures = [] if filled is None else [node for node in tree.nodes if _shows(node, alpha.node.image)]
    between = _between([step, *textures], output) - {step}
    if any(node.type not in _COPIED for node in between):
        return
    section = Section(tree, "EEVEE: the share of a pixel", (step.location.x, step.location.y + 1400.0))
    copies = {node: _copied(section, node) for node in tree.nodes if node in between}
    for texture in between & set(textures):
        copies[texture].image = filled
    # Half a texel's alpha stays at half of the pixel, whatever the cutoff.
    bent = math.log(0.5) / math.log(cutoff)
    alpha = copies[alpha.node].outputs["Alpha"] if alpha.node in copies else alpha
    share = alpha if abs(bent - 1.0) < 1e-3 else section.math("POWER", alpha, bent, label="Cutoff at ½")
    for link in [link for link in tree.links if link.to_node in between or link.to_node == output]:
        source = link.from_socket
        if link.from_node == step:
            source = share
        elif link.from_node in between:
            source = copies[link.from_node].outputs[list(link.from_node.outputs).index(source)]
        elif link.to_node == output:
            continue
        target = copies.get(link.to_node, output)
        tree.links.new(source, target.inputs[list(link.to_node.inputs).index(link.to_socket)])
    if everywhere is not None:
        everywhere.is_active_output = True


def _shows(node: _Node, image: bpy.types.Image) -> bool:
    return bool(node.type == "TEX_IMAGE" and node.image == image)


def _between(starts: Sequence[_Node], output: _Node) -> set[_Node]:
    """Return the nodes on all ways from nodes to an output, with the first but without the output."""
    ahead = _reached([output], lambda link: (link.to_node, link.from_node))
    return _reached(starts, lambda link: (link.from_node, link.to_node)) & ahead - {output}


def _reached(starts: Sequence[_Node], ends: Callable[[bpy.types.NodeLink], tuple[_Node, _Node]]) -> set[_Node]:
    """Return the nodes that can be reached over links, each from its first to its second end."""
    ways: dict[_Node, list[_Node]] = {}
    for first, second in map(ends, starts[0].id_data.links):
        ways.setdefault(first, []).append(second)
    found, waiting = set(starts), list(starts)
    while waiting:
        new = set(ways.get(waiting.pop(), [])) - found
        found |= new
        waiting += new
    return found


def _copied(section: Section, node: _Node) -> _Node:
    options = {name: getattr(node, name) for name in _OPTIONS if hasattr(node, name)}
    copy = section.node(node.bl_idname, label=node.label, **options)
    for own, other in zip(node.inputs, copy.inputs, strict=True):
        if hasattr(own, "default_value"):
            other.default_value = own.default_value
    return copy
