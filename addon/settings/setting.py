"""Description of one setting: its meaning, limits and choices."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, Literal, get_args, get_origin


@dataclass(frozen=True)
class Limits:
    """Range of a number. Both ends are included; `above` excludes `low`, and `below` excludes `high`."""

    low: float
    high: float = math.inf
    above: bool = False
    below: bool = False

    def hold(self, value: float) -> bool:
        over = self.low < value if self.above else self.low <= value
        under = value < self.high if self.below or self.high == math.inf else value <= self.high
        return over and under

    def __str__(self) -> str:
        low, high = _written(self.low), _written(self.high)
        if self.high == math.inf:
            return f"greater than {low} and finite" if self.above else f"at least {low}"
        if self.above or self.below:
            return (
                f"{'greater than' if self.above else 'at least'} {low} and "
                f"{'less than' if self.below else 'at most'} {high}"
            )
        return f"from {low} to {high}"


def _written(number: float) -> str:
    """Return a number without the zeros of a float."""
    return str(number) if isinstance(number, int) else f"{number:.12g}"


@dataclass(frozen=True)
class Setting:
    """Description of a setting without its name and default.

    about: text of the tooltip and --help, in sentences without the last period. For a switch: the effect when it is on.
    unit: placeholder for the value in --help, in capitals.
    unset: meaning of the value None.
    choices: allowed words, each with a description or an empty text.
    """

    about: str
    unit: str = ""
    limits: Limits | None = None
    unset: str = ""
    choices: Mapping[Any, str] = field(default_factory=dict)

    @property
    def limit(self) -> str:
        """Allowed values in words; empty if any value of the type is allowed."""
        return str(self.limits or "") or (f"one of {', '.join(self.choices)}" if self.choices else "")

    def allows(self, value: Any) -> bool:
        if value is None:
            return bool(self.unset)
        return (self.limits is None or self.limits.hold(value)) and (not self.choices or value in self.choices)


@dataclass(frozen=True)
class NamedSetting:
    """A setting with its name, the type of its values and its default."""

    name: str
    type: type
    default: Any
    setting: Setting

    @staticmethod
    def of(name: str, hint: Any, default: Any) -> NamedSetting:
        """Build it from ``Annotated[type, Setting(…)]``.

        The type loses None; a ``Literal`` becomes ``str``, and a tuple type ``tuple``.
        """
        kind, setting = get_args(hint)
        if NoneType in get_args(kind):
            [kind] = [each for each in get_args(kind) if each is not NoneType]
        origin = get_origin(kind)
        return NamedSetting(name, str if origin is Literal else origin or kind, default, setting)
