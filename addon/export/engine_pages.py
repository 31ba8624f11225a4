"""Atlas pages for engines, used only while files are written.

Engines make box-filtered mips of a PNG, and these lose thin leaves. With a lower alpha cutoff and remapped alpha crowns
keep their density for some mip levels (`leafcloud.Level.for_engines`). Blender itself uses the original page.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager

import bpy

import leafcloud

from ..levels.material import CUTOFF_NODE, PAGE_NODE, atlas_image


@contextmanager
def engine_pages(levels: Mapping[str, leafcloud.Level]) -> Iterator[None]:
    """Give the clouds' materials the atlas pages and alpha cutoffs for engines while the block runs.

    `levels`: by the names of the materials. Alpha-blended clouds keep their page: box-filtered mips suit them.
    """
    materials: dict[bpy.types.Image, dict[str, leafcloud.Level]] = {}
    for name, level in levels.items():
        if level.alpha_cutoff > 0.0:
            page = bpy.data.materials[name].node_tree.nodes[PAGE_NODE].image
            materials.setdefault(page, {})[name] = level
    with ExitStack() as stack:
        for page, sharers in materials.items():
            stack.enter_context(_engine_page(page, sharers))
        yield


@contextmanager
def _engine_page(page: bpy.types.Image, levels: Mapping[str, leafcloud.Level]) -> Iterator[None]:
    """Replace one `page` while the block runs, in all materials that share it. Each material has its own cutoff."""
    trees = [bpy.data.materials[name].node_tree for name in levels]
    textures = [tree.nodes[PAGE_NODE] for tree in trees]
    thresholds = [tree.nodes[CUTOFF_NODE].inputs[1] for tree in trees]
    own_cutoffs = [threshold.default_value for threshold in thresholds]
    cutoffs = [level.for_engines()[1] for level in levels.values()]
    name = page.name
    page.name = "Leafcloud page in Blender"  # The files need this name for the other image.
    shown = None
    try:
        shown = atlas_image(name, next(iter(levels.values())).for_engines()[0])
        _show(textures, thresholds, shown, cutoffs)
        yield
    finally:
        _show(textures, thresholds, page, own_cutoffs)
        if shown is not None:
            bpy.data.images.remove(shown)
        page.name = name


def _show(
    textures: Sequence[bpy.types.Node],
    thresholds: Sequence[bpy.types.NodeSocket],
    page: bpy.types.Image,
    cutoffs: Sequence[float],
) -> None:
    for texture, threshold, cutoff in zip(textures, thresholds, cutoffs, strict=True):
        texture.image, threshold.default_value = page, cutoff
