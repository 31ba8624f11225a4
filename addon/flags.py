"""The command line's flags: those of the settings, and those that say what to do with them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from .setting import Described
from .settings import BakeSettings, SettingsError, described, flag

CURVES = ("full", "quick")


class UsageError(Exception):
    """The command line is wrong. One line."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; --help lists the flags")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line. Raises `UsageError`; `--help` prints all flags and ends the program."""
    parser = _Parser(
        prog="bake.py",
        description="Bakes the leaves of a tree into levels of detail that do not pop.",
        epilog="Lengths are in the scene's units, shares are of the radius R of the leaves' bounding sphere. Exit "
        "status: 0 success, 1 failure, 2 wrong command line, 130 interrupted, 143 terminated; unless it is 0, DIR is "
        "as it was.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--input",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="a .glb, .gltf, .obj or .blend file (default: the open scene); several are a tree each, unless --trees "
        "says otherwise, and of these only the first may be a .blend",
    )
    parser.add_argument(
        "--leaves",
        nargs="+",
        metavar="NAME",
        help="objects or materials that are leaves (default: found by names such as leaf or needle, else by shape)",
    )
    parser.add_argument(
        "--out", type=_folder, metavar="DIR", help="the folder that the files go to; it is made if need be"
    )
    for setting in described():
        _add_setting(parser, setting)
    parser.add_argument(
        "--plan-only", action="store_true", help="print which effects the bake would carry, and why; write nothing"
    )
    parser.add_argument("--json", action="store_true", help="print the plan of --plan-only as JSON instead of a table")
    parser.add_argument(
        "--cost-curve",
        nargs="?",
        const="full",
        choices=CURVES,
        metavar="HOW",
        help="instead of a bake, measure what accuracy costs in time with many settings, and write NAME_curve.csv, "
        ".json, .png and .svg; HOW is full (minutes) or quick (seconds; a sample of the leaves)",
    )
    options = parser.parse_args(arguments)
    options.views = tuple(options.views or ())
    return options


def settings_of(options: argparse.Namespace) -> BakeSettings:
    """The settings that the flags ask for. Raises `UsageError`."""
    try:
        return BakeSettings(**{each.name: getattr(options, each.name) for each in described()})
    except SettingsError as error:
        raise UsageError(str(error)) from error


def _add_setting(parser: argparse.ArgumentParser, each: Described) -> None:
    if each.type is bool:
        name = flag(f"no_{each.name}" if each.default else each.name)
        action = "store_false" if each.default else "store_true"
        text = f"do without {each.setting.about}" if each.default else each.setting.about
        parser.add_argument(name, dest=each.name, action=action, help=text)
        return
    more: dict[str, Any] = {"type": each.type, "default": each.default}
    if each.type is tuple:
        more = {"type": _direction, "action": "append"}
    parser.add_argument(flag(each.name), metavar=each.setting.unit, help=_help(each), **more)


def _help(each: Described) -> str:
    """What the setting means, what it may be, and what it is where the flag is not given."""
    words, choices = [each.setting.about], each.setting.choices
    if choices:
        words.append(": " + "; ".join(f"{name}, {what}" if what else name for name, what in choices.items()))
    elif each.setting.limit:
        words.append(f"; {each.setting.limit}")
    if each.type is not tuple:
        words.append(f" (default: {each.setting.unset if each.default is None else each.default})")
    return "".join(words).replace("%", "%%")


def _folder(name: str) -> Path:
    """A folder's path; an empty name, of a variable that is not set, would be the current folder."""
    if not name:
        raise argparse.ArgumentTypeError("the folder's name is empty")
    return Path(name)


def _direction(text: str) -> tuple[float, float, float]:
    """Three numbers with commas between."""
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) != 3 or not any(numbers):
        raise ValueError(text)
    return numbers[0], numbers[1], numbers[2]
