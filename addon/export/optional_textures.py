"""Optional textures in a GLB file, for custom shaders. glTF's materials have no place for them, so extras hold them.

Each key of `material.extras.leafcloud` is a glTF texture reference. The textures are linear and laid out like the base
color.

`bentNormalTexture`: bent-normal occlusion. Light from the direction l reaches the surface with the fraction
`lc_sun_share(occlusion, 2 · texel − 1, l)` (shaders/leafcloud.glsl). l is in the axes of tangent, bitangent and normal,
not flipped on the back. The occlusion is the red channel of `metallicRoughnessTexture`.

`leafUvTexture` and `leafIdTexture`: the leaf that a texel shows, and the place in its texture (see `levels.leaf_map`).
The texels are labels, so they need nearest filtering, have no mips, and are stored as PNG only.

`octahedralTexture` and `octahedralNormalTexture`: the pages of an octahedral impostor, in the material of the cross
impostor (see `levels.octahedral`). They lie as the views do, not as the base color.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..levels.leaf_map import ID_NODE, UV_NODE
from ..levels.material import BENT_NORMAL_NODE
from ..levels.octahedral import COLOR_NODE, NORMAL_DEPTH_NODE
from .glb_file import Glb

OPTIONAL_NODES = {
    BENT_NORMAL_NODE: "bentNormalTexture",
    UV_NODE: "leafUvTexture",
    ID_NODE: "leafIdTexture",
    COLOR_NODE: "octahedralTexture",
    NORMAL_DEPTH_NODE: "octahedralNormalTexture",
}
"""The key of each optional texture, by the name of its image node."""
_LABELS = ("leafUvTexture", "leafIdTexture")
_NEAREST = {"magFilter": 9728, "minFilter": 9728}


def add_optional_textures(glb: Glb, collection: bpy.types.Collection) -> None:
    """Add the optional textures of the materials in `collection` to the file that was written from it."""
    waiting = {
        material.name: images
        for obj in collection.all_objects
        for material in obj.data.materials
        if material is not None and (images := _images(material))
    }
    for material in glb.materials:
        for key, image in waiting.get(material["name"], {}).items():
            number = glb.append_texture(material, image.name, image.packed_file.data)
            if key in _LABELS:
                glb.document["textures"][number]["sampler"] = _nearest(glb.document)
            material.setdefault("extras", {}).setdefault("leafcloud", {})[key] = {"index": number}


def _images(material: bpy.types.Material) -> dict[str, bpy.types.Image]:
    """Return the packed optional images of a material by their keys."""
    nodes = {} if material.node_tree is None else material.node_tree.nodes
    images = {key: nodes[name].image for name, key in OPTIONAL_NODES.items() if name in nodes}
    return {key: image for key, image in images.items() if image is not None and image.packed_file is not None}


def _nearest(document: dict[str, Any]) -> int:
    """Return the index of a sampler with nearest filtering. Append one if there is none."""
    samplers = document.setdefault("samplers", [])
    if _NEAREST not in samplers:
        samplers.append(_NEAREST)
    return samplers.index(_NEAREST)
