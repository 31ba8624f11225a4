"""The effect wind on a level: attributes of its vertices, the modifier, and custom properties for engines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..mesh.baked_levels import EXTRAS, PLAIN, level_number
from ..nodes.laws import NEVER
from ..nodes.wind import WindSettings, add_wind_modifier
from ..plan.lod_range import LodRange
from ..plan.wind import GOLDEN
from .building import Build, y_up
from .leaf_moves import LeafMoves
from .morphs import add_point_attribute


@dataclass(frozen=True)
class WindAttributes:
    """Wind data per vertex, in the tree's coordinates. None: the level does not have it, or already stores it.

    pivot (v, 3): of its leaf or billboard. billboard_pivot (v, 3): of its billboard on the next level.
    phase (v,) in [0, 1) and flutter (v,): leaves only. flutter rises from 0 at the crown's center to 1 at its hull.
    """

    pivot: NDArray[np.float32] | None = None
    billboard_pivot: NDArray[np.float32] | None = None
    phase: NDArray[np.float32] | None = None
    flutter: NDArray[np.float32] | None = None

    @property
    def attributes(self) -> dict[str, NDArray[np.float32]]:
        """The arrays that are not None, by attribute name."""
        named = {
            "leaf_pivot": self.pivot,
            "leaf_billboard_pivot": self.billboard_pivot,
            "leaf_phase": self.phase,
            "leaf_flutter": self.flutter,
        }
        return {name: values for name, values in named.items() if values is not None}

    @property
    def nbytes(self) -> int:
        return sum(values.nbytes for values in self.attributes.values())


def add_wind(obj: bpy.types.Object, lod_range: LodRange, build: Build) -> None:
    """Add the modifier to a level's object or to its trunk; to the former also the custom properties for engines."""
    assert build.wind is not None
    start, end = (min(distance / build.tree.scale, NEVER) for distance in (lod_range.start, lod_range.end))
    wind = replace(build.wind, start=start, end=end, centre=build.centre)
    if PLAIN not in obj:  # The picture of an octahedral impostor cannot bend, and its surface must not.
        add_wind_modifier(obj, wind)
    if level_number(obj) is not None:
        obj[EXTRAS]["wind"] = wind_extras(wind)


def leaf_wind_attributes(
    leaf_ids: NDArray[np.integer[Any]],
    moves: LeafMoves | None,
    of_vertex: NDArray[np.integer[Any]],
    build: Build,
    leaf_pivots: NDArray[np.float64],
) -> WindAttributes | None:
    """Return the wind attributes for vertices of the triangles `of_vertex` (v,); None without wind.

    `leaf_pivots` (t, 3): of each triangle's leaf.

    Leaves without a billboard keep swaying with their own branch.
    """
    if build.wind is None:
        return None
    chain = build.chain
    pivots = leaf_pivots[of_vertex]
    carriers = None
    if moves is not None:
        billboards = moves.billboards[of_vertex][:, None]
        carried = chain.clouds[0].plane_pivots()[billboards[:, 0]]
        carriers = np.where(billboards < 0, pivots, carried).astype(np.float32)
    return WindAttributes(
        pivot=None if build.has("pruning") else pivots.astype(np.float32),
        billboard_pivot=carriers,
        phase=phases(leaf_ids[of_vertex]),
        flutter=freedom(leaf_pivots.astype(np.float32), chain.pivots.astype(np.float32))[of_vertex],
    )


def cloud_wind_attributes(
    level: leafcloud.Level,
    following: leafcloud.Level | None,
    billboards: NDArray[np.integer[Any]],
    parents: NDArray[np.integer[Any]],
    build: Build,
) -> WindAttributes | None:
    """Return the wind attributes for vertices of `billboards` (v,) that morph to the planes `parents` (v,) of the next
    level.

    None without wind and for the cross impostor, which has no pivots: it stands on the ground and bends as the trunk.
    """
    if build.wind is None or level.cloud is None:
        return None
    own = level.plane_pivots()[level.plane_ids[billboards]].astype(np.float32)
    if following is None:
        return WindAttributes(own)
    return WindAttributes(
        pivot=None if build.has("pruning") else own,
        billboard_pivot=following.plane_pivots()[parents].astype(np.float32) if build.has("transitions") else None,
    )


def add_wind_attributes(mesh: bpy.types.Mesh, wind_attributes: WindAttributes) -> None:
    """Store the data as point attributes of the mesh."""
    for name, values in wind_attributes.attributes.items():
        add_point_attribute(mesh, name, "FLOAT" if values.ndim == 1 else "FLOAT_VECTOR", values)


def phases(leaf_ids: NDArray[np.integer[Any]]) -> NDArray[np.float32]:
    """Return (n,) phases in [0, 1) that differ strongly between leaves with successive numbers."""
    return np.minimum(leaf_ids.astype(np.float64) * GOLDEN % 1.0, 1.0 - 2.0**-24).astype(np.float32)


def freedom(pivots: NDArray[np.float32], crown: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (n,) the flutter of leaves with `pivots` (n, 3), in [0, 1].

    It is the distance from the crown's center, relative to the ellipsoid inscribed in the bounding box of all pivots
    of the `crown` (m, 3), at most 1.
    """
    low, high = crown.min(axis=0), crown.max(axis=0)
    half = np.where(high > low, (high - low) / 2.0, 1.0)
    return np.minimum(np.linalg.norm((pivots - (low + high) / 2.0) / half, axis=1), 1.0).astype(np.float32)


def wind_extras(settings: WindSettings) -> dict[str, Any]:
    """Return the wind's custom properties for engines, as `shaders/leafcloud.glsl` expects them.

    Vectors are Y-up, lengths in the node's own units. Only `direction` is in the world.
    """
    stature, wind, swing = settings.stature, settings.wind, settings.swing
    return {
        "direction": y_up(wind.direction),
        "strength": wind.strength,
        "gusts": wind.gusts,
        "period": stature.period,
        "foot": y_up(stature.foot),
        "up": y_up(stature.up),
        "height": stature.height,
        "spread": stature.spread,
        "sway": swing.sway,
        "branches": swing.branches,
        "flutter": swing.flutter,
    }
