"""The light that the cross impostor gets in Cycles, dimmed to that of the level before.

Its few planes shade each other less than leaves do: a crown was 1.3 to 1.5 times as bright where the cross impostor
took over. Renderers without shadows, and exporters, keep its colors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..material.images import decoded
from ..nodes.builder import Section
from .building import Build
from .fading import output_for
from .material import BACK_NODE, CUTOFF_NODE

_SUNS, _SIDE, _SAMPLES = 24, 64, 2
"""Suns, each with a view of its own, the side of the pictures in pixels, and samples along each side of a pixel."""
_DARKEST = 0.5

SHADE_NODE = "Leafcloud Shade"
"""The node that holds the share of the light that a level does not reflect."""


def dim_in_cycles(material: bpy.types.Material, share: float) -> None:
    """Make a level's material reflect this share of the light in Cycles: the rest of each opaque place is black."""
    tree = material.node_tree
    everywhere, output = tree.get_output_node("ALL"), output_for(tree, "CYCLES")
    opacity = tree.nodes.get(CUTOFF_NODE)
    if opacity is None:
        return  # Blended: no cross impostor is.
    section = Section(tree, "Shade between leaves", (everywhere.location.x, everywhere.location.y + 1800.0))
    black = section.node("ShaderNodeBsdfDiffuse", (0.0, 0.0, 0.0, 1.0)).outputs[0]
    lost = section.math("MULTIPLY", opacity.outputs[0], 1.0 - share, label="Shaded share")
    lost.node.name = SHADE_NODE
    back = tree.nodes.get(BACK_NODE)  # It hides the backs of single-sided levels, black or not.
    target = output.inputs["Surface"] if back is None else back.inputs[1]
    mixed = section.node("ShaderNodeMixShader", lost, target.links[0].from_socket, black).outputs[0]
    tree.links.new(mixed, target)
    everywhere.is_active_output = True


def share_of_cross(build: Build) -> float | None:
    """Return the `light_share` of the cross impostor; None if there is none, or if it needs no light."""
    foliages = [level.foliage for level in build.chain.levels if not isinstance(level, leafcloud.OctahedralLevel)]
    if build.chain.levels[-1].method != "cross" or build.emits:
        return None
    leaves = foliages[-2]() if len(foliages) > 1 else build.foliage
    return light_share(foliages[-1](), leaves, build.foliage)


def light_share(level: leafcloud.Foliage, before: leafcloud.Foliage, tree: leafcloud.Foliage) -> float:
    """Return the light of suns on the level before over that on a level: the mean over suns and views all around.

    `tree`: the leaves, in the middle of the pictures.
    """
    ours, theirs = (sum(_lit(each, tree)) for each in (level, before))
    return min(max(theirs / ours, _DARKEST), 1.0) if ours > 0.0 else 1.0


def _lit(foliage: leafcloud.Foliage, tree: leafcloud.Foliage) -> Iterator[float]:
    """Yield the light of each sun on the foliage, over that of its colors alone."""
    for number, sun in enumerate(_directions(-1.0)):
        view = list(_directions(-0.2))[5 * number % _SUNS]
        centre, radius = tree.world_centre.tolist(), tree.radius
        drawn = partial(leafcloud.render, [foliage], view, _SIDE, centre=centre, radius=radius, samples=_SAMPLES)
        flat, lit = _light(drawn()), _light(drawn(sun=sun))
        yield lit / flat - leafcloud.SKY if flat > 0.0 else 0.0


def _light(codes: NDArray[np.uint8]) -> float:
    shares = codes.astype(np.float32) / 255.0
    return float((decoded(shares[..., :3]) * shares[..., 3:]).sum())


def _directions(lowest: float) -> Iterator[tuple[float, float, float]]:
    """Yield unit vectors on a spiral, down to the height `lowest`."""
    for number in range(_SUNS):
        height = 1.0 - (1.0 - lowest) * (number + 0.5) / _SUNS
        across, turn = math.sqrt(1.0 - height**2), number * math.pi * (3.0 - math.sqrt(5.0))
        yield across * math.cos(turn), across * math.sin(turn), height
