"""Gloss and normals that are no plain images: what feeds a Principled BSDF, rendered as data where its colours lie.

Cycles renders the square of `flatten`, which shines with the inputs' codes. It lies in the plane of X and Y with its
texture coordinates along them: a normal in the world is one of tangent space there, red to the right, green up. It is
as large as one unit of texture coordinates is on the leaves, for a Bump node is the steeper the smaller that is.

Normals that depend on how a leaf lies (object space, vectors by position) mean nothing on the square, and are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .extract import Geometry, texture_uvs, world_positions
from .flatten import (
    cycles_errors,
    of_single_leaves,
    own_copy,
    rendered,
    scratch_scene,
    show,
    side_of,
    square,
)
from .images import check_readable
from .node_links import Input, Output, folded, follow, nodes_behind
from .shader_sums import Builder, shining
from .surface import principled_of
from .textures import NotUnderstoodError, Texture, repeats, texture_of, uv_maps

GLOSS = ("Roughness", "Metallic")
NORMAL = ("Normal",)
"""The inputs of a Principled BSDF that are rendered together."""


@dataclass(frozen=True)
class Rendering:
    """pixels: (h, w, 4) the codes, row 0 on top. said: a sentence for the report."""

    pixels: NDArray[np.uint8]
    said: str


def rendering_of(principled: Output, names: Sequence[str], colors: Texture | None) -> Texture:
    """How a rendering of these inputs lies on the mesh. Raises `NotUnderstoodError` where it cannot be made."""
    return rendering_over(nodes_behind([principled.input(name) for name in names]), colors)


def rendering_over(nodes: Sequence[bpy.types.Node], colors: Texture | None) -> Texture:
    """How a rendering of these nodes lies on the mesh: like the colours, which have its only texture coordinates.

    Raises `NotUnderstoodError` for nodes that cannot be rendered, or lie elsewhere.
    """
    layout = replace(colors or Texture(None), image=None)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    missing = [node.name for node in images if node.image is None]
    if missing:
        raise NotUnderstoodError(f"depends on the node {missing[0]!r}, which has no image")
    others = sorted(uv_maps(nodes) - {layout.uv_map})
    if others:
        raise NotUnderstoodError(f"lies on {_named(others[0])} and the base colour on {_named(layout.uv_map)}")
    moved = layout.transform != Texture.transform
    if moved and not all(_moved_alike(node, layout) for node in images):
        raise NotUnderstoodError("and the base colour go through different Mapping nodes")
    if np.linalg.det(np.reshape(layout.transform, (2, 3))[:, :2]) == 0.0:
        raise NotUnderstoodError("goes through a Mapping node of scale 0")
    plain = repeats(nodes) and (moved or not any(node.type == "MAPPING" for node in nodes))
    return replace(layout, extension="REPEAT" if plain else "MIXED")


def _named(uv_map: str) -> str:
    return f"the UV map {uv_map!r}" if uv_map else "the active UV map"


def _moved_alike(image: bpy.types.Node, layout: Texture) -> bool:
    try:
        return texture_of(Output(image.outputs["Color"])).transform == layout.transform
    except NotUnderstoodError:
        return False


def is_of_tangent_space(target: Input) -> bool:
    """Whether a normal is that of the surface, turned by Normal Maps of tangent space and Bumps, or a mix of such."""
    return folded(target, _normals_used, _is_of_tangent_space)


def _normals_used(target: Input) -> list[Input]:
    """The inputs that a node makes a normal of."""
    source = follow(target)
    if isinstance(source, Output) and source.node.type == "BUMP":
        return [source.input("Normal")]
    if isinstance(source, Output) and source.node.type in {"MIX", "VECT_MATH"}:
        return [each for each in source.inputs() if each.socket.enabled and each.socket.type in {"VECTOR", "RGBA"}]
    return []


def _is_of_tangent_space(target: Input, used: list[bool]) -> bool:
    source = follow(target)
    if isinstance(source, Input):
        return source.socket.hide_value  # which stands for the surface's own
    node = source.node
    match node.type:
        case "NORMAL_MAP":
            return str(node.space) == "TANGENT"
        case "NEW_GEOMETRY":
            return source.socket.name in {"Normal", "True Normal"}
        case "BUMP" | "MIX" | "VECT_MATH":
            return all(used)
    return False


def unit_sizes(geometry: Geometry, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """(materials,) how long one unit of the images' coordinates is in the world, in the mean; 1 where there is none."""
    count = len(geometry.materials)
    uvs = texture_uvs(geometry)
    if uvs is None:
        return np.ones(count)
    corners = world_positions(geometry, matrix)[geometry.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    (u1, v1), (u2, v2) = ((uvs[:, i] - uvs[:, 0]).T.astype(np.float64) for i in (1, 2))
    of_materials, of_uvs = (
        np.bincount(geometry.material_ids, weights, count) for weights in (area, np.abs(u1 * v2 - u2 * v1))
    )
    known = (of_materials > 0.0) & (of_uvs > 0.0)
    return np.sqrt(np.divide(of_materials, of_uvs, out=np.ones(count), where=known))


def render_gloss(material: bpy.types.Material, layout: Texture, size: float) -> Rendering:
    """Roughness in green, metallic in blue. As `render_normals`."""
    values, said = _render(material, GLOSS, layout, size, _gloss_codes)
    said = f"roughness and metallic are no constants or channels of one image; they are rendered {said}"
    return Rendering(_bytes(values), f"material {material.name!r}: its {said}")


def render_normals(material: bpy.types.Material, layout: Texture, size: float) -> Rendering:
    """Normals as in an image of them. `layout` as of `rendering_of`, `size` as of `unit_sizes`.

    Raises `SceneError` for an image without pixels, and when Cycles does not render.
    """
    values, said = _render(material, NORMAL, layout, size, _normal_codes)
    normals = 2.0 * values - 1.0  # the mean of a texel's samples
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    up = np.array([0.0, 0.0, 1.0], np.float32)
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), up)
    said = f"normals are no plain tangent-space map of strength 1; they are rendered {said}"
    return Rendering(_bytes(0.5 * normals + 0.5), f"material {material.name!r}: its {said}")


def _render(
    material: bpy.types.Material,
    names: Sequence[str],
    layout: Texture,
    size: float,
    codes: Callable[[Builder, bpy.types.Node], bpy.types.NodeSocket],
) -> tuple[NDArray[np.float32], str]:
    """(h, w, 3) what the codes are, and how they were rendered."""
    principled = principled_of(material)
    assert principled is not None  # else there is no layout
    nodes = nodes_behind([principled.input(name) for name in names])
    for node in nodes:
        if node.type == "TEX_IMAGE":
            check_readable(node.image, material.name)
    with cycles_errors(material), _shining_codes(material, codes) as shown, scratch_scene() as scene:
        mesh = square(nodes, layout.transform)
        mesh.materials.append(shown)
        try:
            pixels = rendered(scene, mesh, side_of(nodes), size)
        finally:
            bpy.data.meshes.remove(mesh)
    said = f"to an image of {len(pixels)} texels a side"
    if layout.extension != "REPEAT":
        said += ", which repeats outside of [0, 1]"
    if lost := of_single_leaves(nodes):
        said += f", so what the nodes {' and '.join(lost)} say of single leaves is lost"
    return pixels[..., :3], f"{said}; the leaves' own material in glTF is what Blender's exporter reads of it"


@contextmanager
def _shining_codes(
    material: bpy.types.Material, codes: Callable[[Builder, bpy.types.Node], bpy.types.NodeSocket]
) -> Iterator[bpy.types.Material]:
    """A copy that shines with what `codes` makes of its Principled BSDF, which may be in groups."""
    with own_copy(material) as copy:
        principled = principled_of(copy)
        assert principled is not None  # as of the material
        builder = Builder(principled.socket.id_data)
        color = codes(builder, principled.node)
        for group in reversed(principled.groups):
            color = builder.handed_out(group, color, "NodeSocketColor")
            builder = Builder(group.id_data)
        show(copy.node_tree, shining(builder, color, 1.0))
        yield copy


def _gloss_codes(builder: Builder, principled: bpy.types.Node) -> bpy.types.NodeSocket:
    # Samples are cut before they are averaged: Cycles shades with values between 0 and 1.
    roughness, metallic = (_within(builder, builder.read(principled.inputs[name])) for name in GLOSS)
    both = builder.tree.nodes.new("ShaderNodeCombineXYZ")
    for target, value in zip(both.inputs, (1.0, roughness, metallic), strict=True):
        builder.connect(value, target)
    return both.outputs[0]


def _within(builder: Builder, value: Any) -> bpy.types.NodeSocket:
    return builder.math("MINIMUM", builder.math("MAXIMUM", value, 0.0), 1.0)


def _normal_codes(builder: Builder, principled: bpy.types.Node) -> bpy.types.NodeSocket:
    normal = builder.read(principled.inputs["Normal"])
    halved = builder.scaled(builder.vector("NORMALIZE", normal, 0.0), 0.5)
    return builder.vector("ADD", halved, (0.5, 0.5, 0.5))


def _bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(h, w, 4) opaque codes of (h, w, 3) values."""
    opaque = np.concatenate([values, np.ones_like(values[..., :1])], axis=2)
    return np.rint(np.clip(opaque, 0.0, 1.0) * 255.0).astype(np.uint8)
