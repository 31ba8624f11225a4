"""Translucency of the clouds in a GLB file: `KHR_materials_diffuse_transmission`.

The extension mixes as the clouds' materials in Blender do: (1 − factor) · base color is reflected, factor · color is
transmitted. If an atlas page has opaque parts, the alpha of the color image multiplies the factor. Blender's exporter
does not support the extension. An engine without support reflects the whole base color.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..levels.material import SHARE_NODE, TRANSLUCENCY_NODE
from .glb_file import Glb

DIFFUSE_TRANSMISSION = "KHR_materials_diffuse_transmission"


_SHARE_TEXTURE = "diffuseTransmissionTexture"


def has_opaque_parts(material: dict[str, Any]) -> bool:
    """Return whether some parts of a glTF material's page transmit no light."""
    return _SHARE_TEXTURE in material.get("extensions", {}).get(DIFFUSE_TRANSMISSION, {})


def add_translucency(glb: Glb, collection: bpy.types.Collection) -> None:
    """Add the translucency of the materials in `collection` to the file that was written from it."""
    trees = {
        material.name: material.node_tree
        for obj in collection.all_objects
        for material in obj.data.materials
        if material is not None and material.node_tree is not None and TRANSLUCENCY_NODE in material.node_tree.nodes
    }
    for material in glb.materials:
        tree = trees.get(material["name"])
        image = None if tree is None else tree.nodes[TRANSLUCENCY_NODE].image
        if tree is None or image is None or image.packed_file is None:
            continue
        number = glb.append_texture(material, image.name, image.packed_file.data)
        extension = material.setdefault("extensions", {})[DIFFUSE_TRANSMISSION] = {
            "diffuseTransmissionFactor": tree.nodes[SHARE_NODE].inputs[1].default_value,
            "diffuseTransmissionColorTexture": {"index": number},
        }
        if tree.nodes[TRANSLUCENCY_NODE].outputs["Alpha"].is_linked:
            # A second texture, because KTX2 may replace the first one and has no alpha here.
            textures = glb.document["textures"]
            textures.append(dict(textures[number]))
            extension[_SHARE_TEXTURE] = {"index": number + 1}
        glb.use_extension(DIFFUSE_TRANSMISSION)
