"""The setting `effects`: a list of effects to turn on or off."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

EFFECTS = tuple(sorted(module.name for module in pkgutil.iter_modules([str(Path(__file__).parents[1] / "effects")])))
"""Names of all effects: the files in addon/effects."""

EFFECT_CHOICES = ("auto", "all", "none")
"""Words that may begin a list of effects in place of names."""


@dataclass(frozen=True)
class AskedEffects:
    """A parsed list of effects.

    base: the word of `EFFECT_CHOICES` in the list, or None.
    names: the effects listed without a sign.
    forced: the effects listed with a sign: True for +, False for -.
    """

    base: str | None
    names: tuple[str, ...]
    forced: Mapping[str, bool]

    @property
    def known(self) -> bool:
        """True if all names are effects, and the list does not have both a base and names without a sign."""
        return (self.base is None or not self.names) and {*self.names, *self.forced} <= set(EFFECTS)

    def listed(self, name: str) -> bool | None:
        """Return whether the list turns the effect on; None leaves the decision to the plan."""
        if name in self.forced:
            return self.forced[name]
        if self.base == "auto":
            return None
        return self.base == "all" or name in self.names

    def named(self, name: str) -> bool:
        """Return whether the list turns the effect on by its name, with or without a sign."""
        return self.forced.get(name, name in self.names)


def asked_effects(effects: str) -> AskedEffects:
    """Parse a list of effects separated by commas, without checking the names."""
    words = [word.strip() for word in effects.split(",")]
    forced = {word[1:].strip(): word[0] == "+" for word in words if word[:1] in ("+", "-")}
    plain = [word for word in words if word[:1] not in ("+", "-")]
    base = next((word for word in plain if word in EFFECT_CHOICES), None if plain else "auto")
    return AskedEffects(base, tuple(word for word in plain if word != base), forced)
