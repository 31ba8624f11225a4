"""Where the leaves go at a = 1: onto the first cloud, also where that was made of some of them, grown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leafcloud

NO_BILLBOARD = -1
"""Of leaves that are pruned before the first cloud takes over."""


@dataclass(frozen=True)
class LeafMoves:
    """Per triangle: its billboard (t,), where its corners (t, 3, 3) and its leaf's pivot (t, 3) lie at a = 1; world."""

    billboards: NDArray[np.int32]
    targets: NDArray[np.float64]
    pivot_targets: NDArray[np.float64]


def leaf_moves(chain: leafcloud.Chain, corners: NDArray[np.float64]) -> LeafMoves:
    """Of the leaves with `corners` (t, 3, 3), in the world, onto the chain's first level, which is a cloud.

    Targets are those of leaves as large as they are at rest: the node group lets them grow about their pivots, and then
    they lie where the cloud shows them. What is pruned before stays where it is.
    """
    level = chain.levels[0]
    assert level.cloud is not None
    parents = level.cloud.parents.astype(np.int32)
    if chain.kept is None:
        return LeafMoves(parents, level.targets, level.pivot_targets)
    kept, growth = chain.kept
    billboards = np.full(len(corners), NO_BILLBOARD, np.int32)
    targets, pivot_targets = corners.copy(), chain.pivots
    pivots = level.pivot_targets[:, None]
    billboards[kept] = parents
    targets[kept] = pivots + (level.targets - pivots) / growth[:, None, None]
    pivot_targets[kept] = level.pivot_targets
    return LeafMoves(billboards, targets, pivot_targets)
