"""The command line's flags: what each is called, what it means, and the settings that they make."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import NoReturn

from .settings import CHAINS, EFFECTS, EFFORTS, ENGINES, METHODS, PRESETS, BakeSettings, SettingsError

CURVES = ("full", "quick")


class UsageError(Exception):
    """The command line is wrong. One line."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; --help lists the flags")


def _folder(name: str) -> Path:
    """A folder's path; an empty name, of a variable that is not set, would be the current folder."""
    if not name:
        raise argparse.ArgumentTypeError("the folder's name is empty")
    return Path(name)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line. Raises `UsageError`; `--help` prints all flags and ends the program."""
    default = BakeSettings()
    parser = _Parser(
        prog="bake.py",
        description="Bakes the leaves of a tree into levels of detail that do not pop.",
        epilog="Lengths are in the scene's units, shares are of the radius R of the leaves' bounding sphere.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--input", type=Path, metavar="FILE", help="a .glb, .gltf, .obj or .blend file (default: the open scene)"
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
    parser.add_argument(
        "--epsilon",
        type=float,
        default=default.epsilon,
        metavar="SHARE",
        help="greatest distance that a vertex may move along its billboard's normal on level 1, "
        "as a share of R, in (0, 1] (default: %(default)s)",
    )
    parser.add_argument(
        "--candidates",
        type=int,
        default=default.candidates,
        metavar="COUNT",
        help="planes tried per billboard, at least 1 (default: %(default)s)",
    )
    parser.add_argument(
        "--levels",
        type=int,
        default=default.levels,
        metavar="COUNT",
        help="number of billboard clouds, the cross not counted (default: %(default)s)",
    )
    parser.add_argument(
        "--no-cross",
        dest="cross",
        action="store_false",
        help="leave out the last level, crossed billboards of the whole tree",
    )
    _add_fit_arguments(parser, default)
    _add_wishes(parser, default)
    parser.add_argument(
        "--seed", type=int, default=default.seed, metavar="NUMBER", help="of every random choice (default: %(default)s)"
    )
    parser.add_argument(
        "--texture-size",
        type=int,
        default=default.texture_size,
        metavar="TEXELS",
        help="columns of level 1's atlas in texels, halved with every level (default: %(default)s)",
    )
    parser.add_argument(
        "--texture-height",
        type=int,
        default=default.texture_height,
        metavar="TEXELS",
        help="rows of level 1's atlas (default: as many as columns)",
    )
    parser.add_argument(
        "--close-cracks",
        action="store_true",
        help="billboards also show the parts of other billboards' leaves that lie within epsilon of their plane",
    )
    parser.add_argument(
        "--pixels",
        type=float,
        default=default.pixels,
        metavar="PIXELS",
        help="a level takes over where its error is seen smaller than this many pixels (default: %(default)s)",
    )
    parser.add_argument(
        "--bend-normals",
        type=float,
        default=default.bend_normals,
        metavar="SHARE",
        help="how far the billboards' normals are bent toward the hull of the crown, 0 to 1 (default: %(default)s)",
    )
    parser.add_argument(
        "--chain",
        default=default.chain,
        metavar="NAME",
        help=f"how the levels follow one another: {', '.join(CHAINS)}; with pruning leaves get ever fewer until the "
        "cross takes over, with both until a first cloud of those that are left does (default: %(default)s)",
    )
    parser.add_argument(
        "--prune-pixels",
        type=float,
        default=default.prune_pixels,
        metavar="PIXELS",
        help="with --chain pruning or both leaves are pruned where one is seen smaller than this "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--prune-half",
        type=float,
        default=default.prune_half,
        metavar="SHARE",
        help="half of the leaves are left at the distance where pruning begins, divided by this; "
        "in (0, 0.5] (default: %(default)s)",
    )
    parser.add_argument(
        "--engine",
        default=default.engine,
        metavar="NAME",
        help=f"which engine the glTF is for: {', '.join(ENGINES)} (default: %(default)s)",
    )
    parser.add_argument(
        "--effects",
        default=default.effects,
        metavar="NAMES",
        help=f"auto, all, none, or out of {','.join(EFFECTS)} with commas between; behind that +NAME and -NAME "
        "force one on or off, and alone they do so over auto, as in --effects=-gloss (default: %(default)s)",
    )
    parser.add_argument(
        "--viewer",
        default=default.viewer,
        metavar="NAME",
        help="who looks at the levels: camera, those of the scene where it has any and no --engine is named, over all "
        "frames; anywhere, as without a camera (default: %(default)s)",
    )
    parser.add_argument(
        "--unlit",
        action="store_true",
        help="what draws the levels shows their colours as they are: light that stands still is baked into them",
    )
    parser.add_argument(
        "--plan-only", action="store_true", help="print which effects the bake would carry, and why; write nothing"
    )
    parser.add_argument(
        "--cost-curve",
        nargs="?",
        const="full",
        choices=CURVES,
        metavar="HOW",
        help="instead of a bake, measure what accuracy costs in time with many settings, and write NAME_curve.csv, "
        ".json, .png and .svg; HOW is full (minutes) or quick (seconds; a sample of the leaves)",
    )
    parser.add_argument("--json", action="store_true", help="print the plan of --plan-only as JSON instead of a table")
    options = parser.parse_args(arguments)
    options.views = tuple(options.views or ())
    return options


def _add_fit_arguments(parser: argparse.ArgumentParser, default: BakeSettings) -> None:
    """How planes are found, how many, and what their outlines look like."""
    parser.add_argument(
        "--method",
        default=default.method,
        metavar="NAME",
        help=f"the fitter: {', '.join(METHODS)} (default: %(default)s); kmeans needs --max-billboards",
    )
    parser.add_argument(
        "--effort",
        default=default.effort,
        metavar="NAME",
        help=f"how long the method stochastic searches: {', '.join(EFFORTS)} (default: %(default)s)",
    )
    parser.add_argument(
        "--max-billboards",
        type=int,
        metavar="COUNT",
        help="at most so many on level 1, at the smallest error bound found that does; --epsilon is then not used",
    )
    parser.add_argument(
        "--max-texels",
        type=int,
        metavar="COUNT",
        help="level 1 needs at most so many, each an eighth of the error bound long, at the smallest bound found "
        "that does, but not below --epsilon; at least 256",
    )
    parser.add_argument(
        "--max-size",
        type=float,
        metavar="SHARE",
        help="how far a billboard's leaves may lie from where it was found, as a share of R (default: anywhere)",
    )
    parser.add_argument(
        "--compact", type=float, metavar="SHARE", help="part billboards at gaps of this share of R (default: never)"
    )
    parser.add_argument(
        "--gather",
        type=float,
        default=default.gather,
        metavar="WEIGHT",
        help="how much leaves prefer billboards whose middle is near: billboards become smaller, and less of them is "
        "empty; 0 or more, 1 is noticeable (default: %(default)s)",
    )
    parser.add_argument(
        "--max-corners",
        type=int,
        default=default.max_corners,
        metavar="COUNT",
        help="corners of a billboard's outline, 3 to 16; 4 gives rectangles (default: %(default)s)",
    )
    parser.add_argument(
        "--whole-leaves",
        action="store_true",
        help="keep every leaf on one billboard at the cost of more billboards (default: wherever one holds it)",
    )
    parser.add_argument(
        "--vertical",
        type=float,
        default=default.vertical,
        metavar="SHARE",
        help="what a billboard that lies flat loses when it is chosen, 0 to 1 (default: %(default)s)",
    )
    parser.add_argument(
        "--views",
        action="append",
        type=_direction,
        metavar="X,Y,Z",
        help="a likely direction of view in the scene, for --facing-views; may be given again (--views=-1,0,0 where it "
        "begins with a minus)",
    )
    parser.add_argument(
        "--facing-views",
        type=float,
        default=default.facing_views,
        metavar="SHARE",
        help="what a billboard loses that none of --views sees face-on, 0 to 1 (default: %(default)s)",
    )
    parser.add_argument(
        "--image-epsilon",
        type=float,
        metavar="RADIANS",
        help="greatest angle by which a vertex may be seen to move, with --viewing-distance",
    )
    parser.add_argument(
        "--viewing-distance",
        type=float,
        metavar="SHARE",
        help="how near a viewer comes to the crown's centre, as a share of R above 1, with --image-epsilon",
    )


def _add_wishes(parser: argparse.ArgumentParser, default: BakeSettings) -> None:
    """How good the levels are to be, in place of settings that decide it."""
    parser.add_argument(
        "--samples",
        type=int,
        default=default.samples,
        metavar="COUNT",
        help="of each texel, along each of its sides, 1 to 16 (default: %(default)s)",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        metavar="SECONDS",
        help="make the levels as good as possible in so many, measured without Blender's start and the files; chooses "
        "--epsilon, --samples, --effort, and a page not above --texture-size",
    )
    parser.add_argument(
        "--image-error",
        type=float,
        metavar="ERROR",
        help="the same, as quickly as possible with at most this image error on level 1, between 0 and 1",
    )
    parser.add_argument(
        "--preset",
        metavar="NAME",
        help=f"the same, by a place on this tree's cost curve: {', '.join(PRESETS)}",
    )


def _direction(text: str) -> tuple[float, float, float]:
    """Three numbers with commas between."""
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) != 3 or not any(numbers):
        raise ValueError(text)
    return numbers[0], numbers[1], numbers[2]


def settings_of(options: argparse.Namespace) -> BakeSettings:
    """The settings that the flags ask for. Raises `UsageError`."""
    names = [field.name for field in fields(BakeSettings)]
    try:
        return BakeSettings(**{name: getattr(options, name) for name in names})
    except SettingsError as error:
        raise UsageError(str(error)) from error
