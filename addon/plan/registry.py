"""The registry of effects: one for each file in addon/effects."""

from __future__ import annotations

from functools import cache
from importlib import import_module

from ..settings.effects import EFFECTS
from .effect import Effect


@cache
def all_effects() -> tuple[Effect, ...]:
    """Return the effects, sorted by name."""
    return tuple(import_module(f"..effects.{name}", __package__).EFFECT for name in EFFECTS)


def effect_named(name: str) -> Effect:
    """Return the effect called `name`. Raise `KeyError` for an unknown name."""
    return {effect.name: effect for effect in all_effects()}[name]
