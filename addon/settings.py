"""What a bake is asked to do: checked where it is made, so that nothing behind it has to check again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal, TypedDict, get_args

Method = Literal["stochastic", "density", "kmeans"]
Effort = Literal["literal", "default", "final", "best"]
Preset = Literal["draft", "balanced", "final"]

METHODS = get_args(Method)
EFFORTS = get_args(Effort)
PRESETS = get_args(Preset)
WISHES = ("seconds", "image_error", "preset")
"""Settings that choose epsilon, page, samples and effort by a quick cost curve; one of them at most."""
ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
CHAINS = ("billboards", "pruning", "both")
EFFECTS = (
    "transitions",
    "pruning",
    "back_sides",
    "trunk_levels",
    "far_levels",
    "normals",
    "gloss",
    "translucency",
    "occlusion",
    "self_shadowing",
    "leaf_map",
    "contrast",
    "wind",
    "baked_light",
)
MOVING_LIGHT = tuple(name for name in EFFECTS if name != "baked_light")
"""What `all` stands for: the effects for light that may move, beside which baked light makes no sense."""
CHANNELS = ("normals", "gloss", "translucency")
"""The effects that are channels of the textures and are read from the leaves' own materials."""
EFFECT_CHOICES = ("auto", "all", "none")
"""What a list of effects may begin with in place of names."""
VIEWERS = ("camera", "anywhere")

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
    effort: how long the method stochastic searches.
    max_billboards: level 1 has at most so many, at the smallest epsilon found that does; `epsilon` is then not used.
    max_texels: the same for texels as long as epsilon / 8, but not below `epsilon`.
    max_size: how far a billboard's leaves may lie from where it was found, as a share of R; at least epsilon.
    compact: billboards are parted at gaps of this share of R.
    gather: how much leaves prefer billboards whose middle is near: smaller billboards, less of them empty; ≥ 0.
    max_corners: corners of a billboard's outline, 4 for rectangles; 3 … 16.
    whole_leaves: whether leaves stay on one billboard at the cost of more billboards.
    vertical: what a billboard that lies flat loses when it is chosen; 0 … 1.
    views: likely directions of view; facing_views: what a billboard loses that none of them sees face-on; 0 … 1.
    image_epsilon, viewing_distance: no vertex moves by more than this angle, in radians, seen from no nearer than this
        distance, a share of R above 1; both or neither.
    seed: of every random choice; ≥ 0.
    texture_size: columns of level 1's atlas in texels, halved with every level, not below 64; 64 … 16384.
    texture_height: its rows; None makes it square; 64 … 16384.
    samples: of each texel, along each of its sides; 1 … 16.
    seconds: the levels are as good as they get in so many, looking for settings among them; > 0.
    image_error: level 1 has at most this, as quickly as may be; in (0, 1).
    preset: a place on the cost curve: within twice the least error, within a quarter of it, the least.
        Each of these three chooses epsilon, samples, effort, and a page not above texture_size.
    close_cracks: whether billboards also show the parts of other billboards' leaves that lie within ε of their plane.
    cross: whether crossed billboards of the whole tree follow behind the clouds.
    bend_normals: the share by which the billboards' normals are bent toward the hull of the crown; 0 … 1.
    effects: "auto", "all", "none", or names out of `EFFECTS` with commas between them; +NAME and -NAME behind that
        force one on or off, and alone they do so over "auto".
    engine: which engine the glTF files are meant for.
    viewer: who looks at the levels: "camera", those of the scene where it has any and no engine is named; "anywhere".
    unlit: whether what draws the levels shows their colours as they are, without any light.
    chain: how the levels follow one another: "billboards", all leaves until level 1; "pruning", ever fewer leaves and
        then the cross; "both", level 1 of the leaves that pruning has left.
    prune_pixels: in the latter two leaves are pruned where one is seen smaller than this many pixels; > 0.
    prune_half: half of the leaves are left at the distance where that begins, divided by this; in (0, ½].
    pixels: a level takes over where its greatest deviation is seen smaller than this many pixels; > 0.

    Raises `SettingsError` for a value outside its range.
    """

    epsilon: float = 0.04
    candidates: int = 600
    levels: int = 2
    method: Method = "stochastic"
    effort: Effort = "default"
    max_billboards: int | None = None
    max_texels: int | None = None
    max_size: float | None = None
    compact: float | None = None
    gather: float = 0.0
    max_corners: int = 4
    whole_leaves: bool = False
    vertical: float = 0.0
    views: tuple[tuple[float, float, float], ...] = ()
    facing_views: float = 0.0
    image_epsilon: float | None = None
    viewing_distance: float | None = None
    seed: int = 0
    texture_size: int = 2048
    texture_height: int | None = None
    samples: int = 4
    seconds: float | None = None
    image_error: float | None = None
    preset: Preset | None = None
    close_cracks: bool = False
    cross: bool = True
    bend_normals: float = 0.0
    effects: str = "auto"
    engine: str = "generic"
    viewer: str = "camera"
    unlit: bool = False
    chain: str = "billboards"
    prune_pixels: float = 16.0
    prune_half: float = 0.5
    pixels: float = 8.0

    def __post_init__(self) -> None:
        self._require("epsilon", 0.0 < self.epsilon <= 1.0, "greater than 0 and at most 1 (a share of the radius)")
        self._require("candidates", 1 <= self.candidates <= MOST_CANDIDATES, f"from 1 to {MOST_CANDIDATES}")
        self._require("levels", 1 <= self.levels <= MOST_LEVELS, f"from 1 to {MOST_LEVELS}")
        self._require("seed", 0 <= self.seed <= LARGEST_SEED, f"from 0 to {LARGEST_SEED}")
        for name in ("texture_size", "texture_height"):
            side = getattr(self, name)
            fits = side is None or SMALLEST_TEXTURE <= side <= LARGEST_TEXTURE
            self._require(name, fits, f"from {SMALLEST_TEXTURE} to {LARGEST_TEXTURE} texels")
        self._require("pixels", 0.0 < self.pixels < math.inf, "greater than 0 and finite")
        self._require("method", self.method in METHODS, f"one of {', '.join(METHODS)}")
        self._require("effort", self.effort in EFFORTS, f"one of {', '.join(EFFORTS)}")
        counted = self.max_billboards is None or self.max_billboards >= 1
        self._require("max_billboards", counted, "at least 1")
        needs_count = self.method != "kmeans" or self.max_billboards is not None
        self._require("max_billboards", needs_count, "given: the method kmeans has it as its input")
        self._require("max_texels", self.max_texels is None or self.max_texels >= 256, "at least 256")
        sized = self.max_size is None or self.epsilon <= self.max_size <= 2.0
        self._require("max_size", sized, f"from epsilon ({self.epsilon}) to 2")
        self._require("compact", self.compact is None or 0.0 < self.compact <= 2.0, "greater than 0 and at most 2")
        self._require("gather", 0.0 <= self.gather <= 1e6, "from 0 to 1000000")
        self._require("max_corners", 3 <= self.max_corners <= 16, "from 3 to 16")
        self._require("vertical", 0.0 <= self.vertical <= 1.0, "from 0 to 1")
        self._require("facing_views", 0.0 <= self.facing_views <= 1.0, "from 0 to 1")
        angle = self.image_epsilon
        self._require("image_epsilon", angle is None or 0.0 < angle <= 1.0, "greater than 0 and at most 1 (radians)")
        distance = self.viewing_distance
        self._require("viewing_distance", distance is None or 1.0 < distance <= 1e6, "greater than 1 (a share of R)")
        self._require(
            "viewing_distance", (distance is None) == (angle is None), "given with --image-epsilon, or not at all"
        )
        self._require("bend_normals", 0.0 <= self.bend_normals <= 1.0, "from 0 to 1")
        self._require("engine", self.engine in ENGINES, f"one of {', '.join(ENGINES)}")
        self._require("viewer", self.viewer in VIEWERS, f"one of {', '.join(VIEWERS)}")
        self._require("chain", self.chain in CHAINS, f"one of {', '.join(CHAINS)}")
        ends = self.chain != "pruning" or self.cross
        self._require("chain", ends, "another without the cross: behind pruned leaves nothing else follows")
        self._require("prune_pixels", 0.0 < self.prune_pixels < math.inf, "greater than 0 and finite")
        self._require("prune_half", 0.0 < self.prune_half <= 0.5, "greater than 0 and at most 0.5")
        self._require("samples", 1 <= self.samples <= 16, "from 1 to 16")
        self._check_wishes()
        asked = asked_effects(self.effects)
        known = asked.known and {*asked.names, *asked.forced} <= set(EFFECTS)
        choices = (
            f"{', '.join(EFFECT_CHOICES)}, or a list out of {', '.join(EFFECTS)} with commas between, + or - before"
        )
        self._require("effects", known, choices)
        prunes = self.chain == "billboards" or asked.state("pruning") is not False
        self._require("effects", prunes, f"with pruning for --chain {self.chain}")

    def _check_wishes(self) -> None:
        timed = self.seconds is None or 0.0 < self.seconds < math.inf
        self._require("seconds", timed, "greater than 0 and finite")
        near = self.image_error is None or 0.0 < self.image_error < 1.0
        self._require("image_error", near, "greater than 0 and less than 1")
        self._require("preset", self.preset in (None, *PRESETS), f"one of {', '.join(PRESETS)}")
        given = [name for name in WISHES if getattr(self, name) is not None]
        for name in given:
            self._require(name, len(given) == 1, f"given without {' and '.join(flag(g) for g in given if g != name)}")
            free = self.chain == "billboards" and self.method == "stochastic"
            free &= self.max_billboards is None and self.max_texels is None and self.image_epsilon is None
            self._require(
                name,
                free,
                "given where epsilon can be chosen: without --method, --max-billboards, --max-texels, --image-epsilon "
                "and --chain",
            )

    def _require(self, name: str, holds: bool, limit: str) -> None:
        if holds:
            return
        value, default = getattr(self, name), next(field.default for field in fields(self) if field.name == name)
        raise SettingsError(f"{flag(name)} is {value!r}, it must be {limit}; the default is {default!r}")


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
        """Whether an effect is asked for; None leaves it to the plan. Levels are asked for by settings of their own."""
        if name in self.forced:
            return self.forced[name]
        if self.base == "auto":
            return None
        if name == "far_levels":
            return True
        return name in (MOVING_LIGHT if self.base == "all" else self.names)


def asked_effects(effects: str) -> AskedEffects:
    """Reads a list with commas between, of which the names are not checked."""
    words = [word.strip() for word in effects.split(",")]
    forced = {word[1:].strip(): word[0] == "+" for word in words if word[:1] in ("+", "-")}
    plain = [word for word in words if word[:1] not in ("+", "-")]
    base = next((word for word in plain if word in EFFECT_CHOICES), None if plain else "auto")
    return AskedEffects(base, tuple(word for word in plain if word != base), forced)
