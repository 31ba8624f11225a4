"""Settings of a bake. Each one is defined here once, with its limits and texts.

The command line's flags, Blender's properties and the checks are made from these definitions. Code that receives a
`BakeSettings` need not check it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal, TypedDict, get_type_hints

from .effects import EFFECT_CHOICES, EFFECTS, asked_effects
from .setting import Described, Limits, Setting

Method = Literal["stochastic", "density", "kmeans"]
Effort = Literal["literal", "default", "final", "best"]
Preset = Literal["draft", "balanced", "final"]

WISHES = ("seconds", "image_error", "preset")
"""Settings that choose epsilon, texture size, samples and effort by a quick cost curve. At most one may be set."""
_FIX_EPSILON = ("method", "max_billboards", "max_texels", "image_epsilon", "chain")
"""Settings that exclude the wishes unless they have their defaults: they leave no epsilon to choose."""
ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
CHAINS = {
    "billboards": "all leaves until the first cloud takes over",
    "pruning": "fewer leaves with distance, then the cross impostor, without clouds",
    "both": "fewer leaves with distance, then a first cloud made of the remaining leaves",
}

SMALLEST_TEXTURE = 64


class SettingsError(ValueError):
    """An invalid setting. The message is one line: the setting, its value, its limit, the remedy; see `naming`."""


_SHARE = Limits(0, 1)
_POSITIVE = Limits(0, above=True)


@dataclass(frozen=True)
class BakeSettings:
    """Settings of one bake, the same for the command line and the interface.

    R is the radius of the bounding sphere of the leaves. Raises `SettingsError` for a value outside its limits, and for
    settings that exclude one another.
    """

    epsilon: Annotated[
        float,
        Setting(
            "Maximum distance a leaf may move along its billboard's normal on level 1, as a fraction of the crown "
            "radius R. Smaller is more accurate and uses more billboards",
            "FRACTION",
            Limits(0, 1, above=True),
        ),
    ] = 0.04
    candidates: Annotated[
        int,
        Setting(
            "Planes tried per billboard. More gives fewer billboards and takes longer", "COUNT", Limits(1, 1_000_000)
        ),
    ] = 600
    levels: Annotated[
        int,
        Setting(
            "Number of billboard clouds, without the leaves and the cross impostor. Each cloud has 2.5 times the error "
            "bound and half the texture size of the one before",
            "COUNT",
            Limits(1, 8),
        ),
    ] = 2
    cross: Annotated[bool, Setting("Cross impostor of the whole tree as the last level")] = True
    method: Annotated[
        Method,
        Setting(
            "Algorithm that fits the billboards",
            "NAME",
            choices={
                "stochastic": "search for the planes that hold the most leaves",
                "density": "densest planes first",
                "kmeans": "k-means clusters of leaves, as many as `max_billboards`",
            },
        ),
    ] = "stochastic"
    effort: Annotated[
        Effort,
        Setting(
            "Search time of the stochastic method. A longer search finds fewer billboards",
            "NAME",
            choices={
                "literal": "the published algorithm, for comparison",
                "default": "greedy search over all directions and offsets: a fraction of a second",
                "final": "the greedy search, then a search for fewer billboards: seconds",
                "best": "the same as final with ten times the search time",
            },
        ),
    ] = "default"
    max_billboards: Annotated[
        int | None,
        Setting(
            "Maximum number of billboards on level 1. Replaces `epsilon` by the smallest error bound found that needs "
            "no more billboards, plus the allowance `extra_error`",
            "COUNT",
            Limits(1),
            unset="as many as the error bound needs",
        ),
    ] = None
    extra_error: Annotated[
        float,
        Setting(
            "Extra error allowed beyond the smallest bound for `max_billboards`, as a fraction of that bound. Spent "
            "where it reduces the mean deviation",
            "FRACTION",
            Limits(0, 1),
        ),
    ] = 0.25
    max_texels: Annotated[
        int | None,
        Setting(
            "Maximum number of texels on level 1, each one eighth of the error bound wide. Uses the smallest error "
            "bound found that needs no more texels, but not less than `epsilon`",
            "COUNT",
            Limits(256),
            unset="as many as the error bound needs",
        ),
    ] = None
    max_size: Annotated[
        float | None,
        Setting(
            "Maximum distance of a billboard's leaves from the place where the billboard was found, as a fraction of "
            "R, at least `epsilon`. Smaller billboards have more triangles and draw fewer empty pixels",
            "FRACTION",
            Limits(0, 2, above=True),
            unset="0.2, or twice the mean leaf radius if that is more; no limit with `max_billboards`",
        ),
    ] = None
    compact: Annotated[
        float | None,
        Setting(
            "Minimum width of a gap at which a billboard is split in two, as a fraction of R",
            "FRACTION",
            Limits(0, 2, above=True),
            unset="never split",
        ),
    ] = None
    gather: Annotated[
        float,
        Setting(
            "Weight of the distance to a billboard's center when a leaf chooses its billboard. Larger gives smaller "
            "billboards with less empty area; 1 is noticeable",
            "WEIGHT",
            Limits(0, 1_000_000),
        ),
    ] = 0.0
    max_corners: Annotated[
        int,
        Setting(
            "Corners of a billboard's outline. 4 gives rectangles; more corners leave less empty area and add "
            "triangles",
            "COUNT",
            Limits(3, 16),
        ),
    ] = 4
    whole_leaves: Annotated[
        bool,
        Setting(
            "Keep a leaf on one billboard wherever any plane can hold it, not only where a plane of the cloud does. "
            "Uses more billboards"
        ),
    ] = False
    vertical: Annotated[float, Setting("Score penalty for horizontal planes", "FRACTION", _SHARE)] = 0.0
    views: Annotated[
        tuple[tuple[float, float, float], ...],
        Setting("Likely view direction in the scene, for `facing_views`. Repeat the flag for more directions", "X,Y,Z"),
    ] = ()
    facing_views: Annotated[
        float, Setting("Score penalty for planes that face none of the directions in `views`", "FRACTION", _SHARE)
    ] = 0.0
    image_epsilon: Annotated[
        float | None,
        Setting(
            "Maximum angle by which a vertex may appear to move, for a viewer at `viewing_distance`",
            "RADIANS",
            Limits(0, 1, above=True),
            unset="any",
        ),
    ] = None
    viewing_distance: Annotated[
        float | None,
        Setting(
            "Minimum distance of the viewer from the crown's center, as a fraction of R, for `image_epsilon`",
            "FRACTION",
            Limits(1, 1_000_000, above=True),
            unset="any",
        ),
    ] = None
    seed: Annotated[int, Setting("Random seed", "NUMBER", Limits(0, 2**63 - 1))] = 0
    texture_size: Annotated[
        int,
        Setting(
            "Width of level 1's atlas in texels. Each further cloud has half the width of the one before",
            "TEXELS",
            Limits(SMALLEST_TEXTURE, 16384),
        ),
    ] = 2048
    texture_height: Annotated[
        int | None,
        Setting(
            "Height of level 1's atlas in texels", "TEXELS", Limits(SMALLEST_TEXTURE, 16384), unset="same as the width"
        ),
    ] = None
    samples: Annotated[
        int,
        Setting(
            "Samples per texel along each side. More gives smoother textures and takes longer", "COUNT", Limits(1, 16)
        ),
    ] = 4
    close_gaps: Annotated[
        bool,
        Setting(
            "Close gaps between billboards: each also shows the parts of other billboards' leaves within the error "
            "bound of its plane. Makes the crown denser"
        ),
    ] = False
    bend_normals: Annotated[
        float,
        Setting(
            "How far the billboards' normals bend toward the hull of the crown. Larger gives softer, rounder shading",
            "FRACTION",
            _SHARE,
        ),
    ] = 0.0
    seconds: Annotated[
        float | None,
        Setting(
            "Time budget in seconds for making the levels, without Blender's start and writing files. Chooses error "
            "bound, samples, effort and a texture size up to `texture_size`, for the least error",
            "SECONDS",
            _POSITIVE,
            unset="off",
        ),
    ] = None
    image_error: Annotated[
        float | None,
        Setting(
            "Maximum image error of level 1. Chooses the same settings as `seconds`, for the shortest time",
            "ERROR",
            Limits(0, 1, above=True, below=True),
            unset="off",
        ),
    ] = None
    preset: Annotated[
        Preset | None,
        Setting(
            "Point on this tree's cost curve. Chooses the same settings as `seconds`",
            "NAME",
            unset="off",
            choices={
                "draft": "the fastest with at most twice the least error",
                "balanced": "the fastest with at most 1.25 times the least error",
                "final": "the least error",
            },
        ),
    ] = None
    pixels: Annotated[
        float,
        Setting(
            "A level takes over where its error appears smaller than this many pixels. Larger switches sooner and "
            "draws faster",
            "PIXELS",
            _POSITIVE,
        ),
    ] = 8.0
    chain: Annotated[str, Setting("Order of the levels by distance", "NAME", choices=CHAINS)] = "billboards"
    prune_pixels: Annotated[
        float,
        Setting(
            "Leaf size in pixels below which pruning begins, for the chains pruning and both. Larger prunes sooner",
            "PIXELS",
            _POSITIVE,
        ),
    ] = 16.0
    prune_half: Annotated[
        float,
        Setting(
            "Distance where pruning begins, divided by the distance where half of the leaves remain. Larger prunes "
            "faster",
            "FRACTION",
            Limits(0, 0.5, above=True),
        ),
    ] = 0.5
    trees: Annotated[
        str,
        Setting(
            "How the objects are divided into trees. The levels of several trees share atlas pages",
            "NAME",
            choices={
                "one": "all objects are one tree",
                "parents": "one tree per topmost parent, with its children",
                "collections": "one tree per collection",
            },
        ),
    ] = "one"
    engine: Annotated[
        str,
        Setting(
            "Target engine of the glTF files. For babylon, godot, unity and unreal, rank and pivot are texture "
            "coordinates; for the others, named attributes",
            "NAME",
            choices=dict.fromkeys(ENGINES, ""),
        ),
    ] = "generic"
    effects: Annotated[
        str,
        Setting(
            f"Effects of the levels: {', '.join(EFFECT_CHOICES)}, or names separated by commas from "
            f"{', '.join(EFFECTS)}. Add +NAME or -NAME to force an effect on or off. Without a word before them they "
            "change auto, as in `effects=-gloss`",
            "NAMES",
        ),
    ] = "auto"
    viewer: Annotated[
        str,
        Setting(
            "Distances for which levels are made",
            "NAME",
            choices={
                "auto": "the scene's cameras over all frames if the cameras or the trees move and no engine is set, "
                "else all distances, because the place of a still camera is often an accident",
                "anywhere": "all distances, so all levels are made",
                "camera": "the scene's cameras, moving or still, so only the levels that they see are made",
            },
        ),
    ] = "auto"
    unlit: Annotated[
        bool,
        Setting("Bake static light of the scene into the levels, for a target that draws them without lighting"),
    ] = False

    def __post_init__(self) -> None:
        for each in described():
            self._require(each.name, each.setting.allows(getattr(self, each.name)), each.setting.limit)
        self._check_fit()
        self._check_effects()
        self._check_wishes()

    @property
    def by_cameras(self) -> bool:
        """True if the scene's cameras may decide which levels are made."""
        return self.viewer != "anywhere" and self.engine == "generic"

    def _check_fit(self) -> None:
        needs_count = self.method != "kmeans" or self.max_billboards is not None
        self._require("max_billboards", needs_count, "set: the method kmeans needs the number of billboards")
        sized = self.max_size is None or self.epsilon <= self.max_size
        self._require("max_size", sized, f"from `epsilon` ({self.epsilon}) to 2")
        both = (self.viewing_distance is None) == (self.image_epsilon is None)
        self._require("viewing_distance", both, "set together with `image_epsilon`, or not at all")
        ends = self.chain != "pruning" or self.cross
        self._require("chain", ends, "another when the cross is off: after pruned leaves the cross is the only level")

    def _check_effects(self) -> None:
        asked = asked_effects(self.effects)
        choices = (
            f"{', '.join(EFFECT_CHOICES)}, or names separated by commas from {', '.join(EFFECTS)}, each with "
            "an optional + or -"
        )
        self._require("effects", asked.known, choices)
        if self.chain != "billboards" and asked.listed("pruning") is False:
            raise SettingsError(
                f"`chain={self.chain}` needs the effect pruning, which is off: turn it on, or choose `chain=billboards`"
            )

    def _check_wishes(self) -> None:
        given = [name for name in WISHES if getattr(self, name) is not None]
        for name in given:
            others = " and ".join(f"`{other}`" for other in given if other != name)
            self._require(name, not others, f"set without {others}")
            fixed = [other for other in _FIX_EPSILON if getattr(self, other) != getattr(BakeSettings, other)]
            without = " and ".join(f"`{other}`" for other in fixed)
            self._require(name, not fixed, f"set without {without}, because it has to choose `epsilon`")

    def _require(self, name: str, holds: bool, limit: str) -> None:
        if holds:
            return
        value, default = getattr(self, name), getattr(BakeSettings, name)
        usual = setting_named(name).setting.unset if default is None else repr(default)
        raise SettingsError(f"`{name}` is {value!r}, it must be {limit}; the default is {usual}")


@cache
def described() -> tuple[Described, ...]:
    """Return all settings, in the order of `BakeSettings`."""
    hints = get_type_hints(BakeSettings, include_extras=True)
    return tuple(Described.of(name, hint, getattr(BakeSettings, name)) for name, hint in hints.items())


def setting_named(name: str) -> Described:
    """Return the setting called `name`. Raise `KeyError` for an unknown name."""
    return {each.name: each for each in described()}[name]


def fit_options(settings: BakeSettings) -> FitOptions:
    """Return the settings of the fit as keyword options of `leafcloud.fit`."""
    return FitOptions(**{name: getattr(settings, name) for name in FitOptions.__annotations__})  # type: ignore[typeddict-item]


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
    max_corners: int
    whole_leaves: bool
    vertical: float
    views: tuple[tuple[float, float, float], ...]
    facing_views: float
    image_epsilon: float | None
    viewing_distance: float | None
    seed: int


def flag(name: str) -> str:
    """Return the command line's flag for the setting `name`."""
    return "--" + name.replace("_", "-")
