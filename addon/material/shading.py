"""Reader and renderer of roughness, metallic and normals of a material's Principled BSDF.

Reads constants, one occlusion-roughness-metallic image split by a Separate Color node (as Blender's glTF importer
builds it), and a tangent-space Normal Map that no Mapping node rotates. Everything else is rendered, with the UV
mapping of the base color. If rendering is impossible, a warning says so, and roughness 1, metallic 0 or mesh normals
are used.

Cycles renders the square of `flatten`, which emits the inputs encoded as colors. The square is in the XY plane with U
along X and V along Y, so world-space normals equal tangent-space normals there: red points right, green up. Its side is
the world size of one UV unit on the leaves, because a Bump node gets steeper with smaller sizes. Normals that depend on
the leaf's orientation (object space, vectors from positions) have no meaning on the square and are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np
from numpy.typing import NDArray

from .emission import Builder, Socket, outside_groups
from .flatten import of_single_leaves, render
from .images import Pixels, as_bytes, check_images, is_missing
from .node_links import Port, folded, follow, nodes_behind, number_at, share_at, shown_nodes
from .surface import principled_of, read_surface
from .textures import NotUnderstoodError, Texture, laid_alike, layout_with, texture_of, transform_matrix

USUAL_SPECULAR = 0.5
"""The Specular IOR Level for an index of refraction of 1.5, the default of glTF."""

_ROUGHNESS_METALLIC, _NORMAL = ("Roughness", "Metallic"), ("Normal",)
"""Inputs of a Principled BSDF that share one rendering."""


@dataclass(frozen=True)
class Shading:
    """Shading of one material.

    Roughness is the factor `roughness` times the green channel of `orm`, metallic is the factor `metallic` times the
    blue channel. `normal` is a tangent-space normal map. A texture without an image has yet to be rendered.
    """

    roughness: float = 1.0
    metallic: float = 0.0
    orm: Texture | None = None
    normal: Texture | None = None
    specular: float = USUAL_SPECULAR
    """Specular IOR Level."""
    warnings: tuple[str, ...] = ()

    @property
    def glossy(self) -> bool:
        """Whether lights make visible reflections on it."""
        return self.orm is not None or self.roughness < 0.9 or self.metallic > 0.0


@dataclass(frozen=True)
class Reflection:
    """Roughness and metallic of a tree's leaves: numbers if all are alike, else a material that differs."""

    roughness: float
    metallic: float
    varies: str | None
    """The first glossy material, if materials differ or one has an image or a rendering; else `None`."""
    warnings: tuple[str, ...] = ()
    """Sentences about features that can be neither read nor rendered, or that differ between the materials."""
    specular: float = USUAL_SPECULAR
    """The mean over the materials."""


def reflection_of(materials: Sequence[bpy.types.Material | None]) -> Reflection:
    """Return the roughness and metallic shared by all materials, or a material that differs."""
    shadings = [read_shading(material, read_surface(material).texture) for material in materials]
    first = shadings[0]
    warnings = list(dict.fromkeys(warning for shading in shadings for warning in shading.warnings))
    specular = sum(s.specular for s in shadings) / len(shadings)
    levels = sorted({f"{s.specular:.3g}" for s in shadings})
    if any(s.specular != first.specular for s in shadings):
        differ = f"the leaf materials' Specular IOR Levels ({', '.join(levels)}) differ"
        warnings.append(f"{differ}: the billboards use their mean, {specular:.3g}")
    if {(s.roughness, s.metallic, s.orm) for s in shadings} == {(first.roughness, first.metallic, None)}:
        return Reflection(first.roughness, first.metallic, None, tuple(warnings), specular)
    glossy = (material.name for material, s in zip(materials, shadings, strict=True) if material and s.glossy)
    return Reflection(1.0, 0.0, next(glossy, None), tuple(warnings), specular)


def read_shading(material: bpy.types.Material | None, colors: Texture | None) -> Shading:
    """Read a material's nodes. Images must have the same mapping as `colors`, if the material has color textures."""
    if material is None:
        return Shading()
    principled = principled_of(material)
    if principled is None:
        return Shading(warnings=tuple(_unread(material)))
    shading = Shading()
    for read in (_with_orm, _with_specular, _with_normal):
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


def _with_specular(shading: Shading, principled: Port, _: Texture | None) -> Shading:
    specular = share_at(principled.input("Specular IOR Level"))
    if specular is None:
        raise NotUnderstoodError(f"Specular IOR Level varies; {USUAL_SPECULAR} is used instead")
    return replace(shading, specular=specular)


def _with_orm(shading: Shading, principled: Port, colors: Texture | None) -> Shading:
    rough, metal = (principled.input(name) for name in _ROUGHNESS_METALLIC)
    if _lacks_image([rough, metal]):
        return shading
    roughness, metallic = (share_at(target) for target in (rough, metal))
    if roughness is not None and metallic is not None:
        return replace(shading, roughness=roughness, metallic=metallic)
    channels = [(target, name) for target, name in ((rough, "Green"), (metal, "Blue")) if number_at(target) is None]
    images = {_image_of_channel(target, name) for target, name in channels}
    image = images.pop()
    # The image multiplies both factors, so an input without a link to it can only be 0.
    scaled = (roughness or 0.0) + (metallic or 0.0) > 0.0
    if images or image is None or scaled or not laid_alike(colors, image):
        image = _rendering(
            principled, _ROUGHNESS_METALLIC, colors, "roughness or metallic", "roughness 1 and metallic 0 are used"
        )
        return replace(shading, roughness=1.0, metallic=1.0, orm=image)
    roughness, metallic = (1.0 if factor is None else factor for factor in (roughness, metallic))
    return replace(shading, roughness=roughness, metallic=metallic, orm=image)


def _image_of_channel(target: Port, channel: str) -> Texture | None:
    """Return the image behind a Separate Color node if the input reads its output `channel`; else `None`."""
    source = follow(target)
    if source.kind != "SEPARATE_COLOR" or source.socket.name != channel:
        return None
    return _image(source.inputs()[0])


def _image(target: Port) -> Texture | None:
    """Return the image that feeds an input with its color; `None` for anything else."""
    source = follow(target)
    if source.kind != "TEX_IMAGE" or source.socket.name != "Color":
        return None
    try:
        return texture_of(source)
    except NotUnderstoodError:
        return None


def _with_normal(shading: Shading, principled: Port, colors: Texture | None) -> Shading:
    source = follow(principled.input("Normal"))
    if not source.kind or _lacks_image([principled.input("Normal")]):
        return shading
    node = source.node
    if source.kind == "NORMAL_MAP" and node.space == "TANGENT" and number_at(source.input("Strength")) == 1.0:
        image = _image(source.input("Color"))
        if image is not None and laid_alike(colors, image) and _is_upright(image):
            return replace(shading, normal=image)
    instead = "mesh normals are used"
    if not folded(source, _normals_mixed, _is_of_tangent_space):
        reason = f"normals come from the node {node.name!r}, not from tangent-space maps and bumps"
        raise NotUnderstoodError(f"{reason}; {instead} instead")
    return replace(shading, normal=_rendering(principled, _NORMAL, colors, "normal", instead))


def _lacks_image(targets: Sequence[Port]) -> bool:
    """Return whether an image behind inputs is missing: a plant without it is better than none. `losses` tells it."""
    return any(node.type == "TEX_IMAGE" and is_missing(node.image) for node in nodes_behind(targets))


def _is_upright(image: Texture) -> bool:
    """Return whether the image's axes match those of the UV map. A Normal Map node uses the UV map's axes always."""
    (along_u, across_u, _), (across_v, along_v, _) = transform_matrix(image)
    return bool(along_u > 0.0 and along_v > 0.0 and across_u == across_v == 0.0)


def _normals_mixed(source: Port) -> list[Port]:
    """Return the sources from which a node computes a normal."""
    if source.kind == "BUMP":
        return [follow(source.input("Normal"))]
    if source.kind in {"MIX", "VECT_MATH"}:
        used = (each for each in source.inputs() if each.socket.enabled and each.socket.type in {"VECTOR", "RGBA"})
        return [follow(each) for each in used]
    return []


def _is_of_tangent_space(source: Port, mixed: list[bool]) -> bool:
    """Return whether a normal mixes only surface normals, tangent-space Normal Maps and Bumps."""
    if not source.kind:
        return bool(source.socket.hide_value)  # an unlinked input without a value uses the surface normal
    match source.kind:
        case "NORMAL_MAP":
            return str(source.node.space) == "TANGENT"
        case "NEW_GEOMETRY":
            return source.socket.name in {"Normal", "True Normal"}
    return bool(mixed) and all(mixed)


def _rendering(principled: Port, names: Sequence[str], colors: Texture | None, what: str, instead: str) -> Texture:
    """Return the UV mapping of a rendering of these inputs. Raises `NotUnderstoodError` if they cannot be rendered."""
    try:
        return layout_with(colors, nodes_behind([principled.input(name) for name in names]))
    except NotUnderstoodError as reason:
        raise NotUnderstoodError(f"{what} {reason}; {instead} instead") from reason


def render_orm(material: bpy.types.Material, layout: Texture, size: float) -> tuple[Pixels, str]:
    """Render roughness to green and metallic to blue. Otherwise like `render_normals`."""
    values, said = _render(material, _ROUGHNESS_METALLIC, layout, size)
    said = f"its roughness and metallic are neither constants nor channels of one image; they are rendered {said}"
    return as_bytes(values), f"material {material.name!r}: {said}"


def render_normals(material: bpy.types.Material, layout: Texture, size: float) -> tuple[Pixels, str]:
    """Render normals to a tangent-space normal map (h, w, 4). Return also a sentence for the report.

    `layout`: the texture that `read_shading` found. `size`: the world size of one UV unit.
    Raises `SceneError` for an image without pixels, or when Cycles fails.
    """
    values, said = _render(material, _NORMAL, layout, size)
    normals = 2.0 * values[..., :3] - 1.0  # means of a texel's samples, so not of unit length
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), (0.0, 0.0, 1.0))
    codes = np.concatenate([0.5 * normals + 0.5, values[..., 3:]], axis=2)
    said = f"its normals are more than a tangent-space map of strength 1; they are rendered {said}"
    return as_bytes(codes), f"material {material.name!r}: {said}"


def _render(
    material: bpy.types.Material, names: Sequence[str], layout: Texture, size: float
) -> tuple[NDArray[np.float32], str]:
    """Return (h, w, 4) inputs of the Principled BSDF encoded as a color, and a description of the rendering."""
    principled = principled_of(material)
    assert principled is not None  # without one there is no layout
    nodes = nodes_behind([principled.input(name) for name in names])
    check_images(nodes, material.name)
    values = render(material, nodes, partial(_emission, names=names), transform=layout.transform, size=size)
    said = f"to an image of {len(values)} × {len(values)} texels"
    if layout.extension != "REPEAT":
        said += ", which repeats outside [0, 1]"
    if lost := of_single_leaves(nodes):
        said += f", so per-leaf variation from {' and '.join(lost)} is dropped"
    return values, f"{said}; glTF level 0 uses Blender's own material export"


def _emission(copy: bpy.types.Material, names: Sequence[str]) -> Socket:
    """Add a shader that emits inputs of the Principled BSDF, which may be inside groups, encoded as a color."""
    principled = principled_of(copy)
    assert principled is not None  # the original has one
    builder = Builder(principled.socket.id_data)
    values = [builder.read(principled.node.inputs[name]) for name in names]
    if names == _NORMAL:
        halved = builder.vector("SCALE", builder.vector("NORMALIZE", *values), 0.5)
        color = builder.vector("ADD", halved, (0.5, 0.5, 0.5))
    else:
        # Clamp before averaging: Cycles clamps roughness and metallic to [0, 1] at each sample.
        color = builder.result("ShaderNodeCombineXYZ", 1.0, *(builder.math("ADD", v, 0.0, clamp=True) for v in values))
    return outside_groups(principled, builder.emission(color))
