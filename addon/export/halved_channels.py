"""Smaller PNG images of the pages' other channels, halved as often as the base color (`engine_pages`).

Base color has to keep its coverage, so it is made before the export. The other channels are mip levels of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..levels.material import with_opaque_parts
from .channel_textures import CHANNEL_TEXTURES
from .engine_pages import EnginePage
from .glb_file import Glb
from .translucency import has_opaque_parts


@dataclass(frozen=True)
class HalvedChannels:
    """The pages by material name. Alpha-blended clouds keep all of their images whole."""

    pages: Mapping[str, EnginePage]

    def add_to(self, glb: Glb) -> None:
        """Replace the images of the channels of all materials with pages."""
        images, textures = glb.document.get("images", []), glb.document.get("textures", [])
        done: set[int] = set()
        """Images of this file that are halved. Trees may share them."""
        for material in glb.materials:
            page = self.pages.get(material["name"])
            if page is None or page.halvings == 0 or page.level.alpha_cutoff == 0.0:
                continue
            for channel, find in CHANNEL_TEXTURES.items():
                number = None if channel == "base_color" else find(material)
                if number is not None and (source := textures[number]["source"]) not in done:
                    parts = channel == "translucency" and has_opaque_parts(material)
                    pixels = _with_opaque_parts(page) if parts else page.channel(channel)
                    images[source]["bufferView"] = glb.append_view(leafcloud.encode_png([pixels]))
                    done.add(source)
        if done:
            glb.remove_unused_views()


def _with_opaque_parts(page: EnginePage) -> NDArray[np.uint8]:
    """Return the color of the transmitted light; alpha is the share of texels that transmit any."""
    level = page.level
    assert level.translucency is not None
    alpha = with_opaque_parts(level.translucency, level.base_color)[..., 3]
    pixels = page.channel("translucency")
    height, width = pixels.shape[:2]
    blocks = alpha.reshape(height, alpha.shape[0] // height, width, alpha.shape[1] // width)
    return np.dstack([pixels[..., :3], np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)])
