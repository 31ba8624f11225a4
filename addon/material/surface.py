"""Reader of base color and alpha from a material's nodes, in the forms that importers and artists build.

Reads a Principled BSDF if its Base Color and Alpha are products of constants, one image and one color attribute. A
Translucent BSDF may be mixed with it. Alpha may have a cutoff (Math Round, Greater Than, 1 − Less Than), and may be the
factor of a Mix Shader with a Transparent BSDF instead. An Emission of strength 1, alone or seen by the camera alone, is
an unlit material: its color is the base color. Everything else is a gap: the material is rendered (see `flatten`), or,
if there is nothing to render, the viewport color replaces it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import bpy

from ..errors import SceneError
from .node_links import Port, can_render, follow, node_count, number_at, output_of, sources_behind
from .textures import NotUnderstoodError, Texture, laid_alike, layout_of, texture_of

Rgb = tuple[float, float, float]

MOST_NODES = 5_000
"""Greatest number of nodes of a material, including its groups. Blender needs minutes for more."""

_MOST_PRODUCTS = 3
"""Greatest number of Multiply nodes in a row that are read. Importers use two."""


@dataclass(frozen=True)
class Surface:
    """Base color and alpha of a material: factor · texture · color attribute."""

    name: str
    color: Rgb
    """Linear."""
    alpha: float = 1.0
    color_texture: Texture | None = None
    alpha_texture: Texture | None = None
    """Has the same UV mapping as `color_texture` if both exist."""
    alpha_channel: Literal["alpha", "luminance"] = "alpha"
    color_attribute: str | None = None
    alpha_attribute: str | None = None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = True
    unlit: bool = False
    """The color shows without light."""
    warnings: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()
    """Descriptions of unread parts, to follow the material's name. Their fields above have the viewport color."""
    layout: Texture | None = None
    """With gaps: the UV mapping of the material's rendering; `None` if it cannot be rendered."""

    @property
    def texture(self) -> Texture | None:
        return self.layout or self.color_texture or self.alpha_texture


def read_surface(material: bpy.types.Material | None, *, as_exported: bool = False) -> Surface:
    """Read a material's nodes. `None` gives Blender's gray of surfaces without a material.

    `as_exported`: read the material as Blender's glTF exporter does, from the output for all renderers and, in mixed
    shaders, the nearest Principled BSDF. A bake adds its fades only to outputs for single renderers.

    Raises `SceneError` for more than `MOST_NODES` nodes.
    """
    if material is None:
        return Surface("default", (0.8, 0.8, 0.8))
    red, green, blue, alpha = material.diffuse_color
    viewport = Surface(
        material.name,
        (red, green, blue),
        alpha,
        alpha_mode="OPAQUE" if alpha == 1.0 else "BLEND",
        double_sided=not material.use_backface_culling,
    )
    if not _has_nodes(material):
        return viewport
    if (count := node_count(material.node_tree)) > MOST_NODES:
        raise SceneError(
            f"material {material.name!r} has {count:,} nodes, with each use of a group counted; the limit is "
            f"{MOST_NODES:,}: use fewer nested groups, or bake the material to an image"
        )
    return _of_shaders(viewport, material.node_tree, as_exported=as_exported)


def _of_shaders(viewport: Surface, tree: bpy.types.NodeTree, *, as_exported: bool) -> Surface:
    """Read a tree's shaders. `viewport` has the material's name, and the colors that replace unread ones."""
    try:
        shader, mask = _behind_cutout(output_of(tree, "ALL" if as_exported else "CYCLES"))
        if (emission := _unlit(shader)) is not None:
            colored = _with_color(viewport, emission.input("Color"), tree)
            return replace(_with_alpha(colored, None, mask, tree), unlit=True)
        principled = _first_principled(shader)
        mixed = principled.node != shader.node
        if mixed and not as_exported and not _is_translucent(shader):
            raise NotUnderstoodError(f"mixes several shaders at the node {shader.node.name!r}")
    except NotUnderstoodError as reason:
        return _with_gap(viewport, "surface", reason, tree)
    colored = _with_color(viewport, principled.input("Base Color"), tree)
    surface = _with_alpha(colored, principled.input("Alpha"), mask, tree)
    if not mixed:
        return surface
    only = f"only its Principled BSDF {principled.node.name!r} is read"
    return replace(surface, warnings=(f"material {surface.name!r} mixes several shaders: {only}",))


def principled_of(material: bpy.types.Material) -> Port | None:
    """Return the first Principled BSDF of the material's surface; None without one."""
    try:
        shader = shader_of(material)
        return None if shader is None else _first_principled(shader)
    except NotUnderstoodError:
        return None


def opacity_input(material: bpy.types.Material) -> Port | None:
    """Return the input that cuts a material out: of a Mix Shader, else of its Principled BSDF; None without either."""
    try:
        mask = _behind_cutout(output_of(material.node_tree))[1]
    except NotUnderstoodError:
        return None
    principled = principled_of(material) if mask is None else None
    return mask if principled is None else principled.input("Alpha")


def shader_of(material: bpy.types.Material) -> Port | None:
    """Return the shader of the material's surface behind a cutout; None without one."""
    try:
        return _behind_cutout(output_of(material.node_tree))[0] if _has_nodes(material) else None
    except NotUnderstoodError:
        return None


def _has_nodes(material: bpy.types.Material) -> bool:
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates `use_nodes`
        warnings.simplefilter("ignore", DeprecationWarning)
        return material.node_tree is not None and getattr(material, "use_nodes", True)


def are_unlit(materials: Sequence[bpy.types.Material | None]) -> bool:
    """Return whether all materials show their colors without light."""
    return all(read_surface(material).unlit for material in materials)


def _unlit(shader: Port) -> Port | None:
    """Return the Emission whose color a material shows without light, as glTF's unlit materials do; else None.

    Importers let the camera alone see it.
    """
    if _is_for_cameras(shader):
        shader = follow(shader.inputs()[2])
    return shader if shader.kind == "EMISSION" and number_at(shader.input("Strength")) == 1.0 else None


def _is_for_cameras(shader: Port) -> bool:
    """Return whether a shader is a Mix Shader whose second shader is for rays from the camera."""
    if shader.kind != "MIX_SHADER":
        return False
    factor = follow(shader.inputs()[0])
    return factor.kind == "LIGHT_PATH" and factor.socket.name == "Is Camera Ray"


def _first_principled(shader: Port) -> Port:
    """Return a Principled BSDF, or the first that a shader mixes. Raises `NotUnderstoodError`."""
    for found in [shader, *sources_behind(shaders_mixed(shader))]:
        if found.kind == "BSDF_PRINCIPLED":
            return found
    raise NotUnderstoodError(f"comes from the node {shader.node.name!r}, without a Principled BSDF")


def _behind_cutout(output: bpy.types.Node | None) -> tuple[Port, Port | None]:
    """Return the shader upstream of a material output, and the input that cuts it out. Raises `NotUnderstoodError`.

    A cutout is a Mix Shader of a Transparent BSDF (factor 0) and another shader (factor 1), whatever the ray.
    """
    shader, mask = None if output is None else follow(Port(output.inputs["Surface"])), None
    if shader is not None and shader.kind == "MIX_SHADER" and not _is_for_cameras(shader):
        factor, first, second = shader.inputs()
        if follow(first).kind == "BSDF_TRANSPARENT":
            shader, mask = follow(second), factor
    if shader is None or not shader.kind:
        raise NotUnderstoodError("has no shader")
    return shader, mask


def shaders_mixed(shader: Port) -> list[Port]:
    """Return the inputs with the shaders that a Mix Shader or an Add Shader mixes; none of other shaders."""
    mixes = shader.kind in {"MIX_SHADER", "ADD_SHADER"}
    return [target for target in shader.inputs() if target.socket.type == "SHADER"] if mixes else []


def _is_translucent(shader: Port) -> bool:
    """Return whether a shader mixes a Principled and a Translucent BSDF. The former gives the base color."""
    kinds = sorted(follow(target).kind for target in shaders_mixed(shader))
    return kinds == ["BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"]


def _with_color(viewport: Surface, color: Port, tree: bpy.types.NodeTree) -> Surface:
    try:
        product = product_of(color)
        _check_factor(product)
    except NotUnderstoodError as reason:
        return _with_gap(viewport, "base color", reason, tree)
    return replace(viewport, color=product.factor, color_texture=product.texture, color_attribute=product.attribute)


def _with_alpha(surface: Surface, alpha: Port | None, mask: Port | None, tree: bpy.types.NodeTree) -> Surface:
    """Add the alpha of a Principled BSDF, if it is one, or the mask that cuts it out."""
    shown = mask or alpha
    if shown is None:
        return replace(surface, alpha=1.0, alpha_mode="OPAQUE")
    try:
        if mask is not None and alpha is not None and number_at(alpha) != 1.0:
            raise NotUnderstoodError("is cut out by a Mix Shader, too")
        target, cutoff = cut(shown)
        product = product_of(target)
        _check_factor(product)
        if product.texture and surface.color_texture and not laid_alike(product.texture, surface.color_texture):
            raise NotUnderstoodError("and its base color use different texture coordinates")
    except NotUnderstoodError as reason:
        return _with_gap(surface, "alpha", reason, tree)
    opaque = product == Product()
    return replace(
        surface,
        alpha=product.factor[0],
        alpha_texture=product.texture,
        alpha_channel="alpha" if product.channel == "Alpha" else "luminance",
        alpha_attribute=product.attribute,
        alpha_mode="MASK" if cutoff is not None else "OPAQUE" if opaque else "BLEND",
        alpha_cutoff=0.5 if cutoff is None else cutoff,
    )


def _with_gap(surface: Surface, what: str, reason: NotUnderstoodError, tree: bpy.types.NodeTree) -> Surface:
    layout = None
    if can_render(tree) and (output := output_of(tree)) is not None:
        layout = layout_of([Port(output.inputs["Surface"])])
    return replace(surface, gaps=(*surface.gaps, f"its {what} {reason}"), layout=layout)


@dataclass(frozen=True)
class Product:
    """Product of a factor (three equal numbers for alpha), a channel of an image and a color attribute."""

    factor: Rgb = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    channel: str = "Color"
    attribute: str | None = None

    def times(self, other: Product) -> Product:
        if (self.texture and other.texture) or (self.attribute is not None and other.attribute is not None):
            raise NotUnderstoodError("multiplies two images or two color attributes")
        textured = self if self.texture else other
        red, green, blue = (a * b for a, b in zip(self.factor, other.factor, strict=True))
        attribute = other.attribute if self.attribute is None else self.attribute
        return Product((red, green, blue), textured.texture, textured.channel, attribute)


def product_of(target: Port, most: int = _MOST_PRODUCTS) -> Product:
    """Return the product behind a color or value input. Raises `NotUnderstoodError`."""
    source, kind = follow(target), target.socket.type
    factors = _factors(source, kind) if most else []
    if not factors:
        return _single(source, kind)
    first, second = (product_of(factor, most - 1) for factor in factors)
    return first.times(second)


def _factors(source: Port, kind: str) -> list[Port]:
    """Return the inputs that a node multiplies, as colors or as values; none for other nodes."""
    node = source.node
    if kind == "VALUE":
        return source.inputs()[:2] if _is_math(source, "MULTIPLY") else []
    if source.kind != "MIX" or node.data_type != "RGBA" or node.blend_type != "MULTIPLY":
        return []
    if number_at(source.input("Factor_Float")) != 1.0:
        raise NotUnderstoodError(f"is multiplied by the node {node.name!r} with a Factor other than 1")
    return [source.input("A_Color"), source.input("B_Color")]


def _single(source: Port, kind: str) -> Product:
    """Return the product of a constant, an image or a color attribute alone."""
    node, name = source.socket.node, source.socket.name
    if source.kind in {"", "VALUE", "RGB"}:
        if source.socket.type != "VALUE" and kind == "VALUE":
            raise NotUnderstoodError(f"is a color at the input {name!r} of {node.name!r}")
        value = source.socket.default_value
        red, green, blue = (value,) * 3 if source.socket.type == "VALUE" else value[:3]
        return Product((red, green, blue))
    values = {"Alpha", "Color"} if node.type == "TEX_IMAGE" else {"Alpha"}
    if name not in (values if kind == "VALUE" else {"Color"}):
        raise NotUnderstoodError(f"comes from the output {name!r} of the node {node.name!r}")
    if node.type == "TEX_IMAGE":
        return Product(texture=texture_of(source), channel=name)
    if node.type == "VERTEX_COLOR":
        return Product(attribute=node.layer_name)
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        return Product(attribute=node.attribute_name)
    raise NotUnderstoodError(f"comes from the node {node.name!r}")


def cut(target: Port) -> tuple[Port, float | None]:
    """Return the input before a cutoff node, and the cutoff. Alpha is 1 from the cutoff up, 0 below it.

    The glTF importer builds Round and 1 − Less Than, artists and Leafcloud Greater Than.
    """
    source = follow(target)
    if source.kind != "MATH":
        return target, None
    first, second, *_ = source.inputs()
    limit = number_at(second)
    if source.node.operation == "ROUND":
        return first, 0.5
    if source.node.operation == "GREATER_THAN" and limit is not None:
        return first, max(limit, 0.5 / 255.0)  # At least half an 8-bit step, so 0 stays transparent.
    below = follow(second)
    if source.node.operation == "SUBTRACT" and number_at(first) == 1.0 and _is_math(below, "LESS_THAN"):
        first, second, *_ = below.inputs()
        limit = number_at(second)
        return (target, None) if limit is None else (first, limit)
    return target, None


def _is_math(source: Port, operation: str) -> bool:
    return source.kind == "MATH" and source.node.operation == operation


def _check_factor(product: Product) -> None:
    """Raise `NotUnderstoodError` for factors outside [0, 1]: no surface reflects or covers more than 100%."""
    if not all(0.0 <= part <= 1.0 for part in product.factor):
        shown = ", ".join(f"{part:.3g}" for part in product.factor)
        raise NotUnderstoodError(f"has the factor ({shown}), which is outside [0, 1]")
