"""The data of a level's mesh, and the level's object made from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..mesh.baked_levels import EXTRAS
from ..plan.lod_range import LodRange
from ..scene.light import Light
from . import morphs
from .building import Build
from .mesh import MeshFaces
from .morphs import Pruning, Transition
from .prune_tables import PREFIX_STEPS, area_shares, prefix_table
from .wind import WindAttributes, add_wind_attributes


@dataclass(frozen=True)
class Shape:
    """The data of a level's mesh: its faces in pruning order, the rank of each face, and the vertex attributes.

    light: (c, 3) for each side, one row per corner of the mesh.
    """

    surface: MeshFaces
    ranks: NDArray[np.float32]
    pruning: Pruning | None = None
    transition: Transition | None = None
    light: Light | None = None
    wind: WindAttributes | None = None


def pruning_of(ranks: NDArray[np.float32], pivots: NDArray[np.float64], build: Build) -> Pruning | None:
    """Return the pruning attributes from the `ranks` (v,) and `pivots` (v, 3) of the vertices' leaves."""
    return Pruning(ranks, pivots.astype(np.float32)) if build.has("pruning") else None


def transition_of(
    billboards: NDArray[np.int32], targets: NDArray[np.float64], pivot_targets: NDArray[np.float64]
) -> Transition:
    """Return the transition attributes for vertices. `billboards` (v,): numbers in the next level, −1 for none.

    `targets`, `pivot_targets` (v, 3): positions at a = 1.
    """
    return Transition(billboards, targets.astype(np.float32), pivot_targets.astype(np.float32))


def object_of(
    mesh: bpy.types.Mesh, shape: Shape, extras: dict[str, Any], lod_range: LodRange, build: Build
) -> bpy.types.Object:
    """Create a level's object, with the attributes of the effects and `extras` as custom properties."""
    obj, costs = bpy.data.objects.new(mesh.name, mesh), build.costs
    if shape.pruning is not None:
        with costs.spent_on("pruning", shape.pruning.nbytes):
            morphs.add_pruning(mesh, shape.pruning)
            mesh[EXTRAS] = _pruning_extras(mesh, shape)
    if shape.wind is not None:
        with costs.spent_on("wind", shape.wind.nbytes):
            add_wind_attributes(mesh, shape.wind)
    if shape.transition is not None:
        with costs.spent_on("transitions", shape.transition.nbytes):
            morphs.add_transition(obj, shape.transition)
        extras = {**extras, "transition_start": lod_range.start, "transition_end": lod_range.end}
    obj[EXTRAS] = extras
    return obj


def _pruning_extras(mesh: bpy.types.Mesh, shape: Shape) -> dict[str, Any]:
    """Return the tables of triangle counts and areas. Materials are given by name instead of by number."""
    names = [material.name if material is not None else "" for material in mesh.materials]
    prefixes = [{**row, "material": names[row["material"]]} for row in prefix_table(shape.surface, shape.ranks)]
    areas = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", areas)
    return {"keep_steps": PREFIX_STEPS, "prefixes": prefixes, "area_shares": area_shares(areas, shape.ranks)}
