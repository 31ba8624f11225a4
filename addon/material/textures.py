"""Reader of a material's image textures and their UV mapping: UV map, wrapping, Mapping nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from .node_links import Port, follow, nodes_behind, sources_behind, trees_of

ACTIVE = ""
"""Name for the render-active UV map or color attribute."""


class NotUnderstoodError(Exception):
    """A part of a material that the readers do not support. The message follows a subject like "its base color"."""


@dataclass(frozen=True)
class Texture:
    """An image and its UV mapping."""

    image: bpy.types.Image | None
    """`None` for a rendering that has yet to be made."""
    uv_map: str = ACTIVE
    extension: str = "REPEAT"
    """Wrapping outside [0, 1]: REPEAT, EXTEND, CLIP, MIRROR, or MIXED for any other wrapping."""
    transform: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    """(2, 3) by rows: transform from the UV map's coordinates to the image's."""

    @property
    def words(self) -> str:
        return "its rendering" if self.image is None else f"the image {self.image.name!r}"


def transform_matrix(texture: Texture | None) -> NDArray[np.float64]:
    """Return (2, 3) the transform from the UV map's coordinates to the image's; the identity without a texture."""
    return np.array(Texture.transform if texture is None else texture.transform).reshape(2, 3)


def laid_alike(colors: Texture | None, texture: Texture) -> bool:
    """Return whether a texture has the same UV mapping as the colors; without colors, the default mapping."""
    return replace(colors or Texture(None), image=texture.image) == texture


def texture_of(source: Port) -> Texture:
    """Return the image of an Image Texture node and its UV mapping. Raises `NotUnderstoodError`."""
    node = source.node
    if node.image is None:
        raise NotUnderstoodError(f"comes from the node {node.name!r}, which has no image")
    if node.projection != "FLAT" or node.image.source not in {"FILE", "GENERATED"}:
        kind = f"{node.image.source.lower()}, {node.projection.lower()} projection"
        raise NotUnderstoodError(f"comes from the image {node.image.name!r} ({kind})")
    return _laid(Texture(node.image, extension=node.extension), source.input("Vector"))


def _laid(texture: Texture, coordinates: Port) -> Texture:
    """Return the texture with the UV map, wrapping and transform from the nodes behind `coordinates`."""
    while (source := follow(coordinates)).kind:
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


def _wrapped(combine: Port) -> Port | None:
    """Return the vector behind the glTF importer's nodes that wrap u and v separately; else `None`.

    The nodes are Separate XYZ, Math (Wrap or Ping-Pong) and Combine XYZ.
    """
    separated: list[Port] = []
    for target in combine.inputs()[:2]:
        source = follow(target)
        if source.kind == "MATH" and source.node.operation in {"WRAP", "PINGPONG"}:
            source = follow(source.inputs()[0])
        separated.append(source)
    u, v = separated
    apart = u.kind == "SEPXYZ" and u.node == v.node and (u.socket.name, v.socket.name) == ("X", "Y")
    return u.input("Vector") if apart else None


def _mapping(source: Port) -> tuple[float, ...]:
    """Return (2, 3) by rows the transform of a Mapping node of type Point: scale, then rotation, then translation."""
    location, rotation, scale = (source.input(name) for name in ("Location", "Rotation", "Scale"))
    if any(follow(target).kind for target in (location, rotation, scale)):
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


def layout_of(targets: Sequence[Port]) -> Texture:
    """Return the UV mapping to render these inputs with: the UV map of their first image, else the first UV map."""
    sources = sources_behind(targets)
    nodes = [source.node for source in sources]
    image = next((source for source in sources if source.kind == "TEX_IMAGE"), None)
    maps = uv_maps(nodes if image is None else nodes_behind([image.input("Vector")]))
    plain = _repeats(nodes) and not any(node.type == "MAPPING" for node in nodes)
    return Texture(None, maps[0] if maps else ACTIVE, "REPEAT" if plain else "MIXED")


def layout_with(colors: Texture | None, nodes: Sequence[bpy.types.Node]) -> Texture:
    """Return the UV mapping of a rendering of nodes. It equals that of the colors, because a mesh has only one.

    Raises `NotUnderstoodError` for nodes that cannot be rendered, or that use another mapping.
    """
    layout = replace(colors or Texture(None), image=None)
    images = [node for node in nodes if node.type == "TEX_IMAGE"]
    missing = [node.name for node in images if node.image is None]
    if missing:
        raise NotUnderstoodError(f"depends on the node {missing[0]!r}, which has no image")
    others = sorted({*uv_maps(nodes)} - {layout.uv_map})
    if others:
        raise NotUnderstoodError(f"uses {_named(others[0])}, but the base color uses {_named(layout.uv_map)}")
    moved = layout.transform != Texture.transform
    if moved and not all(_is_moved_like(node, layout) for node in images):
        raise NotUnderstoodError("and the base color use different Mapping nodes")
    if np.linalg.det(np.reshape(layout.transform, (2, 3))[:, :2]) == 0.0:
        raise NotUnderstoodError("uses a Mapping node with scale 0")
    plain = _repeats(nodes) and (moved or not any(node.type == "MAPPING" for node in nodes))
    return replace(layout, extension="REPEAT" if plain else "MIXED")


def _named(uv_map: str) -> str:
    return f"the UV map {uv_map!r}" if uv_map else "the active UV map"


def _is_moved_like(image: bpy.types.Node, layout: Texture) -> bool:
    try:
        return texture_of(Port(image.outputs["Color"])).transform == layout.transform
    except NotUnderstoodError:
        return False


def repeats(material: bpy.types.Material | None) -> bool:
    """Return whether the material looks the same where all its texture coordinates differ by whole numbers."""
    trees = [] if material is None or material.node_tree is None else trees_of(material.node_tree)
    nodes = [node for tree in trees for node in tree.nodes]
    return _repeats(nodes) and all(_maps_whole_numbers(node) for node in nodes if node.type == "MAPPING")


def _maps_whole_numbers(mapping: bpy.types.Node) -> bool:
    """Return whether a Mapping node moves coordinates by whole numbers if its input moves by whole numbers."""
    try:
        linear = np.reshape(_mapping(Port(mapping.outputs["Vector"])), (2, 3))[:, :2]
    except NotUnderstoodError:
        return False
    return mapping.vector_type == "POINT" and bool((linear == linear.round()).all())


def _repeats(nodes: Sequence[bpy.types.Node]) -> bool:
    """Return whether the nodes' result over [0, 1]² repeats outside it, before Mapping nodes apply."""
    images = all(node.extension == "REPEAT" for node in nodes if node.type == "TEX_IMAGE")
    return images and all(
        link.to_node.type in {"TEX_IMAGE", "MAPPING", "REROUTE"}
        for node in nodes
        for output in node.outputs
        if uv_map_of(output) is not None
        for link in output.links
    )


def uv_maps(nodes: Iterable[bpy.types.Node]) -> list[str]:
    """Return the names of the UV maps that nodes use, in their order; `ACTIVE` for the render-active one."""
    names: list[str | None] = []
    for node in nodes:
        names += [uv_map_of(output) for output in node.outputs if output.is_linked]
        names += [ACTIVE] if node.type == "TEX_IMAGE" and not node.inputs["Vector"].is_linked else []
    return list(dict.fromkeys(name for name in names if name is not None))


def uv_map_of(output: bpy.types.NodeSocket) -> str | None:
    """Return the UV map that an output gives, else `None`. The Vector of an Attribute node counts as a UV map."""
    node = output.node
    match node.type:
        case "UVMAP":
            return str(node.uv_map)
        case "TEX_COORD" if output.name == "UV":
            return ACTIVE
        case "ATTRIBUTE" if output.name == "Vector" and node.attribute_type == "GEOMETRY":
            return str(node.attribute_name)
    return None
