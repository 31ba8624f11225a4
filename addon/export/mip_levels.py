"""Mip levels of the base color beside the pages' PNG images, for packages that read them: `extras.leafcloud.mipLevels`.

Engines make box-filtered mip levels of a PNG, and sparse leaves dissolve in them. A package gives the texture these
levels instead: those of the KTX2 file before its compression (`leafcloud.Level.mips`). Other readers ignore them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import leafcloud

from .channel_textures import CHANNEL_TEXTURES
from .engine_pages import EnginePage
from .glb_file import Glb


@dataclass
class MipLevels:
    """The pages by material name. Each image is encoded when it is first used."""

    pages: Mapping[str, EnginePage]
    encoded: dict[str, bytes] = field(default_factory=dict)

    def add_to(self, glb: Glb) -> None:
        """Add an image of the mip levels to each material with a page that is cut out."""
        document = glb.document
        for material in glb.materials:
            page = self.pages.get(material["name"])
            if page is None or page.level.alpha_cutoff == 0.0:
                continue
            number = CHANNEL_TEXTURES["base_color"](material)
            assert number is not None
            image = document["images"][document["textures"][number]["source"]]["name"]
            if image not in self.encoded:
                self.encoded[image] = leafcloud.encode_png([stacked(page.mips())])
            texture = glb.append_texture(material, f"{image} mip levels", self.encoded[image])
            material.setdefault("extras", {}).setdefault("leafcloud", {})["mipLevels"] = {"index": texture}


def stacked(levels: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return images (h, w, 4) under one another, at the left side of an image as wide as the first, which is widest."""
    width = levels[0].shape[1]
    return np.concatenate([np.pad(level, ((0, 0), (0, width - level.shape[1]), (0, 0))) for level in levels])
