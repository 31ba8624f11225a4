"""Renderings of roughness, metallic and normals for materials whose nodes cannot be read as images.

The rendering has the same UV mapping as the base color. Cycles renders the square of `flatten`, which emits the inputs
of the Principled BSDF, encoded as colors. The square is in the XY plane with U along X and V along Y, so world-space
normals equal tangent-space normals there: red points right, green up. Its side is the world size of one UV unit on the
leaves, because a Bump node gets steeper with smaller sizes.

Normals that depend on the leaf's orientation (object space, vectors from positions) have no meaning on the square and
are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..mesh.extract import Geometry, texture_uvs, world_positions
from .flatten import cycles_errors, of_single_leaves, own_copy, rendered, scratch_scene, show, side_of, square
from .images import check_readable
from .node_links import Input, Output, folded, follow, nodes_behind
from .shader_sums import Builder, shining
from .surface import principled_of
from .textures import NotUnderstoodError, Texture, repeats, texture_of, uv_maps

GLOSS = ("Roughness", "Metallic")
NORMAL = ("Normal",)
"""Inputs of a Principled BSDF that share one rendering."""


@dataclass(frozen=True)
class Rendering:
    """A rendering as data. pixels: (h, w, 4) 8-bit values, row 0 on top. said: a sentence for the report."""

    pixels: NDArray[np.uint8]
    said: str


def rendering_of(principled: Output, names: Sequence[str], colors: Texture | None) -> Texture:
    """Return the UV mapping of a rendering of these inputs. Raises `NotUnderstoodError` if they cannot be rendered."""
    return rendering_over(nodes_behind([principled.input(name) for name in names]), colors)


def rendering_over(nodes: Sequence[bpy.types.Node], colors: Texture | None) -> Texture:
    """Return the UV mapping of a rendering of these nodes. It equals that of the colors, because a mesh has only one.

    Raises `NotUnderstoodError` for nodes that cannot be rendered, or that use another mapping.
    """
    layout = replace(colors or Texture(None), image=None)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    missing = [node.name for node in images if node.image is None]
    if missing:
        raise NotUnderstoodError(f"depends on the node {missing[0]!r}, which has no image")
    others = sorted(uv_maps(nodes) - {layout.uv_map})
    if others:
        raise NotUnderstoodError(f"uses {_named(others[0])}, but the base color uses {_named(layout.uv_map)}")
    moved = layout.transform != Texture.transform
    if moved and not all(_moved_alike(node, layout) for node in images):
        raise NotUnderstoodError("and the base color use different Mapping nodes")
    if np.linalg.det(np.reshape(layout.transform, (2, 3))[:, :2]) == 0.0:
        raise NotUnderstoodError("uses a Mapping node with scale 0")
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
    """Return whether a normal mixes only surface normals, tangent-space Normal Maps and Bumps."""
    return folded(target, _normals_used, _is_of_tangent_space)


def _normals_used(target: Input) -> list[Input]:
    """Return the inputs from which a node computes a normal."""
    source = follow(target)
    if isinstance(source, Output) and source.node.type == "BUMP":
        return [source.input("Normal")]
    if isinstance(source, Output) and source.node.type in {"MIX", "VECT_MATH"}:
        return [each for each in source.inputs() if each.socket.enabled and each.socket.type in {"VECTOR", "RGBA"}]
    return []


def _is_of_tangent_space(target: Input, used: list[bool]) -> bool:
    source = follow(target)
    if isinstance(source, Input):
        return source.socket.hide_value  # an unlinked input without a value uses the surface normal
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
    """Return (materials,) the mean world size of one UV unit by material; 1 for a material without area or UV area."""
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
    """Render roughness to green and metallic to blue. Otherwise like `render_normals`."""
    values, said = _render(material, GLOSS, layout, size, _gloss_codes)
    said = f"roughness and metallic are neither constants nor channels of one image; they are rendered {said}"
    return Rendering(_bytes(values), f"material {material.name!r}: its {said}")


def render_normals(material: bpy.types.Material, layout: Texture, size: float) -> Rendering:
    """Render normals to a tangent-space normal map. `layout` is from `rendering_of`, `size` from `unit_sizes`.

    Raises `SceneError` for an image without pixels, or when Cycles fails.
    """
    values, said = _render(material, NORMAL, layout, size, _normal_codes)
    normals = 2.0 * values - 1.0  # means of a texel's samples, so not of unit length
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    up = np.array([0.0, 0.0, 1.0], np.float32)
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), up)
    said = f"normals are more than a tangent-space map of strength 1; they are rendered {said}"
    return Rendering(_bytes(0.5 * normals + 0.5), f"material {material.name!r}: its {said}")


def _render(
    material: bpy.types.Material,
    names: Sequence[str],
    layout: Texture,
    size: float,
    codes: Callable[[Builder, bpy.types.Node], bpy.types.NodeSocket],
) -> tuple[NDArray[np.float32], str]:
    """Return (h, w, 3) the rendered values that `codes` builds, and a description of the rendering."""
    principled = principled_of(material)
    assert principled is not None  # without one there is no layout
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
    said = f"to an image of {len(pixels)} × {len(pixels)} texels"
    if layout.extension != "REPEAT":
        said += ", which repeats outside [0, 1]"
    if lost := of_single_leaves(nodes):
        said += f", so per-leaf variation from {' and '.join(lost)} is dropped"
    return pixels[..., :3], f"{said}; glTF level 0 uses Blender's own material export"


@contextmanager
def _shining_codes(
    material: bpy.types.Material, codes: Callable[[Builder, bpy.types.Node], bpy.types.NodeSocket]
) -> Iterator[bpy.types.Material]:
    """Yield a copy that emits what `codes` builds from its Principled BSDF, which may be inside groups."""
    with own_copy(material) as copy:
        principled = principled_of(copy)
        assert principled is not None  # the original has one
        builder = Builder(principled.socket.id_data)
        color = codes(builder, principled.node)
        for group in reversed(principled.groups):
            color = builder.handed_out(group, color, "NodeSocketColor")
            builder = Builder(group.id_data)
        show(copy.node_tree, shining(builder, color, 1.0))
        yield copy


def _gloss_codes(builder: Builder, principled: bpy.types.Node) -> bpy.types.NodeSocket:
    # Clamp before averaging: Cycles clamps roughness and metallic to [0, 1] at each sample.
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
    """Convert (h, w, 3) values to (h, w, 4) opaque 8-bit values."""
    opaque = np.concatenate([values, np.ones_like(values[..., :1])], axis=2)
    return np.rint(np.clip(opaque, 0.0, 1.0) * 255.0).astype(np.uint8)
