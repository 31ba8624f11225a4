"""Baked trees, found again in a file by what the bake wrote on their objects: for what is made of them later.

A level is a mesh object with `leafcloud.level` among its custom properties, and its modifier *Leafcloud LOD* knows from
where it is drawn. Copies that an artist made of it, and copies of those, have both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

import leafcloud

from ..plan.reach import View
from ..scene.baked_levels import EXTRAS
from ..scene.baked_levels import level_number as level_number
from ..versions import get_modifier_input
from .levels import BuiltLevel
from .lod_nodes import GROUP_NAME
from .node_laws import NEVER

_ANYWHERE = "with `viewer=anywhere`, for levels need not follow a camera that sees one of them only"
"""How a bake gets the effects that a forest and a scene live by."""


@dataclass(frozen=True)
class LeafPruning:
    """How the leaves of a tree are pruned, in the tree's own units; as for `LodSettings`.

    measured: whether the bake planned it, and measured growth and contrast.
    """

    start: float
    half: float = 0.5
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    measured: bool = False


@dataclass(frozen=True)
class BakedTree:
    """The levels of one tree, the leaves first.

    switch_distances: one for each level, in world units; the first is 0. centre: of the foliage, in the tree's
    coordinates. scale: world units per unit of these.
    """

    levels: tuple[BuiltLevel, ...]
    switch_distances: tuple[float, ...]
    centre: tuple[float, float, float]
    scale: float


def woods() -> dict[bpy.types.Object, bpy.types.Object]:
    """The wood of every level in the file that has some."""
    children = (obj for obj in bpy.data.objects if obj.parent is not None and obj.type == "MESH")
    return {obj.parent: obj for obj in children if level_number(obj) is None and level_number(obj.parent) is not None}


def tree_collections(objects: Iterable[bpy.types.Object]) -> tuple[bpy.types.Collection, ...]:
    """The collections in which leaves among the `objects` lie, each once, in the order of their names."""
    found = {collection for obj in objects if level_number(obj) == 0 for collection in obj.users_collection}
    return tuple(sorted(found, key=lambda collection: collection.name))


def baked_tree(collection: bpy.types.Collection) -> BakedTree:
    """The tree whose levels the collection holds.

    Raises `ValueError` for a collection that has not just one of each level, and for levels without their modifier.
    """
    found = sorted((number, obj.name) for obj in collection.all_objects if (number := level_number(obj)) is not None)
    if not found:
        raise ValueError(f"collection {collection.name!r} has no baked levels: choose the one that a bake has made")
    if [number for number, _ in found] != list(range(len(found))):
        names = ", ".join(name for _, name in found[:8])
        raise ValueError(
            f"collection {collection.name!r} holds {names}: choose a collection with one tree, all of its levels"
        )
    wood = woods()
    objects = [collection.all_objects[name] for _, name in found]
    # Of what is mirrored all factors are negative; its distances are not.
    scale = float(np.mean(np.abs(objects[0].matrix_world.to_scale())))
    return BakedTree(
        levels=tuple(_built(number, obj, wood.get(obj)) for number, obj in enumerate(objects)),
        switch_distances=(0.0, *(scale * lod_input(obj, "Appear") for obj in objects[1:])),
        centre=lod_input(objects[0], "Centre"),
        scale=scale,
    )


def leaf_pruning(leaves: bpy.types.Object, pixels: float, view: View) -> LeafPruning:
    """How the `leaves`, a LOD 0, were baked to be pruned; else from where one is seen smaller than `pixels`.

    Raises `ValueError` for leaves that have no ranks to be pruned by, or not their modifier.
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
        (lod_input(leaves, name), lod_input(leaves, f"{name} of Few")) for name in ("Growth", "Contrast")
    )
    start, half = lod_input(leaves, "Prune Start"), lod_input(leaves, "Prune Half")
    return LeafPruning(start, half, growth, contrast, measured=True)


def lod_input(level: bpy.types.Object, name: str) -> Any:
    """What the level's modifier has as its input `name`, in the level's own units.

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


def _built(number: int, obj: bpy.types.Object, wood: bpy.types.Object | None) -> BuiltLevel:
    return BuiltLevel(number, obj, wood, len(obj.data.loops) - 2 * len(obj.data.polygons))


def _leaf_size(mesh: bpy.types.Mesh) -> float:
    """The side of a square as large as a leaf is in the mean; 0 of no leaf that may be pruned."""
    ranks, areas = np.empty(len(mesh.vertices), np.float32), np.empty(len(mesh.polygons), np.float32)
    mesh.attributes["leaf_rank"].data.foreach_get("value", ranks)
    mesh.polygons.foreach_get("area", areas)
    count = len(np.unique(ranks[ranks >= 0.0]))
    return math.sqrt(areas.sum(dtype=np.float64) / count) if count else 0.0
