"""Levels made of leaves: LOD 0, the tree's own leaves in the order of pruning, then simplified and fewer leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..geometry import Geometry
from .baked_light import add_light
from .building import Build
from .leaf_moves import LeafMoves, leaf_moves, moves_of_fewer, moves_to_leaves
from .material import layer_names
from .mesh import create_mesh, split_vertices, triangle_surface
from .shape import Shape, object_of, pruning_of, transition_of
from .trunk import gathered, outward
from .wind import leaf_wind_attributes


def leaf_object(build: Build) -> bpy.types.Object:
    """Create the object of LOD 0."""
    geometry, pivots = build.tree.leaves, build.chain.pivots
    moves = _moves(0, pivots, build)
    shape, schedule = _shape(geometry, build.foliage.leaf_ids, pivots, moves, build), build.schedule
    if build.light is not None:
        shape = replace(shape, light=build.light.at(_order(geometry, build.foliage.leaf_ids, build)))
    materials = geometry.materials
    mesh = create_mesh(f"{build.name}_LOD0", shape.surface, materials, layer_names(materials))
    if shape.light is not None:
        with build.costs.spent_on("baked_light", shape.light.nbytes):
            add_light(mesh, shape.light)
    extras: dict[str, Any] = {"level": 0, "switch_distance": 0.0}
    if build.prunes_leaves:
        start, half = schedule.pruning.start, schedule.pruning.half
        extras |= {"prune_start": start, "prune_half": half, "growth": list(build.chain.growth)}
    for effect in build.charged():
        extras |= effect.add_to_leaves(mesh, build)
    return object_of(mesh, shape, extras, schedule.lod_ranges[0], build)


def later_leaf_object(level: leafcloud.LeafLevel, number: int, build: Build) -> bpy.types.Object:
    """Create the object of a later level of leaves. They have the materials of the tree's own leaves."""
    own = level.corners[:, 0] // 3
    leaf_ids, pivots = build.foliage.leaf_ids[own], level.pivots
    geometry = _placed(build.tree.leaves, level, leaf_ids)
    shape = _shape(geometry, leaf_ids, pivots, _moves(number, pivots, build), build)
    name = f"{build.name}_LOD{number}"
    mesh = create_mesh(name, shape.surface, geometry.materials, layer_names(geometry.materials))
    extras = {
        "level": number,
        "switch_distance": build.schedule.switch_distances[number],
    }
    return object_of(mesh, shape, extras, build.schedule.lod_ranges[number], build)


def _moves(number: int, pivots: NDArray[np.float64], build: Build) -> LeafMoves | None:
    """Return the moves of level `number`, of leaves, to the level after it; None if nothing morphs.

    `pivots` (t, 3): of its triangles.
    """
    levels, chain = build.leaf_levels, build.chain
    if not build.has("transitions"):
        return None
    if number < len(levels):
        return moves_to_leaves(levels[number])
    if chain.clouds[0].cloud is None:
        return None
    if not levels or levels[-1].kept is None:
        return leaf_moves(chain, pivots)
    simplified = levels[0].kept is None
    return moves_of_fewer(chain, levels[-1], chain.pivots[levels[0].corners[:, 0] // 3] if simplified else chain.pivots)


def _placed(leaves: Geometry, level: leafcloud.LeafLevel, leaf_ids: NDArray[np.integer[Any]]) -> Geometry:
    """Return the simplified leaves as a geometry. Triangles of one leaf keep their common vertices.

    `leaf_ids` (s,): the leaf of each simplified triangle.
    """
    same = gathered(leaves, level.corners)
    keys = np.stack([same.triangles.ravel(), np.repeat(leaf_ids, 3)], axis=1)
    _, first, vertices = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    grown = replace(
        same,
        positions=level.positions.reshape(-1, 3)[first].astype(np.float32),
        triangles=vertices.reshape(-1, 3).astype(np.int32),
    )
    return outward(grown, leaves, level.corners)


def _order(geometry: Geometry, leaf_ids: NDArray[np.integer[Any]], build: Build) -> NDArray[np.int64]:
    """Return the triangles sorted by material, then by rank. The triangles of a leaf stay together."""
    return np.lexsort((leaf_ids, build.chain.ranks[leaf_ids], geometry.material_ids))


def _shape(
    geometry: Geometry,
    leaf_ids: NDArray[np.integer[Any]],
    pivots: NDArray[np.float64],
    moves: LeafMoves | None,
    build: Build,
) -> Shape:
    """Return the mesh data of leaves. `leaf_ids` (t,) and `pivots` (t, 3): of each triangle's leaf."""
    order = _order(geometry, leaf_ids, build)
    ranks = build.chain.ranks[leaf_ids]
    billboards = np.zeros(len(order), np.int32) if moves is None else moves.billboards[order]
    split = split_vertices(geometry.triangles[order], billboards - billboards.min(initial=0))
    of_vertex = order[split.first // 3]
    transition = None
    if moves is not None:
        targets = moves.targets.reshape(-1, 3)[3 * of_vertex + split.first % 3]
        transition = transition_of(billboards[split.first // 3], targets, moves.pivot_targets[of_vertex])
    return Shape(
        surface=triangle_surface(geometry, order, split),
        ranks=ranks[order],
        pruning=pruning_of(ranks[of_vertex], pivots[of_vertex], build),
        transition=transition,
        wind=leaf_wind_attributes(leaf_ids, moves, of_vertex, build, pivots),
    )
