"""Creation of the tree variants for the forests of `nodes.forest`, from the levels of a bake.

    LOD 0 with all its leaves, with ½ of them, ¼, ⅛ …; LOD 1 … k; the cross impostor

Permanently pruned leaves need no ramp. Each kept leaf grows by s = √(ΣA / ΣA of kept leaves), which keeps the total
area as live pruning does, and by the same γ. Unpruned meshes and trunks are shared with the bake.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ..mesh.baked_levels import EXTRAS
from ..nodes.forest import GROUP_NAME, MOST_VARIANTS, ForestSettings, add_forest_modifier
from ..nodes.laws import NEVER
from ..nodes.sides import add_side_modifier
from ..nodes.wind import WindSettings, add_wind_modifier
from ..plan.pruning import halvings
from ..versions import get_modifier_input, has_modifier_input
from .building import BuiltLevel
from .rollback import removed_on_failure

_LIVE_ATTRIBUTES = (
    "leaf_rank",
    "leaf_target",
    "leaf_pivot_target",
    "leaf_billboard",
    "leaf_billboard_pivot",
    "own_billboard",
)
"""Attributes for morphs and live pruning. Variants have neither."""
_WIND_ATTRIBUTES = ("leaf_pivot", "leaf_phase", "leaf_flutter")
"""Attributes that a variant keeps if there is wind."""


@dataclass(frozen=True)
class Forest:
    """A collection of variants, which is in no scene, and the distances where the second, third … variant starts.

    distances: in world units. centre: the point that they are measured from.
    """

    variants: bpy.types.Collection
    distances: tuple[float, ...]
    centre: tuple[float, float, float]

    def plant(
        self, obj: bpy.types.Object, *, width: float = 0.15, far: float = NEVER, kind: int = -1
    ) -> bpy.types.NodesModifier:
        """Add a modifier to `obj` that draws a tree on each of its points. The scale of `obj` must be 1.

        width, far, kind: as in `ForestSettings`.
        """
        return add_forest_modifier(obj, self.variants, ForestSettings(self.distances, self.centre, width, far, kind))


def remove_forests(obj: bpy.types.Object) -> None:
    """Remove the forests planted on an object, with the variants that nothing else uses."""
    variants = _variants_on(obj)
    for modifier in [each for each in obj.modifiers if each.name.startswith(GROUP_NAME)]:
        obj.modifiers.remove(modifier)
    # Blender 5.2 still counts a removed modifier as a user.
    used = set().union(*map(_variants_on, bpy.data.objects), (each.instance_collection for each in bpy.data.objects))
    for collection in variants - used:
        objects = list(collection.all_objects)
        meshes = {each.data for each in objects}
        bpy.data.batch_remove([*objects, *collection.children_recursive, collection])
        bpy.data.batch_remove([mesh for mesh in meshes if mesh.users == 0])


def _variants_on(obj: bpy.types.Object) -> set[bpy.types.Collection]:
    """Return the variants of the forests planted on an object."""
    planted = (each for each in obj.modifiers if each.name.startswith(GROUP_NAME))
    return {get_modifier_input(each, "Variants") for each in planted if has_modifier_input(each, "Variants")} - {None}


def build_forest(
    levels: Sequence[BuiltLevel],
    name: str,
    *,
    switch_distances: Sequence[float],
    centre: tuple[float, float, float],
    prune_start: float = NEVER,
    prune_half: float = 0.5,
    growth: tuple[float, float] = (0.0, 0.0),
    wind: WindSettings | None = None,
) -> Forest:
    """Create the variants of one tree from its baked `levels`, LOD 0 first.

    switch_distances: one per level, in world units; the first is 0. centre: of the foliage, in the tree's coordinates.
    prune_start, prune_half: d₀ > 0 in world units and h in (0, ½] of λ(d). Half of the leaves are drawn from d₀/h on, a
    quarter from d₀/h² on, down to 1/128, until LOD 1 takes over. growth: `leafcloud.Chain.growth`.
    wind: the wind on the trees; the levels must be baked with wind. Trees of one variant sway in step.

    The variants' objects lie at the world origin, rotated and scaled like the levels. On failure everything created is
    removed. Raises `ValueError` for more than 16 variants, and for pruning a LOD 0 without ranks.
    """
    behind = [*switch_distances[1:], NEVER]
    pruned = halvings(prune_start, prune_half, until=behind[0])
    leaves = levels[0].object.data
    if pruned and "leaf_rank" not in leaves.attributes:
        raise ValueError(f"mesh {leaves.name!r} has no leaf_rank: bake it with the effect pruning, or do not prune it")
    distances = (*(distance for _, distance in pruned), *switch_distances[1:])
    if len(distances) >= MOST_VARIANTS:
        raise ValueError(f"the forest would have {len(distances) + 1} variants, it may have {MOST_VARIANTS}")
    with removed_on_failure():
        variants = bpy.data.collections.new(name)
        turn = _turn(levels[0].object)
        meshes = [leaves, *(pruned_mesh(leaves, keep, name, growth, sways=wind is not None) for keep, _ in pruned)]
        for mesh in meshes:
            _add_variant(variants, levels[0], mesh, turn)
        for level in levels[1:]:
            _add_variant(variants, level, level.object.data, turn)
        if wind is not None:
            for obj in variants.all_objects:
                add_wind_modifier(obj, replace(wind, start=NEVER, end=NEVER))
    return Forest(variants, distances, tuple(turn @ Vector(centre)))


def _turn(obj: bpy.types.Object) -> Matrix:
    """Return the object's rotation and scale (3, 3), including its parents'."""
    return (obj.matrix_basis if obj.parent is None else obj.matrix_world).to_3x3()


def _add_variant(variants: bpy.types.Collection, level: BuiltLevel, mesh: bpy.types.Mesh, turn: Matrix) -> None:
    """Add a child collection with the mesh and the level's trunk, both rotated and scaled by `turn`."""
    name = f"{variants.name}_{len(variants.children):02d}"
    variant = bpy.data.collections.new(name)
    variants.children.link(variant)
    members = {name: (mesh, level.object)}
    if level.trunk is not None:
        members[f"{name}_trunk"] = (level.trunk.data, level.trunk)
    for member, (data, own) in members.items():
        obj = bpy.data.objects.new(member, data)
        for slot, of_level in zip(obj.material_slots, own.material_slots, strict=True):
            if of_level.link == "OBJECT":
                slot.link, slot.material = "OBJECT", of_level.material
        obj.matrix_basis = turn.to_4x4()
        variant.objects.link(obj)
        if level.two_sided is not None and data is mesh:
            add_side_modifier(obj, level.two_sided)


def pruned_mesh(
    mesh: bpy.types.Mesh, keep: float, name: str, growth: tuple[float, float], *, sways: bool = False
) -> bpy.types.Mesh:
    """Return a new mesh with the leaves of rank below `keep`, grown about their pivots to keep the covered area.

    `mesh` has the point attributes `leaf_rank` and `leaf_pivot`. Protected leaves (negative rank) do not change. The
    new mesh has the same materials and layers, but no attributes for morphs and pruning. It keeps the wind attributes
    if it `sways`.
    """
    ranks, pivots = _read(mesh, "leaf_rank"), _read(mesh, "leaf_pivot")
    points = np.empty((len(ranks), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    logarithm = math.log(keep)
    factor = math.exp(logarithm * (growth[0] + growth[1] * logarithm))
    growing = (ranks >= 0.0) & (ranks < keep)
    points[growing] = pivots[growing] + (points - pivots)[growing] * (_scale(mesh, ranks, keep) * np.float32(factor))

    made = mesh.copy()
    made.name = name
    _forget_morphs(made, _LIVE_ATTRIBUTES if sways else (*_LIVE_ATTRIBUTES, *_WIND_ATTRIBUTES))
    made.vertices.foreach_set("co", points.ravel())
    # bmesh keeps all layers when it deletes vertices, also the custom normals of Blender 4.2.
    work = bmesh.new()
    try:
        work.from_mesh(made)
        lost = ranks >= keep
        bmesh.ops.delete(work, geom=list(compress(work.verts, lost)), context="VERTS")
        work.to_mesh(made)
    finally:
        work.free()
    return made


def _scale(mesh: bpy.types.Mesh, ranks: NDArray[np.float32], keep: float) -> np.float32:
    """Return s; 1 if no kept leaf may grow."""
    areas, first = np.empty(len(mesh.polygons), np.float32), np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("area", areas)
    mesh.polygons.foreach_get("loop_start", first)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    of_face = ranks[corners[first]]
    whole, left = (areas[(of_face >= 0.0) & (of_face < limit)].sum(dtype=np.float64) for limit in (np.inf, keep))
    return np.float32(np.sqrt(whole / left) if left > 0.0 else 1.0)


def _read(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32]:
    """Return the point attribute's values: (v,) numbers or (v, 3) vectors."""
    attribute = mesh.attributes[name]
    numbers = attribute.data_type == "FLOAT"
    values = np.empty(len(mesh.vertices) if numbers else (len(mesh.vertices), 3), np.float32)
    attribute.data.foreach_get("value" if numbers else "vector", values.ravel())
    return values


def _forget_morphs(mesh: bpy.types.Mesh, attributes: Sequence[str]) -> None:
    """Remove the shape keys, vertex groups, the custom property `EXTRAS` and the given attributes from the mesh."""
    carrier = bpy.data.objects.new(mesh.name, mesh)
    carrier.shape_key_clear()
    carrier.vertex_groups.clear()
    bpy.data.objects.remove(carrier)
    mesh.pop(EXTRAS, None)
    for name in attributes:
        if (attribute := mesh.attributes.get(name)) is not None:
            mesh.attributes.remove(attribute)
