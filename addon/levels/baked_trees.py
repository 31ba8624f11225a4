"""Lookup of baked trees in a file, for forests and tree sets made from them.

A level is a mesh object with the custom property `leafcloud.level`. Its modifier *Leafcloud LOD* holds the distances
where it is drawn. Copies of a level have both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

import leafcloud

from ..mesh.baked_levels import EXTRAS, level_number
from ..nodes.laws import NEVER
from ..nodes.lod import GROUP_NAME, lod_distance
from ..plan.lod_range import View
from ..versions import get_modifier_input
from .building import BuiltLevel

_ANYWHERE = "with `viewer=anywhere` (if the camera sees only one level, levels need no modifier)"
"""Remedy: the bake setting that turns on the effects that forests and tree sets need."""


@dataclass(frozen=True)
class LeafPruning:
    """Pruning of a tree's leaves, in the tree's own units, as in `LodSettings`.

    measured: whether the bake planned the pruning and measured growth and contrast.
    """

    start: float
    half: float = 0.5
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    measured: bool = False


@dataclass(frozen=True)
class BakedTree:
    """The levels of one tree, the leaves first.

    switch_distances: one per level, in world units; the first is 0. centre: of the foliage, in the tree's coordinates.
    scale: world units per unit of the tree's coordinates.
    """

    levels: tuple[BuiltLevel, ...]
    switch_distances: tuple[float, ...]
    centre: tuple[float, float, float]
    scale: float


def trunks() -> dict[bpy.types.Object, bpy.types.Object]:
    """Return the trunk object of each level in the file that has one."""
    children = (obj for obj in bpy.data.objects if obj.parent is not None and obj.type == "MESH")
    return {obj.parent: obj for obj in children if level_number(obj) is None and level_number(obj.parent) is not None}


def tree_collections(objects: Iterable[bpy.types.Object]) -> tuple[bpy.types.Collection, ...]:
    """Return the collections of the baked leaves (LOD 0) among the `objects`, each once, sorted by name."""
    found = {collection for obj in objects if level_number(obj) == 0 for collection in obj.users_collection}
    return tuple(sorted(found, key=lambda collection: collection.name))


def baked_tree(collection: bpy.types.Collection) -> BakedTree:
    """Return the baked tree in a collection.

    Raises `ValueError` unless the collection has exactly one of each level, and for levels without their modifier.
    """
    found = sorted((number, obj.name) for obj in collection.all_objects if (number := level_number(obj)) is not None)
    if not found:
        raise ValueError(f"collection {collection.name!r} has no baked levels: choose one that a bake made")
    if [number for number, _ in found] != list(range(len(found))):
        names = ", ".join(name for _, name in found[:8])
        raise ValueError(
            f"collection {collection.name!r} holds {names}: choose a collection with one tree, all of its levels"
        )
    trunk = trunks()
    objects = [collection.all_objects[name] for _, name in found]
    # A mirrored object's scale factors are negative, but distances are not.
    scale = float(np.mean(np.abs(objects[0].matrix_world.to_scale())))
    return BakedTree(
        levels=tuple(_built(number, obj, trunk.get(obj)) for number, obj in enumerate(objects)),
        switch_distances=(0.0, *(scale * lod_length(obj, "Appear") for obj in objects[1:])),
        centre=lod_input(objects[0], "Centre"),
        scale=scale,
    )


def leaf_pruning(leaves: bpy.types.Object, pixels: float, view: View) -> LeafPruning:
    """Return the pruning that `leaves`, a LOD 0, were baked with.

    If the bake planned none, pruning starts at the distance where a leaf looks smaller than `pixels` in the `view`.
    Raises `ValueError` for leaves without ranks, and for planned pruning without the modifier *Leafcloud LOD*.
    """
    mesh = leaves.data
    if "leaf_rank" not in mesh.attributes:
        remedy = "bake it with the chain Both or Pruning and the viewer Anywhere, or turn the effect pruning on"
        raise ValueError(f"mesh {mesh.name!r} has no leaf_rank: {remedy}")
    if "prune_start" not in leaves[EXTRAS]:
        size = _leaf_size(mesh)
        start = leafcloud.switch_distance(size, pixels, view.resolution, view.field_of_view) if size else NEVER
        return LeafPruning(min(start, NEVER))
    growth, contrast = (
        (lod_input(leaves, name), lod_input(leaves, f"{name} Quadratic")) for name in ("Growth", "Contrast")
    )
    start, half = lod_length(leaves, "Prune Start"), lod_input(leaves, "Prune Half")
    return LeafPruning(start, half, growth, contrast, measured=True)


def lod_input(level: bpy.types.Object, name: str) -> Any:
    """Return the value of the input `name` of the level's modifier, in the level's own units.

    Raises `ValueError` for a level without that modifier.
    """
    modifier = level.modifiers.get(GROUP_NAME)
    if modifier is None or getattr(modifier, "node_group", None) is None:
        remedy = f"bake the tree {_ANYWHERE}, or with the effects transitions or pruning, and leave its modifiers on"
        raise ValueError(f"object {level.name!r} has no modifier {GROUP_NAME!r}: {remedy}")
    try:
        return get_modifier_input(modifier, name)
    except KeyError as error:
        raise ValueError(f"object {level.name!r} has a modifier that is not Leafcloud's: {error.args[0]}") from None


def lod_length(level: bpy.types.Object, name: str) -> float:
    """Return the distance `name` of the level's modifier times its LOD Distance, as `lod_input` does."""
    return min(float(lod_input(level, name)) * lod_distance(level.modifiers[GROUP_NAME]), NEVER)


def _built(number: int, obj: bpy.types.Object, trunk: bpy.types.Object | None) -> BuiltLevel:
    return BuiltLevel(number, obj, trunk, len(obj.data.loops) - 2 * len(obj.data.polygons))


def _leaf_size(mesh: bpy.types.Mesh) -> float:
    """Return the side of a square with the mean area of a leaf; 0 if no leaf may be pruned."""
    ranks, areas = np.empty(len(mesh.vertices), np.float32), np.empty(len(mesh.polygons), np.float32)
    mesh.attributes["leaf_rank"].data.foreach_get("value", ranks)
    mesh.polygons.foreach_get("area", areas)
    count = len(np.unique(ranks[ranks >= 0.0]))
    return math.sqrt(areas.sum(dtype=np.float64) / count) if count else 0.0
