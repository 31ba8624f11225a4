"""What is known of one setting: what it means, what it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, Literal, get_args, get_origin


@dataclass(frozen=True)
class Limits:
    """Which numbers a setting may be. Of whole numbers both ends are in; `above` and `below` leave an end out."""

    low: float
    high: float = math.inf
    above: bool = False
    below: bool = False

    def hold(self, value: float) -> bool:
        over = self.low < value if self.above else self.low <= value
        under = value < self.high if self.below or self.high == math.inf else value <= self.high
        return over and under

    def __str__(self) -> str:
        if self.high == math.inf:
            return f"greater than {self.low:g} and finite" if self.above else f"at least {self.low:g}"
        if self.above or self.below:
            return (
                f"{'greater than' if self.above else 'at least'} {self.low:g} and "
                f"{'less than' if self.below else 'at most'} {self.high:g}"
            )
        return f"from {self.low} to {self.high}"


@dataclass(frozen=True)
class Setting:
    """What is known of a setting beside its name and default.

    about: what it means, as a sentence without its first capital and its point; of one that is on, what is then there.
    unit: of its value, in capitals, as the command line names what follows a flag.
    unset: what None stands for.
    choices: the words that it may be, each with what it stands for or nothing.
    """

    about: str
    unit: str = ""
    limits: Limits | None = None
    unset: str = ""
    choices: Mapping[str, str] = field(default_factory=dict)

    @property
    def limit(self) -> str:
        """What it may be, in words; empty for what needs none."""
        return str(self.limits or "") or (f"one of {', '.join(self.choices)}" if self.choices else "")

    def allows(self, value: Any) -> bool:
        if value is None:
            return bool(self.unset)
        return (self.limits is None or self.limits.hold(value)) and (not self.choices or value in self.choices)


@dataclass(frozen=True)
class Described:
    """A setting with its name, the type of its values, and its default."""

    name: str
    type: type
    default: Any
    setting: Setting

    @staticmethod
    def of(name: str, hint: Any, default: Any) -> Described:
        """From ``Annotated[type, Setting(…)]``: the type without None; of words ``str``, of tuples ``tuple``."""
        kind, setting = get_args(hint)
        if NoneType in get_args(kind):
            [kind] = [each for each in get_args(kind) if each is not NoneType]
        origin = get_origin(kind)
        return Described(name, str if origin is Literal else origin or kind, default, setting)
