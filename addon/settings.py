"""What a bake is asked to do: checked where it is made, so that nothing behind it has to check again."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal, get_args

Method = Literal["stochastic"]

METHODS = get_args(Method)
ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
CHAINS = ("billboards",)
EFFECTS = ("transitions", "pruning", "back_sides")
EFFECT_CHOICES = ("auto", "all", "none")
"""What may stand in place of a list of effects."""

MOST_LEVELS = 8
SMALLEST_TEXTURE = 64
LARGEST_TEXTURE = 16384
MOST_CANDIDATES = 1_000_000
LARGEST_SEED = 2**63 - 1


class SettingsError(ValueError):
    """A setting that cannot be followed. One line: the flag, its value, its limit, what to do."""


@dataclass(frozen=True)
class BakeSettings:
    """The settings of one bake, the same from the command line and from the interface.

    epsilon: greatest distance that a vertex of level 1 may move along its plane's normal, as a share of R; in (0, 1].
    candidates: planes tried per billboard; ≥ 1.
    levels: number of clouds behind the leaves; 1 … 8.
    method: the fitter.
    seed: of every random choice; ≥ 0.
    texture_size: side of level 1's atlas in texels, halved with every level, not below 64; 64 … 16384.
    cross: whether two crossed billboards of the whole tree follow behind the clouds.
    effects: "auto", "all", "none", or names out of `EFFECTS` with commas between them.
    engine: which engine the glTF files are meant for.
    chain: how the levels follow one another.
    pixels: a level takes over where its greatest deviation is seen smaller than this many pixels; > 0.

    Raises `SettingsError` for a value outside its range.
    """

    epsilon: float = 0.04
    candidates: int = 600
    levels: int = 2
    method: Method = "stochastic"
    seed: int = 0
    texture_size: int = 2048
    cross: bool = True
    effects: str = "auto"
    engine: str = "generic"
    chain: str = "billboards"
    pixels: float = 8.0

    def __post_init__(self) -> None:
        self._require("epsilon", 0.0 < self.epsilon <= 1.0, "greater than 0 and at most 1 (a share of the radius)")
        self._require("candidates", 1 <= self.candidates <= MOST_CANDIDATES, f"from 1 to {MOST_CANDIDATES}")
        self._require("levels", 1 <= self.levels <= MOST_LEVELS, f"from 1 to {MOST_LEVELS}")
        self._require("seed", 0 <= self.seed <= LARGEST_SEED, f"from 0 to {LARGEST_SEED}")
        texture = SMALLEST_TEXTURE <= self.texture_size <= LARGEST_TEXTURE
        self._require("texture_size", texture, f"from {SMALLEST_TEXTURE} to {LARGEST_TEXTURE} texels")
        self._require("pixels", 0.0 < self.pixels < math.inf, "greater than 0 and finite")
        self._require("method", self.method in METHODS, f"one of {', '.join(METHODS)}")
        self._require("engine", self.engine in ENGINES, f"one of {', '.join(ENGINES)}")
        self._require("chain", self.chain in CHAINS, f"one of {', '.join(CHAINS)}")
        known = self.effects in EFFECT_CHOICES or set(effect_names(self.effects)) <= set(EFFECTS)
        choices = f"{', '.join(EFFECT_CHOICES)}, or a list out of {', '.join(EFFECTS)} with commas between"
        self._require("effects", known, choices)

    def _require(self, name: str, holds: bool, limit: str) -> None:
        if holds:
            return
        value, default = getattr(self, name), next(field.default for field in fields(self) if field.name == name)
        raise SettingsError(f"{flag(name)} is {value!r}, it must be {limit}; the default is {default!r}")


def flag(name: str) -> str:
    """The command line's flag for the setting `name`."""
    return "--" + name.replace("_", "-")


def effect_names(effects: str) -> tuple[str, ...]:
    """The names in a list with commas between, without the spaces around them."""
    return tuple(name.strip() for name in effects.split(","))
