"""Costs of effects as functions of amounts that are known before the bake: vertices, texels or triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

BYTES_PER_TEXEL = 4
BILLBOARD_VERTICES = 1000
"""Typical number of vertices that level 1's billboards and leaves split between billboards add."""


@dataclass(frozen=True)
class Amounts:
    """The amounts that costs are proportional to."""

    vertices: int
    """Vertices of the leaves."""
    triangles: int
    """Triangles of the leaves."""
    trunk: int
    """Trunk triangles of all clouds together, before simplification."""
    trunk_left: int
    """Estimated trunk triangles of all clouds together, after simplification."""
    texels: int
    """Texels of the atlas pages of all levels."""
    far_texels: int
    """Texels of the atlas pages after level 1's."""
    depth: float
    """Mean number of leaves along a line of sight."""
    leaf_size: float
    """Size of a leaf as a fraction of R."""

    @property
    def all_vertices(self) -> int:
        """Vertices of the leaves and of level 1's billboards."""
        return self.vertices + BILLBOARD_VERTICES

    @property
    def first_texels(self) -> int:
        """Texels of level 1's atlas page."""
        return self.texels - self.far_texels


@dataclass(frozen=True)
class Rate:
    """The cost of an effect as a function of an amount, with `depth` from `Amounts`.

    seconds = `fixed` + `per_layer` · depth + (`seconds` + `seconds_per_layer` · depth) · amount
    bytes = `nbytes` · amount
    """

    amount: Callable[[Amounts], int]
    nbytes: float = 0.0
    fixed: float = 0.0
    per_layer: float = 0.0
    seconds: float = 0.0
    seconds_per_layer: float = 0.0

    def time(self, known: Amounts) -> float:
        each = self.seconds + self.seconds_per_layer * known.depth
        return self.fixed + self.per_layer * known.depth + each * self.amount(known)

    def size(self, known: Amounts) -> float:
        return self.nbytes * self.amount(known)
