"""Leafcloud: levels of detail for foliage that do not pop.

Conventions, the same in every function:

* positions and distances are in the caller's units and coordinates, angles in radians;
* shares (deviations, ``epsilon``) are fractions of the radius ``R`` of the foliage's bounding sphere
  (centre of the axis-aligned box, farthest vertex);
* texture coordinates have their origin in the lower left corner, v up (Blender's convention);
  images are ``(height, width, 4)`` uint8 arrays, row 0 on top, sRGB with straight alpha;
* ``t`` is the number of triangles of the foliage that was fitted, ``k`` of planes, ``b`` of billboards.

Everything is deterministic: the same input, settings and seed give the same bytes on any number of
threads and on any machine. Every refusal of a value is a :class:`LeafcloudError` whose message names it, its limit
and the remedy; an argument of a type that cannot be meant is a ``TypeError``, as everywhere in Python.

Ctrl-C raises ``KeyboardInterrupt`` within a second in every call; work that cannot stop ends unseen in the background.
Calls work in a child process after ``fork``, with threads of the child's own.
"""

from collections.abc import Callable, Sequence
from typing import Generic, Literal, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
Method = Literal["stochastic", "density", "kmeans"]
"""``stochastic``: search for the planes that hold most (Lacewell et al. 2006 and what grew from it). ``density``: the
densest planes first (Décoret et al. 2003). ``kmeans``: clusters about planes; ``max_billboards`` is its input, ε its
result."""
Effort = Literal["literal", "default", "final", "best"]
"""How long the method ``stochastic`` searches: as published (for comparison); greedily over all directions and offsets;
then for fewer planes (seconds); the same ten times as long."""
Progress = Callable[[str, float], bool | None]
"""Called with the stage and the fraction done in [0, 1]; returning ``False`` cancels."""

Preset = Literal["draft", "balanced", "final"]
Cost = Literal["seconds", "billboards", "bytes"]

_T = TypeVar("_T", covariant=True)

class LeafcloudError(Exception):
    """The base of everything that Leafcloud refuses."""

class CancelledError(LeafcloudError):
    """The work was cancelled by its caller."""

class Material:
    """What a triangle's surface looks like.

    ``base_color`` is a linear RGBA factor; ``image`` an sRGB RGBA image ``(h, w, 4)`` uint8 that repeats outside
    [0, 1]. ``alpha_cutoff`` counts for ``MASK`` only. A material that is not ``double_sided`` shows the
    side from which its triangles wind counter-clockwise.

    ``normal`` is a tangent-space normal map as in glTF (red to the right, green up the texture), ``gloss`` an image of
    occlusion, roughness and metallic that multiplies the factors, both with linear codes; ``translucency`` the linear
    colour of the light that shines through, times ``translucency_image`` (sRGB). All are laid like ``image``. Factors
    lie in [0, 1].
    """
    def __init__(
        self,
        name: str = "leaf",
        *,
        base_color: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
        image: NDArray[np.uint8] | None = None,
        alpha_mode: AlphaMode = "OPAQUE",
        alpha_cutoff: float = 0.5,
        double_sided: bool = True,
        normal: NDArray[np.uint8] | None = None,
        roughness: float = 1.0,
        metallic: float = 0.0,
        gloss: NDArray[np.uint8] | None = None,
        translucency: Sequence[float] | None = None,
        translucency_image: NDArray[np.uint8] | None = None,
    ) -> None: ...
    @property
    def name(self) -> str: ...

class Foliage:
    """Triangles, their leaves and how they look, in a local frame.

    ``positions`` (v, 3) float32 or float64; ``triangles`` (t, 3) integers; ``uvs`` per vertex (v, 2) or per corner (t,
    3, 2); ``normals`` likewise (…, 3), of any length; ``colors`` likewise (…, 4), linear RGBA that multiply the base
    colour; ``back_colors`` likewise (…, 3), linear RGB in their place where a triangle is seen to wind clockwise, as
    light differs on the two sides of a leaf; ``material_ids`` (t,) indices into ``materials``; ``leaf_ids`` (t,) any
    integers, equal within a leaf. Without ``leaf_ids`` a leaf is a connected component: triangles that share a vertex,
    or an edge whose two ends coincide exactly. ``protected`` (t,) bool: leaves with such a triangle are never pruned.

    Raises ``LeafcloudError`` for no triangles, indices out of range, coordinates that are not finite, arrays
    of the wrong shape, and when all triangles have zero area.
    """
    def __init__(
        self,
        positions: ArrayLike,
        triangles: ArrayLike,
        *,
        uvs: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        back_colors: ArrayLike | None = None,
        material_ids: ArrayLike | None = None,
        materials: Sequence[Material] | None = None,
        leaf_ids: ArrayLike | None = None,
        protected: NDArray[np.bool_] | None = None,
    ) -> None: ...
    @property
    def centre(self) -> NDArray[np.float64]: ...
    @property
    def radius(self) -> float: ...
    @property
    def triangle_count(self) -> int: ...
    @property
    def leaf_count(self) -> int: ...
    @property
    def area(self) -> float:
        """Of all triangles, caller's units squared."""
    @property
    def leaf_ids(self) -> NDArray[np.uint32]:
        """(t,) the leaf of each triangle, 0 … leaf_count − 1 in order of first appearance."""

class Cloud:
    """What a fit decides: planes, and the parent of every triangle."""
    @property
    def planes(self) -> NDArray[np.float64]:
        """(k, 4) unit normal n and distance d: a point p lies at n·p − d, in the caller's coordinates."""
    @property
    def parents(self) -> NDArray[np.uint32]:
        """(t,) the plane of each triangle."""
    @property
    def deviations(self) -> NDArray[np.float64]:
        """(t,) the greatest distance of the triangle's vertices to its plane, caller's units; never above ``epsilon``
        × R."""
    @property
    def epsilon(self) -> float:
        """The bound, as a share of R."""
    @property
    def max_deviation(self) -> float:
        """Share of R."""
    @property
    def mean_deviation(self) -> float:
        """Area-weighted mean of ``deviations``, share of R."""

class BakeSeconds(TypedDict):
    fit: float
    pack: float
    bake: float
    look: float

class LookSeconds(TypedDict):
    order: float
    """Finding how much of each leaf is seen."""
    sky: float
    """Finding how much of the sky is seen."""
    growth: float
    """Finding how pruned leaves grow."""
    contrast: float
    """Finding how much contrast they keep."""

class Level:
    """A cloud with its outlines, its atlas page and the transition of the level before onto it.

    The level before is the leaves for level 1, the billboards of the level before for the others, as a fan of c − 2
    triangles a billboard: corners (0, 1, 2), (0, 2, 3) and so on. Every outline has the same number of corners c.
    """
    @property
    def cloud(self) -> Cloud | None:
        """``None`` for the cross, which has no parents."""
    @property
    def method(self) -> str:
        """The fitter's name, or "cross"."""
    @property
    def corners(self) -> NDArray[np.float64]:
        """(b, c, 3) the outline, convex, counter-clockwise seen from the side that shows the texture; of a rectangle
        lower left, lower right, upper right, upper left."""
    @property
    def uvs(self) -> NDArray[np.float32]:
        """(b, c, 2)"""
    @property
    def plane_ids(self) -> NDArray[np.uint32]:
        """(b,) the plane of each billboard."""
    @property
    def two_sided(self) -> bool:
        """Whether the two sides show different textures: then billboards come as pairs of single-sided quads, else
        each is double-sided."""
    @property
    def ranks(self) -> NDArray[np.float32]:
        """(b,) the billboards' own places in the pruning order, in [0, 1)."""
    @property
    def base_color(self) -> NDArray[np.uint8]:
        """(h, w, 4) the atlas page: sRGB, straight alpha, colours dilated under transparent texels."""
    @property
    def normal(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) normals on the side that faces the viewer, in each billboard's axes: a tangent-space normal map as
        in glTF, linear codes; ``None`` when it was not asked for."""
    @property
    def gloss(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) occlusion, roughness, metallic, linear codes; ``None`` when it was not asked for."""
    @property
    def translucency(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) the colour of the light that shines through, sRGB; ``None`` when it was not asked for."""
    @property
    def visibility(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) where the sky is seen, b = 2 · code / 255 − 1 in each billboard's axes (red to the right, green up,
        blue toward the viewer): light from the direction l reaches the share ``lc_sun_share(occlusion, b, l)`` of a
        place (shaders/leafcloud.glsl), where the occlusion is the red of ``gloss``. ``None`` when it was not asked
        for."""
    @property
    def leaf_uv(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) where in its texture the leaf lies that most of a texel sees, so that a cloud can take another
        texture: u = (16 · red + blue // 16 + ½) / 4096, v = (16 · green + blue % 16 + ½) / 4096 of the codes, origin in
        the lower left corner. Labels: look up the nearest, without mips. ``None`` when it was not asked for."""
    @property
    def leaf_id(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) which leaf that is: its number modulo 65536 is red + 256 · green, its material's is blue (255 where
        wood is seen). ``None`` when it was not asked for."""
    def for_engines(self) -> tuple[NDArray[np.uint8], float]:
        """``base_color`` and ``alpha_cutoff`` for engines, which make the mip levels of a PNG by plain means: alpha is
        remapped to a lower cutoff, so that the same area passes at level 0 and, in the mean, at levels 1 to 3."""
    def ktx2(self, channel: str) -> bytes:
        """The image of ``channel`` ("base_color", "normal" …) as a KTX2 file with all its mip levels: Basis Universal
        UASTC with Zstandard, as ``KHR_texture_basisu`` wants it. Base colour is that of ``for_engines``: as many texels
        of each billboard pass its cutoff at every level as on the page itself, as compressed, within 1 % or one texel,
        down to 8 × 8 texels of the page and 4 × 4 of the billboard. The same bytes for the same page on one machine.

        Raises ``LeafcloudError`` for a channel that the level does not have or that has no mips (``leaf_uv``,
        ``leaf_id``), and for a page whose side is no multiple of 4.
        """
    @property
    def alpha_cutoff(self) -> float:
        """Texels of at least this alpha are drawn; 0 where alpha is coverage, and nothing is cut out."""
    @property
    def texels(self) -> int:
        """Texels of the page that lie in billboards."""
    @property
    def texel_size(self) -> float:
        """The side of a texel on the billboards, caller's units; the same all over the level."""
    @property
    def occupancy(self) -> float:
        """The share of the page that billboards take, with their gutters."""
    @property
    def page_share(self) -> float:
        """The level's share of all that lies on its page; 1 where it shares it with no other tree (`share_pages`)."""
    @property
    def targets(self) -> NDArray[np.float64]:
        """(t, 3, 3) where each corner of the level before lies at a = 1: on its plane, but for 1/4096 of its height
        over
        it, which keeps the depth order of leaves that overlap. Empty (0, 3, 3) for the cross."""
    @property
    def pivots(self) -> NDArray[np.float64]:
        """(t, 3) the pivot of each triangle's leaf."""
    @property
    def pivot_targets(self) -> NDArray[np.float64]:
        """(t, 3) where that pivot lies at a = 1."""
    @property
    def in_plane_motion(self) -> float:
        """The greatest distance that a vertex moves within its plane, share of R."""
    @property
    def mean_deviation(self) -> float:
        """Area-weighted mean deviation from the level before (the cross: of the vertices, from the nearer plane),
        share of R."""
    @property
    def max_deviation_leaves(self) -> float:
        """Upper bound of the distance between a leaf's point and its place on this level along the normals passed,
        share of R."""
    @property
    def coverage(self) -> float:
        """Rendered coverage over that of the leaves, mean of the judge's views."""
    @property
    def image_error(self) -> float:
        """The judge's image error against the leaves."""
    @property
    def seconds(self) -> BakeSeconds: ...
    @property
    def channel_seconds(self) -> dict[str, float]:
        """What each image of the page took of the seconds ``bake``, by its name: "base_color", "normal" …"""
    def foliage(self) -> Foliage:
        """The billboards as foliage again."""

class Chain:
    """All levels behind the leaves, finest first."""
    @property
    def levels(self) -> list[Level]: ...
    @property
    def ranks(self) -> NDArray[np.float32]:
        """(leaf_count,) each leaf's place in the pruning order, in [0, 1); −1 for a protected one."""
    @property
    def pivots(self) -> NDArray[np.float64]:
        """(t, 3) the pivot of each triangle's leaf, caller's units: the centroid of its area."""
    @property
    def growth(self) -> tuple[float, float]:
        """(c₁, c₂): a crown with the share λ of its leaves is as dense as before when these grow by s · γ, where
        γ = exp(c₁ L + c₂ L²), L = ln λ. Measured by looking where ``keep`` was given, else (0, 0)."""
    @property
    def contrast(self) -> tuple[float, float]:
        """(k₁, k₂): its pixels vary as before when colours keep the share κ = min(1, exp(k₁ L + k₂ L²)) of their
        distance from the mean. Measured likewise."""
    @property
    def look_seconds(self) -> LookSeconds:
        """What it took to look at the leaves before the levels; 0 for what was not asked for."""
    @property
    def seconds(self) -> float:
        """What building it took, all stages of all levels."""
    @property
    def chosen(self) -> Offer | None:
        """What was chosen to keep a wish, and what had been predicted of that; ``None`` without a wish."""
    @property
    def kept(self) -> tuple[NDArray[np.uint32], NDArray[np.float64]] | None:
        """With a ``keep`` below 1: (t′,) the triangles that the first level is made of, and (t′,) how much larger than
        at first each is there, linearly. The first level's parents, targets and pivots have a row for each of them.
        """

class CurveSettings(TypedDict):
    """The settings that a curve varies; what they mean stands in :func:`build_chain`."""

    method: Method
    effort: Effort
    epsilon: float
    candidates: int
    max_billboards: int | None
    levels: int
    cross: bool
    texture_size: int
    samples: int
    tight_pages: bool

class CurveSeconds(TypedDict):
    """Of all levels together. ``prepare``: orders of pruning, the looks at the leaves. ``look``: judging by looks."""

    prepare: float
    fit: float
    pack: float
    bake: float
    look: float
    total: float

class CurveRow(TypedDict):
    """What one choice of settings costs and gives.

    ``measured_on``: triangles of the leaves, of a sample of them in a quick curve. ``peak_bytes``: by how
    many bytes the process had grown at most, as the system says (VmHWM over VmRSS; None but on Linux); memory that was
    freed before and is taken again does not count. ``billboards``, ``triangles``: of level 1. ``texels``: in billboards
    of all levels. ``bytes``: of all levels on a graphics card, four a texel with mip levels, and 32 a corner.
    ``texel``: the side of one on level 1; it and the deviations of level 1 are shares of R. ``image_error``: the
    judge's, of level 1, in [0, 1]. ``front``: no other row is as quick and as near or nearer.
    """

    settings: CurveSettings
    measured_on: int
    seconds: CurveSeconds
    peak_bytes: int | None
    billboards: int
    triangles: int
    texels: int
    bytes: int
    texel: float
    max_deviation: float
    mean_deviation: float
    image_error: float
    front: bool

class CurveRefusal(TypedDict):
    settings: CurveSettings
    reason: str

class Prediction(TypedDict):
    seconds: float
    image_error: float

class Offer(TypedDict):
    settings: CurveSettings
    predicted: Prediction

class Curve:
    """What accuracy costs in time, measured on one foliage. All but seconds and peak_bytes, and what follows from them,
    is the same every time."""
    @property
    def rows(self) -> list[CurveRow]:
        """In the order in which they were measured; the first is what the others are changed from."""
    @property
    def refused(self) -> list[CurveRefusal]:
        """What could not be built, and why."""
    @property
    def quick(self) -> bool: ...
    @property
    def offers(self) -> list[Offer]:
        """The front of what is predicted for all the leaves, quickest first, each of less error than the one before.
        Pages are no larger than was asked for."""
    @property
    def presets(self) -> dict[Preset, Offer]:
        """Places among the offers."""
    def predict(self, **options: object) -> Prediction:
        """Seconds and error of a chain with these options of :func:`build_chain`: settings act by factors, read off
        between the rows on logarithmic axes. Raises ``LeafcloudError`` for options out of range."""
    def svg(
        self,
        over: Cost | Literal["offers"] = "seconds",
        *,
        title: str = "",
        width: int = 960,
        height: int = 640,
        text: float = 1.0,
    ) -> str:
        """A chart of error over a cost, each method a line, the front ringed; ``"offers"`` shows the offers by
        predicted seconds, and the presets by name. Sides in [240, 8192] pixels; ``text``: the size of letters and
        lines, in [0.5, 4], of what suits a page."""
    def picture(
        self,
        over: Cost | Literal["offers"] = "seconds",
        *,
        title: str = "",
        width: int = 960,
        height: int = 640,
        text: float = 1.0,
    ) -> NDArray[np.uint8]:
        """The same as (height, width, 4) pixels."""

class Job(Generic[_T]):
    """Work on a Rust thread. Never touches Python objects while it runs."""
    @property
    def stage(self) -> str: ...
    @property
    def fraction(self) -> float:
        """In [0, 1], never falling."""
    @property
    def done(self) -> bool: ...
    @property
    def best(self) -> _T | None:
        """The best complete result so far; ``None`` until there is one. Fits of the efforts ``final`` and ``best``, and
        those within a budget, have one early and then better ones; it stays when they are cancelled. Foliage of more
        than some 40,000 leaves or parts has one at the end."""
    def cancel(self) -> None: ...
    def result(self, timeout: float | None = None) -> _T:
        """Waits for the end. Raises the work's error, ``CancelledError`` or, after ``timeout`` seconds,
        ``TimeoutError``."""

class FitOptions(TypedDict, total=False):
    """What :func:`fit` may be asked for; beside each option what it is otherwise."""

    method: Method  # "stochastic"
    effort: Effort  # "default"
    epsilon: float  # 0.04
    candidates: int  # 600
    seed: int  # 0
    whole_leaves: bool  # False
    facing: float  # 1.0
    gather: float  # 0.0
    max_billboards: int | None  # None
    slack: float  # 0.0
    max_texels: int | None  # None
    max_size: float | None  # None
    compact: float | None  # None
    max_corners: int  # 4
    trim: bool  # True
    penalty: float  # 0.5
    views: Sequence[Sequence[float]]  # ()
    facing_views: float  # 0.0
    vertical: float  # 0.0
    up: Sequence[float]  # (0.0, 0.0, 1.0)
    image_epsilon: float | None  # None
    viewing_distance: float | None  # None

class LevelOptions(FitOptions, total=False):
    """What levels may be asked for beside that, see :func:`build_chain`."""

    levels: int  # 2
    cross: bool  # True
    texture_size: int  # 2048
    texture_height: int | None  # None
    samples: int  # 4
    back_sides: bool | None  # None
    close_cracks: bool  # False
    blended: bool  # False
    normals: float | None  # None
    gloss: bool  # False
    translucency: bool  # False
    occlusion: bool  # False
    visibility: bool  # False
    leaf_map: bool  # False
    tight_pages: bool  # True
    pixels: float  # 8.0
    order_by_visibility: bool  # True

class ChainOptions(LevelOptions, total=False):
    """What a chain may be asked for beside that, see :func:`build_chain`."""

    keep: float | None  # None
    leaf_pixels: float  # 16.0
    prune_half: float  # 0.5
    contrast: bool  # True
    seconds: float | None  # None
    image_error: float | None  # None
    preset: Preset | None  # None

def fit(
    foliage: Foliage,
    *,
    progress: Progress | None = None,
    **options: Unpack[FitOptions],
) -> Cloud:
    """Finds planes such that every vertex lies within ``epsilon`` · R of its triangle's plane, checked in f64.

    ``epsilon`` in (0, 1], a share of R. ``candidates`` ≥ 1: planes tried per billboard; directions are a fraction of it
    where all offsets of a direction are tried at once. ``whole_leaves`` keeps the triangles of a leaf on one plane
    whenever any plane could hold them all, at the cost of more billboards; otherwise they stay together wherever one of
    the cloud's planes holds them all. ``facing`` ≥ 0 is the weight of 1 − |cos| against the squared relative deviation
    when a leaf chooses among the planes that hold it (0: the nearest plane); ``gather`` ≥ 0 that of the squared
    distance (in R) from the middle of what a plane has: billboards become smaller, less of what is drawn is empty.

    Budgets: ``max_billboards`` asks for the smallest ε found that needs no more, ``epsilon`` is then not used;
    with ``slack`` in [0, 1] leaves may move as large a share of that ε farther where refits bring them nearer in the
    mean for it, and the nearest of several seeds' clouds is taken (not with ``max_texels`` or ``image_epsilon``);
    ``max_texels`` asks for the smallest ε found that needs no more texels of the side ε/8, not below ``epsilon``; time:
    :func:`start_fit`, whose job holds a complete answer early and may be cancelled. ``Cloud.epsilon`` says what came
    out.

    Shape: ``max_size`` (share of R, in [ε, 2]) is the greatest distance of a billboard's leaves from the place where
    the billboard was found (a larger leaf has its own size). None: any distance; in
    :func:`build_chain` 0.2, or twice the mean radius of the leaves (behind level 1: of the billboards before) where
    that is more, but any distance with ``max_billboards`` and for the published methods (``density``, ``kmeans``,
    effort ``literal``);
    ``compact`` (share of R) parts billboards at gaps as wide; ``max_corners`` in [3, 16] is the number of an outline's
    corners, 4 for rectangles; ``trim`` makes outlines enclose what is opaque, and leaves weigh what is opaque of them.

    Preferences, as factors of a plane's score: ``facing_views`` in [0, 1] is what a plane loses that none of the
    directions ``views`` sees face-on, ``vertical`` in [0, 1] what it loses that lies flat under ``up``.

    ``image_epsilon`` (radians) with ``viewing_distance`` (share of R, above 1): a viewer who stays that far from the
    centre sees no vertex move by a greater angle; leaves near him then move less than ε (levels behind the first: 2.5
    times the angle of the one before).

    ``penalty`` in [0, 100] is for ``density``: what a leaf takes from planes that just miss it (the paper: 10).
    """

def start_fit(
    foliage: Foliage,
    **options: Unpack[FitOptions],
) -> Job[Cloud]: ...
def build_chain(
    foliage: Foliage,
    *,
    wood: Foliage | None = None,
    progress: Progress | None = None,
    **options: Unpack[ChainOptions],
) -> Chain:
    """Fits, packs and bakes every level.

    Options of the fit as in :func:`fit`. Level i has 2.5 times the ε of the level before (shares of the leaves' R; a
    budget is the first level's) and a page of ``texture_size`` / 2^(i−1) columns and, without a ``texture_height``, as
    many rows. ``wood`` is seen by the
    cross only.
    ``pixels`` > 0: how large a level's deviation is seen where the level takes over; the page of the cross impostor has
    texels of half a pixel there, or smaller ones, and is no larger than ``texture_size`` allows.
    ``order_by_visibility``: leaves that are seen less are pruned sooner, which takes looks at all of them; without it
    place and chance alone make ``Chain.ranks``.
    ``back_sides``: separate textures for the two sides; ``None`` lets each level decide by looking whether they differ.
    ``keep``: λ, the share of the leaves that is left where the first level takes over, in (0, 1]: all levels are made
    of those, grown about their pivots as they are there (``Chain.kept``); ``None``: leaves are not pruned.
    ``leaf_pixels``: how many pixels a leaf is long where pruning begins, > 0; ``prune_half``: h of :func:`keep`. With
    a ``keep`` it is measured at such sizes how leaves have to grow and to lose contrast (``Chain.growth`` and
    ``contrast``; without ``contrast`` the latter is not).
    ``close_cracks``: a billboard also shows the parts of other billboards' leaves that lie within ε of its plane.
    ``blended``: billboards are see-through where leaves are, ``Level.alpha_cutoff`` is 0; draw them from back to front
    (:func:`blend_order`).
    Pages have channels beside base colour when they are asked for: ``normals`` (the share in [0, 1] by which they are
    bent toward the hull of the crown), ``gloss``, ``translucency``, ``occlusion`` (the share of the sky that is seen
    from a place, in the red of ``gloss``), ``visibility`` (where it is seen, with ``occlusion``: the crown shades
    itself), ``leaf_map`` (``Level.leaf_uv`` and ``leaf_id``).
    """

def cost_curve(
    foliage: Foliage,
    *,
    wood: Foliage | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    **options: Unpack[LevelOptions],
) -> Curve:
    """Builds chains with many settings and measures each: ε, candidates, levels, page, samples, effort, method, one
    changed at a time from what is given here, and some that are coarse or fine in all (minutes).

    ``quick``: few settings on a tenth of the leaves, 3,500 to 9,000 triangles, grown to cover as much, from two
    directions where a bake looks from eight (seconds); its figures serve to predict and to compare.

    Raises ``LeafcloudError`` for settings out of range or without a cloud, when nothing could be built, and
    ``CancelledError``.
    """

def start_cost_curve(
    foliage: Foliage,
    *,
    wood: Foliage | None = None,
    quick: bool = False,
    **options: Unpack[LevelOptions],
) -> Job[Curve]: ...
def share_pages(chains: Sequence[Chain]) -> list[Chain]:
    """The same chains, with their first levels on one page, their second ones on another, and so on: a forest needs one
    texture a level. Regions are carried over texel by texel onto the smallest page (whose sides are multiples of 4);
    each level keeps its own ``alpha_cutoff``, and so looks as it does alone. Chains may have different numbers of
    levels; a short one's cross then shares a page with the others' clouds.

    Raises ``LeafcloudError`` for levels of different channels or of which only some are blended, and for more than fits
    on 16384 × 16384 texels.
    """

def start_chain(
    foliage: Foliage,
    *,
    wood: Foliage | None = None,
    **options: Unpack[ChainOptions],
) -> Job[Chain]: ...

class Simplified:
    """What :func:`simplify` leaves of a mesh of ``t`` triangles: ``n`` ≤ ``t`` triangles."""
    @property
    def corners(self) -> NDArray[np.uint32]:
        """(n, 3) the corners of the input that are those of each triangle: corner c is corner c % 3 of triangle c // 3.
        ``triangles.ravel()[corners]`` are their vertices, ``uvs.reshape(-1, 2)[corners]`` their texture coordinates
        where these came per corner, ``material_ids[corners[:, 0] // 3]`` the materials. Connected parts stay together.
        """
    @property
    def error(self) -> float:
        """The greatest distance that was measured between input and result, either way, or of a part that was left out
        its radius, whichever is more; caller's units, at most the ``error`` that was asked for."""

def simplify(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    error: float,
    uvs: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    colors: ArrayLike | None = None,
    material_ids: ArrayLike | None = None,
) -> Simplified:
    """Trunks and branches, or any mesh, with as few triangles as were found within ``error``, a length above 0 in the
    units of ``positions``.

    ``positions`` (v, 3) float32 or float64; ``triangles`` (t, 3) integers; ``uvs`` per vertex (v, 2) or per corner (t,
    3, 2); ``normals`` likewise (…, 3), of any length; ``colors`` likewise (…, 4); ``material_ids`` (t,) any integers.

    Corners of the result are corners of the input, nothing is computed anew. Texture seams and the borders between
    materials and colours stay apart. What came out is measured against what went in, both ways, at samples half of
    ``error`` apart (at most 17 to an edge). Connected parts (by vertices, or edges whose ends coincide) that fit into
    a sphere of the radius ``error`` are left out: there may be no triangles left, (0, 3).

    The same bytes on any number of threads; another kind of processor may round otherwise (``meshopt``, which orders
    the collapses, is C++). Raises ``LeafcloudError`` as :class:`Foliage` does, and for an ``error`` that is not above 0
    and finite.
    """

class BlendOrder:
    """Pieces of triangles, and the tree by which they are drawn from back to front; see :func:`blend_order`.

    ``c`` corners of ``p`` triangles, ``k`` nodes. Node 0 is the root, if there is any.
    """
    @property
    def sources(self) -> NDArray[np.uint32]:
        """(c,) the triangle of the input that each corner lies in."""
    @property
    def weights(self) -> NDArray[np.float64]:
        """(c, 3) and where: its barycentric coordinates, not negative, 1 together."""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(p, 3) corners, wound as those of the input; in the order for an eye far away in the direction ``toward``."""
    @property
    def planes(self) -> NDArray[np.float64]:
        """(k, 4) n and d of each node's plane n · x = d, n of length 1."""
    @property
    def children(self) -> NDArray[np.int64]:
        """(k, 2) the nodes of what lies where n · x > d, and where n · x < d; −1 where nothing does. An eye draws the
        one on its far side first, then the node's own triangles, then the one on its side."""
    @property
    def ranges(self) -> NDArray[np.uint32]:
        """(k, 2) the first of ``triangles`` that lies in the node, and the one behind the last."""

def blend_order(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    toward: Sequence[float] = (0.0, 0.0, 1.0),
    most: int | None = None,
) -> BlendOrder:
    """A binary space partition of triangles that are blended and may cross one another.

    ``positions`` (v, 3) floats; ``triangles`` (t, 3) integers. What crosses a node's plane is cut in two; behind
    ``most`` pieces nothing is cut any more, and the order is only about right (``None``: there may be some n² of them).
    Triangles without area are left out. The same result on any machine.

    Raises ``LeafcloudError`` for a position or direction that is not finite, and for an index out of range.
    """

def render(
    parts: Sequence[Foliage],
    direction: Sequence[float],
    size: int,
    *,
    centre: Sequence[float],
    radius: float,
    up: Sequence[float] = (0.0, 0.0, 1.0),
    samples: int = 4,
    filtered: bool = True,
) -> NDArray[np.uint8]:
    """An orthographic, flat-lit picture (size, size, 4): base colours seen against ``direction`` (from the centre to
    the eye).

    ``samples`` in [1, 16] lie along each side of a pixel. Textures are filtered over the distance between them, which
    is smooth with few; without (``filtered=False``) they are looked up in points and with the colours between texels
    that renderers show, which is as true as the samples are many."""

def write_png(path: str, image: NDArray[np.uint8]) -> None:
    """Writes an (h, w, 4) sRGB image; the same bytes for the same pixels."""

def read_gltf(path: str, *, names: Sequence[str] | None = None) -> Foliage:
    """The foliage of a .glb or .gltf file, without Blender: meshes and materials whose node, mesh or material name
    contains one of ``names`` (default: leaf, leaves, foliage, needle, frond). Z up.

    Read are the first UV set, colours, normals, and of materials base colour, alpha, gloss and normal map. Textures
    repeat, whatever the file's samplers say, and are not moved. What a file says beyond that (other UV sets, emission,
    extensions) is left to Blender's importer and ``bake.py``."""

def keep(distance: float, start: float, half: float = 0.5) -> float:
    """λ(d) = min((d₀/d)^(ln ½ / ln h), 1): the share of leaves drawn at ``distance``; ``start`` d₀ > 0, ``half`` h in
    (0, ½]."""

def leaf_scale(rank: float, keep: float) -> float:
    """The ramp r in [0, 1]: linear to 0 at rank = λ over the last min(0.05, 1 − λ) of the drawn leaves, 1 before."""

def area_scale(ranks: ArrayLike, areas: ArrayLike, keep: float) -> float:
    """s = √(ΣA / Σ A·r²): the linear factor that keeps the covered area when the leaves with ``ranks`` and ``areas``
    are pruned to λ."""

def transition(distance: float, start: float, end: float) -> float:
    """a: 0 up to ``start``, 1 from ``end``, linear between."""

def switch_distance(deviation: float, pixels: float, resolution: float, field_of_view: float) -> float:
    """The distance from which ``deviation`` (caller's units) is seen smaller than ``pixels``; vertical resolution in
    pixels and
    field of view in radians of a perspective camera."""
