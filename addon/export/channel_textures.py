"""The textures of a page's channels in the materials of a GLB file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .translucency import DIFFUSE_TRANSMISSION


def _in_surface(name: str) -> Callable[[dict[str, Any]], int | None]:
    return lambda material: _index(material.get("pbrMetallicRoughness", {}).get(name))


def _index(texture: dict[str, Any] | None) -> int | None:
    return None if texture is None else texture["index"]


CHANNEL_TEXTURES: dict[str, Callable[[dict[str, Any]], int | None]] = {
    "base_color": _in_surface("baseColorTexture"),
    "orm": _in_surface("metallicRoughnessTexture"),
    "normal": lambda material: _index(material.get("normalTexture")),
    "translucency": lambda material: _index(
        material.get("extensions", {}).get(DIFFUSE_TRANSMISSION, {}).get("diffuseTransmissionColorTexture"),
    ),
    "bent_normal": lambda material: _index(
        material.get("extras", {}).get("leafcloud", {}).get("bentNormalTexture"),
    ),
}
"""Functions that return the index of a channel's texture in a glTF material, or None."""
