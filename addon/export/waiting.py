"""The texture of where the sky is seen, in a GLB file: no part of glTF's materials, so it stands in their extras.

`material.extras.leafcloud.visibilityTexture` is a texture as glTF describes it, linear codes, laid out like the
colours. Light from the direction l, in the axes of tangent, bitangent and normal (not turned on the back), reaches the
share `occlusion + (2 · code − 1) · l` of a place, cut to [0, 1]; the occlusion is the red of
`metallicRoughnessTexture`.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..build.materials import VISIBILITY_NODE
from .glb_file import append_texture, read_glb, write_glb


def add_visibility(path: Path, collection: bpy.types.Collection) -> None:
    """Adds the textures of the materials in `collection` to the GLB file that it was written to."""
    images = {
        material.name: material.node_tree.nodes[VISIBILITY_NODE].image
        for obj in collection.objects
        for material in obj.data.materials
        if material is not None and material.node_tree is not None and VISIBILITY_NODE in material.node_tree.nodes
    }
    if not images:
        return
    document, binary = read_glb(path)
    for material in document.get("materials", []):
        image = images.get(material["name"])
        if image is None or image.packed_file is None:
            continue
        number, binary = append_texture(document, binary, material, image.name, image.packed_file.data)
        extras = material.setdefault("extras", {}).setdefault("leafcloud", {})
        extras["visibilityTexture"] = {"index": number}
    write_glb(path, document, binary)
