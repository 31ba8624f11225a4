"""Targets of the leaves at a = 1, on the first cloud. The cloud may be made from kept leaves at their grown size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leafcloud

NO_BILLBOARD = -1
"""Billboard number of leaves that are not on the first cloud: pruned before it takes over, or hidden by the crown."""


@dataclass(frozen=True)
class LeafMoves:
    """Data per triangle: its billboard (t,), and the positions of its corners (t, 3, 3) and of its leaf's pivot (t, 3)
    at a = 1."""

    billboards: NDArray[np.int32]
    targets: NDArray[np.float64]
    pivot_targets: NDArray[np.float64]


def moves_to_leaves(level: leafcloud.LeafLevel) -> LeafMoves:
    """Return the moves of the level before onto the leaves of `level`. They are on no billboard."""
    return LeafMoves(np.full(len(level.targets), NO_BILLBOARD, np.int32), level.targets, level.pivot_targets)


def leaf_moves(chain: leafcloud.Chain, chain_pivots: NDArray[np.float64]) -> LeafMoves:
    """Return the moves of the leaves that the first cloud is made of onto it.

    `chain_pivots` (t, 3): of their triangles. Targets are for leaves at their size at rest. The node group grows the
    leaves about their pivots, and then they coincide with the cloud. Leaves without a billboard shrink into their
    pivots.
    """
    level = chain.clouds[0]
    assert level.cloud is not None
    parents = level.cloud.parents.astype(np.int32)
    if chain.kept is None:
        return LeafMoves(parents, level.targets, level.pivot_targets)
    kept, growth = chain.kept
    billboards = np.full(len(chain_pivots), NO_BILLBOARD, np.int32)
    pivot_targets = chain_pivots.copy()
    targets = np.repeat(pivot_targets[:, None], 3, axis=1)
    pivots = level.pivot_targets[:, None]
    billboards[kept] = parents
    targets[kept] = pivots + (level.targets - pivots) / growth[:, None, None]
    pivot_targets[kept] = level.pivot_targets
    return LeafMoves(billboards, targets, pivot_targets)


def moves_of_fewer(chain: leafcloud.Chain, level: leafcloud.LeafLevel, chain_pivots: NDArray[np.float64]) -> LeafMoves:
    """Return the moves of a level of fewer leaves onto the first cloud. They stay as large as they are.

    `chain_pivots` (t, 3): of the triangles that the first cloud is made of.
    """
    assert level.kept is not None
    kept, growth = level.kept
    whole = leaf_moves(chain, chain_pivots)
    pivots = whole.pivot_targets[kept]
    targets = pivots[:, None] + (whole.targets[kept] - pivots[:, None]) * growth[:, None, None]
    return LeafMoves(whole.billboards[kept], targets, pivots)
