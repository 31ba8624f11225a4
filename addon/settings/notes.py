"""Notes about settings that a bake may not follow, because of other settings."""

from __future__ import annotations

from .bake import BakeSettings
from .levels import WISHES
from .setting import listed

_CHOSEN = ("epsilon", "samples", "effort")
"""Settings that the wishes choose. The texture size is chosen, too, but only below the given one."""


def notes(settings: BakeSettings) -> list[str]:
    """Return notes about settings that the bake may not follow, because of other settings."""
    found = []
    wish = [name for name in WISHES if getattr(settings, name) is not None]
    chosen = [name for name in _CHOSEN if getattr(settings, name) != getattr(BakeSettings, name)]
    if wish and chosen:
        found.append(f"{listed(wish)} may replace {listed(chosen)} by other values")
    if settings.facing_views and not settings.views:
        found.append("`facing_views` has no effect without `views`")
    return found
