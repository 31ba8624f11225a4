"""Small reader of GLB files by the specification, without code of the add-on that writes them."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class Primitive:
    """Triangles of one material.

    `indices` is (t, 3). Attributes and morph targets are (v, …) by name, as stored in the file.
    """

    material: dict[str, Any]
    indices: NDArray[np.int64]
    attributes: dict[str, NDArray[np.generic]]
    targets: list[dict[str, NDArray[np.generic]]]


@dataclass(frozen=True)
class Node:
    """A node with the primitives of its mesh, leaves and trunk apart. `matrix` (4, 4) takes them to world space."""

    name: str
    matrix: NDArray[np.float64]
    extras: dict[str, Any]
    mesh_extras: dict[str, Any]
    primitives: list[Primitive]
    trunk: list[Primitive] = field(default_factory=list)
    children: list[str] = field(default_factory=list)

    def to_world(self, points: NDArray[np.generic]) -> NDArray[np.float64]:
        return points.astype(np.float64) @ self.matrix[:3, :3].T + self.matrix[:3, 3]


def read_glb(path: Path) -> dict[str, Node]:
    """Return all nodes of the file by name, including nodes outside of all scenes."""
    content, binary = read_chunks(path)
    inner = {child for node in content["nodes"] for child in node.get("children", ())}
    return _nodes(content, binary, [number for number in range(len(content["nodes"])) if number not in inner])


def read_scene(path: Path) -> dict[str, Node]:
    """Return the nodes of the default scene by name. A reader without extensions draws these."""
    content, binary = read_chunks(path)
    return _nodes(content, binary, content["scenes"][content["scene"]]["nodes"])


def read_chunks(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON document and the binary chunk of the file."""
    data = path.read_bytes()
    magic, _, length = struct.unpack_from("<4sII", data)
    assert magic == b"glTF"
    assert length == len(data)
    json_length, _ = struct.unpack_from("<I4s", data, 12)
    return json.loads(data[20 : 20 + json_length]), data[20 + json_length + 8 :]


def rewritten(source: Path, path: Path, edit: Callable[[dict[str, Any], bytearray], None]) -> Path:
    """Write a GLB file with an edited document and body."""
    document, binary = read_chunks(source)
    body = bytearray(binary)
    edit(document, body)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def _nodes(content: dict[str, Any], binary: bytes, roots: list[int]) -> dict[str, Node]:
    nodes: dict[str, Node] = {}

    def visit(index: int, parent: NDArray[np.float64]) -> None:
        node = content["nodes"][index]
        matrix = parent @ _matrix(node)
        mesh = content["meshes"][node["mesh"]] if "mesh" in node else {}
        primitives = [_primitive(content, binary, primitive) for primitive in mesh.get("primitives", ())]
        children = [content["nodes"][child]["name"] for child in node.get("children", ())]
        extras = node.get("extras", {})
        own = mesh.get("extras", {})
        first = own.get("leafcloud", {}).get("first_trunk_primitive", len(primitives))
        nodes[node["name"]] = Node(node["name"], matrix, extras, own, primitives[:first], primitives[first:], children)
        for child in node.get("children", ()):
            visit(child, matrix)

    for root in roots:
        visit(root, np.eye(4))
    return nodes


def _matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _primitive(content: dict[str, Any], binary: bytes, primitive: dict[str, Any]) -> Primitive:
    def read(index: int) -> NDArray[np.generic]:
        return _accessor(content, binary, index)

    return Primitive(
        material=content["materials"][primitive["material"]] if "material" in primitive else {},
        indices=read(primitive["indices"]).astype(np.int64).reshape(-1, 3),
        attributes={name: read(index) for name, index in primitive["attributes"].items()},
        targets=[{name: read(index) for name, index in target.items()} for target in primitive.get("targets", ())],
    )


def _accessor(content: dict[str, Any], binary: bytes, index: int) -> NDArray[np.generic]:
    accessor = content["accessors"][index]
    view = content["bufferViews"][accessor["bufferView"]]
    assert "sparse" not in accessor
    width = _WIDTHS[accessor["type"]]
    assert view.get("byteStride", 4 * width) == 4 * width
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(binary, _COMPONENTS[accessor["componentType"]], accessor["count"] * width, start)
    return values if width == 1 else values.reshape(-1, width)
