"""Materials that EEVEE may filter: an output of its own without the cutoff, and leaf textures without foreign colors.

EEVEE averages texels in mip levels and cuts out after that: of leaves that cover less than half of a pixel nothing is
left, and the colors under transparent texels, often white, are mixed in. So its output gets the alpha as it is, which
EEVEE dithers, and leaf materials get a copy of their texture whose transparent texels have the colors around them.
Cycles does not filter; it and exporters keep the cutoff.
"""

from __future__ import annotations

import math

import bpy

import leafcloud

from ..material.images import pixels_of
from ..material.node_links import Port, follow
from ..material.surface import cut, principled_of, read_surface
from ..mesh.baked_levels import level_number
from ..nodes.builder import Section
from .building import Build
from .fading import output_for
from .material import atlas_image

_COPIED = {"BSDF_PRINCIPLED", "BSDF_TRANSLUCENT", "BSDF_TRANSPARENT", "MIX_SHADER", "ADD_SHADER", "MATH", "REROUTE"}
"""Types of nodes that may lie between a cutoff and the output."""
_OPTIONS = ("operation", "use_clamp", "distribution", "subsurface_method")


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
                _without_cutoff(material)
                continue
            if material not in copies:
                copies[material] = material.copy()
                copies[material].name = f"{material.name}_filtered"
                build.costs.add_bytes("filtering", _fill(copies[material]))
                _without_cutoff(copies[material])
            slot.link, slot.material = "OBJECT", copies[material]


def _cutoff(material: bpy.types.Material) -> tuple[bpy.types.Node, bpy.types.NodeSocket, float] | None:
    """Return the node that cuts out, the alpha before it and its cutoff; None if there is none that can be passed."""
    principled = principled_of(material)
    if principled is None or principled.groups:
        return None
    alpha = principled.input("Alpha")
    before, cutoff = cut(alpha)
    if cutoff is None or not 0.0 < cutoff < 1.0 or before.groups or not follow(before).kind:
        return None
    return follow(alpha).node, follow(before).socket, cutoff


def _without_cutoff(material: bpy.types.Material) -> None:
    """Give EEVEE an output of its own, for which all nodes behind the cutoff are copied."""
    found = _cutoff(material)
    assert found is not None
    step, alpha, cutoff = found
    tree = material.node_tree
    everywhere = tree.get_output_node("ALL")
    output = output_for(tree, "EEVEE")
    between = _between(step, output)
    if any(node.type not in _COPIED for node in between):
        return
    section = Section(tree, "EEVEE: the share of a pixel", (step.location.x, step.location.y + 1400.0))
    # Half a texel's alpha stays at half of the pixel, whatever the cutoff.
    bent = math.log(0.5) / math.log(cutoff)
    share = alpha if abs(bent - 1.0) < 1e-3 else section.math("POWER", alpha, bent, label="Cutoff at ½")
    copies = {node: _copied(section, node) for node in between}
    for link in [link for link in tree.links if link.to_node in copies or link.to_node == output]:
        source = link.from_socket
        if link.from_node == step:
            source = share
        elif link.from_node in copies:
            source = copies[link.from_node].outputs[list(link.from_node.outputs).index(source)]
        elif link.to_node == output:
            continue
        target = copies.get(link.to_node, output)
        tree.links.new(source, target.inputs[list(link.to_node.inputs).index(link.to_socket)])
    if everywhere is not None:
        everywhere.is_active_output = True


def _between(step: bpy.types.Node, output: bpy.types.Node) -> list[bpy.types.Node]:
    """Return the nodes on all ways from a node to an output, without both."""
    tree = step.id_data
    behind, ahead = _reached(tree, step, forward=True), _reached(tree, output, forward=False)
    return [node for node in tree.nodes if node in behind and node in ahead and node not in (step, output)]


def _reached(tree: bpy.types.NodeTree, start: bpy.types.Node, *, forward: bool) -> set[bpy.types.Node]:
    ways: dict[bpy.types.Node, list[bpy.types.Node]] = {}
    for link in tree.links:
        first, second = (link.from_node, link.to_node) if forward else (link.to_node, link.from_node)
        ways.setdefault(first, []).append(second)
    found, waiting = {start}, [start]
    while waiting:
        new = set(ways.get(waiting.pop(), [])) - found
        found |= new
        waiting += new
    return found


def _copied(section: Section, node: bpy.types.Node) -> bpy.types.Node:
    options = {name: getattr(node, name) for name in _OPTIONS if hasattr(node, name)}
    copy = section.node(node.bl_idname, label=node.label, **options)
    for own, other in zip(node.inputs, copy.inputs, strict=True):
        if hasattr(own, "default_value"):
            other.default_value = own.default_value
    return copy


def _fill(material: bpy.types.Material) -> int:
    """Replace a leaf texture by a copy with colors under its transparent texels. Return the copy's bytes."""
    surface = read_surface(material)
    color, alpha = surface.color_texture, surface.alpha_texture
    if color is None or alpha is None or color.image != alpha.image or surface.alpha_channel != "alpha":
        return 0
    own = color.image
    name = f"{own.name}_filled"
    filled = bpy.data.images.get(name)
    if filled is None:
        pixels = pixels_of(own, material.name)
        filled = atlas_image(name, leafcloud.fill_transparent(pixels, surface.alpha_cutoff))
    for node in material.node_tree.nodes:
        if node.type == "TEX_IMAGE" and node.image == own:
            node.image = filled
    return 4 * filled.size[0] * filled.size[1]
