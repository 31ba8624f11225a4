"""The settings of a bake that are options of `leafcloud.fit`."""

from __future__ import annotations

from typing import TypedDict

from .bake import BakeSettings
from .levels import Effort, Method


def fit_options(settings: BakeSettings) -> FitOptions:
    """Return the settings of the fit as keyword options of `leafcloud.fit`, without an error bound that is not set."""
    values = {name: getattr(settings, name) for name in FitOptions.__annotations__}
    if settings.epsilon is None:
        del values["epsilon"]
    return FitOptions(**values)  # type: ignore[typeddict-item]


class FitOptions(TypedDict):
    """Names that `BakeSettings` and the options of `leafcloud.fit` have in common; both document them."""

    epsilon: float
    candidates: int
    method: Method
    effort: Effort
    max_billboards: int | None
    extra_error: float
    max_texels: int | None
    max_size: float | None
    compact: float | None
    gather: float
    whole_leaves: bool
    vertical: float
    views: tuple[tuple[float, float, float], ...]
    facing_views: float
    image_epsilon: float | None
    viewing_distance: float | None
    seed: int
