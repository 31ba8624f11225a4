"""KTX2 textures beside the PNGs of a GLB file: `KHR_texture_basisu`.

An engine that supports the extension uses the KTX2 textures. Any other engine uses the PNGs and makes its own mip
levels. Alpha of the KTX2's mip levels is bent, so that an engine that cuts it out keeps the coverage.
`extras.leafcloud.alphaPivots` of the material lets a shader undo that, to draw alpha as a share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import leafcloud

from ..plan.pages import KTX2_EXTENSION
from .channel_textures import CHANNEL_TEXTURES
from .glb_file import Glb


def is_taken(level: leafcloud.Level) -> bool:
    """Return whether KTX2 is possible: glTF requires sides that are multiples of 4."""
    height, width, _ = level.base_color.shape
    return height % 4 == 0 and width % 4 == 0


@dataclass
class Ktx2Textures:
    """KTX2 textures of the pages of levels, by material name and channel. Each is encoded when it is first used."""

    levels: Mapping[str, leafcloud.Level]
    encoded: dict[tuple[str, str], bytes] = field(default_factory=dict)

    def get(self, material: str, channel: str) -> bytes:
        key = (material, channel)
        if key not in self.encoded:
            self.encoded[key] = self.levels[material].ktx2(channel)
        return self.encoded[key]

    def add_to(self, glb: Glb) -> None:
        """Add the KTX2 textures of its materials. Without levels the file does not change."""
        document = glb.document
        named = [material for material in glb.materials if material["name"] in self.levels]
        done: dict[int, int] = {}
        """The KTX2 image for each PNG. Several textures may use one image."""
        for material in named:
            for channel, find in CHANNEL_TEXTURES.items():
                number = find(material)
                if number is None:
                    continue
                texture = document["textures"][number]
                if texture["source"] not in done:
                    view = glb.append_view(self.get(material["name"], channel))
                    document["images"].append({"bufferView": view, "mimeType": "image/ktx2"})
                    done[texture["source"]] = len(document["images"]) - 1
                texture.setdefault("extensions", {})[KTX2_EXTENSION] = {"source": done[texture["source"]]}
            if pivots := self.levels[material["name"]].alpha_pivots():
                extras = material.setdefault("extras", {}).setdefault("leafcloud", {})
                extras["alphaPivots"] = [round(pivot, 4) for pivot in pivots]
        if done:
            glb.use_extension(KTX2_EXTENSION)
