"""What a material's nodes say of base colour and alpha, as far as they are a product.

Understood is a Principled BSDF whose Base Color and Alpha are products of constants, one image and one colour
attribute, as Blender's glTF and OBJ importers and most artists build them; for alpha also the three ways to write a
cut-off (Math Round, Greater Than, 1 − Less Than), and a Mix Shader with Transparent BSDF. What is not understood is a
gap: then the material is rendered instead (see `flatten`), or, where there is nothing to render, the viewport colour
takes its place.
"""

from __future__ import annotations

import math
import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import bpy
import numpy as np
from numpy.typing import NDArray

from . import SceneError
from .node_links import (
    Input,
    Links,
    Output,
    can_render,
    folded,
    follow,
    node_count,
    number_at,
    output_of,
    shown_nodes,
)

Rgb = tuple[float, float, float]
MOST_NODES = 5_000
"""Of a material, in all its groups. Blender needs minutes for more."""

ACTIVE = ""
"""As the name of a UV map or colour attribute: the one that the mesh renders with."""


@dataclass(frozen=True)
class Texture:
    """An image and how it is laid on the mesh."""

    image: bpy.types.Image | None
    """`None` for a rendering that is still to be made."""
    uv_map: str = ACTIVE
    extension: str = "REPEAT"
    """What lies outside [0, 1]: REPEAT, EXTEND, CLIP, MIRROR, or MIXED where the two axes differ."""
    transform: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    """(2, 3) by rows: carries the UV map's coordinates to the image's."""

    @property
    def words(self) -> str:
        return "its rendering" if self.image is None else f"the image {self.image.name!r}"


@dataclass(frozen=True)
class Surface:
    """Base colour and alpha of a material: factor · texture · colour attribute."""

    name: str
    color: Rgb
    """Linear."""
    alpha: float = 1.0
    color_texture: Texture | None = None
    alpha_texture: Texture | None = None
    """Laid on the mesh like `color_texture` when there are both."""
    alpha_channel: Literal["alpha", "luminance"] = "alpha"
    color_attribute: str | None = None
    alpha_attribute: str | None = None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = True
    warnings: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()
    """What is not understood, in words that follow the material's name; the viewport colour stands for it here."""
    layout: Texture | None = None
    """With gaps: how the material's rendering is laid on the mesh, `None` where it cannot be rendered."""

    @property
    def texture(self) -> Texture | None:
        return self.layout or self.color_texture or self.alpha_texture


@dataclass(frozen=True)
class Product:
    """A product of a factor (three equal numbers for alpha), an image's channel and a colour attribute."""

    factor: Rgb = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    channel: str = "Color"
    attribute: str | None = None

    @property
    def constant(self) -> bool:
        return self.texture is None and self.attribute is None

    def times(self, other: Product) -> Product:
        if (self.texture and other.texture) or (self.attribute is not None and other.attribute is not None):
            raise NotUnderstoodError("multiplies two images or two colour attributes")
        textured = self if self.texture else other
        red, green, blue = (a * b for a, b in zip(self.factor, other.factor, strict=True))
        attribute = other.attribute if self.attribute is None else self.attribute
        return Product((red, green, blue), textured.texture, textured.channel, attribute)


class NotUnderstoodError(Exception):
    """Words that follow "its base colour"."""


def read_surface(material: bpy.types.Material | None, *, as_exported: bool = False) -> Surface:
    """Reads a material's nodes. `None` is Blender's grey of surfaces without a material.

    `as_exported` reads the material as Blender's glTF exporter does: at the output for all renderers, and of mixed
    shaders the nearest Principled BSDF. A bake adds its fades to outputs for single renderers only.

    Raises `SceneError` for more than `MOST_NODES`.
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
            f"material {material.name!r} has {count:,} nodes, those of groups counted wherever a group is used; the "
            f"limit is {MOST_NODES:,}: use fewer groups within groups, or bake the material to an image"
        )
    try:
        output = output_of(material.node_tree, "ALL" if as_exported else "CYCLES")
        principled, opacity, shader = _find_principled(output)
        mixed = principled.node != shader.node
        if mixed and not as_exported and not _lets_light_through(shader) and can_render(material.node_tree):
            raise NotUnderstoodError(f"mixes several shaders at the node {shader.node.name!r}")
    except NotUnderstoodError as reason:
        return _with_gap(viewport, "surface", reason, material.node_tree)
    surface = _with_color(viewport, principled, material.node_tree)
    surface = _with_alpha(surface, [principled.input("Alpha"), *opacity], material.node_tree)
    if mixed:
        only = f"only its Principled BSDF {principled.node.name!r} is read"
        warning = f"material {material.name!r} mixes several shaders: {only}"
        surface = replace(surface, warnings=(*surface.warnings, warning))
    return surface


def transform_matrix(texture: Texture | None) -> NDArray[np.float64]:
    """(2, 3) the map from the UV map's coordinates to the image's; the identity without a texture."""
    return np.array(Texture.transform if texture is None else texture.transform).reshape(2, 3)


def principled_of(material: bpy.types.Material) -> Output | None:
    """The Principled BSDF that makes the material's surface, if one does."""
    if not _has_nodes(material):
        return None
    try:
        return _find_principled(output_of(material.node_tree))[0]
    except NotUnderstoodError:
        return None


def _has_nodes(material: bpy.types.Material) -> bool:
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates the question
        warnings.simplefilter("ignore", DeprecationWarning)
        return material.node_tree is not None and getattr(material, "use_nodes", True)


def shader_of(material: bpy.types.Material) -> Output | None:
    """What makes the material's surface where it is not cut out, if anything does."""
    if not _has_nodes(material):
        return None
    try:
        return _behind_cut_outs(output_of(material.node_tree))[0]
    except NotUnderstoodError:
        return None


def _find_principled(output: bpy.types.Node | None) -> tuple[Output, list[Input], Output]:
    """The Principled BSDF upstream of a material output, inputs that multiply its alpha, and the shader that they cut
    out: itself, or what mixes it with others."""
    shader, opacity = _behind_cut_outs(output)
    for found in _shaders(shader):
        if found.node.type == "BSDF_PRINCIPLED":
            return found, opacity, shader
    raise NotUnderstoodError(f"comes from the node {shader.node.name!r}, without a Principled BSDF")


def _behind_cut_outs(output: bpy.types.Node | None) -> tuple[Output, list[Input]]:
    """The shader upstream of a material output, and the inputs that cut it out."""
    shader = follow(Input(output.inputs["Surface"])) if output is not None else None
    if not isinstance(shader, Output):
        raise NotUnderstoodError("has no shader")
    opacity: list[Input] = []
    while _is_cut_out(shader):
        factor, _, opaque = shader.inputs()
        opacity.append(factor)
        behind = follow(opaque)
        if not isinstance(behind, Output):
            raise NotUnderstoodError("has no shader")
        shader = behind
    return shader, opacity


def _is_cut_out(shader: Output) -> bool:
    """Whether the shader mixes Transparent (at factor 0) with another (at factor 1)."""
    if shader.node.type != "MIX_SHADER":
        return False
    clear = follow(shader.inputs()[1])
    return isinstance(clear, Output) and clear.node.type == "BSDF_TRANSPARENT"


def _lets_light_through(shader: Output) -> bool:
    """Whether it mixes a Principled and a Translucent BSDF, whose base colour is the former's (see `translucency`)."""
    behind = [follow(target) for target in shader.inputs() if target.socket.type == "SHADER"]
    types = sorted(source.node.type for source in behind if isinstance(source, Output))
    return types == ["BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"]


def _shaders(shader: Output) -> Iterator[Output]:
    """The shader and those that it mixes, nearest first."""
    found = {shader}
    waiting = deque(found)
    while waiting:
        current = waiting.popleft()
        yield current
        if current.node.type in {"MIX_SHADER", "ADD_SHADER"}:
            behind = (follow(target) for target in current.inputs() if target.socket.type == "SHADER")
            for source in behind:
                if isinstance(source, Output) and source not in found:
                    found.add(source)
                    waiting.append(source)


def _with_color(viewport: Surface, principled: Output, tree: bpy.types.NodeTree) -> Surface:
    try:
        product = color_product(principled.input("Base Color"))
        _check_factor(product)
    except NotUnderstoodError as reason:
        return _with_gap(viewport, "base colour", reason, tree)
    return replace(viewport, color=product.factor, color_texture=product.texture, color_attribute=product.attribute)


def _with_alpha(surface: Surface, targets: list[Input], tree: bpy.types.NodeTree) -> Surface:
    try:
        product, cutoff = _alpha_product(targets)
        _check_factor(product)
        if product.texture and surface.color_texture and not laid_alike(product.texture, surface.color_texture):
            raise NotUnderstoodError("and its base colour use different texture coordinates")
    except NotUnderstoodError as reason:
        return _with_gap(surface, "alpha", reason, tree)
    alpha = product.factor[0]
    if cutoff is not None:
        mode: Literal["OPAQUE", "MASK", "BLEND"] = "MASK"
    else:
        mode = "OPAQUE" if product.constant and alpha == 1.0 else "BLEND"
    return replace(
        surface,
        alpha=alpha,
        alpha_texture=product.texture,
        alpha_channel="alpha" if product.channel == "Alpha" else "luminance",
        alpha_attribute=product.attribute,
        alpha_mode=mode,
        alpha_cutoff=0.5 if cutoff is None else cutoff,
    )


def _check_factor(product: Product) -> None:
    """No surface reflects or covers more than all."""
    if not all(0.0 <= part <= 1.0 for part in product.factor):
        shown = ", ".join(f"{part:.3g}" for part in product.factor)
        raise NotUnderstoodError(f"has the factor ({shown}), part of which lies outside of [0, 1]")


def laid_alike(first: Texture, second: Texture) -> bool:
    """Whether two images lie on the mesh in the same way."""
    return replace(first, image=second.image) == second


def _with_gap(surface: Surface, what: str, reason: NotUnderstoodError, tree: bpy.types.NodeTree) -> Surface:
    layout = _layout(tree) if can_render(tree) else None
    return replace(surface, gaps=(*surface.gaps, f"its {what} {reason}"), layout=layout)


def _layout(tree: bpy.types.NodeTree) -> Texture:
    """How a rendering is laid: as its first image is, or as its only UV Map node says."""
    nodes = shown_nodes(tree)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    maps = [_map_behind(node) for node in images] or [node.uv_map for node in nodes if node.type == "UVMAP"]
    plain = repeats(nodes) and not any(node.type == "MAPPING" for node in nodes)
    return Texture(None, maps[0] if maps else ACTIVE, "REPEAT" if plain else "MIXED")


def repeats(nodes: Sequence[bpy.types.Node]) -> bool:
    """Whether what nodes show over [0, 1]² goes on like that, but for what Mapping nodes do."""
    images = all(node.extension == "REPEAT" for node in nodes if node.type == "TEX_IMAGE")
    return images and all(
        link.to_node.type in {"TEX_IMAGE", "MAPPING", "REROUTE"}
        for node in nodes
        for output in node.outputs
        if uv_map_of(output) is not None
        for link in output.links
    )


def uv_maps(nodes: Iterable[bpy.types.Node]) -> set[str]:
    """The names of the UV maps that nodes look at, `ACTIVE` for the one that renders."""
    nodes = list(nodes)
    linked = (output for node in nodes for output in node.outputs if output.is_linked)
    names = {name for output in linked if (name := uv_map_of(output)) is not None}
    unlinked = any(node.type == "TEX_IMAGE" and not node.inputs["Vector"].is_linked for node in nodes)
    return names | {ACTIVE} if unlinked else names


def uv_map_of(output: bpy.types.NodeSocket) -> str | None:
    """The UV map that an output is, `None` where it is something else; a vector of a named attribute counts as one."""
    node = output.node
    match node.type:
        case "UVMAP":
            return str(node.uv_map)
        case "TEX_COORD" if output.name == "UV":
            return ACTIVE
        case "ATTRIBUTE" if output.name == "Vector" and node.attribute_type == "GEOMETRY":
            return str(node.attribute_name)
    return None


def _map_behind(image: bpy.types.Node) -> str:
    """The UV map that an image is looked up by, through what moves it."""
    links = Links()
    link = links.to(image.inputs["Vector"])
    while link is not None:
        node, name = link.from_node, uv_map_of(link.from_socket)
        if name is not None:
            return name
        if node.type not in {"MAPPING", "REROUTE"}:
            break
        link = links.to(node.inputs[0])
    return ACTIVE


def color_product(target: Input) -> Product:
    """The product behind a colour input. Raises `NotUnderstoodError`."""
    return folded(target, _color_factors, _color_of)


def _color_factors(target: Input) -> list[Input]:
    """The inputs that a node multiplies, none where it is another node."""
    source = follow(target)
    if isinstance(source, Input) or not _multiplies_colors(source.node):
        return []
    if number_at(source.input("Factor_Float")) != 1.0:
        raise NotUnderstoodError(f"is multiplied in part by the node {source.node.name!r}")
    return [source.input("A_Color"), source.input("B_Color")]


def _multiplies_colors(node: bpy.types.Node) -> bool:
    return node.type == "MIX" and node.data_type == "RGBA" and node.blend_type == "MULTIPLY"


def _color_of(target: Input, factors: list[Product]) -> Product:
    if factors:
        return factors[0].times(factors[1])
    grey = number_at(target)
    if grey is not None:
        return Product((grey, grey, grey))
    source = follow(target)
    node = source.socket.node
    if isinstance(source, Input) or node.type == "RGB":
        red, green, blue, _ = source.socket.default_value
        return Product((red, green, blue))
    if source.socket.name == "Color":
        return _leaf_product(source)
    raise NotUnderstoodError(f"comes from the output {source.socket.name!r} of the node {node.name!r}")


def _alpha_product(targets: list[Input]) -> tuple[Product, float | None]:
    """The product behind the alpha inputs and its cut-off, `None` where it is not cut."""
    constants = [number_at(target) for target in targets]
    varying = [target for target, constant in zip(targets, constants, strict=True) if constant is None]
    scale = math.prod(constant for constant in constants if constant is not None)
    product = Product((scale, scale, scale))
    if not varying:
        return product, None
    if len(varying) > 1:
        raise NotUnderstoodError("comes from a Mix Shader and from the Principled BSDF")
    behind, cutoff = _cut(varying[0])
    if cutoff is not None and scale != 1.0:
        raise NotUnderstoodError("is scaled after it is cut off")
    return product.times(_value_product(behind)), cutoff


def _value_product(target: Input) -> Product:
    """The product behind a value input."""
    return folded(target, _value_factors, _value_of)


def _value_factors(target: Input) -> list[Input]:
    """As `_color_factors`."""
    source = follow(target)
    if isinstance(source, Input) or (source.node.type, getattr(source.node, "operation", "")) != ("MATH", "MULTIPLY"):
        return []
    return source.inputs()[:2]


def _value_of(target: Input, factors: list[Product]) -> Product:
    if factors:
        return factors[0].times(factors[1])
    constant = number_at(target)
    if constant is not None:
        return Product((constant, constant, constant))
    source = follow(target)
    if isinstance(source, Input):
        raise NotUnderstoodError(f"is a colour at the input {source.socket.name!r} of {source.socket.node.name!r}")
    node = source.node
    if source.socket.name == "Alpha" or (node.type == "TEX_IMAGE" and source.socket.name == "Color"):
        return _leaf_product(source)
    raise NotUnderstoodError(f"comes from the output {source.socket.name!r} of the node {node.name!r}")


def _leaf_product(source: Output) -> Product:
    """An image or a colour attribute, at the output Color or Alpha."""
    node = source.node
    if node.type == "TEX_IMAGE":
        return Product(texture=texture_of(source), channel=source.socket.name)
    if node.type == "VERTEX_COLOR":
        return Product(attribute=node.layer_name)
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        return Product(attribute=node.attribute_name)
    raise NotUnderstoodError(f"comes from the node {node.name!r}")


def _cut(target: Input) -> tuple[Input, float | None]:
    """The input that is cut off, and where: it counts as 1 from the cut-off on, as 0 below."""
    source = follow(target)
    if isinstance(source, Input) or source.node.type != "MATH":
        return target, None
    first, second, *_ = source.inputs()
    a, b = number_at(first), number_at(second)
    match source.node.operation:
        case "ROUND":
            return first, 0.5
        case "GREATER_THAN" if b is not None:
            return first, _above(b)
        case "LESS_THAN" if a is not None:
            return second, _above(a)
        case "SUBTRACT" if a == 1.0:
            return _cut_below(second) or (target, None)
    return target, None


def _above(limit: float) -> float:
    """The cut-off of what has to be greater: half a code above 0, where it matters."""
    return max(limit, 0.5 / 255.0)


def _cut_below(target: Input) -> tuple[Input, float] | None:
    """The same for a value that is 1 below the cut-off and 0 from there on."""
    source = follow(target)
    if isinstance(source, Input) or source.node.type != "MATH":
        return None
    first, second, *_ = source.inputs()
    a, b = number_at(first), number_at(second)
    if source.node.operation == "LESS_THAN" and b is not None:
        return first, b
    if source.node.operation == "GREATER_THAN" and a is not None:
        return second, a
    return None


def texture_of(source: Output) -> Texture:
    """The image of an Image Texture node and how it is laid. Raises `NotUnderstoodError`."""
    node = source.node
    if node.image is None:
        raise NotUnderstoodError(f"comes from the node {node.name!r}, which has no image")
    if node.projection != "FLAT" or node.image.source not in {"FILE", "GENERATED"}:
        kind = f"{node.image.source.lower()}, {node.projection.lower()} projection"
        raise NotUnderstoodError(f"comes from the image {node.image.name!r} ({kind})")
    return _laid(Texture(node.image, extension=node.extension), source.input("Vector"))


def _laid(texture: Texture, coordinates: Input) -> Texture:
    """The texture with the UV map, wrapping and transform that its coordinates say."""
    while isinstance(source := follow(coordinates), Output):
        node = source.node
        name = uv_map_of(source.socket)
        if name is not None:
            return replace(texture, uv_map=name)
        if node.type == "MAPPING" and node.vector_type == "POINT":
            texture = replace(texture, transform=_composed(texture.transform, _mapping(source)))
            coordinates = source.input("Vector")
        elif node.type == "COMBXYZ" and (wrapped := _wrapped(source)) is not None:
            texture, coordinates = replace(texture, extension="MIXED"), wrapped
        else:
            raise NotUnderstoodError(f"has texture coordinates from the node {node.name!r}")
    return texture


def _wrapped(combine: Output) -> Input | None:
    """The vector whose u and v the glTF importer wraps apart (Separate, Wrap or Ping-Pong, Combine), else `None`."""
    separated: list[Output] = []
    for target in combine.inputs()[:2]:
        source = follow(target)
        if isinstance(source, Output) and source.node.type == "MATH" and source.node.operation in {"WRAP", "PINGPONG"}:
            source = follow(source.inputs()[0])
        if not isinstance(source, Output) or source.node.type != "SEPXYZ":
            return None
        separated.append(source)
    u, v = separated
    if u.node != v.node or (u.socket.name, v.socket.name) != ("X", "Y"):
        return None
    return u.input("Vector")


def _mapping(source: Output) -> tuple[float, ...]:
    """(2, 3) by rows: a Mapping node of type Point, which scales, then turns, then moves."""
    location, rotation, scale = (source.input(name) for name in ("Location", "Rotation", "Scale"))
    if any(isinstance(follow(target), Output) for target in (location, rotation, scale)):
        raise NotUnderstoodError(f"has texture coordinates that vary at the node {source.node.name!r}")
    moved, (tilt_x, tilt_y, angle), (sx, sy, _) = (
        follow(target).socket.default_value for target in (location, rotation, scale)
    )
    if tilt_x or tilt_y:
        raise NotUnderstoodError(f"has texture coordinates that are tilted by the node {source.node.name!r}")
    cosine, sine = math.cos(angle), math.sin(angle)
    return (cosine * sx, -sine * sy, moved[0], sine * sx, cosine * sy, moved[1])


def _composed(after: tuple[float, ...], before: tuple[float, ...]) -> tuple[float, ...]:
    first, second = (np.vstack([np.reshape(rows, (2, 3)), (0.0, 0.0, 1.0)]) for rows in (before, after))
    return tuple(float(value) for value in (second @ first)[:2].ravel())
