"""Through which leaves what is behind them is seen.

Importers and artists leave a material blended wherever its image has alpha and nobody asked for a cutoff; most such
leaves have edges, and nothing is seen through them. So texels are looked at: what lies between opaque and clear, and is
no soft edge of something opaque, has to be more than what is opaque; where corners have alpha, as often as they have
it. Known limit: of a material whose alpha has to be rendered nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from . import SceneError
from .describe import opacity_of
from .extract import Geometry
from .surface import read_surface

LEAST_SHARE = 0.1
"""Of the leaves' area: fewer leaves are cut out with the others, which would all be blended for their sake."""
_CLEAR, _OPAQUE = 0.02, 0.85
_ALPHAS = 9
"""Of corners that are looked at."""
_EDGE = 2
"""Texels that a soft edge is wide."""


def see_through(leaves: Geometry, blended: Sequence[bpy.types.Material]) -> tuple[str, ...]:
    """The names of those of the `blended` materials, if enough of the leaves have them."""
    found = [material for material in blended if is_see_through(material, _corner_alphas(leaves, material))]
    a, b, c = np.moveaxis(leaves.positions[leaves.triangles].astype(np.float64), 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    numbers = [number for number, material in enumerate(leaves.materials) if material in found]
    share = areas[np.isin(leaves.material_ids, numbers)].sum() / max(areas.sum(), np.finfo(float).tiny)
    return tuple(material.name for material in found) if share >= LEAST_SHARE else ()


def is_see_through(material: bpy.types.Material, corners: Sequence[float] = (1.0,)) -> bool:
    """Whether what is behind a material is seen through most of it, as far as its nodes and its image say.

    `corners`: alphas by which its leaves multiply that, each as often as the others.
    """
    surface = read_surface(material)
    if surface.alpha_mode != "BLEND" or any(not gap.startswith("its base colour ") for gap in surface.gaps):
        return False
    try:
        opacity = opacity_of(surface)
    except SceneError:  # An image that is missing is told when it is baked.
        return False
    more = 0
    for alpha in corners:
        opaque = alpha * opacity >= _OPAQUE
        between = (alpha * opacity > _CLEAR) & ~_grown(opaque)
        more += int(between.sum()) - int(opaque.sum())
    return more > 0


def _corner_alphas(leaves: Geometry, material: bpy.types.Material) -> Sequence[float]:
    """Some of the alphas that corners of a material's leaves have, evenly from the least to the greatest."""
    if leaves.colors is None or read_surface(material).alpha_attribute is None:
        return (1.0,)
    alphas = leaves.colors[leaves.material_ids == leaves.materials.index(material), :, 3]
    return tuple(np.quantile(alphas, np.linspace(0.0, 1.0, _ALPHAS)).tolist())


def _grown(texels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """With what lies within an edge of them; images repeat."""
    for axis in (0, 1):
        steps = range(-_EDGE, _EDGE + 1)
        texels = np.logical_or.reduce([np.roll(texels, step, axis) for step in steps])
    return texels
