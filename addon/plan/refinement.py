"""Warnings about a refinement that changes nothing."""

from __future__ import annotations

from collections.abc import Sequence

import leafcloud


def refine_warnings(refine: str, levels: Sequence[leafcloud.AnyLevel]) -> list[str]:
    """Return a warning for levels after LOD 0 that the setting `refine` does not change."""
    if refine == "off":
        return []
    clouds = {number: level for number, level in enumerate(levels, start=1) if level.cloud is not None}
    if not clouds:
        return ["`refine` has no effect: no level has billboards"]
    return [
        f"`refine` has no effect on level {number}: its billboards are alpha-blended"
        for number, level in clouds.items()
        if isinstance(level, leafcloud.Level) and level.alpha_cutoff == 0.0
    ]
