"""Materials that EEVEE may filter: an output of its own without the cutoff, and leaf textures without foreign colors.

EEVEE averages texels in mip levels, then applies the cutoff. Leaves that cover less than half of a pixel vanish, and
the colors under transparent texels, often white, mix into the others. So EEVEE's output has no cutoff: EEVEE dithers
the alpha. Leaf materials get a copy of their texture, in which the leaf colors continue under transparent texels.
Cycles does not filter. Cycles and exporters keep the cutoff and the texture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import bpy

import leafcloud

from ..material.images import pixels_of
from ..material.node_links import follow
from ..material.surface import cut, opacity_input, read_surface
from ..mesh.baked_levels import level_number
from ..nodes.builder import Section
from .building import Build
from .fading import output_for
from .images import PackedImages

_COPIED = {
    *("BSDF_PRINCIPLED", "BSDF_TRANSLUCENT", "BSDF_TRANSPARENT", "EMISSION", "MIX_SHADER", "ADD_SHADER"),
    *("MATH", "MIX", "REROUTE", "TEX_IMAGE"),
}
"""Types of nodes that may lie between a cutoff and the output."""
_OPTIONS = (
    *("operation", "use_clamp", "distribution", "subsurface_method", "data_type", "blend_type", "clamp_factor"),
    *("clamp_result", "factor_mode", "image", "interpolation", "extension", "projection", "projection_blend"),
)

_Node: TypeAlias = bpy.types.Node


class _LeafTextures:
    """Copies of leaf textures by the texture and the cutoff."""

    def __init__(self, images: PackedImages) -> None:
        self._images = images
        self.copies: dict[tuple[bpy.types.Image, float], bpy.types.Image] = {}

    def copy_of(self, image: bpy.types.Image, name: str, cutoff: float) -> bpy.types.Image:
        """Return a copy with colors under its transparent texels. `name`: of the material."""
        if (image, cutoff) not in self.copies:
            pixels = leafcloud.fill_below(pixels_of(image, name), cutoff)
            self.copies[image, cutoff] = self._images.add(f"{bpy.path.clean_name(image.name)}_filled", pixels)
        return self.copies[image, cutoff]


def let_filter(collection: bpy.types.Collection, build: Build) -> None:
    """Let EEVEE filter the materials of leaves and trunks, by copies that are linked to the objects.

    Files, and other objects, use the artist's materials of the meshes. Pages are filtered when they are made.
    """
    textures = _LeafTextures(build.images)
    copies: dict[bpy.types.Material, bpy.types.Material | None] = {}
    objects = list(collection.all_objects)
    for slot in [slot for obj in objects for slot in _slots_of_leaves(obj, build)]:
        material = slot.material
        if material not in copies:
            copies[material] = _filtered(material, textures)
        if copies[material] is not None:
            slot.link, slot.material = "OBJECT", copies[material]
    for image in textures.copies.values():
        build.costs.add_bytes("filtering", 4 * math.prod(image.size))
    for material in [each for each in copies if each.users == 0]:
        bpy.data.materials.remove(material)  # A copy of this bake that fades: its filtered copy fades, too.


def _slots_of_leaves(obj: bpy.types.Object, build: Build) -> list[bpy.types.MaterialSlot]:
    number = level_number(obj)
    if obj.type != "MESH" or (number is not None and number >= build.first_cloud):
        return []
    return [slot for slot in obj.material_slots if slot.material is not None and slot.material.node_tree is not None]


def _filtered(material: bpy.types.Material, textures: _LeafTextures) -> bpy.types.Material | None:
    """Return a copy that EEVEE may filter; None for a material that is not cut out, or not in a way that is known."""
    copy = material.copy()
    if not show_shares(copy, textures):
        bpy.data.materials.remove(copy)
        return None
    copy.name = f"{material.name}_filtered"
    copy.surface_render_method = "DITHERED"
    return copy


def show_shares(material: bpy.types.Material, filled: _LeafTextures | None = None) -> bool:
    """Give EEVEE an output of its own, for which the nodes behind the cutoff are copied. Return whether that is done.

    filled: copies of leaf textures so far, for leaf materials; a new one is added. Pages need none.
    """
    found = _cutoff(material)
    if found is None:
        return False
    step, alpha, cutoff = found
    tree = material.node_tree
    active = tree.nodes.active
    everywhere, output = tree.get_output_node("ALL"), output_for(tree, "EEVEE")
    own = None if filled is None else _leaf_texture(material)
    textures = [node for node in tree.nodes if node.type == "TEX_IMAGE" and own is not None and node.image == own]
    between = _between([step, *textures], output)
    if not _known(between):
        textures, between = [], _between([step], output)
    if not _known(between):
        return False
    between.discard(step)
    section = Section(tree, "EEVEE: the share of a pixel", (step.location.x, step.location.y + 1400.0))
    copies = {node: _copied(section, node) for node in tree.nodes if node in between}
    for texture in between & set(textures):
        assert filled is not None, "pages have no textures to replace"
        copies[texture].image = filled.copy_of(texture.image, material.name, cutoff)
        active = copies[texture]  # Workbench filters, too.
    before = _copy_of(alpha, copies)
    # Half a texel's alpha stays at half of the pixel, whatever the cutoff.
    bent = math.log(0.5) / math.log(cutoff)
    share = before if abs(bent - 1.0) < 1e-3 else section.math("POWER", before, bent, label="Cutoff at ½")
    for link in [link for link in tree.links if _feeds(link, {*between, output})]:
        if link.to_node == output and link.from_node not in between:
            continue
        source = share if link.from_node == step else _copy_of(link.from_socket, copies)
        target = copies.get(link.to_node, output)
        tree.links.new(source, target.inputs[list(link.to_node.inputs).index(link.to_socket)])
    if everywhere is not None:
        everywhere.is_active_output = True
    tree.nodes.active = active  # Workbench shows its texture.
    return True


def _cutoff(material: bpy.types.Material) -> tuple[_Node, bpy.types.NodeSocket, float] | None:
    """Return the node that cuts out, the alpha before it and its cutoff; None if there is none that can be passed."""
    alpha = opacity_input(material)
    if alpha is None or alpha.groups or material.node_tree.get_output_node("EEVEE") is None:
        return None
    before, cutoff = cut(alpha)
    source = follow(before)
    if cutoff is None or not 0.0 < cutoff < 1.0 or source.groups or not source.kind:
        return None
    return follow(alpha).node, source.socket, cutoff


def _leaf_texture(material: bpy.types.Material) -> bpy.types.Image | None:
    """Return the image of color and alpha; None where they come from different images."""
    surface = read_surface(material, as_exported=True)
    color, alpha = surface.color_texture, surface.alpha_texture
    if color is None or alpha is None or color.image != alpha.image or surface.alpha_channel != "alpha":
        return None
    return color.image


def _known(nodes: set[_Node]) -> bool:
    return all(node.type in _COPIED and not node.mute for node in nodes)


def _feeds(link: bpy.types.NodeLink, nodes: set[_Node]) -> bool:
    return link.to_node in nodes and bool(link.is_valid) and not link.is_muted


def _copy_of(socket: bpy.types.NodeSocket, copies: dict[_Node, _Node]) -> bpy.types.NodeSocket:
    """Return the output of a node's copy; of a node that is not copied its own."""
    copy = copies.get(socket.node)
    return socket if copy is None else copy.outputs[list(socket.node.outputs).index(socket)]


def _between(starts: Sequence[_Node], output: _Node) -> set[_Node]:
    """Return the nodes on all ways from nodes to an output, with the first but without the output."""
    ahead = _reached([output], lambda link: (link.to_node, link.from_node))
    return _reached(starts, lambda link: (link.from_node, link.to_node)) & ahead - {output}


def _reached(starts: Sequence[_Node], ends: Callable[[bpy.types.NodeLink], tuple[_Node, _Node]]) -> set[_Node]:
    """Return the nodes that can be reached over links, each from its first to its second end."""
    ways: dict[_Node, list[_Node]] = {}
    for first, second in map(ends, (link for link in starts[0].id_data.links if link.is_valid and not link.is_muted)):
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
        if hasattr(own, "default_value") and own.type == other.type:
            other.default_value = own.default_value
    return copy
