"""What the wind needs to know of a level's vertices, and of a tree's stature; only where the effect wind is on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..placement import y_up
from ..plan.wind import GOLDEN
from .morphs import add_point_attribute
from .wind_nodes import WindSettings


@dataclass(frozen=True)
class Swaying:
    """Per vertex (v): the pivot of its leaf or billboard (v, 3), that of its billboard on the next level (v, 3), and of
    leaves alone the phase, in [0, 1), and how freely they flutter, from 0 in the heart of the crown to 1 at its hull.

    In the tree's coordinates; None is what the level does not have, or has already.
    """

    pivot: NDArray[np.float32] | None = None
    billboard_pivot: NDArray[np.float32] | None = None
    phase: NDArray[np.float32] | None = None
    flutter: NDArray[np.float32] | None = None

    @property
    def attributes(self) -> dict[str, NDArray[np.float32]]:
        """By name."""
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


def add_swaying(mesh: bpy.types.Mesh, swaying: Swaying) -> None:
    """Stores the attributes."""
    for name, values in swaying.attributes.items():
        add_point_attribute(mesh, name, "FLOAT" if values.ndim == 1 else "FLOAT_VECTOR", values)


def plane_pivots(level: leafcloud.Level) -> NDArray[np.float64]:
    """(k, 3) for each plane of the cloud `level` the centroid of its billboard's area, in the world.

    That is the pivot which the core gives the billboard when it stands as a leaf of the next level.
    """
    corners = level.corners.astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, :-1], sides[:, 1:]), axis=2) / 2.0
    middles = (corners[:, :1] + corners[:, 1:-1] + corners[:, 2:]) / 3.0
    whole = areas.sum(axis=1)
    weights = np.where(whole[:, None] > 0.0, areas / np.where(whole > 0.0, whole, 1.0)[:, None], 1.0 / areas.shape[1])
    assert level.cloud is not None
    pivots = np.zeros((len(level.cloud.planes), 3))
    pivots[level.plane_ids] = (weights[..., None] * middles).sum(axis=1)
    return pivots


def phases(leaf_ids: NDArray[np.integer[Any]]) -> NDArray[np.float32]:
    """(n,) in [0, 1): neighbours in the order of leaves are far apart."""
    return np.minimum(leaf_ids.astype(np.float64) * GOLDEN % 1.0, 1.0 - 2.0**-24).astype(np.float32)


def freedom(pivots: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) of leaves with `pivots` (n, 3): the distance from the crown's middle as a share of the ellipsoid that fills
    the box about all pivots, at most 1."""
    low, high = pivots.min(axis=0), pivots.max(axis=0)
    half = np.where(high > low, (high - low) / 2.0, 1.0)
    return np.minimum(np.linalg.norm((pivots - (low + high) / 2.0) / half, axis=1), 1.0).astype(np.float32)


def wind_extras(settings: WindSettings) -> dict[str, Any]:
    """What engines need beside the vertices, as `shaders/leafcloud.glsl` takes it: vectors are Y-up, lengths in the
    node's own units; `direction` alone is in the world."""
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
