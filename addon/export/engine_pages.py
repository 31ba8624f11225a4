"""Pages for engines, which make the mip levels of a PNG by plain means: in place only while files are written.

Plain means lose what is thin. With a lower cutoff, and alpha to suit it, crowns keep their density for some levels
(`leafcloud.Level.for_engines`); Blender itself looks at the page as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager

import bpy

import leafcloud

from ..build.materials import CUTOFF_NODE, PAGE_NODE, atlas_image


@contextmanager
def engine_pages(levels: Mapping[str, leafcloud.Level]) -> Iterator[None]:
    """Gives the clouds' materials, by their names, the pages and cutoffs for engines.

    What is blended keeps its own: plain means suit it.
    """
    with ExitStack() as stack:
        for name, level in levels.items():
            if level.alpha_cutoff == 0.0:
                continue
            stack.enter_context(_engine_page(bpy.data.materials[name].node_tree, level))
        yield


@contextmanager
def _engine_page(tree: bpy.types.NodeTree, level: leafcloud.Level) -> Iterator[None]:
    pixels, cutoff = level.for_engines()
    texture, threshold = tree.nodes[PAGE_NODE], tree.nodes[CUTOFF_NODE].inputs[1]
    page, own_cutoff = texture.image, threshold.default_value
    name = page.name
    page.name = "Leafcloud page in Blender"  # The file has the other by its name.
    try:
        texture.image, threshold.default_value = atlas_image(name, pixels), cutoff
        yield
    finally:
        if texture.image != page:
            bpy.data.images.remove(texture.image)
        texture.image, threshold.default_value = page, own_cutoff
        page.name = name
