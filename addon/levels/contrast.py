"""Materials that keep a pruned crown's contrast by mixing the mean color into the leaf colors (Cook et al. 2007).

Fewer and larger leaves make the pixels of a distant crown vary more. The node group stores the fraction of the mean
color as the attribute `leaf_mean_share`. Copies of the leaf materials mix it into the Base Color of each Principled
BSDF. If the attribute is 0 or missing, colors are unchanged. Other shaders are never changed.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

import leafcloud

from ..material.node_links import MEAN_SHARE

CONTRAST_NODE = "Leafcloud Contrast"

_LOOKS, _SIDE = 6, 64
"""Number of renderings for the mean color, and their side in pixels."""


def mean_color(foliage: leafcloud.Foliage) -> tuple[float, float, float]:
    """Return the mean linear color of the visible leaves, seen from all around."""
    total, weight = np.zeros(3), 0.0
    for look in range(_LOOKS):
        angle = 2.0 * math.pi * look / _LOOKS
        direction = (math.cos(angle), math.sin(angle), 0.3)
        codes = leafcloud.render(
            [foliage], direction, _SIDE, centre=foliage.world_centre.tolist(), radius=foliage.radius
        )
        shares = codes.astype(np.float64) / 255.0
        light = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)[..., :3]
        total += (light * shares[..., 3:]).sum((0, 1))
        weight += shares[..., 3].sum()
    red, green, blue = (total / max(weight, 1e-9)).tolist()
    return red, green, blue


def contrast_material(
    material: bpy.types.Material | None, mean: tuple[float, float, float]
) -> bpy.types.Material | None:
    """Return a copy of a material that mixes in `mean` (linear) by `leaf_mean_share`.

    Without a Principled BSDF, return the material itself.
    """
    if material is None or material.node_tree is None or not _principled(material):
        return material
    copy = material.copy()
    tree = copy.node_tree
    for number, shader in enumerate(_principled(copy)):
        socket = shader.inputs["Base Color"]
        share, mixed = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeMix")
        share.attribute_name, share.label = MEAN_SHARE, "Pruned: fraction of the mean"
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
