"""Reader of roughness, metallic and normals from a material's Principled BSDF.

Reads constants, one occlusion-roughness-metallic image split by a Separate Color node (as Blender's glTF importer
builds it), and a tangent-space Normal Map that no Mapping node rotates. Everything else is rendered (see
`rendered_shading`). If rendering is impossible, a warning says so, and roughness 1, metallic 0 or mesh normals are
used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy

from .node_links import Input, Output, follow, number_at, shown_nodes
from .rendered_shading import GLOSS, NORMAL, is_of_tangent_space, rendering_of
from .surface import principled_of, read_surface
from .textures import NotUnderstoodError, Texture, laid_alike, texture_of, transform_matrix

USUAL_SPECULAR = 0.5
"""The Specular IOR Level for an index of refraction of 1.5, the default of glTF."""


@dataclass(frozen=True)
class Shading:
    """Shading of one material.

    Roughness is the factor `roughness` times the green channel of `gloss`, metallic is the factor `metallic` times the
    blue channel. `normal` is a tangent-space normal map. A texture without an image has yet to be rendered.
    """

    roughness: float = 1.0
    metallic: float = 0.0
    gloss: Texture | None = None
    normal: Texture | None = None
    specular: float = USUAL_SPECULAR
    """Specular IOR Level."""
    warnings: tuple[str, ...] = ()

    @property
    def glossy(self) -> bool:
        """Whether lights make visible reflections on it."""
        return self.gloss is not None or self.roughness < 0.9 or self.metallic > 0.0


@dataclass(frozen=True)
class Gloss:
    """Roughness and metallic of a tree's leaves: numbers if all are alike, else a material that differs."""

    roughness: float
    metallic: float
    varies: str | None
    """The first glossy material, if materials differ or one has an image or a rendering; else `None`."""
    warnings: tuple[str, ...] = ()
    """Sentences about features that can be neither read nor rendered, or that differ between the materials."""
    specular: float = USUAL_SPECULAR
    """The mean over the materials."""


def gloss_of(materials: Sequence[bpy.types.Material | None]) -> Gloss:
    """Return the roughness and metallic shared by all materials, or a material that differs."""
    shadings = [read_shading(material, read_surface(material).texture) for material in materials]
    first = shadings[0]
    alike = {(s.roughness, s.metallic, s.gloss) for s in shadings} == {(first.roughness, first.metallic, None)}
    warnings = tuple(dict.fromkeys(warning for shading in shadings for warning in shading.warnings))
    specular = sum(s.specular for s in shadings) / len(shadings)
    if any(s.specular != first.specular for s in shadings):
        shown = ", ".join(sorted({f"{s.specular:.3g}" for s in shadings}))
        said = (
            f"the leaf materials' Specular IOR Levels ({shown}) differ: the billboards use their mean, {specular:.3g}"
        )
        warnings = (*warnings, said)
    if alike:
        return Gloss(first.roughness, first.metallic, None, warnings, specular)
    names = [
        material.name for material, s in zip(materials, shadings, strict=True) if material is not None and s.glossy
    ]
    return Gloss(1.0, 0.0, next(iter(names), None), warnings, specular)


def read_shading(material: bpy.types.Material | None, colors: Texture | None) -> Shading:
    """Read a material's nodes. Images must have the same mapping as `colors`, if the material has color textures."""
    principled = None if material is None else principled_of(material)
    if material is None:
        return Shading()
    if principled is None:
        return Shading(warnings=tuple(_unread(material)))
    shading = Shading()
    for read in (_with_gloss, _with_specular, _with_normal):
        try:
            shading = read(shading, principled, colors)
        except NotUnderstoodError as reason:
            shading = replace(shading, warnings=(*shading.warnings, f"material {material.name!r}: its {reason}"))
    return shading


def _unread(material: bpy.types.Material) -> list[str]:
    """Return warnings about normals and highlights of shaders other than the Principled BSDF."""
    nodes = [] if material.node_tree is None else shown_nodes(material.node_tree)
    turned = [node.name for node in nodes if (normal := node.inputs.get("Normal")) and normal.is_linked]
    shiny = [node.name for node in nodes if node.type == "BSDF_GLOSSY"]
    said = f"material {material.name!r}: its"
    return [
        f"{said} {what} come from the node {names[0]!r}; {instead} used; connect a Principled BSDF"
        for what, instead, names in (("normals", "mesh normals are", turned), ("highlights", "roughness 1 is", shiny))
        if names
    ]


def _with_specular(shading: Shading, principled: Output, _: Texture | None) -> Shading:
    specular = _within(number_at(principled.input("Specular IOR Level")))
    if specular is None:
        raise NotUnderstoodError(f"Specular IOR Level varies; {USUAL_SPECULAR} is used instead")
    return replace(shading, specular=specular)


def _with_gloss(shading: Shading, principled: Output, colors: Texture | None) -> Shading:
    rough, metal = (principled.input(name) for name in ("Roughness", "Metallic"))
    roughness, metallic = (_within(number_at(target)) for target in (rough, metal))
    if roughness is not None and metallic is not None:
        return replace(shading, roughness=roughness, metallic=metallic)
    found = {
        _channel_of(target, name) for target, name in ((rough, "Green"), (metal, "Blue")) if number_at(target) is None
    }
    image = found.pop()
    # The image multiplies both factors, so an input without a link to it can only be 0.
    scaled = (roughness or 0.0) + (metallic or 0.0) > 0.0
    if found or image is None or scaled or not laid_like(colors, image):
        return replace(shading, roughness=1.0, metallic=1.0, gloss=_rendered_gloss(principled, colors))
    return replace(
        shading,
        roughness=1.0 if roughness is None else roughness,
        metallic=1.0 if metallic is None else metallic,
        gloss=image,
    )


def _within(number: float | None) -> float | None:
    """Clamp to [0, 1], as Blender does."""
    return None if number is None else min(max(number, 0.0), 1.0)


def _rendered_gloss(principled: Output, colors: Texture | None) -> Texture:
    try:
        return rendering_of(principled, GLOSS, colors)
    except NotUnderstoodError as reason:
        raise NotUnderstoodError(
            f"roughness or metallic {reason}; roughness 1 and metallic 0 are used instead"
        ) from reason


def _channel_of(target: Input, channel: str) -> Texture | None:
    """Return the image behind a Separate Color node if the input reads its output `channel`; else `None`."""
    source = follow(target)
    if not isinstance(source, Output) or source.node.type != "SEPARATE_COLOR" or source.socket.name != channel:
        return None
    image = follow(source.inputs()[0])
    return _understood(image)


def _understood(source: Input | Output) -> Texture | None:
    """Return the image whose Color output this is; `None` for another source or unsupported texture coordinates."""
    if not isinstance(source, Output) or source.node.type != "TEX_IMAGE" or source.socket.name != "Color":
        return None
    try:
        return texture_of(source)
    except NotUnderstoodError:
        return None


def _with_normal(shading: Shading, principled: Output, colors: Texture | None) -> Shading:
    source = follow(principled.input("Normal"))
    if isinstance(source, Input):
        return shading
    node = source.node
    if node.type == "NORMAL_MAP" and node.space == "TANGENT" and number_at(source.input("Strength")) == 1.0:
        image = _understood(follow(source.input("Color")))
        if image is not None and laid_like(colors, image) and _is_upright(image):
            return replace(shading, normal=image)
    return replace(shading, normal=_rendered_normal(principled, node, colors))


def _rendered_normal(principled: Output, node: bpy.types.Node, colors: Texture | None) -> Texture:
    if not is_of_tangent_space(principled.input("Normal")):
        raise NotUnderstoodError(
            f"normals come from the node {node.name!r}, not from tangent-space maps and bumps; mesh normals are used "
            f"instead"
        )
    try:
        return rendering_of(principled, NORMAL, colors)
    except NotUnderstoodError as reason:
        raise NotUnderstoodError(f"normal {reason}; mesh normals are used instead") from reason


def _is_upright(image: Texture) -> bool:
    """Return whether the image's axes match those of the UV map. A Normal Map node uses the UV map's axes always."""
    (along_u, across_u, _), (across_v, along_v, _) = transform_matrix(image)
    return bool(along_u > 0.0 and along_v > 0.0 and across_u == across_v == 0.0)


def laid_like(colors: Texture | None, texture: Texture) -> bool:
    """Return whether a texture has the same mapping as the color texture; without one, the default mapping."""
    return laid_alike(texture, colors or Texture(texture.image))
