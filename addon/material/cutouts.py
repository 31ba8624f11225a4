"""Leaf materials with the wrong alpha mode: opaque with a transparent image, or blended with an opaque one.

Some exporters never write the alpha mode, others always write BLEND.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy

from ..errors import SceneError
from .images import lacks_alpha, pixels_of
from .node_links import nodes_behind
from .surface import principled_of, read_surface

_LEAST, _MOST = 0.05, 0.98
"""Shares of the texels that are transparent in an image that cuts leaves out."""


def cut_out_by_images(materials: Sequence[bpy.types.Material | None]) -> None:
    """Cut opaque materials out where their color image is transparent, unless shader and image are in two groups."""
    for material, image, _ in list(_forgotten(materials)):
        principled = principled_of(material)
        assert principled is not None  # `_forgotten` has read it
        tree = principled.socket.id_data
        behind = nodes_behind([principled.input("Base Color")])
        texture = next((node for node in behind if node.type == "TEX_IMAGE" and node.id_data == tree), None)
        if texture is None or texture.image != image:
            continue
        threshold = tree.nodes.new("ShaderNodeMath")
        threshold.operation, threshold.location = "GREATER_THAN", (texture.location.x + 300.0, texture.location.y)
        threshold.inputs[1].default_value = 0.5
        tree.links.new(texture.outputs["Alpha"], threshold.inputs[0])
        tree.links.new(threshold.outputs[0], principled.input("Alpha").socket)


def forgotten_alpha(materials: Sequence[bpy.types.Material | None]) -> list[str]:
    """Return a sentence for each opaque material whose color image is transparent in parts."""
    return [
        f"material {material.name!r} is opaque, but {share:.0%} of its image {image.name!r} are transparent: if leaves "
        f"should be cut out, link the image's Alpha to the Alpha of the shader (`alpha=texture`)"
        for material, image, share in _forgotten(materials)
    ]


def without_empty_alpha(material: bpy.types.Material) -> None:
    """Make a material opaque whose alpha comes from an image without alpha, such as a JPEG."""
    surface = read_surface(material)
    texture, principled = surface.alpha_texture, principled_of(material)
    if texture is None or principled is None or surface.alpha_channel != "alpha" or not lacks_alpha(texture.image):
        return
    if surface.alpha == 1.0 and surface.alpha_attribute is None:
        alpha = principled.input("Alpha").socket
        for link in list(alpha.links):
            alpha.id_data.links.remove(link)


def _forgotten(
    materials: Sequence[bpy.types.Material | None],
) -> Iterator[tuple[bpy.types.Material, bpy.types.Image, float]]:
    """Yield each opaque material with its color image and the share of its texels that are transparent."""
    for material in dict.fromkeys(materials):
        surface = read_surface(material)
        texture = surface.color_texture
        if (
            material is None
            or surface.alpha_mode != "OPAQUE"
            or surface.gaps
            or texture is None
            or texture.image is None
        ):
            continue
        if surface.unlit or texture.image.alpha_mode == "NONE" or lacks_alpha(texture.image):
            continue
        try:
            share = float((pixels_of(texture.image, material.name)[..., 3] < 128).mean())
        except SceneError:  # The bake reports a missing image.
            continue
        if _LEAST <= share <= _MOST:
            yield material, texture.image, share
