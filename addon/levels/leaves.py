"""LOD 0: the tree's own leaves, sorted for pruning, with their places on the first cloud."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .baked_light import add_light
from .building import Build
from .leaf_moves import leaf_moves
from .material import layer_names
from .mesh import create_mesh, split_vertices, triangle_surface
from .shape import Shape, object_of, pruning_of, transition_of
from .wind import leaf_wind_attributes


def leaf_object(build: Build) -> bpy.types.Object:
    """Create the object of LOD 0."""
    shape, schedule = _shape(build), build.schedule
    materials = build.tree.leaves.materials
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


def _shape(build: Build) -> Shape:
    """Return the leaves sorted by material, then by rank. The triangles of a leaf stay together."""
    geometry, chain = build.tree.leaves, build.chain
    leaf_ids = build.foliage.leaf_ids
    ranks = chain.ranks[leaf_ids]
    order = np.lexsort((leaf_ids, ranks, geometry.material_ids))
    moves = None
    if build.has("transitions") and chain.levels[0].cloud is not None:
        moves = leaf_moves(chain, geometry.positions[geometry.triangles])
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
        pruning=pruning_of(ranks[of_vertex], chain.pivots[of_vertex], build),
        transition=transition,
        light=None if build.light is None else build.light.at(order),
        wind=leaf_wind_attributes(leaf_ids, moves, of_vertex, build),
    )
