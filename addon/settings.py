"""What a bake is asked to do: each setting stands here once, with its limits and its words. Flags, properties and
checks are made of these; nothing behind them has to check again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal, TypedDict, get_type_hints

from .setting import Described, Limits, Setting

Method = Literal["stochastic", "density", "kmeans"]
Effort = Literal["literal", "default", "final", "best"]
Preset = Literal["draft", "balanced", "final"]

WISHES = ("seconds", "image_error", "preset")
"""Settings that choose epsilon, page, samples and effort by a quick cost curve; one of them at most."""
_FIX_EPSILON = ("method", "max_billboards", "max_texels", "image_epsilon", "chain")
"""Settings that leave the wishes no epsilon to choose, where they are not at their defaults."""
ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
CHAINS = {
    "billboards": "all leaves until the first cloud takes over",
    "pruning": "ever fewer leaves, then the cross",
    "both": "fewer leaves on the way to a first cloud of those that are left",
}
EFFECTS = (
    "transitions",
    "pruning",
    "back_sides",
    "trunk_levels",
    "far_levels",
    "normals",
    "gloss",
    "translucency",
    "blend_order",
    "occlusion",
    "self_shadowing",
    "shadow_proxy",
    "leaf_map",
    "contrast",
    "grazing_fade",
    "wind",
    "baked_light",
)
MOVING_LIGHT = tuple(name for name in EFFECTS if name not in ("baked_light", "blend_order"))
"""What `all` stands for: the effects for light that may move, beside which baked light makes no sense; and the plan
still decides whether leaves are seen through."""
CHANNELS = ("normals", "gloss", "translucency")
"""The effects that are channels of the textures and are read from the leaves' own materials."""
PAGE_EFFECTS = ("normals", "gloss", "translucency", "occlusion", "self_shadowing", "leaf_map")
"""The effects that are textures of the clouds: levels that share a page have all of them or none."""
EFFECT_CHOICES = ("auto", "all", "none")
"""What a list of effects may begin with in place of names."""

SMALLEST_TEXTURE = 64


class SettingsError(ValueError):
    """A setting that cannot be followed. One line: the setting, its value, its limit, what to do; see `naming`."""


_SHARE = Limits(0, 1)
_POSITIVE = Limits(0, above=True)


@dataclass(frozen=True)
class BakeSettings:
    """The settings of one bake, the same from the command line and from the interface.

    R is the radius of the bounding sphere of the leaves. Raises `SettingsError` for a value outside its limits, and for
    settings that exclude one another.
    """

    epsilon: Annotated[
        float,
        Setting(
            "how far a leaf may move along its billboard's normal on level 1, as a share of the crown's radius R",
            "SHARE",
            Limits(0, 1, above=True),
        ),
    ] = 0.04
    candidates: Annotated[
        int,
        Setting(
            "planes tried per billboard: more make fewer billboards, and take longer", "COUNT", Limits(1, 1_000_000)
        ),
    ] = 600
    levels: Annotated[
        int, Setting("billboard clouds behind the leaves, the cross not counted", "COUNT", Limits(1, 8))
    ] = 2
    cross: Annotated[bool, Setting("crossed billboards of the whole tree behind the clouds")] = True
    method: Annotated[
        Method,
        Setting(
            "the fitter",
            "NAME",
            choices={
                "stochastic": "planes through leaves drawn at random",
                "density": "the greedy planes of billboard clouds",
                "kmeans": "leaves parted into as many billboards as `max_billboards` says",
            },
        ),
    ] = "stochastic"
    effort: Annotated[
        Effort,
        Setting(
            "how long the method stochastic looks for few billboards",
            "NAME",
            choices={
                "literal": "the published algorithm, for comparison",
                "default": "all offsets of all directions, greedily: a fraction of a second",
                "final": "then a search for fewer billboards: seconds",
                "best": "the same, ten times as long",
            },
        ),
    ] = "default"
    max_billboards: Annotated[
        int | None,
        Setting(
            "at most so many on level 1, at the smallest error bound found that does, and slack beyond it",
            "COUNT",
            Limits(1),
            unset="as many as the error bound asks for",
        ),
    ] = None
    slack: Annotated[
        float,
        Setting(
            "where `max_billboards` decides: how much farther than the smallest error bound leaves may move where that "
            "brings them nearer on average, as a share of it",
            "SHARE",
            Limits(0, 1),
        ),
    ] = 0.25
    max_texels: Annotated[
        int | None,
        Setting(
            "level 1 needs at most so many, each an eighth of the error bound long, at the smallest bound found that "
            "does, but not below `epsilon`",
            "COUNT",
            Limits(256),
            unset="as many as the error bound asks for",
        ),
    ] = None
    max_size: Annotated[
        float | None,
        Setting(
            "greatest distance of a billboard's leaves from the place where the billboard was found, as a share of R, "
            "at least `epsilon`; smaller billboards have more triangles and draw fewer empty pixels",
            "SHARE",
            Limits(0, 2, above=True),
            unset="0.2 or, for large leaves, twice their radius; no limit for a given number of billboards",
        ),
    ] = None
    compact: Annotated[
        float | None,
        Setting("billboards are parted at gaps of this share of R", "SHARE", Limits(0, 2, above=True), unset="never"),
    ] = None
    gather: Annotated[
        float,
        Setting(
            "how much leaves prefer billboards whose middle is near: billboards become smaller, and less of them is "
            "empty; 1 is noticeable",
            "WEIGHT",
            Limits(0, 1_000_000),
        ),
    ] = 0.0
    max_corners: Annotated[
        int,
        Setting(
            "corners of a billboard's outline: 4 gives rectangles, more leave less of it empty", "COUNT", Limits(3, 16)
        ),
    ] = 4
    whole_leaves: Annotated[
        bool, Setting("keep every leaf on one billboard at the cost of more billboards, not only where one holds it")
    ] = False
    vertical: Annotated[float, Setting("what a billboard that lies flat loses when it is chosen", "SHARE", _SHARE)] = (
        0.0
    )
    views: Annotated[
        tuple[tuple[float, float, float], ...],
        Setting("a likely direction of view in the scene, for `facing_views`; may be given again", "X,Y,Z"),
    ] = ()
    facing_views: Annotated[
        float, Setting("score penalty of billboards that no view of `views` sees face-on", "SHARE", _SHARE)
    ] = 0.0
    image_epsilon: Annotated[
        float | None,
        Setting(
            "greatest angle by which a vertex may be seen to move, with `viewing_distance`",
            "RADIANS",
            Limits(0, 1, above=True),
            unset="any",
        ),
    ] = None
    viewing_distance: Annotated[
        float | None,
        Setting(
            "how near a viewer comes to the crown's centre, as a share of R, with `image_epsilon`",
            "SHARE",
            Limits(1, 1_000_000, above=True),
            unset="anywhere",
        ),
    ] = None
    seed: Annotated[int, Setting("of every random choice", "NUMBER", Limits(0, 2**63 - 1))] = 0
    texture_size: Annotated[
        int,
        Setting(
            "columns of level 1's atlas in texels, halved with every level", "TEXELS", Limits(SMALLEST_TEXTURE, 16384)
        ),
    ] = 2048
    texture_height: Annotated[
        int | None,
        Setting("rows of level 1's atlas", "TEXELS", Limits(SMALLEST_TEXTURE, 16384), unset="as many as columns"),
    ] = None
    samples: Annotated[
        int,
        Setting(
            "of each texel, along each of its sides: more make smoother textures, and take longer",
            "COUNT",
            Limits(1, 16),
        ),
    ] = 4
    close_cracks: Annotated[
        bool,
        Setting(
            "billboards also show the parts of other billboards' leaves that lie within the error bound of their plane"
        ),
    ] = False
    bend_normals: Annotated[
        float,
        Setting(
            "how far the billboards' normals are bent toward the hull of the crown, as foliage is often shaded",
            "SHARE",
            _SHARE,
        ),
    ] = 0.0
    seconds: Annotated[
        float | None,
        Setting(
            "make the levels as good as possible in so many, measured without Blender's start and the files; chooses "
            "error bound, samples, effort, and a page not above the texture size",
            "SECONDS",
            _POSITIVE,
            unset="as the settings say",
        ),
    ] = None
    image_error: Annotated[
        float | None,
        Setting(
            "make the levels as quickly as possible with at most this image error on level 1, choosing likewise",
            "ERROR",
            Limits(0, 1, above=True, below=True),
            unset="as the settings say",
        ),
    ] = None
    preset: Annotated[
        Preset | None,
        Setting(
            "the same, by a place on this tree's cost curve",
            "NAME",
            unset="as the settings say",
            choices={
                "draft": "the quickest with at most twice the least error",
                "balanced": "the quickest within a quarter of the least error",
                "final": "the least error",
            },
        ),
    ] = None
    pixels: Annotated[
        float, Setting("a level takes over where its error is seen smaller than this many pixels", "PIXELS", _POSITIVE)
    ] = 8.0
    chain: Annotated[str, Setting("how the levels follow one another", "NAME", choices=CHAINS)] = "billboards"
    prune_pixels: Annotated[
        float,
        Setting(
            "with the chains pruning and both leaves are pruned where one is seen smaller than this many pixels",
            "PIXELS",
            _POSITIVE,
        ),
    ] = 16.0
    prune_half: Annotated[
        float,
        Setting(
            "half of the leaves are left at the distance where pruning begins, divided by this",
            "SHARE",
            Limits(0, 0.5, above=True),
        ),
    ] = 0.5
    trees: Annotated[
        str,
        Setting(
            "what is a tree of its own; the levels of several share their pages",
            "NAME",
            choices={
                "one": "all that is baked, together",
                "parents": "each topmost parent with what hangs on it",
                "collections": "each collection",
            },
        ),
    ] = "one"
    engine: Annotated[
        str,
        Setting(
            "which engine the glTF is for: babylon, godot, unity and unreal get rank and pivot as texture coordinates, "
            "the others as attributes by name",
            "NAME",
            choices=dict.fromkeys(ENGINES, ""),
        ),
    ] = "generic"
    effects: Annotated[
        str,
        Setting(
            f"{', '.join(EFFECT_CHOICES)}, or out of {','.join(EFFECTS)} with commas between; behind that +NAME and "
            "-NAME force one on or off, and alone they do so over auto, as in `effects=-gloss`",
            "NAMES",
        ),
    ] = "auto"
    viewer: Annotated[
        str,
        Setting(
            "the distances that levels are made for",
            "NAME",
            choices={
                "auto": "distances of the scene's cameras over all frames if the cameras or the trees move and "
                "no engine is set; else all distances, because the place of a still camera is often an accident",
                "anywhere": "all distances: all levels are made",
                "camera": "distances of the scene's cameras, moving or not: only the levels that they see are made",
            },
        ),
    ] = "auto"
    unlit: Annotated[
        bool,
        Setting("what draws the levels shows their colours as they are: light that stands still is baked into them"),
    ] = False

    def __post_init__(self) -> None:
        for each in described():
            self._require(each.name, each.setting.allows(getattr(self, each.name)), each.setting.limit)
        self._check_fit()
        self._check_effects()
        self._check_wishes()

    @property
    def by_cameras(self) -> bool:
        """Whether the scene's cameras may decide which levels are made."""
        return self.viewer != "anywhere" and self.engine == "generic"

    def _check_fit(self) -> None:
        needs_count = self.method != "kmeans" or self.max_billboards is not None
        self._require("max_billboards", needs_count, "given: the method kmeans has it as its input")
        sized = self.max_size is None or self.epsilon <= self.max_size
        self._require("max_size", sized, f"from epsilon ({self.epsilon}) to 2")
        both = (self.viewing_distance is None) == (self.image_epsilon is None)
        self._require("viewing_distance", both, "given with `image_epsilon`, or not at all")
        ends = self.chain != "pruning" or self.cross
        self._require("chain", ends, "another without the cross: behind pruned leaves nothing else follows")

    def _check_effects(self) -> None:
        asked = asked_effects(self.effects)
        known = asked.known and {*asked.names, *asked.forced} <= set(EFFECTS)
        choices = (
            f"{', '.join(EFFECT_CHOICES)}, or a list out of {', '.join(EFFECTS)} with commas between, + or - before"
        )
        self._require("effects", known, choices)
        if self.chain != "billboards" and asked.state("pruning") is False:
            raise SettingsError(
                f"`chain={self.chain}` goes with pruning only, which the effects leave out: turn the effect pruning "
                "on, or choose `chain=billboards`"
            )

    def _check_wishes(self) -> None:
        given = [name for name in WISHES if getattr(self, name) is not None]
        for name in given:
            others = " and ".join(f"`{other}`" for other in given if other != name)
            self._require(name, not others, f"given without {others}")
            fixed = [other for other in _FIX_EPSILON if getattr(self, other) != getattr(BakeSettings, other)]
            without = " and ".join(f"`{other}`" for other in fixed)
            self._require(name, not fixed, f"given where `epsilon` can be chosen: without {without}")

    def _require(self, name: str, holds: bool, limit: str) -> None:
        if holds:
            return
        value, default = getattr(self, name), getattr(BakeSettings, name)
        usual = setting_named(name).setting.unset if default is None else repr(default)
        raise SettingsError(f"`{name}` is {value!r}, it must be {limit}; the default is {usual}")


@cache
def described() -> tuple[Described, ...]:
    """All settings, in their order."""
    hints = get_type_hints(BakeSettings, include_extras=True)
    return tuple(Described.of(name, hint, getattr(BakeSettings, name)) for name, hint in hints.items())


def setting_named(name: str) -> Described:
    """The setting of this name. Raises `KeyError` where none has it."""
    return {each.name: each for each in described()}[name]


def fit_options(settings: BakeSettings) -> FitOptions:
    """The settings that are the fitter's, as the wheel takes them."""
    return FitOptions(**{name: getattr(settings, name) for name in FitOptions.__annotations__})  # type: ignore[typeddict-item]


class FitOptions(TypedDict):
    """The names that `BakeSettings` and the wheel have in common; what they mean stands in both."""

    epsilon: float
    candidates: int
    method: Method
    effort: Effort
    max_billboards: int | None
    slack: float
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
    """The command line's flag for the setting `name`."""
    return "--" + name.replace("_", "-")


@dataclass(frozen=True)
class AskedEffects:
    """What a list of effects asks for: its `base`, or None and the `names` that it begins with; what is `forced`."""

    base: str | None
    names: tuple[str, ...]
    forced: Mapping[str, bool]

    @property
    def known(self) -> bool:
        """Whether a base stands alone, and where it may."""
        return self.base is None or not self.names

    def state(self, name: str) -> bool | None:
        """Whether an effect is asked for; None leaves it to the plan.

        Levels are asked for by settings of their own.
        """
        if name in self.forced:
            return self.forced[name]
        if self.base == "auto":
            return None
        if name == "far_levels":
            return True
        if name == "blend_order" and self.base == "all":
            return None
        return name in (MOVING_LIGHT if self.base == "all" else self.names)


def asked_effects(effects: str) -> AskedEffects:
    """Reads a list with commas between, of which the names are not checked."""
    words = [word.strip() for word in effects.split(",")]
    forced = {word[1:].strip(): word[0] == "+" for word in words if word[:1] in ("+", "-")}
    plain = [word for word in words if word[:1] not in ("+", "-")]
    base = next((word for word in plain if word in EFFECT_CHOICES), None if plain else "auto")
    return AskedEffects(base, tuple(word for word in plain if word != base), forced)
