"""Mip levels of pages that lie under one another in images of a file, and files without them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def levels_in(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the square mip levels that lie under one another at the left side of an image, the largest first."""
    found, top, side = [], 0, image.shape[1]
    while side:
        found.append(image[top : top + side, :side])
        top, side = top + side, side // 2
    assert top == len(image)
    return found


def with_levels(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the materials that have mip levels; there are some."""
    found = [each for each in document["materials"] if "mipLevels" in each.get("extras", {}).get("leafcloud", {})]
    assert found
    return found


def without(document: dict[str, Any], _: bytearray) -> None:
    """Remove the mip levels, as a tool that drops unknown images does."""
    for material in with_levels(document):
        del material["extras"]["leafcloud"]["mipLevels"]


def of_another_size(document: dict[str, Any], _: bytearray) -> None:
    """Make the pages their own mip levels."""
    for material in with_levels(document):
        material["extras"]["leafcloud"]["mipLevels"] = material["pbrMetallicRoughness"]["baseColorTexture"]


def numbered_anew(document: dict[str, Any], _: bytearray) -> None:
    """Leave the number of a texture that is no more."""
    for material in with_levels(document):
        material["extras"]["leafcloud"]["mipLevels"] = {"index": len(document["textures"])}
