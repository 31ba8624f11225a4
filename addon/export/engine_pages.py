"""Pages for engines, which make the mip levels of a PNG by plain means: in place only while files are written.

Plain means lose what is thin. With a lower cutoff, and alpha to suit it, crowns keep their density for some levels
(`leafcloud.Level.for_engines`); Blender itself looks at the page as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager

import bpy

import leafcloud

from ..build.materials import CUTOFF_NODE, PAGE_NODE, atlas_image


@contextmanager
def engine_pages(levels: Mapping[str, leafcloud.Level]) -> Iterator[None]:
    """Gives the clouds' materials, by their names, the pages and cutoffs for engines.

    What is blended keeps its own: plain means suit it.
    """
    materials: dict[bpy.types.Image, list[str]] = {}
    for name, level in levels.items():
        if level.alpha_cutoff > 0.0:
            materials.setdefault(bpy.data.materials[name].node_tree.nodes[PAGE_NODE].image, []).append(name)
    with ExitStack() as stack:
        for page, names in materials.items():
            trees = [bpy.data.materials[name].node_tree for name in names]
            stack.enter_context(_engine_page(page, trees, levels[names[0]]))
        yield


@contextmanager
def _engine_page(page: bpy.types.Image, trees: Sequence[bpy.types.NodeTree], level: leafcloud.Level) -> Iterator[None]:
    """Of materials that show the same `page`, by which they have one cutoff."""
    pixels, cutoff = level.for_engines()
    textures = [tree.nodes[PAGE_NODE] for tree in trees]
    thresholds = [tree.nodes[CUTOFF_NODE].inputs[1] for tree in trees]
    name, own_cutoff = page.name, thresholds[0].default_value
    page.name = "Leafcloud page in Blender"  # The file has the other by its name.
    shown = None
    try:
        shown = atlas_image(name, pixels)
        _show(textures, thresholds, shown, cutoff)
        yield
    finally:
        _show(textures, thresholds, page, own_cutoff)
        if shown is not None:
            bpy.data.images.remove(shown)
        page.name = name


def _show(
    textures: Sequence[bpy.types.Node],
    thresholds: Sequence[bpy.types.NodeSocket],
    page: bpy.types.Image,
    cutoff: float,
) -> None:
    for texture, threshold in zip(textures, thresholds, strict=True):
        texture.image, threshold.default_value = page, cutoff
