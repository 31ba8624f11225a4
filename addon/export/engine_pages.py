"""Atlas pages for engines, used only while files are written.

Engines make box-filtered mips of a PNG, and these lose thin leaves. Pages for engines keep the density of crowns for
some mip levels, with another alpha cutoff (`leafcloud.Level.for_engines`). Blender itself uses the original page.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..levels.material import CUTOFF_NODE, PAGE_NODE, atlas_image


@dataclass(frozen=True)
class EnginePage:
    """The page of a level with its sides halved `halvings` times, because engines draw the level only small.

    KTX2 stays whole.
    """

    level: leafcloud.Level
    halvings: int = 0

    def base_color(self) -> NDArray[np.uint8]:
        return self.level.for_engines(self.halvings)[0]

    def alpha_cutoff(self) -> float:
        return self.level.for_engines(self.halvings)[1]

    def channel(self, name: str) -> NDArray[np.uint8]:
        return self.level.halved(name, self.halvings)

    def mips(self) -> list[NDArray[np.uint8]]:
        return self.level.mips(self.halvings)

    def ktx2(self, channel: str) -> bytes:
        return self.level.ktx2(channel, self.halvings)


@contextmanager
def engine_pages(pages: Mapping[str, EnginePage]) -> Iterator[None]:
    """Give the clouds' materials the atlas pages and alpha cutoffs for engines while the block runs.

    `pages`: by the names of the materials. Alpha-blended clouds keep their page: box-filtered mips suit them.
    """
    materials: dict[bpy.types.Image, dict[str, EnginePage]] = {}
    for name, page in pages.items():
        if page.level.alpha_cutoff > 0.0:
            image = bpy.data.materials[name].node_tree.nodes[PAGE_NODE].image
            materials.setdefault(image, {})[name] = page
    with ExitStack() as stack:
        for image, sharers in materials.items():
            stack.enter_context(_engine_page(image, sharers))
        yield


@contextmanager
def _engine_page(image: bpy.types.Image, pages: Mapping[str, EnginePage]) -> Iterator[None]:
    """Replace one `image` while the block runs, in all materials that share it. Each material has its own cutoff."""
    trees = [bpy.data.materials[name].node_tree for name in pages]
    textures = [tree.nodes[PAGE_NODE] for tree in trees]
    thresholds = [tree.nodes[CUTOFF_NODE].inputs[1] for tree in trees]
    own_cutoffs = [threshold.default_value for threshold in thresholds]
    cutoffs = [page.alpha_cutoff() for page in pages.values()]
    name = image.name
    image.name = "Leafcloud page in Blender"  # The files need this name for the other image.
    shown = None
    try:
        shown = atlas_image(name, next(iter(pages.values())).base_color())
        _show(textures, thresholds, shown, cutoffs)
        yield
    finally:
        _show(textures, thresholds, image, own_cutoffs)
        if shown is not None:
            bpy.data.images.remove(shown)
        image.name = name


def _show(
    textures: Sequence[bpy.types.Node],
    thresholds: Sequence[bpy.types.NodeSocket],
    page: bpy.types.Image,
    cutoffs: Sequence[float],
) -> None:
    for texture, threshold, cutoff in zip(textures, thresholds, cutoffs, strict=True):
        texture.image, threshold.default_value = page, cutoff
