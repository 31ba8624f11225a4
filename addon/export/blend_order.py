"""Draw order of alpha-blended clouds in GLB files.

Engines draw the triangles of a mesh in the order of its indices. No order of whole billboards is correct, because they
cross one another. The order of their pieces depends on the eye. So the triangles of each cloud's primitive are cut
where they cross (`leafcloud.blend_order`), and all vertex attributes are interpolated. The mesh's extras hold a binary
space partition (BSP) for each primitive:

    leafcloud.blend_order[i] = {planes: [nx, ny, nz, d, …], children: [front, back, …], ranges: [first, behind, …]}

`engines/three/src/blending.js` traverses it. An engine that ignores it draws the order for an eye in front of the tree.
Known limits: a cloud that morphs keeps the order of its rest positions; pruned billboards shrink to nothing, but
stay in the indices.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..levels.building import Costs
from .glb_file import (
    ARRAY_BUFFER,
    ELEMENT_ARRAY_BUFFER,
    Glb,
    accessor_uses,
)

MOST_PIECES = 16
"""Maximum number of pieces per triangle. The total is also limited to the number of leaf triangles, or to `FEW` if that
is more. At the limit cutting stops, and the order is only approximate."""
FEW = 1000
"""Number of pieces that a cloud may have even with fewer leaf triangles."""
_FRONT = np.array([0.0, 0.0, 1.0])
"""The direction to the eye for which the indices are sorted: in front of the tree, in glTF's coordinates."""
_TRIANGLES = 4
_SHORT, _LONG = (5123, np.uint16), (5125, np.uint32)


class BlendOrders:
    """Cutter and sorter of the clouds' primitives. Adds its time and bytes to the costs of the effect `blend_order`.

    `materials`: the names of the clouds' materials. `leaves`: the number of leaf triangles.
    """

    def __init__(self, materials: Collection[str], leaves: int, costs: Costs) -> None:
        self._materials = set(materials)
        self._leaves = leaves
        self._costs = costs
        self._orders: dict[str, leafcloud.BlendOrder] = {}

    def add_to(self, glb: Glb) -> None:
        """Cut and sort the clouds' triangles."""
        known, document = len(self._orders), glb.document
        with self._costs.spent_on("blend_order"):
            names = [material["name"] for material in glb.materials]
            if self._materials.isdisjoint(names):
                return
            before = len(glb.content())
            for index, mesh in enumerate(document["meshes"]):
                toward = _before(document, index)
                for number, primitive in enumerate(mesh["primitives"]):
                    material = names[primitive["material"]] if "material" in primitive else None
                    if material in self._materials and primitive.get("mode", _TRIANGLES) == _TRIANGLES:
                        self._cut(glb, mesh, number, toward)
            glb.remove_unused()
        if len(self._orders) > known:  # Each cloud is in two files and counts once.
            self._costs.add_bytes("blend_order", len(glb.content()) - before)

    def _cut(self, glb: Glb, mesh: dict[str, Any], number: int, toward: NDArray[np.float64]) -> None:
        primitive = mesh["primitives"][number]
        _own_accessors(glb.document, primitive)
        material = glb.materials[primitive["material"]]["name"]
        triangles = glb.values(primitive["indices"]).reshape(-1, 3)
        if material not in self._orders:
            positions = glb.values(primitive["attributes"]["POSITION"])
            most = min(MOST_PIECES * len(triangles), max(self._leaves, FEW))
            self._orders[material] = leafcloud.blend_order(positions, triangles, toward=toward.tolist(), most=most)
        order = self._orders[material]
        _cut_vertices(glb, primitive, triangles, order)
        indices = order.triangles.ravel()
        kind, dtype = _SHORT if len(order.sources) < 2**16 - 1 else _LONG
        change = {"componentType": kind, "count": indices.size}
        _replace(glb, primitive["indices"], indices.astype(dtype), change, ELEMENT_ARRAY_BUFFER)
        extras = mesh.setdefault("extras", {}).setdefault("leafcloud", {})
        trees = extras.setdefault("blend_order", [None] * len(mesh["primitives"]))
        trees[number] = _tree(order)
        if "prefixes" in extras:
            steps = len(extras["prefixes"][number]["triangles"])
            extras["prefixes"][number]["triangles"] = [len(order.triangles)] * steps


def _own_accessors(document: dict[str, Any], primitive: dict[str, Any]) -> None:
    """Copy accessors that other primitives share: Blender's exporter writes equal data only once."""
    primitives = [each for mesh in document["meshes"] for each in mesh["primitives"]]
    users = Counter(
        accessor for each in primitives for accessor in {values[name] for values, name in accessor_uses(each)}
    )
    own: dict[int, int] = {}
    for values, name in accessor_uses(primitive):
        accessor = values[name]
        if users[accessor] > 1:
            if accessor not in own:
                own[accessor] = len(document["accessors"])
                document["accessors"].append(dict(document["accessors"][accessor]))
            values[name] = own[accessor]


def _before(document: dict[str, Any], mesh: int) -> NDArray[np.float64]:
    """Return the direction to the eye in the coordinates of a mesh, by the rotation of the first node with the mesh."""
    node: dict[str, Any] = next((node for node in document["nodes"] if node.get("mesh") == mesh), {})
    *axis, cosine = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    back = -np.array(axis)
    once = np.cross(back, _FRONT)
    return _FRONT + 2.0 * (cosine * once + np.cross(back, once))


def _cut_vertices(glb: Glb, primitive: dict[str, Any], triangles: NDArray[Any], order: leafcloud.BlendOrder) -> None:
    """Interpolate all vertex attributes at the corners of the pieces, from the corners of their triangles."""
    vertices, weights = triangles[order.sources], order.weights[:, :, None]
    sets = [primitive["attributes"], *primitive.get("targets", [])]
    for accessor in dict.fromkeys(number for values in sets for number in values.values()):
        values = glb.values(accessor)
        mixed = (values[vertices] * weights).sum(axis=1)
        mixed = (mixed if values.dtype == np.float32 else np.rint(mixed)).astype(values.dtype)
        change: dict[str, Any] = {"count": len(mixed)}
        if "min" in glb.document["accessors"][accessor]:
            change |= {"min": mixed.min(axis=0).tolist(), "max": mixed.max(axis=0).tolist()}
        _replace(glb, accessor, mixed, change, ARRAY_BUFFER)


def _replace(glb: Glb, accessor: int, values: NDArray[Any], change: dict[str, Any], target: int) -> None:
    """Replace the values of an accessor, in a new buffer view."""
    replaced = glb.document["accessors"][accessor]
    replaced.pop("byteOffset", None)
    replaced |= {"bufferView": glb.append_view(values.tobytes(), target=target), **change}


def _tree(order: leafcloud.BlendOrder) -> dict[str, list[Any]]:
    """Return the tree for glTF's extras, with planes rounded to the digits of single precision."""
    planes = order.planes.astype(np.float32)
    return {
        "planes": [float(f"{value:.7g}") for value in planes.ravel().tolist()],
        "children": order.children.ravel().tolist(),
        "ranges": order.ranges.ravel().tolist(),
    }
