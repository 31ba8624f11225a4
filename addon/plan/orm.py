"""The ORM image: occlusion, roughness and metallic in one texture. Three effects share it; the first one pays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .decision import Decision, first_on
from .rates import BYTES_PER_TEXEL, Rate

if TYPE_CHECKING:
    import leafcloud

_USERS = ("roughness_metallic", "occlusion", "self_shadowing")
CHANNEL = "orm"
"""The core's name of the image."""
RATE = Rate(lambda known: known.texels, BYTES_PER_TEXEL, seconds=1.65e-7, seconds_per_layer=8.3e-9)


def pays(name: str, decisions: Sequence[Decision]) -> bool:
    """Return whether the image is charged to the effect `name`."""
    return first_on(decisions, _USERS) == name


def seconds(name: str, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
    """Return the core's seconds for the image, if they are charged to the effect `name`; else 0."""
    spent = (level.channel_seconds.get(CHANNEL, 0.0) for level in chain.clouds)
    return sum(spent) if pays(name, decisions) else 0.0
