"""Pruned leaves keep the contrast of all: their colours are pulled toward the mean (Cook et al. 2007).

Fewer and larger leaves make a far crown's pixels vary more. The node group stores by how much as `leaf_mean_share`, and
copies of the leaves' materials mix that share of the mean into the Base Color of each Principled BSDF. Where the
attribute is missing, or 0, colours are as they were. Other shaders are left as they are.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

import leafcloud

from ..scene.node_links import MEAN_SHARE

CONTRAST_NODE = "Leafcloud Contrast"

_LOOKS, _SIDE = 6, 64
"""Pictures that the mean is taken of, and their side in pixels."""


def mean_color(foliage: leafcloud.Foliage) -> tuple[float, float, float]:
    """The mean of what is seen of the leaves, from all around; linear."""
    total, weight = np.zeros(3), 0.0
    for look in range(_LOOKS):
        angle = 2.0 * math.pi * look / _LOOKS
        direction = (math.cos(angle), math.sin(angle), 0.3)
        codes = leafcloud.render([foliage], direction, _SIDE, centre=foliage.centre.tolist(), radius=foliage.radius)
        shares = codes.astype(np.float64) / 255.0
        light = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)[..., :3]
        total += (light * shares[..., 3:]).sum((0, 1))
        weight += shares[..., 3].sum()
    red, green, blue = (total / max(weight, 1e-9)).tolist()
    return red, green, blue


def contrast_material(
    material: bpy.types.Material | None, mean: tuple[float, float, float]
) -> bpy.types.Material | None:
    """A copy whose colours follow `leaf_mean_share`; the material itself where there is no Principled BSDF."""
    if material is None or material.node_tree is None or not _principled(material):
        return material
    copy = material.copy()
    tree = copy.node_tree
    for number, shader in enumerate(_principled(copy)):
        socket = shader.inputs["Base Color"]
        share, mixed = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeMix")
        share.attribute_name, share.label = MEAN_SHARE, "Pruned: share of the mean"
        mixed.name = mixed.label = CONTRAST_NODE if number == 0 else f"{CONTRAST_NODE} {number + 1}"
        mixed.data_type = "RGBA"
        factor, own, other = (_socket(mixed, name) for name in ("Factor_Float", "A_Color", "B_Color"))
        x, y = shader.location
        mixed.location, share.location = (x - 200.0, y), (x - 400.0, y + 160.0)
        own.default_value, other.default_value = socket.default_value, (*mean, 1.0)
        for link in list(socket.links):
            tree.links.new(link.from_socket, own)
        tree.links.new(share.outputs["Fac"], factor)
        tree.links.new(next(out for out in mixed.outputs if out.enabled), socket)
    return copy


def _principled(material: bpy.types.Material) -> list[bpy.types.Node]:
    return [node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"]


def _socket(node: bpy.types.Node, identifier: str) -> bpy.types.NodeSocket:
    return next(socket for socket in node.inputs if socket.identifier == identifier)
