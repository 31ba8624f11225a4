"""Settings of the levels: quality, fit, textures, order and pruning. Ranges and defaults of numbers are the core's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import leafcloud

from .choices import CHAINS, FORMS, LASTS, Form, Last
from .setting import Limits, Setting, SettingsError, listed, require, settings_in

Method = Literal["stochastic", "density", "kmeans"]
Effort = Literal["literal", "default", "final", "best"]
Refine = Literal["off", "short", "long"]
Preset = Literal["draft", "balanced", "final"]

WISHES = ("seconds", "image_error", "preset")
"""Settings that choose epsilon, texture size, samples and effort by a quick cost curve. At most one may be set."""
MOST_SIZES = 4
"""Maximum number of sizes at which levels take over."""
_FIX_EPSILON = ("method", "triangles", "max_billboards", "max_texels", "image_epsilon", "chain")
"""Settings that exclude the wishes unless they have their defaults: they leave no epsilon to choose."""


def _range(name: str) -> Limits:
    """Return the range of the core's option `name`."""
    core = leafcloud.SETTINGS[name]
    return Limits(core.low, core.high, above=core.above, below=core.below)


def _default(name: str) -> Any:
    """Return the default of the core's option `name`."""
    return leafcloud.SETTINGS[name].default


SMALLEST_TEXTURE = int(_range("texture_size").low)
LARGEST_TEXTURE: int = _default("texture_size")
"""Greatest width of an atlas page if no width is set."""


@dataclass(frozen=True)
class LevelSettings:
    """Settings of the levels of a tree; `BakeSettings` adds those of the scene and the files.

    R is the radius of the bounding sphere of the leaves. Raises `SettingsError` for a value outside its limits, which
    includes those of settings that a subclass adds, and for settings that exclude one another.
    """

    quality: Annotated[
        float,
        Setting(
            "How little a level differs from the leaves where it takes over, from 0 (fast) to 1 (exact). At 0.5 as "
            "much as the leaves when a light breeze has moved them; half as much at 1, twice as much at 0. Chooses "
            "error bound, texture size and switch distances",
            "FRACTION",
            _range("quality"),
        ),
    ] = _default("quality")
    scene: Annotated[
        float,
        Setting(
            "Distance to the horizon, as a multiple of R. Levels are chosen to make an even plantation up to there "
            "cheap to draw",
            "R",
            _range("scene"),
        ),
    ] = _default("scene")
    memory_budget: Annotated[
        float,
        Setting(
            "Size in MB of the levels' textures on a graphics card, compressed. Larger pages let levels take over "
            "nearer",
            "MB",
            _range("memory_budget"),
        ),
    ] = _default("memory_budget")
    sizes: Annotated[
        tuple[float, ...],
        Setting(
            "Sizes of the crown at which the levels take over, as fractions of the picture's height, the largest "
            "first. One cloud is made for each",
            "FRACTION",
            _range("sizes"),
            unset="the largest at which each level looks like the leaves",
            many=True,
        ),
    ] = ()
    epsilon: Annotated[
        float | None,
        Setting(
            "Maximum distance a leaf may move along its billboard's normal on level 1, as a fraction of the crown "
            "radius R. Smaller is more accurate and uses more billboards",
            "FRACTION",
            _range("epsilon"),
            unset=f"chosen by `quality`, or {_default('epsilon')} where other settings decide",
        ),
    ] = None
    form: Annotated[Form, Setting("Form of level 1, with `quality`", "NAME", choices=FORMS)] = "auto"
    candidates: Annotated[
        int,
        Setting(
            "Planes tried per billboard. More gives fewer billboards and takes longer", "COUNT", _range("candidates")
        ),
    ] = _default("candidates")
    levels: Annotated[
        int,
        Setting(
            "Number of billboard clouds. Simplified leaves and the impostor are extra. With a set `epsilon` each cloud "
            f"has {leafcloud.EPSILON_STEP:g} times the error bound of the one before",
            "COUNT",
            # The chain pruning alone has the core's 0 clouds.
            replace(_range("levels"), low=1),
        ),
    ] = _default("levels")
    cross: Annotated[bool, Setting("Impostor of the whole tree as the last level")] = True
    last: Annotated[Last, Setting("Form of the last level", "NAME", choices=LASTS)] = "auto"
    every_level: Annotated[
        bool,
        Setting(
            "Make every level. Otherwise a level is left out if it saves less than a tenth (later clouds: half) of the "
            "cost of drawing the level before it, or if it looks different from the leaves at every size"
        ),
    ] = False
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
    triangles: Annotated[
        int | None,
        Setting(
            "Maximum number of triangles of level 1, trunk included. Billboards become as small as the number allows, "
            "which leaves fewer empty pixels; if it is too small for `epsilon`, the error bound grows",
            "COUNT",
            _range("triangles"),
            unset="a fifth of the tree's, between 500 and 4000; where `quality` does not choose the levels 15 %, or "
            "10 % if no leaf is cut out of a texture, at most 3000; at most three quarters of the leaves'",
        ),
    ] = None
    max_billboards: Annotated[
        int | None,
        Setting(
            "Maximum number of billboards on level 1. Replaces `epsilon` by the smallest error bound found that needs "
            "no more billboards, plus the allowance `extra_error`",
            "COUNT",
            _range("max_billboards"),
            unset="as many as the error bound needs",
        ),
    ] = None
    extra_error: Annotated[
        float,
        Setting(
            "Extra error allowed beyond the smallest bound for `max_billboards`, as a fraction of that bound. Spent "
            "where it reduces the mean deviation",
            "FRACTION",
            _range("extra_error"),
        ),
    ] = _default("extra_error")
    max_texels: Annotated[
        int | None,
        Setting(
            "Maximum number of texels on level 1, each one eighth of the error bound wide. Uses the smallest error "
            "bound found that needs no more texels, but not less than `epsilon`",
            "COUNT",
            _range("max_texels"),
            unset="as many as the error bound needs",
        ),
    ] = None
    max_size: Annotated[
        float | None,
        Setting(
            "Maximum distance of a billboard's leaves from the place where the billboard was found, as a fraction of "
            "R, at least `epsilon`. Smaller billboards have more triangles and draw fewer empty pixels",
            "FRACTION",
            _range("max_size"),
            unset="cheapest to draw within the triangles, with room for leaves twice as wide as the mean leaf; no "
            "limit with `max_billboards`",
        ),
    ] = None
    compact: Annotated[
        float | None,
        Setting(
            "Minimum width of a gap at which a billboard is split in two, as a fraction of R",
            "FRACTION",
            _range("compact"),
            unset="never split",
        ),
    ] = None
    gather: Annotated[
        float,
        Setting(
            "Weight of the distance to a billboard's center when a leaf chooses its billboard. Larger gives smaller "
            "billboards with less empty area; 1 is noticeable",
            "WEIGHT",
            _range("gather"),
        ),
    ] = _default("gather")
    max_corners: Annotated[
        int,
        Setting(
            "Maximum number of corners of a billboard's polygons. More corners leave less empty area",
            "COUNT",
            _range("max_corners"),
        ),
    ] = _default("max_corners")
    min_visibility: Annotated[
        float,
        Setting(
            "Minimum fraction of a leaf that is seen from outside the crown. Leaves with less are in LOD 0 only; 0 "
            "keeps all leaves",
            "FRACTION",
            _range("min_visibility"),
        ),
    ] = _default("min_visibility")
    whole_leaves: Annotated[
        bool,
        Setting(
            "Keep a leaf on one billboard wherever any plane can hold it, not only where a plane of the cloud does. "
            "Uses more billboards"
        ),
    ] = False
    vertical: Annotated[float, Setting("Score penalty for horizontal planes", "FRACTION", _range("vertical"))] = (
        _default("vertical")
    )
    views: Annotated[
        tuple[tuple[float, float, float], ...],
        Setting("Likely view direction in the scene, for `facing_views`. Repeat the flag for more directions", "X,Y,Z"),
    ] = ()
    facing_views: Annotated[
        float,
        Setting(
            "Score penalty for planes that face none of the directions in `views`", "FRACTION", _range("facing_views")
        ),
    ] = _default("facing_views")
    image_epsilon: Annotated[
        float | None,
        Setting(
            "Maximum angle by which a vertex may appear to move, for a viewer at `viewing_distance`",
            "RADIANS",
            _range("image_epsilon"),
            unset="any",
        ),
    ] = None
    viewing_distance: Annotated[
        float | None,
        Setting(
            "Minimum distance of the viewer from the crown's center, as a fraction of R, for `image_epsilon`",
            "FRACTION",
            _range("viewing_distance"),
            unset="any",
        ),
    ] = None
    seed: Annotated[int, Setting("Random seed", "NUMBER", _range("seed"))] = _default("seed")
    texture_size: Annotated[
        int | None,
        Setting(
            "Width of the atlas page of the first cloud, in texels. Each further cloud has at most half the width "
            "of the one before",
            "TEXELS",
            _range("texture_size"),
            unset="texels of half a pixel where a level takes over, not finer than half a texel of the leaves, within "
            "`memory_budget`",
        ),
    ] = None
    texture_height: Annotated[
        int | None,
        Setting(
            "Height of the atlas page of the first cloud, in texels",
            "TEXELS",
            _range("texture_height"),
            unset="same as the width",
        ),
    ] = None
    samples: Annotated[
        int,
        Setting(
            "Samples per texel along each side. More gives smoother textures and takes longer",
            "COUNT",
            _range("samples"),
        ),
    ] = _default("samples")
    close_gaps: Annotated[
        bool,
        Setting(
            "Close gaps between billboards: each also shows the parts of other billboards' leaves within the error "
            "bound of its plane. Makes the crown denser"
        ),
    ] = False
    refine: Annotated[
        Refine,
        Setting(
            "Change planes and textures of the billboards until pictures of them look like those of the leaves",
            "NAME",
            choices={
                "off": "billboards stay as they are fitted and baked",
                "short": "some seconds for each cloud that is tried",
                "long": "some tens of seconds for each cloud that is tried",
            },
        ),
    ] = "off"
    bend_normals: Annotated[
        float,
        Setting(
            "How far the billboards' normals bend toward the hull of the crown. Larger gives softer, rounder shading",
            "FRACTION",
            _range("normals"),
        ),
    ] = 0.0
    seconds: Annotated[
        float | None,
        Setting(
            "Time budget in seconds for making the levels, without Blender's start and writing files. Chooses error "
            "bound, samples, effort and a texture size up to `texture_size`, for the least error",
            "SECONDS",
            _range("seconds"),
            unset="off",
        ),
    ] = None
    image_error: Annotated[
        float | None,
        Setting(
            "Maximum image error of level 1. Chooses the same settings as `seconds`, for the shortest time",
            "ERROR",
            _range("image_error"),
            unset="off",
        ),
    ] = None
    preset: Annotated[
        Preset | None,
        Setting(
            "Compromise between baking time and image error, measured on this tree. Chooses error bound, samples, "
            "effort and texture size, as `seconds` does",
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
        float | None,
        Setting(
            "A level takes over where its error bound appears smaller than this many pixels, whatever `quality`. "
            "Larger switches sooner and draws faster",
            "PIXELS",
            _range("pixels"),
            unset="where `quality` allows",
        ),
    ] = None
    chain: Annotated[str, Setting("Order of the levels by distance", "NAME", choices=CHAINS)] = "billboards"
    prune_pixels: Annotated[
        float,
        Setting(
            "Leaf size in pixels below which pruning begins, for the chains pruning and both. Larger prunes sooner",
            "PIXELS",
            _range("leaf_pixels"),
        ),
    ] = _default("leaf_pixels")
    prune_half: Annotated[
        float,
        Setting(
            "Distance where pruning begins, divided by the distance where half of the leaves remain. Larger prunes "
            "faster",
            "FRACTION",
            _range("prune_half"),
        ),
    ] = _default("prune_half")

    def __post_init__(self) -> None:
        for each in settings_in(type(self)):
            require(self, each.name, each.setting.allows(getattr(self, each.name)), each.setting.limit)
        self._check_fit()
        self._check_sizes()
        self._check_wishes()

    @property
    def error_bound(self) -> float:
        """The set error bound of level 1, or the core's default."""
        default: float = _default("epsilon")
        return default if self.epsilon is None else self.epsilon

    @property
    def switch_pixels(self) -> float:
        """The set size of a level's error bound where it takes over, or the largest that `quality` allows."""
        default: float = _default("pixels")
        return default if self.pixels is None else self.pixels

    @property
    def wish(self) -> str | None:
        """The name of the wish that chooses epsilon, if one is set."""
        return next((name for name in WISHES if getattr(self, name) is not None), None)

    def _check_fit(self) -> None:
        sized = self.max_size is None or self.error_bound <= self.max_size
        require(self, "max_size", sized, f"at least `epsilon`, {self.error_bound}")
        count, most = len(self.views), _range("views")
        if not most.hold(count):
            raise SettingsError(f"`views` has {count} directions, their number must be {most}: leave some out")
        if self.method == "kmeans" and self.max_billboards is None:
            raise SettingsError("`method=kmeans` needs `max_billboards`: set it, or choose another `method`")
        if (self.viewing_distance is None) != (self.image_epsilon is None):
            raise SettingsError("`image_epsilon` and `viewing_distance` need each other: set both or neither")
        if self.chain == "pruning" and not self.cross:
            raise SettingsError(
                "`chain=pruning` and `cross=False` exclude each other: after pruned leaves the cross impostor is the "
                "only level; change one of them"
            )
        if self.last == "octahedral" and not self.cross:
            raise SettingsError(
                "`last=octahedral` needs the cross impostor, which files have in its place: leave out `cross=False`"
            )
        if self.form == "leaves" and (self.pixels, self.wish, self.chain) != (None, None, "billboards"):
            raise SettingsError(
                "`form=leaves` needs `quality`, which judges the leaves: leave out `pixels`, `seconds`, `image_error`, "
                "`preset` and `chain`"
            )

    def _check_sizes(self) -> None:
        if not self.sizes:
            return
        falling = all(near > far for near, far in pairwise(self.sizes)) and len(self.sizes) <= MOST_SIZES
        require(self, "sizes", falling, f"at most {MOST_SIZES} fractions, the largest first")
        if self.form == "leaves":
            raise SettingsError("`sizes` makes clouds: leave out `form=leaves`, or `sizes`")
        if (self.pixels, self.wish, self.chain) != (None, None, "billboards"):
            raise SettingsError(
                "`sizes` needs `quality`, which judges the levels: leave out `pixels`, `seconds`, `image_error`, "
                "`preset` and `chain`"
            )

    def _check_wishes(self) -> None:
        given = [name for name in WISHES if getattr(self, name) is not None]
        if len(given) > 1:
            raise SettingsError(f"{listed(given)} exclude each other: set one of them")
        fixed = [name for name in _FIX_EPSILON if getattr(self, name) != getattr(LevelSettings, name)]
        if given and fixed:
            raise SettingsError(
                f"{listed(given)} must be set without {listed(fixed)}, because it has to choose `epsilon`"
            )
