"""Materials that cross-fade one level to the next, where it does not replace it billboard by billboard (`nodes.lod`).

The node group stores the hidden fraction of a level as the attribute `leaf_hidden_share`, the negative of it while the
level fades in. Camera rays see either level, by a random number of their place in the picture that is the same for
both, so none passes between them. All other rays see the level that fades out: the next one stands in the same place,
and both would shade each other. The planes of the cross impostor are inside of the crown and would still be in its
shadow: in Cycles the cross impostor replaces the level before in the middle of the fade. If the attribute is 0 or
missing, nothing changes. Exporters read the output for all renderers, which stays unchanged. Engines fade by dithering
(`lc_shown` in shaders/leafcloud.glsl).
"""

from __future__ import annotations

from typing import cast

import bpy

from ..nodes.builder import Section
from ..nodes.laws import HIDDEN_SHARE, OWN_BILLBOARD, PARENT
from ..plan.lod_range import LodRange

RENDERERS = ("CYCLES", "EEVEE")
CELLS = 8192.0
"""Places with a random number of their own, along each side of a picture."""


def fades_by_material(mesh: bpy.types.Mesh, lod_range: LodRange) -> bool:
    """Return whether a level or a trunk with this mesh fades, and has no billboards' numbers to do that by."""
    out = lod_range.fade_out_start < lod_range.vanish and PARENT not in mesh.attributes
    return out or (lod_range.fade_in_end > lod_range.appear and OWN_BILLBOARD not in mesh.attributes)


def let_fade(obj: bpy.types.Object, *, is_cloud: bool, to_cross: bool) -> None:
    """Make a level or a trunk fade by `leaf_hidden_share`. to_cross: to or from the cross impostor.

    Clouds have materials of their own. Leaves and trunks get copies, linked to the object: other objects and files use
    the artist's materials of their meshes.
    """
    if is_cloud:
        for material in obj.data.materials:
            add_fade(material.node_tree, to_cross=to_cross)
        return
    for slot in obj.material_slots:
        material = slot.material
        slot.link, slot.material = "OBJECT", fading_copy(material, to_cross=to_cross)


def fading_copy(material: bpy.types.Material | None, *, to_cross: bool = False) -> bpy.types.Material | None:
    """Return a copy that fades; the material itself if it has no output that could fade."""
    if material is None or material.node_tree is None or material.node_tree.get_output_node("ALL") is None:
        return material
    copy = material.copy()
    copy.name = f"{material.name}_fading"
    add_fade(copy.node_tree, to_cross=to_cross)
    return copy


def add_fade(tree: bpy.types.NodeTree, *, to_cross: bool = False) -> None:
    """Mix a Transparent BSDF into each renderer's output, by `leaf_hidden_share`. The material must have an output."""
    everywhere = tree.get_output_node("ALL")
    x, y = everywhere.location
    section = Section(tree, "Cross-fade: hidden?", (x - 1200.0, y + 900.0))
    share = section.node("ShaderNodeAttribute", attribute_name=HIDDEN_SHARE).outputs["Fac"]
    dithered = _dithered(section, share)
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    clear.location = (x, y + 500.0)
    for row, renderer in enumerate(RENDERERS):
        output = output_for(tree, renderer)
        mix = tree.nodes.new("ShaderNodeMixShader")
        mix.location, output.location = (x + 200.0, y + 700.0 - 200.0 * row), (x + 400.0, y + 700.0 - 200.0 * row)
        shown = output.inputs["Surface"].links[0].from_socket if output.inputs["Surface"].is_linked else None
        hidden = _switched(section, share) if to_cross and renderer == "CYCLES" else dithered
        for source, target in zip((hidden, shown, clear.outputs[0]), mix.inputs, strict=True):
            if source is not None:
                tree.links.new(source, target)
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
    everywhere.is_active_output = True


def _switched(section: Section, share: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return 1 if more than half of the level is hidden, else 0."""
    return section.math("GREATER_THAN", section.math("ABSOLUTE", share), 0.5, label="More than half")


def _dithered(section: Section, share: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return 1 where the level is hidden, else 0.

    Let w be the place's random number and s the attribute. Camera rays: w < s fading out, w ≥ 1 + s fading in. Other
    rays: s < 0.
    """
    seen = section.node("ShaderNodeTexCoord").outputs["Window"]
    cell = section.vector("FLOOR", section.vector("MULTIPLY", seen, (CELLS, CELLS, 0.0)), label="Place")
    random = section.node("ShaderNodeTexWhiteNoise", cell, label="w", noise_dimensions="2D").outputs["Value"]
    coming = section.math("LESS_THAN", share, 0.0, label="Fades in")
    gone = section.math("LESS_THAN", random, share, label="w < s")
    ahead = section.math("MULTIPLY", coming, section.math("GREATER_THAN", random, section.math("ADD", share, 1.0)))
    dithered = section.math("MAXIMUM", gone, ahead, label="Hidden from the camera")
    camera = section.node("ShaderNodeLightPath").outputs["Is Camera Ray"]
    chosen = section.node("ShaderNodeMix", camera, coming, dithered, data_type="FLOAT", label="By the kind of ray")
    return next(socket for socket in chosen.outputs if socket.enabled)


def output_for(tree: bpy.types.NodeTree, renderer: str) -> bpy.types.Node:
    """Return the renderer's own output. If it has none, add one with the links of the output for all renderers."""
    found = cast(bpy.types.Node, tree.get_output_node(renderer))
    if found.target == renderer:
        return found
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = renderer
    for old, new in zip(found.inputs, output.inputs, strict=True):
        for link in list(old.links):
            tree.links.new(link.from_socket, new)
    return output
