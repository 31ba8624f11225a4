"""Reader of the light that a material transmits.

Reads a Principled BSDF with Transmission or Subsurface, and a Mix or Add Shader of a Principled BSDF and a Translucent
BSDF. Their shares must be constants, and their colors must be readable as base colors are (see `surface`). If base
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

from .node_links import Port, folded, follow, share_at, shown_nodes
from .surface import Rgb, Surface, product_of, read_surface, shader_of, shaders_mixed
from .textures import NotUnderstoodError, Texture, laid_alike, layout_with

GREATEST_SHARE = 0.9
"""Upper limit of the share. The rest has to suffice for the reflected light."""


@dataclass(frozen=True)
class MaterialTranslucency:
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


def read_translucency(material: bpy.types.Material | None, surface: Surface) -> MaterialTranslucency:
    """Read the translucency of a material. `surface`: its base color and alpha, as read from the same nodes."""
    shader = None if material is None else shader_of(material)
    share = 0.0 if shader is None else _share(shader)
    if material is None or shader is None or share == 0.0:
        return MaterialTranslucency()
    rendered = MaterialTranslucency(min(share, GREATEST_SHARE), (1.0, 1.0, 1.0), surface.layout)
    if surface.gaps:
        return MaterialTranslucency() if surface.layout is None else rendered
    try:
        read = _read(shader, share)
        if read.texture is not None and not laid_alike(surface.texture, read.texture):
            raise NotUnderstoodError("and its base color use different texture coordinates")
        shines = read.texture is not None or any(read.color)
        return replace(read, share=min(read.share, GREATEST_SHARE)) if shines else MaterialTranslucency()
    except NotUnderstoodError as reason:
        gap = f"its translucency {reason}"
    try:
        layout = layout_with(surface.texture, shown_nodes(material.node_tree))
        if layout.transform != Texture.transform:
            raise NotUnderstoodError("and its base color use a Mapping node")
    except NotUnderstoodError as reason:
        said = f"material {material.name!r}: {gap}; rendering fails because it {reason}; its leaves count as opaque"
        return MaterialTranslucency(warnings=(said,))
    return replace(rendered, texture=layout, gap=gap)


def _read(shader: Port, share: float) -> MaterialTranslucency:
    """Read a Principled BSDF, or an opaque one mixed with a Translucent BSDF. Raises `NotUnderstoodError`."""
    node = shader.node
    if shader.kind == "BSDF_PRINCIPLED":
        if _weight(shader) is None:
            raise NotUnderstoodError(f"varies at the node {node.name!r}, because its weights are not constant")
        return _with_color(shader.input("Base Color"), share, 1.0 - share, share)
    parts = {part.kind: part for part in map(follow, shaders_mixed(shader))}
    if set(parts) != {"BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"} or _weight(parts["BSDF_PRINCIPLED"]) != 0.0:
        raise NotUnderstoodError(f"at the node {node.name!r} does not come from a Translucent BSDF alone")
    color = parts["BSDF_TRANSLUCENT"].input("Color")
    if node.type == "ADD_SHADER":
        return _with_color(color, 0.5, 1.0, 1.0)
    if _factor(shader) is None:
        raise NotUnderstoodError(f"varies at the node {node.name!r}, because its factor is not constant")
    return _with_color(color, share, 1.0 - share, share)


def _with_color(target: Port, share: float, reflected: float, scale: float) -> MaterialTranslucency:
    color = product_of(target)
    if color.attribute is not None and target.socket.node.type == "BSDF_TRANSLUCENT":
        raise NotUnderstoodError(f"is multiplied by the color attribute {color.attribute!r}")
    red, green, blue = (scale * part for part in color.factor)
    return MaterialTranslucency(share, (red, green, blue), color.texture, reflected)


def _share(shader: Port) -> float:
    """Return the share of a shader's light that is transmitted, with ½ for shares that are not constant."""
    return folded(shader, lambda each: [follow(target) for target in shaders_mixed(each)], _share_of)


def _share_of(shader: Port, mixed: list[float]) -> float:
    match shader.kind:
        case "BSDF_PRINCIPLED":
            weight = _weight(shader)
            return 0.5 if weight is None else weight
        case "MIX_SHADER":
            factor = _factor(shader)
            factor = 0.5 if factor is None else factor
            return (1.0 - factor) * mixed[0] + factor * mixed[1]
        case "ADD_SHADER":
            return 0.5 if any(mixed) else 0.0
        case kind:
            return {"BSDF_TRANSLUCENT": 1.0, "SUBSURFACE_SCATTERING": 0.5}.get(kind, 0.0)


def _factor(mix: Port) -> float | None:
    """Return the factor of a Mix Shader; `None` if it varies. It may be multiplied by the alpha of the first shader."""
    target, first = mix.inputs()[0], follow(mix.inputs()[1])
    source = follow(target)
    if source.kind == "MATH" and source.node.operation == "MULTIPLY" and first.kind == "BSDF_PRINCIPLED":
        alpha = follow(first.input("Alpha")).socket
        factors = source.inputs()[:2]
        left = [each for each in factors if follow(each).socket != alpha]
        target = left[0] if len(left) == 1 else target
    return share_at(target)


def _weight(principled: Port) -> float | None:
    """Return the share of a Principled BSDF: all of its transmission, and half of its subsurface light beneath that.

    `None` if it varies.
    """
    clear, inside = (share_at(principled.input(f"{name} Weight")) for name in ("Transmission", "Subsurface"))
    return None if clear is None or inside is None else 1.0 - (1.0 - clear) * (1.0 - 0.5 * inside)
