"""Reader of base color and alpha from a material's nodes.

Reads a Principled BSDF if its Base Color and Alpha are products of constants, one image and one color attribute.
Blender's glTF and OBJ importers and most artists build materials so. Alpha may also have a cutoff (Math Round, Greater
Than, 1 − Less Than), and a Mix Shader with a Transparent BSDF. Everything else is a gap: the material is rendered (see
`flatten`), or, if there is nothing to render, the viewport color replaces it.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import bpy

from ..errors import SceneError
from .node_links import Input, Output, can_render, follow, node_count, output_of, shown_nodes
from .products import Product, Rgb, alpha_product, color_product
from .textures import ACTIVE, NotUnderstoodError, Texture, laid_alike, map_behind, repeats

MOST_NODES = 5_000
"""Greatest number of nodes of a material, including its groups. Blender needs minutes for more."""


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
    """Return the Principled BSDF of the material's surface; None without one."""
    if not _has_nodes(material):
        return None
    try:
        return _find_principled(output_of(material.node_tree))[0]
    except NotUnderstoodError:
        return None


def _has_nodes(material: bpy.types.Material) -> bool:
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates `use_nodes`
        warnings.simplefilter("ignore", DeprecationWarning)
        return material.node_tree is not None and getattr(material, "use_nodes", True)


def shader_of(material: bpy.types.Material) -> Output | None:
    """Return the shader of the material's surface behind cutouts; None without one."""
    if not _has_nodes(material):
        return None
    try:
        return _behind_cut_outs(output_of(material.node_tree))[0]
    except NotUnderstoodError:
        return None


def _find_principled(output: bpy.types.Node | None) -> tuple[Output, list[Input], Output]:
    """Return the Principled BSDF upstream of a material output, inputs that multiply its alpha, and the cut-out shader.

    The cut-out shader is the Principled BSDF itself, or a mix of it with others. Raises `NotUnderstoodError`.
    """
    shader, opacity = _behind_cut_outs(output)
    for found in _shaders(shader):
        if found.node.type == "BSDF_PRINCIPLED":
            return found, opacity, shader
    raise NotUnderstoodError(f"comes from the node {shader.node.name!r}, without a Principled BSDF")


def _behind_cut_outs(output: bpy.types.Node | None) -> tuple[Output, list[Input]]:
    """Return the shader upstream of a material output, and the inputs that cut it out. Raises `NotUnderstoodError`."""
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
    """Return whether a Mix Shader blends a Transparent BSDF (factor 0) with another shader (factor 1)."""
    if shader.node.type != "MIX_SHADER":
        return False
    clear = follow(shader.inputs()[1])
    return isinstance(clear, Output) and clear.node.type == "BSDF_TRANSPARENT"


def _lets_light_through(shader: Output) -> bool:
    """Return whether a shader mixes a Principled and a Translucent BSDF. The former gives the base color."""
    behind = [follow(target) for target in shader.inputs() if target.socket.type == "SHADER"]
    types = sorted(source.node.type for source in behind if isinstance(source, Output))
    return types == ["BSDF_PRINCIPLED", "BSDF_TRANSLUCENT"]


def _shaders(shader: Output) -> Iterator[Output]:
    """Yield the shader and those that it mixes, nearest first."""
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
        return _with_gap(viewport, "base color", reason, tree)
    return replace(viewport, color=product.factor, color_texture=product.texture, color_attribute=product.attribute)


def _with_alpha(surface: Surface, targets: list[Input], tree: bpy.types.NodeTree) -> Surface:
    try:
        product, cutoff = alpha_product(targets)
        _check_factor(product)
        if product.texture and surface.color_texture and not laid_alike(product.texture, surface.color_texture):
            raise NotUnderstoodError("and its base color use different texture coordinates")
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
    """Raise `NotUnderstoodError` for factors outside [0, 1]: no surface reflects or covers more than 100%."""
    if not all(0.0 <= part <= 1.0 for part in product.factor):
        shown = ", ".join(f"{part:.3g}" for part in product.factor)
        raise NotUnderstoodError(f"has the factor ({shown}), which is outside [0, 1]")


def _with_gap(surface: Surface, what: str, reason: NotUnderstoodError, tree: bpy.types.NodeTree) -> Surface:
    layout = _layout(tree) if can_render(tree) else None
    return replace(surface, gaps=(*surface.gaps, f"its {what} {reason}"), layout=layout)


def _layout(tree: bpy.types.NodeTree) -> Texture:
    """Return the UV mapping of a rendering: that of its first image, else that of its first UV Map node."""
    nodes = shown_nodes(tree)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    maps = [map_behind(node) for node in images] or [node.uv_map for node in nodes if node.type == "UVMAP"]
    plain = repeats(nodes) and not any(node.type == "MAPPING" for node in nodes)
    return Texture(None, maps[0] if maps else ACTIVE, "REPEAT" if plain else "MIXED")
