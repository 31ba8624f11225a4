"""What a material's nodes say of the light that shines through it.

Understood are a Principled BSDF with Transmission or Subsurface, and a Mix or Add Shader of a Principled BSDF and a
Translucent BSDF, whose shares are constants and whose colours are read as base colours are. Where either base colour or
translucency is not understood, both are rendered (see `flatten`). What cannot be rendered is said in a warning, and the
leaf counts as opaque.

All of a tree's materials are put in one form, that of glTF's diffuse transmission:

    light = (1 − share) · base colour, reflected  +  share · translucency, shining through

with one share for the whole tree, the greatest of its leaves, because a level has one material; where nothing shines
through at all the share is 0. A leaf that reflects R and lets through T so has the base colour R / (1 − share) and the
translucency T / share, both cut at 1. Of leaves that are all the same Mix Shader that is what their nodes say, and the
base colour does not change.

Approximate are: Transmission, which is taken for as much light, but spread in all directions; Subsurface, of which half
comes out on either side, as from a thin leaf; an Add Shader, of which at most half the light is reflected and at most
half shines through; and colour attributes and tints, which count for the base colour only.
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
"""What is left has to do for all that translucent leaves reflect."""


@dataclass(frozen=True)
class Translucency:
    """Of a material: `color` · `texture` shines through, `reflected` · base colour is reflected."""

    share: float = 0.0
    """Of its light, as far as one number says it; 0 where it is opaque."""
    color: Rgb = (0.0, 0.0, 0.0)
    """Linear."""
    texture: Texture | None = None
    """Without an image where it is still to be rendered; then what is reflected is rendered, too."""
    reflected: float = 1.0
    gap: str = ""
    """What is not understood, in words that follow the material's name, where it is rendered though its base colour is
    understood."""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Translucent:
    """How translucent the leaves of a tree are."""

    share: float
    """The greatest of all."""
    material: str | None
    """The first through which light shines."""
    warnings: tuple[str, ...] = ()
    """What can be neither read nor rendered of any."""


def translucent_of(materials: Sequence[bpy.types.Material | None]) -> Translucent:
    """What the materials of the leaves have in common."""
    read = [read_translucency(material, read_surface(material)) for material in materials]
    names = [material.name for material, each in zip(materials, read, strict=True) if material and each.share > 0.0]
    warnings = tuple(dict.fromkeys(warning for each in read for warning in each.warnings))
    return Translucent(max((each.share for each in read), default=0.0), next(iter(names), None), warnings)


def read_translucency(material: bpy.types.Material | None, surface: Surface) -> Translucency:
    """Reads a material's nodes, which say `surface` of base colour and alpha."""
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
            raise NotUnderstoodError("and its base colour use different texture coordinates")
    except NotUnderstoodError as reason:
        return _rendered(material, surface, share, f"its translucency {reason}")
    if read.texture is None and not any(read.color):
        return Translucency()
    return replace(read, share=min(read.share, GREATEST_SHARE))


def _rendered(material: bpy.types.Material, surface: Surface, share: float, gap: str) -> Translucency:
    try:
        layout = rendering_over(shown_nodes(material.node_tree), surface.texture)
        if layout.transform != Texture.transform:
            raise NotUnderstoodError("and its base colour go through a Mapping node")
    except NotUnderstoodError as reason:
        said = f"material {material.name!r}: {gap}, cannot be rendered because it {reason}; its leaves count as opaque"
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
    """The colour of the Translucent BSDF beside an opaque Principled BSDF."""
    types = {part.node.type: part for part in parts}
    if set(types) != {"BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"}:
        names = " and ".join(repr(part.node.name) for part in parts)
        raise NotUnderstoodError(f"comes from a mix of the nodes {names}, not of a Principled and a Translucent BSDF")
    if _share(types["BSDF_PRINCIPLED"]) > 0.0:
        raise NotUnderstoodError("comes from the Translucent BSDF and from the Principled BSDF's weights")
    color = color_product(types["BSDF_TRANSLUCENT"].input("Color"))
    if color.attribute is not None:
        raise NotUnderstoodError(f"is multiplied by the colour attribute {color.attribute!r}")
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
    """Of a shader's light what shines through, with one half wherever no constant says how much."""
    start: Input | Output = shader
    return folded(start, _mixed, _share_of)


def _mixed(part: Input | Output) -> list[Input]:
    """The inputs for the shaders that a shader mixes."""
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
    """Of a Principled BSDF: what is transmitted, and half of what is scattered inside, behind that."""
    return 1.0 - (1.0 - _cut(clear)) * (1.0 - 0.5 * _cut(inside))


def _cut(share: float) -> float:
    return min(max(share, 0.0), 1.0)
