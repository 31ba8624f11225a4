"""Image textures of a material's nodes, and how each lies on the mesh: UV map, wrapping, Mapping nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from .node_links import Input, Links, Output, follow

ACTIVE = ""
"""As the name of a UV map or color attribute: the one that the mesh renders with."""


class NotUnderstoodError(Exception):
    """Words that follow "its base colour"."""


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


def transform_matrix(texture: Texture | None) -> NDArray[np.float64]:
    """(2, 3) the map from the UV map's coordinates to the image's; the identity without a texture."""
    return np.array(Texture.transform if texture is None else texture.transform).reshape(2, 3)


def laid_alike(first: Texture, second: Texture) -> bool:
    """Whether two images lie on the mesh in the same way."""
    return replace(first, image=second.image) == second


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


def map_behind(image: bpy.types.Node) -> str:
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
