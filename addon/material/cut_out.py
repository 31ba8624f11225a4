"""Blended leaf materials that files cut out: engines cannot sort crossing cards."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager

import bpy

from .surface import read_surface


@contextmanager
def masked(leaf_materials: Sequence[bpy.types.Material | None], kept: Collection[str]) -> Iterator[None]:
    """Cut out blended leaf materials at an alpha of ½ while the block runs, except those named in `kept`.

    In engines, crossing cards that are blended have no depth order. They would also look different from the first
    cloud, which is cut out. A uniform alpha above ½ becomes 1. A lower one stays: a cutout would remove the leaves.
    """
    materials = dict.fromkeys(material for material in leaf_materials if material is not None)
    cut_out = [material for material in materials if is_blended(material) and material.name not in kept]
    cuts = [cut for material in cut_out for cut in _cut_out(material.node_tree)]
    filled = [alpha for material in cut_out for alpha in _even_alphas(material.node_tree)]
    values = [alpha.default_value for alpha in filled]
    try:
        for alpha in filled:
            alpha.default_value = 1.0
        yield
    finally:
        for alpha, value in zip(filled, values, strict=True):
            alpha.default_value = value
        for tree, threshold in cuts:
            source, target = threshold.inputs[0].links[0].from_socket, threshold.outputs[0].links[0].to_socket
            tree.nodes.remove(threshold)
            tree.links.new(source, target)


def is_blended(material: bpy.types.Material) -> bool:
    """Return whether a material's alpha is blended, or unreadable: exporters treat unreadable alpha as blended."""
    surface = read_surface(material)
    return surface.alpha_mode == "BLEND" or any(gap.startswith("its alpha ") for gap in surface.gaps)


def cut_message(material: bpy.types.Material) -> str:
    """Return the message on a blended leaf material that files do not keep blended."""
    alphas = _alphas(material.node_tree)
    if any(alpha.is_linked for alpha in alphas) or not alphas:
        way = "cut it out at an alpha of 0.5"
    elif _even_alphas(material.node_tree):
        way = f"show its uniform alpha of {alphas[0].default_value:.3g} as opaque"
    else:
        way = f"keep its uniform alpha of {alphas[0].default_value:.3g}, without a draw order"
    return f"material {material.name!r} is blended: the glTF files {way}"


def _alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    return [node.inputs["Alpha"] for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]


def _even_alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """Return the inputs with a uniform alpha above ½."""
    return [alpha for alpha in _alphas(tree) if not alpha.is_linked and alpha.default_value > 0.5]


def _cut_out(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Insert a threshold before each linked alpha of a Principled BSDF, and return the tree and the node of each."""
    cuts = []
    for alpha in [alpha for alpha in _alphas(tree) if alpha.is_linked]:
        threshold = tree.nodes.new("ShaderNodeMath")
        threshold.operation = "GREATER_THAN"
        threshold.inputs[1].default_value = 0.5
        tree.links.new(alpha.links[0].from_socket, threshold.inputs[0])
        tree.links.new(threshold.outputs[0], alpha)
        cuts.append((tree, threshold))
    return cuts
