"""Leaves as drawn by the viewer, and leaves as drawn by the node group of the baked .blend file, to compare both."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from glb import Node, Primitive
from laws import Floats, kept, trend
from lod_scenes import evaluate, points_of

from addon.export.gltf import y_up

PAGE = "tests/browser/probe.html"
PATIENCE = 120.0


@dataclass(frozen=True)
class Pruning:
    """Pruning settings: start distance in scene units, h, the terms of γ and κ, and the mean color of the leaves."""

    start: float
    half: float = 0.5
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def keep(self, distance: float) -> float:
        return float(kept(np.array(distance), self.start, self.half))

    def growth_at(self, keep: float) -> float:
        return float(trend(np.array(keep), *self.growth))


def by_leaf(ranks: Floats, rows: Floats) -> dict[float, Floats]:
    """Group `rows` (n, …) by their `ranks` (n,)."""
    order = np.argsort(ranks, kind="stable")
    keys, first = np.unique(ranks[order], return_index=True)
    return dict(zip(keys.tolist(), np.split(rows[order], first[1:]), strict=True))


def attribute(primitive: Primitive, name: str) -> Floats:
    """Return the attribute (v, 3), or zeros if the level lacks it."""
    places = primitive.attributes["POSITION"]
    return primitive.attributes.get(name, np.zeros_like(places)).astype(float)


def pivots_of(primitive: Primitive) -> Floats:
    """Return both pivots (v, 6) of each vertex: at rest, and on its billboard. A leaf may have several billboards."""
    return np.hstack([attribute(primitive, "_LEAF_PIVOT"), attribute(primitive, "_LEAF_PIVOT_TARGET")])


def drawn_by_shader(node: Node, meshes: list[dict[str, Any]]) -> dict[float, Floats]:
    """Return the positions and pivots (n, 9) of the corners that the shader draws, by leaf rank.

    Triangles that shrank to a point count as not drawn.
    """
    ranks, rows = [], []
    for primitive, mesh in zip(node.primitives, meshes, strict=True):
        assert mesh["material"] == primitive.material["name"]
        places = np.frombuffer(base64.b64decode(mesh["places"]), "<f4").reshape(-1, 3).astype(float)
        triangles = primitive.indices[: mesh["count"] // 3]
        triangles = triangles[(np.ptp(places[triangles], axis=1) > 0.0).any(axis=1)]
        ranks.append(attribute(primitive, "_LEAF_RANK")[triangles, 0].ravel())
        rows.append(np.hstack([places, pivots_of(primitive)])[triangles].reshape(-1, 9))
    return by_leaf(np.concatenate(ranks), np.concatenate(rows))


def drawn_by_nodes(obj: bpy.types.Object) -> dict[float, Floats]:
    """Return the points after the modifier by leaf rank, in glTF's coordinates."""
    mesh = evaluate(obj)
    ranks = np.zeros(len(mesh.vertices), np.float32)
    if "leaf_rank" in mesh.attributes:
        mesh.attributes["leaf_rank"].data.foreach_get("value", ranks)
    return by_leaf(ranks.astype(float), y_up(points_of(mesh)).astype(float)) if len(ranks) else {}


def apart(one: Floats, other: Floats) -> float:
    """Return the Hausdorff distance between two point sets."""
    distances = np.linalg.norm(one[:, None] - other[None], axis=2)
    return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))
