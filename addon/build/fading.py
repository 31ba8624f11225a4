"""Materials of levels that fade in and out: where one level hands over to the next, the two cross-fade.

The node group stores the share of a level that is not shown as `leaf_hidden_share`, and outputs for Cycles and EEVEE
mix so much transparency into what they show. Where the attribute is missing, or 0, everything is as it was. A level
that fades casts no shadow: the other of the two is whole, and lies in the same place. The output for all, which
exporters read, stays untouched: engines fade by dither (`lc_shown` in shaders/leafcloud.glsl).
"""

from __future__ import annotations

from typing import cast

import bpy

from .node_laws import HIDDEN_SHARE

RENDERERS = ("CYCLES", "EEVEE")


def fading_copy(material: bpy.types.Material | None) -> bpy.types.Material | None:
    """A copy that fades; the material itself where there is nothing that could."""
    if material is None or material.node_tree is None or material.node_tree.get_output_node("ALL") is None:
        return material
    copy = material.copy()
    copy.name = f"{material.name}_fading"
    add_fade(copy.node_tree)
    return copy


def add_fade(tree: bpy.types.NodeTree) -> None:
    """Lets what each renderer shows of a material with an output fade by `leaf_hidden_share`."""
    x, y = tree.get_output_node("ALL").location
    fade_by(tree, _hidden(tree, (x, y + 700.0)))


def fade_by(tree: bpy.types.NodeTree, hidden: bpy.types.NodeSocket) -> None:
    """Mixes as much transparency as `hidden` says into what each renderer shows of a material with an output."""
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
    """The share that is not shown; to light, all or nothing."""
    x, y = place
    share, path = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeLightPath")
    share.attribute_name, share.label = HIDDEN_SHARE, "Cross-fade: share not shown"
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
    """The renderer's own output; a new one, that shows what the one for all does, where it has none."""
    found = cast(bpy.types.Node, tree.get_output_node(renderer))
    if found.target == renderer:
        return found
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = renderer
    for old, new in zip(found.inputs, output.inputs, strict=True):
        for link in list(old.links):
            tree.links.new(link.from_socket, new)
    return output
