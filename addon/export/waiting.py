"""Textures that wait for a shader made for them, in a GLB file: no part of glTF's materials, so they stand in extras.

Each key of `material.extras.leafcloud` is a texture as glTF describes it, linear codes, laid out like the colours.

`visibilityTexture`: light from the direction l, in the axes of tangent, bitangent and normal (not turned on the back),
reaches the share `lc_sun_share(occlusion, 2 · code − 1, l)` of a place (shaders/leafcloud.glsl); the occlusion is the
red of `metallicRoughnessTexture`.

`leafUvTexture` and `leafIdTexture`: which leaf a texel shows, and where in its texture (see `build.leaf_map`). The
codes are labels, so their sampler takes the nearest, and there are no mips and no other formats than PNG.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..build.leaf_map import ID_NODE, UV_NODE
from ..build.materials import VISIBILITY_NODE
from .glb_file import append_texture, read_glb, write_glb

WAITING_NODES = {VISIBILITY_NODE: "visibilityTexture", UV_NODE: "leafUvTexture", ID_NODE: "leafIdTexture"}
"""By the names of the image nodes that wait."""
_LABELS = ("leafUvTexture", "leafIdTexture")
_NEAREST = {"magFilter": 9728, "minFilter": 9728}


def add_waiting(path: Path, collection: bpy.types.Collection) -> None:
    """Adds the textures that wait in the materials of `collection` to the GLB file that it was written to."""
    waiting = {
        material.name: images
        for obj in collection.all_objects
        for material in obj.data.materials
        if material is not None and (images := _images(material))
    }
    document, binary = read_glb(path)
    for material in document.get("materials", []):
        for key, image in waiting.get(material["name"], {}).items():
            number, binary = append_texture(document, binary, material, image.name, image.packed_file.data)
            if key in _LABELS:
                document["textures"][number]["sampler"] = _nearest(document)
            material.setdefault("extras", {}).setdefault("leafcloud", {})[key] = {"index": number}
    write_glb(path, document, binary)


def _images(material: bpy.types.Material) -> dict[str, bpy.types.Image]:
    """The images that wait in a material, as far as they are packed, by their keys."""
    nodes = {} if material.node_tree is None else material.node_tree.nodes
    images = {key: nodes[name].image for name, key in WAITING_NODES.items() if name in nodes}
    return {key: image for key, image in images.items() if image is not None and image.packed_file is not None}


def _nearest(document: dict[str, Any]) -> int:
    """The number of the sampler that takes the nearest; the others are left alone."""
    samplers = document.setdefault("samplers", [])
    if _NEAREST not in samplers:
        samplers.append(_NEAREST)
    return samplers.index(_NEAREST)
