"""What a material's nodes say of base colour and alpha, as far as they are a product.

Understood is a Principled BSDF whose Base Color and Alpha are products of constants, one image and one colour
attribute, as Blender's glTF and OBJ importers and most artists build them; for alpha also the three ways to write a
cut-off (Math Round, Greater Than, 1 − Less Than), and a Mix Shader with Transparent BSDF. What is not understood is a
gap: then the material is rendered instead (see `flatten`), or, where there is nothing to render, the viewport colour
takes its place.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import bpy

from . import SceneError
from .node_links import Input, Output, can_render, follow, node_count, output_of, shown_nodes
from .products import Product, Rgb, alpha_product, color_product
from .textures import ACTIVE, NotUnderstoodError, Texture, laid_alike, map_behind, repeats

MOST_NODES = 5_000
"""Of a material, in all its groups. Blender needs minutes for more."""


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
        product, cutoff = alpha_product(targets)
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


def _with_gap(surface: Surface, what: str, reason: NotUnderstoodError, tree: bpy.types.NodeTree) -> Surface:
    layout = _layout(tree) if can_render(tree) else None
    return replace(surface, gaps=(*surface.gaps, f"its {what} {reason}"), layout=layout)


def _layout(tree: bpy.types.NodeTree) -> Texture:
    """How a rendering is laid: as its first image is, or as its only UV Map node says."""
    nodes = shown_nodes(tree)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    maps = [map_behind(node) for node in images] or [node.uv_map for node in nodes if node.type == "UVMAP"]
    plain = repeats(nodes) and not any(node.type == "MAPPING" for node in nodes)
    return Texture(None, maps[0] if maps else ACTIVE, "REPEAT" if plain else "MIXED")
