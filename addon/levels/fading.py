"""Materials that cross-fade one level to the next.

The node group stores the hidden fraction of a level as the attribute `leaf_hidden_share`. Outputs for Cycles and EEVEE
mix in as much transparency. If the attribute is 0 or missing, nothing changes. A fading level casts no shadow, because
the other level is fully visible in the same place. Exporters read the output for all renderers, which stays unchanged.
Engines fade by dithering (`lc_shown` in shaders/leafcloud.glsl).
"""

from __future__ import annotations

from typing import cast

import bpy

from ..nodes.laws import HIDDEN_SHARE

RENDERERS = ("CYCLES", "EEVEE")


def let_fade(obj: bpy.types.Object, *, is_cloud: bool) -> None:
    """Make a level or a trunk fade by `leaf_hidden_share`.

    Clouds have materials of their own. Leaves and trunks get copies, linked to the object: other objects and files use
    the artist's materials of their meshes.
    """
    if is_cloud:
        for material in obj.data.materials:
            add_fade(material.node_tree)
        return
    for slot in obj.material_slots:
        material = slot.material
        slot.link, slot.material = "OBJECT", fading_copy(material)


def fading_copy(material: bpy.types.Material | None) -> bpy.types.Material | None:
    """Return a copy that fades; the material itself if it has no output that could fade."""
    if material is None or material.node_tree is None or material.node_tree.get_output_node("ALL") is None:
        return material
    copy = material.copy()
    copy.name = f"{material.name}_fading"
    add_fade(copy.node_tree)
    return copy


def add_fade(tree: bpy.types.NodeTree) -> None:
    """Make a material fade by `leaf_hidden_share` in each renderer. The material must have an output."""
    x, y = tree.get_output_node("ALL").location
    _fade_by(tree, _hidden(tree, (x, y + 700.0)))


def _fade_by(tree: bpy.types.NodeTree, hidden: bpy.types.NodeSocket) -> None:
    """Mix a Transparent BSDF with the factor `hidden` into each renderer's output. The material must have an output."""
    everywhere = tree.get_output_node("ALL")
    x, y = everywhere.location
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    clear.location = (x, y + 500.0)
    for row, renderer in enumerate(RENDERERS):
        output = _output_for(tree, renderer)
        mix = tree.nodes.new("ShaderNodeMixShader")
        mix.location, output.location = (x + 200.0, y + 700.0 - 200.0 * row), (x + 400.0, y + 700.0 - 200.0 * row)
        shown = output.inputs["Surface"].links[0].from_socket if output.inputs["Surface"].is_linked else None
        for source, target in zip((hidden, shown, clear.outputs[0]), mix.inputs, strict=True):
            if source is not None:
                tree.links.new(source, target)
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
    everywhere.is_active_output = True


def _hidden(tree: bpy.types.NodeTree, place: tuple[float, float]) -> bpy.types.NodeSocket:
    """Return the hidden fraction; for shadow rays 1 if the level fades at all, else 0."""
    x, y = place
    share, path = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeLightPath")
    share.attribute_name, share.label = HIDDEN_SHARE, "Cross-fade: hidden fraction"
    fades, shadow, either = (tree.nodes.new("ShaderNodeMath") for _ in range(3))
    fades.operation, shadow.operation, either.operation = "GREATER_THAN", "MULTIPLY", "MAXIMUM"
    fades.inputs[1].default_value = 0.0
    for node, column, row in ((share, 4, 0), (path, 4, 1), (fades, 3, 1), (shadow, 2, 1), (either, 1, 0)):
        node.location = (x - 200.0 * column, y + 200.0 * row)
    tree.links.new(share.outputs["Fac"], fades.inputs[0])
    tree.links.new(fades.outputs[0], shadow.inputs[0])
    tree.links.new(path.outputs["Is Shadow Ray"], shadow.inputs[1])
    tree.links.new(share.outputs["Fac"], either.inputs[0])
    tree.links.new(shadow.outputs[0], either.inputs[1])
    return either.outputs[0]


def _output_for(tree: bpy.types.NodeTree, renderer: str) -> bpy.types.Node:
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
