"""Blended leaf materials: which ones are mostly transparent, and cutouts of the others in files.

Importers and artists leave a material blended if its image has alpha and nobody set a cutoff. Most such leaves have
sharp edges and are not transparent. So texels are counted: the translucent ones, except soft edges of opaque areas,
must outnumber the opaque ones. If corners have alpha, texels are counted for several corner alphas.
Known limit: a material is never mostly transparent if its alpha has to be rendered.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..geometry import Geometry
from .images import opacity_of
from .surface import read_surface

LEAST_SHARE = 0.1
"""Least share of the leaves' area. With less, all leaves are cut out, because a few would force blending on all."""
_CLEAR, _OPAQUE = 0.02, 0.85
_ALPHAS = 9
"""Number of corner alphas to check."""
_EDGE = 2
"""Width of a soft edge in texels."""


def see_through(leaves: Geometry, blended: Sequence[bpy.types.Material]) -> tuple[str, ...]:
    """Return the names of mostly transparent materials of `blended`; none if they cover less than `LEAST_SHARE`."""
    found = [material for material in blended if is_see_through(material, _corner_alphas(leaves, material))]
    a, b, c = np.moveaxis(leaves.positions[leaves.triangles].astype(np.float64), 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    numbers = [number for number, material in enumerate(leaves.materials) if material in found]
    share = areas[np.isin(leaves.material_ids, numbers)].sum() / max(areas.sum(), np.finfo(float).tiny)
    return tuple(material.name for material in found) if share >= LEAST_SHARE else ()


def is_see_through(material: bpy.types.Material, corners: Sequence[float] = (1.0,)) -> bool:
    """Return whether a blended material is mostly transparent, judging by its nodes and image.

    `corners`: alphas of the leaves' corners, with equal weights. They multiply the material's alpha.
    """
    surface = read_surface(material)
    if surface.alpha_mode != "BLEND" or any(not gap.startswith("its base color ") for gap in surface.gaps):
        return False
    try:
        opacity = opacity_of(surface)
    except SceneError:  # The bake reports a missing image.
        return False
    more = 0
    for alpha in corners:
        opaque = alpha * opacity >= _OPAQUE
        between = (alpha * opacity > _CLEAR) & ~_grown(opaque)
        more += int(between.sum()) - int(opaque.sum())
    return more > 0


def _corner_alphas(leaves: Geometry, material: bpy.types.Material) -> Sequence[float]:
    """Return quantiles of the corner alphas of a material's leaves, from the least to the greatest."""
    if leaves.colors is None or read_surface(material).alpha_attribute is None:
        return (1.0,)
    alphas = leaves.colors[leaves.material_ids == leaves.materials.index(material), :, 3]
    return tuple(np.quantile(alphas, np.linspace(0.0, 1.0, _ALPHAS)).tolist())


def _grown(texels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grow a texel mask by `_EDGE` texels in all directions. Images repeat."""
    for axis in (0, 1):
        steps = range(-_EDGE, _EDGE + 1)
        texels = np.logical_or.reduce([np.roll(texels, step, axis) for step in steps])
    return texels


@contextmanager
def masked(leaf_materials: Sequence[bpy.types.Material | None], kept: Collection[str]) -> Iterator[None]:
    """Cut out blended leaf materials at an alpha of ½ while the block runs, except those named in `kept`.

    In engines, crossing cards that are blended have no depth order. They would also look different from the first
    cloud, which is cut out. A uniform alpha above ½ becomes 1. A lower one stays: a cutout would remove the leaves.
    """
    materials = dict.fromkeys(material for material in leaf_materials if material is not None)
    blended = [material for material in materials if is_blended(material) and material.name not in kept]
    alphas = [alpha for material in blended for alpha in _alphas(material.node_tree)]
    with ExitStack() as undo:
        for alpha in alphas:
            if alpha.is_linked:
                undo.callback(_cut_out(alpha))
            elif alpha.default_value > 0.5:
                undo.callback(setattr, alpha, "default_value", alpha.default_value)
                alpha.default_value = 1.0
        yield


def is_blended(material: bpy.types.Material) -> bool:
    """Return whether a material's alpha is blended, or unreadable: exporters treat unreadable alpha as blended."""
    surface = read_surface(material)
    return surface.alpha_mode == "BLEND" or any(gap.startswith("its alpha ") for gap in surface.gaps)


def cut_message(material: bpy.types.Material) -> str:
    """Return the message on a blended leaf material that files do not keep blended."""
    alphas = _alphas(material.node_tree)
    even = [alpha.default_value for alpha in alphas if not alpha.is_linked]
    if not alphas or len(even) < len(alphas):
        way = "cut it out at an alpha of 0.5"
    elif max(even) > 0.5:
        way = f"show its uniform alpha of {even[0]:.3g} as opaque"
    else:
        way = f"keep its uniform alpha of {even[0]:.3g}, without a draw order"
    return f"material {material.name!r} is blended: the glTF files {way}"


def _alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    return [node.inputs["Alpha"] for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]


def _cut_out(alpha: bpy.types.NodeSocket) -> Callable[[], None]:
    """Insert a threshold before a linked alpha, and return a function that removes it."""
    tree, source = alpha.id_data, alpha.links[0].from_socket
    threshold = tree.nodes.new("ShaderNodeMath")
    threshold.operation = "GREATER_THAN"
    threshold.inputs[1].default_value = 0.5
    tree.links.new(source, threshold.inputs[0])
    tree.links.new(threshold.outputs[0], alpha)

    def remove() -> None:
        tree.nodes.remove(threshold)
        tree.links.new(source, alpha)

    return remove
