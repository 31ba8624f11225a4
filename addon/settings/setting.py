"""Description of one setting: its meaning, limits and choices, and the error of a value that they exclude."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints


class SettingsError(ValueError):
    """An invalid setting. The message is one line: the setting, its value, its limit, the remedy; see `naming`."""


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
    many: whether the value is a tuple of numbers, given after one flag.
    choices: allowed words, each with a description or an empty text.
    """

    about: str
    unit: str = ""
    limits: Limits | None = None
    unset: str = ""
    many: bool = False
    choices: Mapping[Any, str] = field(default_factory=dict)

    @property
    def limit(self) -> str:
        """Allowed values in words; empty if any value of the type is allowed."""
        return str(self.limits or "") or (f"one of {', '.join(self.choices)}" if self.choices else "")

    def allows(self, value: Any) -> bool:
        if value is None:
            return bool(self.unset)
        if self.many:
            return all(self.limits is None or self.limits.hold(each) for each in value)
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


def _settings_in(kind: type) -> tuple[NamedSetting, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(NamedSetting.of(name, hint, getattr(kind, name)) for name, hint in hints.items())


settings_in: Callable[[type], tuple[NamedSetting, ...]] = cache(_settings_in)
"""Return the settings that a dataclass and its bases define, in the order of the fields."""


def require(settings: object, name: str, holds: bool, limit: str) -> None:
    """Raise `SettingsError` with the value of the setting `name` and its limit, unless the condition holds."""
    if holds:
        return
    [named] = [each for each in settings_in(type(settings)) if each.name == name]
    usual = named.setting.unset if named.default is None else repr(named.default)
    raise SettingsError(f"`{name}` is {getattr(settings, name)!r}, it must be {limit}; the default is {usual}")


def listed(names: Sequence[str]) -> str:
    """Return the names of settings for a message."""
    return " and ".join(f"`{name}`" for name in names)
