"""One mesh for each level in GLB files: the trunk's primitives follow those of the leaves.

Engines take one mesh for a level: a MultiMesh, a LODGroup or a static mesh with levels has no room for a second object.
Blender needs two, because only the leaves have modifiers.

`extras.leafcloud.first_trunk_primitive` of the mesh is the number of the first primitive of the trunk. All primitives
of a mesh need equally many morph targets: those of the trunk are zeros.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh.baked_levels import EXTRAS
from .glb_file import ARRAY_BUFFER, FLOAT, Glb
from .glb_nodes import node_matrix

FIRST_TRUNK = "first_trunk_primitive"


def join_trunks(glb: Glb) -> None:
    """Move the meshes below each level's node into the level's mesh, and remove their nodes."""
    nodes = glb.document.get("nodes", [])
    levels = [node for node in nodes if _is_level(node)]
    trunks = [(level, _trunks_of(nodes, level)) for level in levels]
    gone = {number for _, found in trunks for number in found}
    if not gone:
        return
    join = _Join(glb, [nodes[number] for number in gone])
    for level, found in trunks:
        for number in found:
            join.add(nodes[number], level)
    _remove_nodes(glb, gone)


def _is_level(node: dict[str, Any]) -> bool:
    return "mesh" in node and "level" in node.get("extras", {}).get(EXTRAS, {})


def _trunks_of(nodes: Sequence[dict[str, Any]], level: dict[str, Any]) -> list[int]:
    """Return the numbers of the nodes below `level` that have a mesh and nothing below them."""
    below = level.get("children", [])
    return [n for n in below if "mesh" in nodes[n] and not _is_level(nodes[n]) and not nodes[n].get("children")]


class _Join:
    """Moves trunks into the meshes of levels. Levels often share a trunk: each of its accessors is placed once."""

    def __init__(self, glb: Glb, trunks: Sequence[dict[str, Any]]) -> None:
        self._glb = glb
        self._placed: dict[tuple[int, bytes], int] = {}
        vertices = [self._vertices(primitive) for trunk in trunks for primitive in self._primitives(trunk)]
        self._zeros = glb.append_view(bytes(12 * max(vertices)), target=ARRAY_BUFFER, byteStride=12)

    def add(self, trunk: dict[str, Any], level: dict[str, Any]) -> None:
        """Append the primitives of a trunk's node to those of its level."""
        mesh, matrix = self._glb.document["meshes"][level["mesh"]], node_matrix(trunk)
        morphs = len(mesh["primitives"][0].get("targets", []))
        mesh.setdefault("extras", {}).setdefault(EXTRAS, {}).setdefault(FIRST_TRUNK, len(mesh["primitives"]))
        for primitive in self._primitives(trunk):
            moved = self._in_level(primitive, matrix)
            if morphs:
                moved["targets"] = [{"POSITION": self._still(primitive)} for _ in range(morphs)]
            mesh["primitives"].append(moved)

    def _primitives(self, node: dict[str, Any]) -> list[dict[str, Any]]:
        primitives: list[dict[str, Any]] = self._glb.document["meshes"][node["mesh"]]["primitives"]
        return primitives

    def _vertices(self, primitive: dict[str, Any]) -> int:
        return int(self._glb.document["accessors"][primitive["attributes"]["POSITION"]]["count"])

    def _still(self, primitive: dict[str, Any]) -> int:
        """Append a morph target of zeros. All of them share one buffer view."""
        zeros = {"bufferView": self._zeros, "componentType": FLOAT, "count": self._vertices(primitive), "type": "VEC3"}
        self._glb.document["accessors"].append({**zeros, "min": [0.0] * 3, "max": [0.0] * 3})
        return len(self._glb.document["accessors"]) - 1

    def _in_level(self, primitive: dict[str, Any], matrix: NDArray[np.float64]) -> dict[str, Any]:
        """Return a copy of the primitive in the level's coordinates. `matrix` (4, 4) is that of the trunk's node."""
        moved = {**primitive, "attributes": dict(primitive["attributes"])}
        if np.array_equal(matrix, np.eye(4)):
            return moved
        for values, name in _changed(moved, matrix):
            key = values[name], matrix.tobytes()
            if key not in self._placed:
                self._placed[key] = self._append(name, self._glb.values(values[name]), matrix)
            values[name] = self._placed[key]
        return moved

    def _append(self, name: str, values: NDArray[Any], matrix: NDArray[np.float64]) -> int:
        if name == "indices":
            return self._glb.append_indices(values.reshape(-1, 3)[:, ::-1])
        if name != "POSITION":
            return self._glb.append_accessor(_turned(name, values, matrix[:3, :3]))
        number = self._glb.append_accessor(values.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
        places = self._glb.values(number)
        self._glb.document["accessors"][number] |= {
            "min": places.min(axis=0).tolist(),
            "max": places.max(axis=0).tolist(),
        }
        return number


def _changed(primitive: dict[str, Any], matrix: NDArray[np.float64]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield the references to accessors that the transform changes; a mirror turns the triangles over."""
    attributes = primitive["attributes"]
    yield from ((attributes, name) for name in ("POSITION", "NORMAL", "TANGENT") if name in attributes)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        yield primitive, "indices"


def _turned(name: str, values: NDArray[Any], linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return normals (v, 3) or tangents (v, 4) after a transform, of unit length. A mirror changes the sign of w."""
    turn = np.linalg.inv(linear).T if name == "NORMAL" else linear
    directions = values[:, :3].astype(np.float64) @ turn.T
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-30)
    return np.hstack([directions, values[:, 3:] * np.sign(np.linalg.det(linear))])


def _remove_nodes(glb: Glb, gone: set[int]) -> None:
    """Remove nodes, the meshes that only they use, and what only these meshes use."""
    document = glb.document
    nodes = [node for number, node in enumerate(document["nodes"]) if number not in gone]
    places = _places(range(len(document["nodes"])), gone)
    used = {node["mesh"] for node in nodes if "mesh" in node}
    meshes = _places(range(len(document["meshes"])), set(range(len(document["meshes"]))) - used)
    for node in nodes:
        if children := [places[child] for child in node.pop("children", []) if child in places]:
            node["children"] = children
        if "mesh" in node:
            node["mesh"] = meshes[node["mesh"]]
    for scene in document["scenes"]:
        scene["nodes"] = [places[number] for number in scene.get("nodes", [])]
    document["nodes"] = nodes
    document["meshes"] = [document["meshes"][number] for number in meshes]
    glb.remove_unused()


def _places(numbers: range, gone: set[int]) -> dict[int, int]:
    """Return the new number of each that stays, by its old one."""
    return {number: place for place, number in enumerate(sorted({*numbers} - gone))}
