"""What a material's nodes say of gloss and normals: the Principled BSDF's Roughness, Metallic and Normal.

Understood are constants, one image of occlusion, roughness and metallic taken apart by a Separate Color node (as
Blender's glTF importer builds it), and a tangent-space Normal Map. What is not understood is said in a warning, and the
leaf counts as rough and smooth there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeGuard

import bpy

from .node_links import Input, Output, follow
from .surface import NotUnderstoodError, Texture, laid_alike, number_at, principled_of, read_surface, texture_of


@dataclass(frozen=True)
class Shading:
    """Roughness and metallic: factor · image (green and blue of `gloss`); `normal` a tangent-space map."""

    roughness: float = 1.0
    metallic: float = 0.0
    gloss: Texture | None = None
    normal: Texture | None = None
    warnings: tuple[str, ...] = ()

    @property
    def glossy(self) -> bool:
        """Whether a light is seen mirrored in it."""
        return self.gloss is not None or self.roughness < 0.9 or self.metallic > 0.0


@dataclass(frozen=True)
class Gloss:
    """How glossy the leaves of a tree are: by numbers where all are alike, else by what varies."""

    roughness: float
    metallic: float
    varies: str | None
    """The first glossy material among several that differ, or one with an image."""
    warnings: tuple[str, ...] = ()
    """What was not understood of any."""


def gloss_of(materials: Sequence[bpy.types.Material | None]) -> Gloss:
    """What all materials have in common, if they do."""
    shadings = [read_shading(material, read_surface(material).texture) for material in materials]
    first = shadings[0]
    alike = {(s.roughness, s.metallic, s.gloss) for s in shadings} == {(first.roughness, first.metallic, None)}
    warnings = tuple(dict.fromkeys(warning for shading in shadings for warning in shading.warnings))
    if alike:
        return Gloss(first.roughness, first.metallic, None, warnings)
    names = [
        material.name for material, s in zip(materials, shadings, strict=True) if material is not None and s.glossy
    ]
    return Gloss(1.0, 0.0, next(iter(names), None), warnings)


def read_shading(material: bpy.types.Material | None, colors: Texture | None) -> Shading:
    """Reads a material's nodes; images have to be laid on the mesh like `colors`, when there are any."""
    principled = None if material is None else principled_of(material)
    if material is None or principled is None:
        return Shading()
    shading = Shading()
    for read in (_with_gloss, _with_normal):
        try:
            shading = read(shading, principled, colors)
        except NotUnderstoodError as reason:
            shading = replace(shading, warnings=(*shading.warnings, f"material {material.name!r}: its {reason}"))
    return shading


def _with_gloss(shading: Shading, principled: Output, colors: Texture | None) -> Shading:
    rough, metal = (principled.input(name) for name in ("Roughness", "Metallic"))
    roughness, metallic = number_at(rough), number_at(metal)
    if roughness is not None and metallic is not None:
        return replace(shading, roughness=roughness, metallic=metallic)
    found = [
        _channel_of(target, name) for target, name in ((rough, "Green"), (metal, "Blue")) if number_at(target) is None
    ]
    images = {texture for texture in found if texture is not None}
    # The image multiplies both: a part that is not linked to it may only be 0.
    scaled = (roughness or 0.0) + (metallic or 0.0) > 0.0
    if len(images) != 1 or None in found or scaled or not laid_like(colors, *images):
        raise NotUnderstoodError(
            "roughness or metallic is no constant and no image laid like the colours; rough stands for it"
        )
    return replace(
        shading,
        roughness=1.0 if roughness is None else roughness,
        metallic=1.0 if metallic is None else metallic,
        gloss=images.pop(),
    )


def _channel_of(target: Input, channel: str) -> Texture | None:
    """The image of which a Separate Color node gives this channel, else `None`."""
    source = follow(target)
    if not isinstance(source, Output) or source.node.type != "SEPARATE_COLOR" or source.socket.name != channel:
        return None
    image = follow(source.inputs()[0])
    return texture_of(image) if _is_color_of_image(image) else None


def _is_color_of_image(source: Input | Output) -> TypeGuard[Output]:
    return isinstance(source, Output) and source.node.type == "TEX_IMAGE" and source.socket.name == "Color"


def _with_normal(shading: Shading, principled: Output, colors: Texture | None) -> Shading:
    source = follow(principled.input("Normal"))
    if isinstance(source, Input):
        return shading
    node = source.node
    if node.type == "NORMAL_MAP" and node.space == "TANGENT" and number_at(source.input("Strength")) == 1.0:
        image = follow(source.input("Color"))
        if _is_color_of_image(image):
            texture = texture_of(image)
            if laid_like(colors, texture):
                return replace(shading, normal=texture)
    raise NotUnderstoodError(
        f"normals come from the node {node.name!r}, not from a tangent-space map of strength 1; smooth stands for it"
    )


def laid_like(colors: Texture | None, texture: Texture) -> bool:
    """Whether the mesh has the texture where it has its colours; without colours, as plainly as can be."""
    return laid_alike(texture, colors or Texture(texture.image))
