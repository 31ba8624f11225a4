"""Flags of the command line: one for each setting, and flags that choose the action."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from .bake import BakeSettings, described, flag, setting_named
from .naming import with_names
from .setting import NamedSetting, SettingsError

CURVES = ("full", "quick")


class UsageError(Exception):
    """An error in the command line. The message is one line."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; --help lists the flags")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line. Raise `UsageError`; `--help` prints all flags and ends the program."""
    parser = _Parser(
        prog="bake.py",
        description="Bake the leaves of a tree into levels of detail that do not pop.",
        epilog="R is the radius of the leaves' bounding sphere. Exit status: 0 success, 1 failure, 2 wrong command "
        "line, 130 interrupted, 143 terminated. A run that does not succeed leaves DIR unchanged.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--input",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="Input file: .glb, .gltf, .obj, .fbx, .usd or .blend. With several files, each is one tree unless --trees "
        "is given, and only the first may be a .blend (default: the open scene)",
    )
    parser.add_argument(
        "--leaves",
        nargs="+",
        metavar="NAME",
        help="Objects or materials that are leaves (default: found by names such as leaf or needle, else by shape)",
    )
    parser.add_argument(
        "--up",
        choices=("auto", "y", "z"),
        default="auto",
        metavar="AXIS",
        help="Axis of .obj files that points up: y, z, or auto: z if the plant stands on it, else y (default: auto)",
    )
    parser.add_argument("--out", type=_folder, metavar="DIR", help="Output folder for all files. Created if missing")
    for setting in described():
        _add_setting(parser, setting)
    parser.add_argument(
        "--memory",
        type=_limit,
        metavar="GIB",
        help="End the bake if it needs more memory. Only on Linux, outside of Blender (default: 90 %% of the free "
        "memory)",
    )
    parser.add_argument(
        "--minutes",
        type=_limit,
        metavar="M",
        help="End the bake if it takes longer. Only on Linux, outside of Blender (default: no limit)",
    )
    parser.add_argument(
        "--plan-only", action="store_true", help="Print the planned effects with their costs and reasons. Write nothing"
    )
    parser.add_argument("--json", action="store_true", help="Print the plan of --plan-only as JSON instead of a table")
    parser.add_argument(
        "--cost-curve",
        nargs="?",
        const="full",
        choices=CURVES,
        metavar="HOW",
        help="Instead of baking, measure time and image error for many settings, and write NAME_curve.csv, .json, .png "
        "and .svg. HOW is full (minutes) or quick (seconds, on a sample of the leaves) (default: full)",
    )
    options = parser.parse_args(arguments)
    options.views = tuple(options.views or ())
    return options


def settings_of(options: argparse.Namespace) -> BakeSettings:
    """Return the settings given by the flags. Raise `UsageError`."""
    try:
        return BakeSettings(**{each.name: _value(each, getattr(options, each.name)) for each in described()})
    except SettingsError as error:
        raise UsageError(with_flags(str(error))) from error


def _value(each: NamedSetting, value: Any) -> Any:
    return tuple(value) if each.setting.many else value


def with_flags(message: str) -> str:
    """Replace every setting named in the message by its flag."""
    return with_names(message, _flag_words)


_OWN_FLAGS = ("input", "leaves", "up", "out")
"""Flags that are not settings but are named in messages."""


def _flag_words(name: str, value: str | None) -> str | None:
    if name in _OWN_FLAGS:
        return flag(name) if value is None else f"{flag(name)} {value}"
    try:
        setting = setting_named(name)
    except KeyError:
        return None
    if setting.type is bool:
        return _switch(setting)
    # After a space, argparse takes a value that begins with a sign for a flag.
    between = "=" if (value or "").startswith(("+", "-")) else " "
    return flag(name) if value is None else f"{flag(name)}{between}{value}"


def _switch(each: NamedSetting) -> str:
    """Return the flag that changes a setting of type bool from its default."""
    return flag(f"no_{each.name}" if each.default else each.name)


def _add_setting(parser: argparse.ArgumentParser, each: NamedSetting) -> None:
    if each.type is bool:
        action = "store_false" if each.default else "store_true"
        text = f"Turn off: {each.setting.about}" if each.default else each.setting.about
        parser.add_argument(_switch(each), dest=each.name, action=action, help=text)
        return
    more: dict[str, Any] = {"type": _reader(each), "default": each.default}
    if each.setting.many:
        more["nargs"] = "+"
    elif each.type is tuple:
        more = {"type": _direction, "action": "append"}
    parser.add_argument(flag(each.name), metavar=each.setting.unit, help=_help(each), **more)


def _reader(each: NamedSetting) -> Callable[[str], Any]:
    """Return the function that reads a setting's value. It refuses other text than a number with the allowed values."""

    kind = float if each.setting.many else each.type

    def read(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            wanted = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{text!r} is no {wanted}; it must be {each.setting.limit}") from None

    return read


def _help(each: NamedSetting) -> str:
    """Return the help of a flag: the meaning, the allowed values and the default."""
    words, choices = [each.setting.about], each.setting.choices
    if choices:
        words.append(". Choices: " + "; ".join(f"{name}: {what}" if what else name for name, what in choices.items()))
    elif each.setting.limit:
        words.append(f". Must be {each.setting.limit}")
    if each.setting.many:
        words.append(f" (default: {each.setting.unset})")
    elif each.type is not tuple:
        words.append(f" (default: {each.setting.unset if each.default is None else each.default})")
    return with_flags("".join(words)).replace("%", "%%")


def _folder(name: str) -> Path:
    """Return a folder's path. Refuse an empty name, as from an unset variable: it would be the current folder."""
    if not name:
        raise argparse.ArgumentTypeError("the folder name is empty")
    return Path(name)


def _limit(text: str) -> float:
    """Read a limit of memory or time."""
    with suppress(ValueError):
        value = float(text)
        if 0.0 < value < math.inf:
            return value
    raise argparse.ArgumentTypeError(f"{text!r} must be a number above 0")


def _direction(text: str) -> tuple[float, float, float]:
    """Parse three numbers separated by commas. Raise `ValueError` for other text and for a zero vector."""
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) != 3 or not any(numbers):
        raise ValueError(text)
    return numbers[0], numbers[1], numbers[2]
