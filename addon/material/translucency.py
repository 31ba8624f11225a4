"""Reader of the light that a material transmits.

Reads a Principled BSDF with Transmission or Subsurface, and a Mix or Add Shader of a Principled BSDF and a Translucent
BSDF. Their shares must be constants, and their colors must be readable as base colors are (see `products`). If base
color or translucency cannot be read, both are rendered (see `flatten`). If rendering is impossible, a warning says so,
and the leaf counts as opaque.

All materials of a tree are converted to the form of glTF's diffuse transmission:

    light = (1 − share) · base color, reflected  +  share · translucency, transmitted

The share is one number for the whole tree, the greatest of its leaves, because a level has one material. It is 0 if
all leaves are opaque. A leaf that reflects R and transmits T has the base color R / (1 − share) and the translucency
T / share, both clipped at 1. If all leaves use the same Mix Shader, these are the colors of its nodes, and the base
color does not change.

Approximations:
- Transmission transmits the same amount of light, but diffusely.
- Subsurface emits half of its light on each side, as in a thin leaf.
- An Add Shader reflects at most half of the light and transmits at most half.
- Color attributes and tints affect only the base color.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy

from .node_links import Input, Output, folded, follow, number_at, shown_nodes
from .products import Product, Rgb, color_product
from .rendered_shading import rendering_over
from .shading import laid_like
from .surface import Surface, read_surface, shader_of
from .textures import NotUnderstoodError, Texture

GREATEST_SHARE = 0.9
"""Upper limit of the share. The rest has to suffice for the reflected light."""


@dataclass(frozen=True)
class Translucency:
    """Translucency of a material: it transmits `color` · `texture` and reflects `reflected` · base color."""

    share: float = 0.0
    """Transmitted share of the light, as one number; 0 for an opaque material."""
    color: Rgb = (0.0, 0.0, 0.0)
    """Linear."""
    texture: Texture | None = None
    """Without an image it has yet to be rendered; then the reflected color is rendered, too."""
    reflected: float = 1.0
    gap: str = ""
    """Description of unread translucency, to follow the material's name; set only if the base color can be read."""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Translucent:
    """Translucency of a tree's leaves."""

    share: float
    """The greatest share of all materials."""
    material: str | None
    """Name of the first translucent material."""
    warnings: tuple[str, ...] = ()
    """Sentences about translucency that can be neither read nor rendered."""


def translucent_of(materials: Sequence[bpy.types.Material | None]) -> Translucent:
    """Return the greatest share of the leaves' materials, the first translucent one, and all warnings."""
    read = [read_translucency(material, read_surface(material)) for material in materials]
    names = [material.name for material, each in zip(materials, read, strict=True) if material and each.share > 0.0]
    warnings = tuple(dict.fromkeys(warning for each in read for warning in each.warnings))
    return Translucent(max((each.share for each in read), default=0.0), next(iter(names), None), warnings)


def read_translucency(material: bpy.types.Material | None, surface: Surface) -> Translucency:
    """Read the translucency of a material. `surface`: its base color and alpha, as read from the same nodes."""
    shader = None if material is None else shader_of(material)
    share = 0.0 if shader is None else _share(shader)
    if material is None or shader is None or share == 0.0:
        return Translucency()
    if surface.gaps:
        rendered = Translucency(min(share, GREATEST_SHARE), (1.0, 1.0, 1.0), surface.layout)
        return Translucency() if surface.layout is None else rendered
    try:
        read = _read(shader)
        if read.texture is not None and not laid_like(surface.texture, read.texture):
            raise NotUnderstoodError("and its base color use different texture coordinates")
    except NotUnderstoodError as reason:
        return _rendered(material, surface, share, f"its translucency {reason}")
    if read.texture is None and not any(read.color):
        return Translucency()
    return replace(read, share=min(read.share, GREATEST_SHARE))


def _rendered(material: bpy.types.Material, surface: Surface, share: float, gap: str) -> Translucency:
    try:
        layout = rendering_over(shown_nodes(material.node_tree), surface.texture)
        if layout.transform != Texture.transform:
            raise NotUnderstoodError("and its base color use a Mapping node")
    except NotUnderstoodError as reason:
        said = f"material {material.name!r}: {gap}; rendering fails because it {reason}; its leaves count as opaque"
        return Translucency(warnings=(said,))
    return Translucency(min(share, GREATEST_SHARE), (1.0, 1.0, 1.0), layout, gap=gap)


def _read(shader: Output) -> Translucency:
    match shader.node.type:
        case "BSDF_PRINCIPLED":
            return _of_principled(shader)
        case "MIX_SHADER":
            return _of_mix(shader)
        case "ADD_SHADER":
            return _of(0.5, 1.0, _translucent_color([_behind(target) for target in shader.inputs()]))
    raise NotUnderstoodError(f"comes from the node {shader.node.name!r}")


def _of_principled(shader: Output) -> Translucency:
    clear, inside = (number_at(shader.input(f"{name} Weight")) for name in ("Transmission", "Subsurface"))
    if clear is None or inside is None:
        raise NotUnderstoodError(f"varies at the node {shader.node.name!r}, whose weights have to be constants")
    share = _through(clear, inside)
    color = color_product(shader.input("Base Color"))
    return _of(share, 1.0 - share, replace(color, attribute=None), share)


def _of_mix(shader: Output) -> Translucency:
    factor, *targets = shader.inputs()
    second = number_at(factor)
    if second is None:
        raise NotUnderstoodError(f"varies at the node {shader.node.name!r}, whose factor has to be a constant")
    parts = [_behind(target) for target in targets]
    share = _cut(second) if parts[1].node.type == "BSDF_TRANSLUCENT" else 1.0 - _cut(second)
    return _of(share, 1.0 - share, _translucent_color(parts), share)


def _translucent_color(parts: Sequence[Output]) -> Product:
    """Return the color of a Translucent BSDF mixed with an opaque Principled BSDF."""
    types = {part.node.type: part for part in parts}
    if set(types) != {"BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"}:
        names = " and ".join(repr(part.node.name) for part in parts)
        raise NotUnderstoodError(f"comes from a mix of the nodes {names}, not of a Principled and a Translucent BSDF")
    if _share(types["BSDF_PRINCIPLED"]) > 0.0:
        raise NotUnderstoodError("comes from the Translucent BSDF and from the Principled BSDF's weights")
    color = color_product(types["BSDF_TRANSLUCENT"].input("Color"))
    if color.attribute is not None:
        raise NotUnderstoodError(f"is multiplied by the color attribute {color.attribute!r}")
    return color


def _of(share: float, reflected: float, color: Product, scale: float = 1.0) -> Translucency:
    red, green, blue = (scale * part for part in color.factor)
    return Translucency(share, (red, green, blue), color.texture, reflected)


def _behind(target: Input) -> Output:
    source = follow(target)
    if isinstance(source, Output):
        return source
    raise NotUnderstoodError(f"is mixed with nothing at the node {target.socket.node.name!r}")


def _share(shader: Output) -> float:
    """Return the share of a shader's light that is transmitted, with ½ for shares that are not constant."""
    start: Input | Output = shader
    return folded(start, _mixed, _share_of)


def _mixed(part: Input | Output) -> list[Input]:
    """Return the inputs of the shaders that a shader mixes."""
    shader = follow(part) if isinstance(part, Input) else part
    if isinstance(shader, Input) or shader.node.type not in {"MIX_SHADER", "ADD_SHADER"}:
        return []
    return [target for target in shader.inputs() if target.socket.type == "SHADER"]


def _share_of(part: Input | Output, mixed: list[float]) -> float:
    shader = follow(part) if isinstance(part, Input) else part
    if isinstance(shader, Input):
        return 0.0
    match shader.node.type:
        case "BSDF_TRANSLUCENT":
            return 1.0
        case "SUBSURFACE_SCATTERING":
            return 0.5
        case "BSDF_PRINCIPLED":
            clear, inside = (number_at(shader.input(f"{name} Weight")) for name in ("Transmission", "Subsurface"))
            return 0.5 if clear is None or inside is None else _through(clear, inside)
        case "MIX_SHADER":
            first, second = mixed
            number = number_at(shader.inputs()[0])
            share = 0.5 if number is None else _cut(number)
            return (1.0 - share) * first + share * second
        case "ADD_SHADER":
            return 0.5 if any(share > 0.0 for share in mixed) else 0.0
    return 0.0


def _through(clear: float, inside: float) -> float:
    """Return the share of a Principled BSDF: all of its transmission, and half of its subsurface light beneath that."""
    return 1.0 - (1.0 - _cut(clear)) * (1.0 - 0.5 * _cut(inside))


def _cut(share: float) -> float:
    return min(max(share, 0.0), 1.0)
