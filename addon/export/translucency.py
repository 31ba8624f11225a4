"""Translucency of leaves and clouds in a GLB file: `KHR_materials_diffuse_transmission`.

The extension mixes as the clouds' materials in Blender do: (1 − factor) · base color is reflected, factor · color is
transmitted. If an atlas page has opaque parts, the alpha of the color image multiplies the factor. Blender's exporter
does not support the extension. An engine without support reflects the whole base color.

A leaf material has the extension if its transmitted color is a constant, or an image that is packed (files that Blender
imported have packed images).
"""

from __future__ import annotations

from typing import Any

import bpy

from ..levels.material import SHARE_NODE, TRANSLUCENCY_NODE
from ..material.surface import Surface, read_surface
from ..material.translucency import read_translucency
from .glb_file import Glb

DIFFUSE_TRANSMISSION = "KHR_materials_diffuse_transmission"


_SHARE_TEXTURE = "diffuseTransmissionTexture"


def has_opaque_parts(material: dict[str, Any]) -> bool:
    """Return whether some parts of a glTF material's page transmit no light."""
    return _SHARE_TEXTURE in material.get("extensions", {}).get(DIFFUSE_TRANSMISSION, {})


def add_leaf_translucency(glb: Glb, collection: bpy.types.Collection) -> None:
    """Add the translucency of the leaves' own materials in `collection` to the file that was written from it."""
    own = {material.name: material for obj in collection.all_objects for material in obj.data.materials if material}
    for material in glb.materials:
        source = own.get(material["name"])
        if source is None or source.node_tree is None or TRANSLUCENCY_NODE in source.node_tree.nodes:
            continue
        surface = read_surface(source)
        through = read_translucency(source, surface)
        image = None if through.texture is None else through.texture.image
        known = through.texture is None or (image is not None and _is_packed(image) and _base(material))
        # Other shares of the base color have no form in the extension.
        if through.share == 0.0 or not known or abs(through.reflected - (1.0 - through.share)) > 1e-3:
            continue
        extension = {
            "diffuseTransmissionFactor": through.share,
            "diffuseTransmissionColorFactor": [min(part / through.share, 1.0) for part in through.color],
        }
        if image is not None:
            extension["diffuseTransmissionColorTexture"] = _leaf_texture(glb, material, surface, image)
        material.setdefault("extensions", {})[DIFFUSE_TRANSMISSION] = extension
        glb.use_extension(DIFFUSE_TRANSMISSION)


def _leaf_texture(glb: Glb, material: dict[str, Any], surface: Surface, image: bpy.types.Image) -> dict[str, Any]:
    """Return the texture of an image, laid as the base color's texture is, and the same if it is the same image."""
    base = _base(material)
    if surface.color_texture is not None and surface.color_texture.image == image:
        return dict(base)
    number = glb.append_texture(material, image.name, image.packed_file.data)
    return {**base, "index": number}


def _is_packed(image: bpy.types.Image) -> bool:
    """Return whether an image is packed as PNG or JPEG, the formats of glTF."""
    data = b"" if image.packed_file is None else image.packed_file.data
    return data.startswith((b"\x89PNG", b"\xff\xd8"))


def _base(material: dict[str, Any]) -> dict[str, Any]:
    """Return the base color's texture of a glTF material; empty without one."""
    texture: dict[str, Any] = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    return texture


def add_translucency(glb: Glb, collection: bpy.types.Collection) -> None:
    """Add the translucency of the clouds' materials in `collection` to the file that was written from it."""
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
