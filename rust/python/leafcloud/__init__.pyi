"""Leafcloud: levels of detail for foliage that do not pop.

Conventions of all functions:

* positions, pivots and planes are in the tree's own coordinates, as given to :class:`Foliage`; its ``matrix``
  transforms them to the world (default: they are world coordinates);
* lengths (radius, deviations, sides of texels, errors, distances) are in world units, angles in radians; directions
  (``up``, ``views``, that of :func:`render`) are directions of the world;
* deviations and ``epsilon`` are fractions of the radius ``R`` of the foliage's bounding sphere (around the center of
  the axis-aligned box, through the farthest vertex);
* texture coordinates have their origin in the lower left corner, v up (Blender's convention);
  images are ``(height, width, 4)`` uint8 arrays, row 0 on top, sRGB with straight alpha;
* ``t`` is the number of triangles of the fitted foliage, ``k`` of planes, ``b`` of billboards.

Results are deterministic: the same input, settings and seed give the same bytes on any number of threads and on any
machine, unless a function documents an exception. An invalid value raises :class:`LeafcloudError`; the message names
the value, its limit and the remedy. Some arguments of a wrong type raise ``TypeError`` instead.

Ctrl-C raises ``KeyboardInterrupt`` within a second in every call. Work that cannot stop ends in the background. Calls
also work in a child process after ``fork``: the child starts its own threads. Calls at the same time have separate
threads, so a short one does not wait for a long one. Memory of results returns to the system when they are gone.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, Literal, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
Method = Literal["stochastic", "density", "kmeans"]
"""``stochastic``: search for the planes that hold the most leaves (extends Lacewell et al. 2006). ``density``: densest
planes first (Décoret et al. 2003). ``kmeans``: clusters around planes; ``max_billboards`` is the input, ε the
result."""
Effort = Literal["literal", "default", "final", "best"]
"""Search time of the method ``stochastic``. ``literal``: the published algorithm, for comparison. ``default``: greedy
search over all directions and offsets. ``final``: then a search for fewer planes (seconds). ``best``: the same with ten
times the search time."""
Refine = Literal["off", "short", "long"]
"""Work of the refinement: none, some seconds or some tens of seconds for each cloud."""
Progress = Callable[[str, float], bool | None]
"""Function called with the stage and the fraction done in [0, 1]. Returning ``False`` cancels the work."""

Preset = Literal["draft", "balanced", "final"]
Form = Literal["auto", "billboards", "leaves"]
Last = Literal["auto", "cross", "octahedral"]
Cost = Literal["seconds", "billboards", "bytes"]

EPSILON_STEP: float
"""Ratio of the error bounds of consecutive clouds."""
FRAGMENTS_PER_TRIANGLE: float
"""Price of a triangle in fragments, for its vertices and its set-up; see :func:`drawing_cost`."""
LARGEST_CROWN: float
"""Largest diameter of the crown in pixels at which a level takes over by its looks: half of 1080 lines."""
LATER_CROWN: float
"""The same for clouds after the first: a sixth of 1080 lines."""
UNJUDGED_CROWN: float
"""Diameter of a crown in pixels that is too small to judge. A level that looks different takes over there."""
HAND_OVER: float
"""The transition a at which the next level takes over. At a = 1 overlapping leaves have almost no depth order."""
LEAST_SAVING: float
"""Fraction of the cost of drawing the level before that a level must save: ``every_level`` in :func:`build_chain`."""
RAMP: float
"""Maximum fraction of the drawn leaves that is growing in or out; see :func:`leaf_scale`."""
SKY: float
"""Light of the sky in :func:`render` with a sun, as a fraction of the base color."""

_T = TypeVar("_T", covariant=True)

class LeafcloudError(Exception):
    """Base class of all errors of Leafcloud."""

class CancelledError(LeafcloudError):
    """The caller cancelled the work."""

class Setting:
    """Range and default of an option that is a number.

    Both ends are included; ``above`` excludes ``low``, and ``below`` excludes ``high``. Counts have ``int`` ends, other
    numbers ``float`` ends. ``high`` may be infinite.
    """
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...
    @property
    def above(self) -> bool: ...
    @property
    def below(self) -> bool: ...
    @property
    def default(self) -> float | None: ...

SETTINGS: Mapping[str, Setting]
"""Range and default of every option of :func:`fit` and :func:`build_chain` that is a number, by its name. ``views``:
the number of directions. ``max_size`` must also be at least ``epsilon``, and ``levels`` may be 0 only with
``cross``."""

class Material:
    """Material of triangles.

    ``base_color``: linear RGBA factor. ``image``: sRGB RGBA image ``(h, w, 4)`` uint8 that repeats outside [0, 1].
    ``alpha_cutoff``: used for ``MASK`` only. A material without ``double_sided`` shows only the side where its
    triangles wind counter-clockwise.

    ``normal``: tangent-space normal map as in glTF (red to the right, green up the texture), linear. ``orm``: image
    of occlusion, roughness and metallic that multiplies the factors, linear. ``translucency``: linear color of the
    transmitted light, times ``translucency_image`` (sRGB). All images use the texture coordinates of ``image``. Factors
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
        orm: NDArray[np.uint8] | None = None,
        translucency: Sequence[float] | None = None,
        translucency_image: NDArray[np.uint8] | None = None,
    ) -> None: ...
    @property
    def name(self) -> str: ...

class Foliage:
    """Triangles with their leaves and materials.

    ``positions``: (v, 3) float32 or float64, in the tree's own coordinates.
    ``triangles``: (t, 3) integers. They wind counter-clockwise as seen from their front, in the tree's coordinates.
    ``matrix``: (4, 4) from the tree's coordinates to the world, for column vectors. It may scale unevenly and mirror;
    fronts stay fronts. The core works in the world, in float64. ``None``: the identity.
    ``uvs``: per vertex (v, 2) or per corner (t, 3, 2).
    ``normals``: likewise (…, 3), of any length, in the tree's coordinates.
    ``colors``: likewise (…, 4), linear RGBA factors of the base color.
    ``back_colors``: likewise (…, 3), linear RGB that replaces ``colors`` on the back of a triangle, where it appears
    clockwise; the light on the two sides of a leaf may differ.
    ``material_ids``: (t,) indices into ``materials``.
    ``leaf_ids``: (t,) any integers, equal within a leaf. Default: a leaf is a connected component. Triangles are
    connected by a shared vertex, or by an edge if both ends coincide exactly.
    ``protected``: (t,) bool; a leaf with a protected triangle is never pruned.

    Raises ``LeafcloudError`` for no triangles, indices out of range, coordinates that are not finite, arrays of the
    wrong shape, and if all triangles have zero area. Raises it also for a ``matrix`` with a value that is not finite, a
    last row other than (0, 0, 0, 1), or a condition number (Frobenius) above 1e8.
    """
    def __init__(
        self,
        positions: ArrayLike,
        triangles: ArrayLike,
        *,
        matrix: ArrayLike | None = None,
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
    def centre(self) -> NDArray[np.float64]:
        """(3,) center of the bounding sphere, in the tree's coordinates."""
    @property
    def world_centre(self) -> NDArray[np.float64]:
        """(3,) the same center in the world, for cameras and :func:`render`."""
    @property
    def radius(self) -> float:
        """Radius R of the bounding sphere, world units."""
    @property
    def mirrored(self) -> bool:
        """True if ``matrix`` mirrors: a counter-clockwise triangle of the tree is clockwise in the world."""
    @property
    def triangle_count(self) -> int: ...
    @property
    def leaf_count(self) -> int: ...
    @property
    def area(self) -> float:
        """Total area of the triangles, world units squared."""
    @property
    def leaf_ids(self) -> NDArray[np.uint32]:
        """(t,) leaf of each triangle, 0 … leaf_count − 1 in order of first appearance."""

class Cloud:
    """Result of a fit: planes, and the parent plane of every triangle."""
    @property
    def planes(self) -> NDArray[np.float64]:
        """(k, 4) unit normal n and distance d, in the tree's coordinates: a point p of the plane has n·p = d."""
    @property
    def parents(self) -> NDArray[np.uint32]:
        """(t,) index of each triangle's plane."""
    @property
    def deviations(self) -> NDArray[np.float64]:
        """(t,) maximum distance of the triangle's vertices from its plane, world units; at most ``epsilon`` × R."""
    @property
    def epsilon(self) -> float:
        """Error bound, fraction of R."""
    @property
    def max_deviation(self) -> float:
        """Maximum of ``deviations``, fraction of R."""
    @property
    def mean_deviation(self) -> float:
        """Area-weighted mean of ``deviations``, fraction of R."""

class BakeSeconds(TypedDict):
    fit: float
    pack: float
    bake: float
    look: float
    refine: float

class LookSeconds(TypedDict):
    order: float
    """Measuring how much of each leaf is visible, for the pruning order."""
    hidden: float
    """Finding the leaves that the crown hides."""
    sky: float
    """Measuring how much of the sky each place sees."""
    growth: float
    """Measuring how much kept leaves must grow."""
    contrast: float
    """Measuring how much contrast kept leaves keep."""

class ImageErrors:
    """Image errors of a level by size: FLIP in [0, 1], compared with the leaves, within four pixels of the silhouettes.

    With ``normals`` that are not bent, each is the larger one of two: without light, and under a sun.
    Sizes are diameters of the leaves' bounding sphere in pixels.
    """

    @property
    def sizes(self) -> list[float]:
        """Sizes, ascending by factors of two, from 7.8 to 250 pixels at most."""
    @property
    def errors(self) -> list[float]:
        """The image error at each of ``sizes``, rounded to three digits."""
    def largest_size(self, target: float) -> float | None:
        """Return the largest size up to which the error is at most ``target``: linear in the logarithm of the size
        between two sizes, and above the largest as it grew before; infinite if it did not grow. ``None``: the error is
        larger than ``target`` even at the smallest size."""

class Level:
    """A cloud with its polygons, its atlas page and the transition from the level before.

    Each of the b billboards is drawn as one or more convex polygons, with c corners in all. A polygon is a fan of
    triangles: corners (0, 1, 2), (0, 2, 3) and so on. The level before level 1 is the leaves. The level before any
    other is the triangles of the previous level's polygons.
    """
    @property
    def cloud(self) -> Cloud | None:
        """The cloud; ``None`` for the cross impostor, which has no parents."""
    @property
    def method(self) -> str:
        """Method of the fit, or "cross"."""
    @property
    def corners(self) -> NDArray[np.float64]:
        """(c, 3) corners of the polygons, one after another: in the world counter-clockwise on the side that shows the
        texture; in the tree's coordinates clockwise if ``Foliage.mirrored``."""
    @property
    def uvs(self) -> NDArray[np.float32]:
        """(c, 2) texture coordinates of the corners."""
    @property
    def polygon_sizes(self) -> NDArray[np.uint32]:
        """(p,) number of corners of each polygon."""
    @property
    def polygon_billboards(self) -> NDArray[np.uint32]:
        """(p,) index of each polygon's billboard, ascending."""
    @property
    def triangles(self) -> int:
        """Number of triangles of all polygons."""
    def plane_pivots(self) -> NDArray[np.float64]:
        """(k, 3) area centroid of the polygons on each plane of the cloud, in the tree's coordinates."""
    @property
    def plane_ids(self) -> NDArray[np.uint32]:
        """(b,) index of each billboard's plane."""
    @property
    def regions(self) -> NDArray[np.uint32]:
        """(b, 4) the texels that each billboard's whole rectangle has on the page: left column, top row (both from the
        top left), width and height."""
    @property
    def two_sided(self) -> bool:
        """True if front and back have different textures. Each billboard is then a pair of single-sided quads;
        otherwise it is double-sided."""
    @property
    def ranks(self) -> NDArray[np.float32]:
        """(b,) rank of each billboard in the pruning order, in [0, 1)."""
    @property
    def base_color(self) -> NDArray[np.uint8]:
        """(h, w, 4) atlas page: sRGB, straight alpha, colors dilated under transparent texels."""
    @property
    def normal(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) normals on the side toward the viewer, in each billboard's axes: a tangent-space normal map as in
        glTF, linear. ``None`` if not requested."""
    @property
    def orm(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) occlusion, roughness and metallic, linear. ``None`` if not requested."""
    @property
    def translucency(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) color of the transmitted light, sRGB. ``None`` if not requested."""
    @property
    def bent_normal(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) bent-normal occlusion: the direction of the visible sky, b = 2 · code / 255 − 1, in each
        billboard's axes (red to the right, green up, blue toward the viewer). Light from the direction l reaches the
        fraction ``lc_sun_share(occlusion, b, l)`` of a place (shaders/leafcloud.glsl); occlusion is the red of
        ``orm``. ``None`` if not requested."""
    @property
    def leaf_uv(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) texture coordinates of the leaf that covers most of the texel, to give a cloud another leaf
        texture: u = (16 · red + blue // 16 + ½) / 4096, v = (16 · green + blue % 16 + ½) / 4096 of the codes, origin in
        the lower left corner. Label texture: sample with nearest filtering, without mips. ``None`` if not requested."""
    @property
    def leaf_id(self) -> NDArray[np.uint8] | None:
        """(h, w, 4) the leaf of ``leaf_uv``: its index modulo 65536 is red + 256 · green, its material's index is blue
        (255 for the trunk). ``None`` if not requested."""
    def mips(self, channel: str) -> list[NDArray[np.uint8]]:
        """Return the mip levels (height, width, 4) of ``channel`` ("base_color", "normal" …), the page itself first,
        down to one texel.

        Alpha of ``base_color`` is a mean of 2 × 2 texels, bent so that the share of drawn texels at or above
        ``alpha_cutoff`` stays that of the page (``alpha_pivots``); of an alpha-blended level it is the mean. Normals
        keep the length 1, colors are averaged as light.

        Raises ``LeafcloudError`` for a channel that the level lacks or that has no mips (``leaf_uv``, ``leaf_id``)."""
    def alpha_pivots(self) -> list[float]:
        """Return for each mip level of ``base_color`` the mean alpha p that was bent to the cutoff c: a below p became
        c · a / p, and a above it c + (1 − c) · (a − p) / (1 − p). On the page itself p is c. Empty if alpha is
        blended."""
    def ktx2(self, channel: str) -> bytes:
        """Return the image of ``channel`` as a KTX2 file with the mip levels of ``mips(channel)``.

        The format is Basis Universal UASTC with Zstandard, as ``KHR_texture_basisu`` requires. The bytes are the same
        for the same page on one machine only.

        Raises ``LeafcloudError`` for a channel that the level lacks or that has no mips (``leaf_uv``, ``leaf_id``), and
        for a page with a side that is not a multiple of 4.
        """
    @property
    def alpha_cutoff(self) -> float:
        """Minimum alpha of drawn texels; 0 for alpha-blended levels, where nothing is cut out."""
    @property
    def texels(self) -> int:
        """Number of texels of the page inside billboards."""
    @property
    def texel_size(self) -> float:
        """Side of a texel on the billboards, world units; the same on the whole level."""
    @property
    def occupancy(self) -> float:
        """Fraction of the page covered by billboards with their gutters."""
    @property
    def page_share(self) -> float:
        """The level's fraction of the used area of its page; 1 unless it shares the page with other trees
        (:func:`share_pages`)."""
    @property
    def targets(self) -> NDArray[np.float64]:
        """(t, 3, 3) position of each corner of the level before at a = 1, in that level's order: on its plane, plus
        1/4096 of its height over the plane to keep the depth order of overlapping leaves. Empty (0, 3, 3) for the cross
        impostor."""
    @property
    def pivots(self) -> NDArray[np.float64]:
        """(t, 3) pivot of each triangle's leaf."""
    @property
    def pivot_targets(self) -> NDArray[np.float64]:
        """(t, 3) position of that pivot at a = 1."""
    @property
    def in_plane_motion(self) -> float:
        """Maximum distance that a vertex moves within its plane, fraction of R."""
    @property
    def refined(self) -> list[tuple[int, float]] | None:
        """Effect of the refinement in pictures of views that no step of it used: sides in pixels, each with the
        mean absolute error relative to that before; 1.0 where nothing changed. ``None`` without refinement of the
        textures."""
    @property
    def refined_planes(self) -> list[tuple[int, float]] | None:
        """Effect of the refinement of the planes, like ``refined``, in pictures of the collapsed leaves. ``None``
        without it."""
    @property
    def mean_deviation(self) -> float:
        """Area-weighted mean deviation from the level before, fraction of R. For the cross impostor: mean distance of
        the vertices from the nearest plane."""
    @property
    def max_deviation_leaves(self) -> float:
        """Upper bound of the distance between a point of a leaf and its position on this level, summed along the
        normals of all levels so far, fraction of R."""
    @property
    def coverage(self) -> float:
        """Rendered coverage divided by that of the leaves, mean over the views of the metrics."""
    @property
    def image_error(self) -> float:
        """Image error of the metrics, compared with the leaves, in pictures of 128 × 128 pixels."""
    def pictures(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return pictures (256, 256, 4) of the leaves and of the level from the side: sRGB with straight alpha, under a
        sun if the level has ``normals``. The picture of an impostor and the one beside it show the trunk, too."""
    def image_errors(self, target: float | None = None) -> ImageErrors:
        """Measure the image error, without light and under a sun, compared with the leaves, in pictures of different
        sizes. With ``target`` it ends at the first size with a larger error, which ``largest_size(target)`` needs.
        Takes some tenths of a second for all sizes; the level keeps what it measured."""
    @property
    def seconds(self) -> BakeSeconds: ...
    @property
    def channel_seconds(self) -> dict[str, float]:
        """Seconds of each image of the page, by name ("base_color", "normal" …); part of the seconds ``bake``."""
    def morphed(self, before: Foliage, a: float) -> Foliage:
        """Return the triangles that the level is made of, at ``a`` in [0, 1] of their transition to the level.

        ``before``: foliage of the level before; for level 1 the leaves, of which the kept ones appear at their size in
        the level (``Chain.kept``).

        Raises ``LeafcloudError`` for the cross impostor, for another foliage, and for ``a`` out of range."""
    def foliage(self) -> Foliage:
        """Return the billboards as foliage of the same tree."""

class LeafLevel:
    """A level of leaves with the materials of the tree's own: simplified ones, or fewer and larger ones. It has no page
    and no cloud."""
    @property
    def cloud(self) -> None: ...
    @property
    def method(self) -> str:
        """The string "simplified" or "fewer"."""
    @property
    def kept(self) -> tuple[NDArray[np.uint32], NDArray[np.float64]] | None:
        """For fewer leaves: the triangles (s,) that are kept of the simplified leaves, or of the tree's own without
        these, and the growth (s,) of each, about the pivot of its leaf, which moves to ``pivots``. None for simplified
        leaves."""
    @property
    def corners(self) -> NDArray[np.uint32]:
        """(s, 3) triangles made of corners of the tree's leaves, counted through all triangles: corner c is corner
        c mod 3 of triangle c // 3. Their attributes are those of the corners. Leaves are in the same order."""
    @property
    def positions(self) -> NDArray[np.float64]:
        """(s, 3, 3) positions of the corners. Leaves grow about their pivots to keep their area."""
    @property
    def targets(self) -> NDArray[np.float64]:
        """(t, 3, 3) position of each corner of the level before at a = 1: a point of its leaf, or the pivot of a leaf
        that is gone."""
    @property
    def pivots(self) -> NDArray[np.float64]:
        """(s, 3) pivot of each triangle's leaf. Fewer leaves are in the middles of the clusters that they stand for."""
    @property
    def pivot_targets(self) -> NDArray[np.float64]:
        """(t, 3) place of each pivot of the level before at a = 1."""
    @property
    def triangles(self) -> int:
        """Number of triangles."""
    @property
    def max_deviation_leaves(self) -> float:
        """Maximum distance of a corner of the tree's own leaves from its target, or of the simplified leaves for fewer
        leaves; fraction of R."""
    @property
    def texel_size(self) -> float:
        """0: the level has no page."""
    @property
    def page_share(self) -> float:
        """1: the level shares no page."""
    @property
    def two_sided(self) -> bool:
        """False: the leaves' materials decide."""
    @property
    def coverage(self) -> float:
        """As :attr:`Level.coverage`."""
    @property
    def image_error(self) -> float:
        """As :attr:`Level.image_error`."""
    def pictures(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """As :meth:`Level.pictures`."""
    def image_errors(self, target: float | None = None) -> ImageErrors:
        """As :meth:`Level.image_errors`."""
    @property
    def seconds(self) -> BakeSeconds:
        """Seconds: ``fit`` for finding the leaves and choosing among them, 0 for the rest."""
    def morphed(self, before: Foliage, a: float) -> Foliage:
        """Return the leaves ``before`` at ``a`` in [0, 1] of their transition to the level.

        Raises ``LeafcloudError`` for another foliage, and for ``a`` out of range."""
    def foliage(self) -> Foliage:
        """Return the leaves of the level as foliage of the same tree."""

class OctahedralLevel:
    """The last level as an octahedral impostor: one quad that faces the eye and shows the three nearest of ``grid`` ×
    ``grid`` views of leaves and trunk, by the law of shaders/octahedral.glsl. It has no cloud."""
    @property
    def cloud(self) -> None: ...
    @property
    def method(self) -> str:
        """The string "octahedral"."""
    @property
    def cross(self) -> Level:
        """The cross impostor, for files that are read without the shader."""
    @property
    def triangles(self) -> int:
        """2."""
    @property
    def color(self) -> NDArray[np.uint8]:
        """(h, w, 4) base color of all views: sRGB, with coverage as straight alpha. Row 0 is on top."""
    @property
    def normal_depth(self) -> NDArray[np.uint8]:
        """(h, w, 4) x and y of the normals in each view's axes, in [-1, 1] as codes (z ≥ 0 follows), the share of the
        light from above that the leaf gets, and in alpha the depth toward the viewer, in [-1, 1] as codes."""
    @property
    def alpha_cutoff(self) -> float:
        """Least alpha to draw, for engines that cut out instead of blending."""
    @property
    def grid(self) -> int:
        """Views along each side of the page."""
    @property
    def view_texels(self) -> int:
        """Texels along each side of a view."""
    @property
    def texels(self) -> int:
        """Texels of a page."""
    @property
    def texel_size(self) -> float:
        """Side of a texel, world units."""
    @property
    def to_layout(self) -> NDArray[np.float64]:
        """(3, 4) rows of the transform from the tree's coordinates to the layout's axes around the middle of the tree,
        with up as the third axis and the stored depth as the unit."""
    @property
    def extent(self) -> tuple[float, float]:
        """Half of the width and of the height of a view's picture, in the layout's unit."""
    @property
    def half(self) -> tuple[float, float, float]:
        """Half of the tree's box along the layout's axes, in its unit."""
    @property
    def max_deviation_leaves(self) -> float:
        """A texel, fraction of R: visible surfaces are drawn within it."""
    @property
    def page_share(self) -> float:
        """1: the level shares no page."""
    @property
    def two_sided(self) -> bool:
        """False."""
    @property
    def coverage(self) -> float:
        """As :attr:`Level.coverage`."""
    @property
    def image_error(self) -> float:
        """As :attr:`Level.image_error`, drawn with blending."""
    def pictures(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """As :meth:`Level.pictures`."""
    def image_errors(self, target: float | None = None) -> ImageErrors:
        """As :meth:`Level.image_errors`."""
    @property
    def seconds(self) -> BakeSeconds:
        """Seconds: ``bake`` for all of it, 0 for the rest."""
    def render(
        self,
        direction: Sequence[float],
        size: int,
        *,
        centre: Sequence[float],
        radius: float,
        up: Sequence[float] = (0.0, 0.0, 1.0),
        samples: int = 4,
        sun: Sequence[float] | None = None,
    ) -> NDArray[np.uint8]:
        """Draw the impostor, blended, as :func:`render` draws foliage, with at most 4096 samples along a side
        (``size`` × ``samples``). Under a ``sun`` the stored openness stands for shadows."""
    def drawing_cost(self, scale: float, *, up: Sequence[float] = (0.0, 0.0, 1.0)) -> DrawingCost:
        """Return the cost of drawing it, as :func:`drawing_cost`. A pixel counts as three fragments: it blends three
        views."""

AnyLevel = LeafLevel | Level | OctahedralLevel

class LeftOut(TypedDict):
    """A level that was not made: it saves less than a tenth of the cost of drawing the level before it."""

    method: str
    epsilon: float | None
    crown_pixels: float
    """Diameter of the crown's sphere, 2 R, in pixels where the level would take over."""
    cost: DrawingCost
    """Cost of the level there."""
    before: DrawingCost
    """Cost of the level before it there; for the cross impostor, which shows the trunk, with the trunk."""

class Judgement(TypedDict):
    """How a level looks in pictures of one size, means over four views, of the light with the larger ``excess``."""

    crown_pixels: float
    """Diameter of the crown."""
    difference: float
    """FLIP inside the silhouettes, over that of the control: the leaves as a light breeze has moved them."""
    contrast: list[float]
    """Contrast of the three finest octaves inside the crown, over the leaves'."""
    coverage: float
    """Sum of alpha over the leaves'."""
    places: float
    """Differences of 16 × 16 cells over those of the control; 0 where the picture has fewer than 64 pixels."""
    color: float
    """Greatest difference of the mean color of a channel, in [0, 1]."""
    excess: float
    """The greatest share that a figure uses of what is allowed: the level passes with at most 1."""
    by: str
    """The name of that figure."""

class TakesOver(TypedDict):
    """Where a level takes over."""

    crown_pixels: float
    """Diameter of the crown."""
    passes: bool
    """Whether the level passes the yardstick there."""
    judged: Judgement
    """Its figures in the pictures whose size is nearest."""

class TriedEpsilon(TypedDict):
    """An error bound that was tried with a draft: the leaves on their planes, without textures."""

    epsilon: float
    excess: float
    by: str
    billboards: int

class Yardstick:
    """Judges levels by what an equally good tree passes: the same leaves as a light breeze has moved them."""

    def __init__(
        self,
        leaves: Foliage,
        *,
        still: Foliage | None = None,
        up: Sequence[float] = (0.0, 0.0, 1.0),
        lit: bool = True,
    ) -> None:
        """Render the leaves and the control in four views. ``still``: the trunk, which levels show, too. ``lit``: also
        under a sun."""
    def judge(self, level: Foliage | OctahedralLevel, *, q: float = 1.0) -> list[Judgement]:
        """Judge a level in pictures of 512 to 16 pixels. ``q``: the difference that is allowed, over the control's."""

def allowed_difference(quality: float) -> float:
    """Return the difference that a quality in [0, 1] allows, over the control's: 2 at 0, 1 at 0.5, 0.5 at 1."""

def page_side(memory_budget: float) -> int:
    """Return the greatest side of the first cloud's page, with base color and normals, within a budget in MB."""

class Chain:
    """All levels after the leaves, finest first."""
    @property
    def takes_over(self) -> list[TakesOver]:
        """Where each of ``levels`` takes over by its looks; empty without ``quality``."""
    @property
    def plain_takes_over(self) -> TakesOver | None:
        """Where the cross impostor takes over in place of the octahedral one; ``None`` if there is none."""
    @property
    def tried(self) -> list[TriedEpsilon]:
        """The error bounds that were tried for the first cloud; the last one was chosen."""
    @property
    def levels(self) -> list[AnyLevel]:
        """All levels: those of leaves, if there are some, then ``clouds``. An octahedral impostor replaces the cross
        impostor."""
    @property
    def clouds(self) -> list[Level]:
        """The clouds and the cross impostor. The first is made of the simplified leaves, if there are some: their
        triangles are those of its parents, targets and pivots, and of ``kept``. It is never made of fewer leaves."""
    @property
    def left_out(self) -> list[LeftOut]:
        """The levels that were not made, with ``every_level=False``."""
    @property
    def ranks(self) -> NDArray[np.float32]:
        """(leaf_count,) rank of each leaf in the pruning order, in [0, 1); −1 for a protected leaf."""
    @property
    def pivots(self) -> NDArray[np.float64]:
        """(t, 3) pivot of each triangle's leaf, the centroid of the leaf's area."""
    @property
    def twigs(self) -> list[NDArray[np.uint32]]:
        """For each cloud the triangles of the trunk that it shows, those of the cloud before among them. Empty unless
        ``quality`` chooses the clouds and ``twigs`` is true."""
    @property
    def growth(self) -> tuple[float, float]:
        """(c₁, c₂) of γ = exp(c₁ L + c₂ L²), L = ln λ. A crown with the fraction λ of its leaves keeps its density if
        these grow by s · γ. Measured in renders if ``keep`` was given, else (0, 0)."""
    @property
    def contrast(self) -> tuple[float, float]:
        """(k₁, k₂) of κ = min(1, exp(k₁ L + k₂ L²)). The pruned crown's pixels keep their contrast if colors keep the
        fraction κ of their distance from the mean. Measured likewise."""
    @property
    def look_seconds(self) -> LookSeconds:
        """Seconds of the measurements on the leaves before the levels; 0 for those not requested."""
    @property
    def seconds(self) -> float:
        """Seconds of the build, all stages of all levels."""
    @property
    def chosen(self) -> Offer | None:
        """Settings chosen for a wish (``seconds``, ``image_error`` or ``preset``) and their prediction; ``None``
        without a wish."""
    @property
    def kept(self) -> tuple[NDArray[np.uint32], NDArray[np.float64]] | None:
        """(t′,) indices of the triangles that the first level is made of, and (t′,) their linear growth factors, 1
        without pruning; ``None`` if these are all triangles. The first level's parents, targets and pivots have one row
        per kept triangle.
        """

class CurveSettings(TypedDict):
    """Settings that a curve varies, documented in :func:`build_chain`."""

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
    """Seconds of all levels together. ``prepare``: pruning order and measurements on the leaves. ``look``: metrics."""

    prepare: float
    fit: float
    pack: float
    bake: float
    look: float
    total: float

class CurveRow(TypedDict):
    """Costs and results of one choice of settings.

    ``measured_on``: number of triangles of the leaves, or of the sample in a quick curve.
    ``peak_bytes``: maximum growth of the process in bytes, as reported by the system (VmHWM over VmRSS); None except on
    Linux. Memory freed before and used again does not count.
    ``billboards``, ``triangles``: numbers of level 1.
    ``texels``: number of texels inside billboards, all levels.
    ``bytes``: graphics memory of all levels: four bytes per texel with mips, and 32 per corner.
    ``texel``: side of a texel on level 1, fraction of R.
    ``max_deviation``, ``mean_deviation``: of level 1, fractions of R.
    ``image_error``: image error of level 1 by the metrics, in [0, 1].
    ``front``: True if the row is on the Pareto front of time and image error.
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
    """Measured cost curve of one foliage: accuracy over time.

    Everything except ``seconds``, ``peak_bytes`` and values derived from them is deterministic."""
    @property
    def rows(self) -> list[CurveRow]:
        """Measured settings, in order of measurement. The first row is the base that the others vary."""
    @property
    def refused(self) -> list[CurveRefusal]:
        """Settings that could not be built, with the reason."""
    @property
    def quick(self) -> bool: ...
    @property
    def offers(self) -> list[Offer]:
        """Best predicted settings for all leaves, fastest first; each has a smaller error than the one before. Pages
        are at most as large as requested."""
    @property
    def presets(self) -> dict[Preset, Offer]:
        """Offer of each preset."""
    def predict(self, **options: object) -> Prediction:
        """Predict seconds and image error of a chain with these options of :func:`build_chain`.

        Each setting multiplies the result by a factor, interpolated between the rows on logarithmic axes. Raises
        ``LeafcloudError`` for options out of range."""
    def svg(
        self,
        over: Cost | Literal["offers"] = "seconds",
        *,
        title: str = "",
        width: int = 960,
        height: int = 640,
        text: float = 1.0,
    ) -> str:
        """Draw a chart of error over a cost as SVG, with one line per method and rings around the front.

        ``"offers"`` shows the offers by predicted seconds, and the presets by name. Sides in [240, 8192] pixels;
        ``text`` scales letters and lines, in [0.5, 4]; 1 suits a printed page."""
    def picture(
        self,
        over: Cost | Literal["offers"] = "seconds",
        *,
        title: str = "",
        width: int = 960,
        height: int = 640,
        text: float = 1.0,
    ) -> NDArray[np.uint8]:
        """Draw the chart of :meth:`svg` as (height, width, 4) pixels."""

class Job(Generic[_T]):
    """Work on a Rust thread. It never touches Python objects while it runs."""
    @property
    def stage(self) -> str: ...
    @property
    def fraction(self) -> float:
        """Fraction done, in [0, 1]; never decreases."""
    @property
    def done(self) -> bool: ...
    @property
    def best(self) -> _T | None:
        """Best complete result so far, or ``None``.

        Fits with effort ``final`` or ``best`` and fits with a budget have a result early, then better ones. It remains
        after a cancellation. Foliage with more than about 40,000 leaves or parts has a result only at the end."""
    def cancel(self) -> None: ...
    def result(self, timeout: float | None = None) -> _T:
        """Wait for the end and return the result. Raise the work's error, ``CancelledError`` or, after ``timeout``
        seconds, ``TimeoutError``."""

class FitOptions(TypedDict, total=False):
    """Options of :func:`fit`, with their defaults as comments."""

    method: Method  # "stochastic"
    effort: Effort  # "default"
    epsilon: float  # 0.04
    candidates: int  # 600
    seed: int  # 0
    whole_leaves: bool  # False
    facing: float  # 1.0
    gather: float  # 0.0
    max_billboards: int | None  # None
    extra_error: float  # 0.25
    max_texels: int | None  # None
    max_size: float | None  # None
    compact: float | None  # None
    trim: bool  # True
    penalty: float  # 0.5
    views: Sequence[Sequence[float]]  # ()
    facing_views: float  # 0.0
    vertical: float  # 0.0
    up: Sequence[float]  # (0.0, 0.0, 1.0)
    image_epsilon: float | None  # None
    viewing_distance: float | None  # None

class LevelOptions(FitOptions, total=False):
    """Further options of levels, documented in :func:`build_chain`, with their defaults as comments."""

    levels: int  # 2
    cross: bool  # True
    every_level: bool  # True
    triangles: int | None  # None
    max_corners: int  # 5
    min_visibility: float  # 0.02
    texture_size: int | None  # None
    texture_height: int | None  # None
    samples: int  # 4
    back_sides: bool | None  # None
    close_gaps: bool  # False
    blended: bool  # False
    normals: float | None  # None
    orm: bool  # False
    translucency: bool  # False
    occlusion: bool  # False
    bent_normal: bool  # False
    leaf_map: bool  # False
    tight_pages: bool  # True
    pixels: float  # 8.0
    refine: Refine  # "off"
    refine_parts: Sequence[Literal["planes", "texels"]]  # ("planes", "texels")
    order_by_visibility: bool  # True
    few_views: bool  # False

class ChainOptions(LevelOptions, total=False):
    """Further options of a chain, documented in :func:`build_chain`, with their defaults as comments."""

    keep: float | None  # None
    leaf_pixels: float  # 16.0
    prune_half: float  # 0.5
    contrast: bool  # True
    seconds: float | None  # None
    image_error: float | None  # None
    preset: Preset | None  # None
    quality: float | None  # None
    scene: float  # 50.0
    memory_budget: float  # 4.0
    sizes: Sequence[float] | None  # None
    shares: bool  # False
    twigs: bool  # False
    steps: Sequence[tuple[float, float]] | None  # None
    form: Form | None  # "auto"
    last: Last | None  # "cross"

def fit(
    foliage: Foliage,
    *,
    progress: Progress | None = None,
    **options: Unpack[FitOptions],
) -> Cloud:
    """Fit planes with every vertex within ``epsilon`` · R of its triangle's plane, checked in f64.

    :data:`SETTINGS` has the range of each number.

    ``epsilon``: error bound, fraction of R.
    ``candidates``: planes tried per billboard. Searches that try all offsets of a direction at once use a fraction
    of it as directions.
    ``whole_leaves``: keep a leaf on one plane whenever any plane could hold all its triangles, at the cost of more
    billboards. Otherwise a leaf stays whole wherever one of the cloud's planes holds it.
    ``facing``: weight of 1 − |cos| against the squared relative deviation when a leaf chooses among the planes that
    hold it; 0 takes the nearest plane.
    ``gather``: weight of the squared distance (in R) from the center of a plane's leaves in the same choice. Larger
    gives smaller billboards with less empty area.

    Budgets:
    ``max_billboards``: use the smallest ε found that needs no more billboards; ``epsilon`` is ignored.
    ``extra_error``: extra error allowance for ``max_billboards``, fraction of that ε. Refits spend it where
    it reduces the mean deviation, and the best of several seeds' clouds is taken. Not with ``max_texels`` or
    ``image_epsilon``.
    ``max_texels``: use the smallest ε found that needs no more texels of side ε/8, but at least ``epsilon``.
    For a time budget use :func:`start_fit`: its job has a complete result early and can be cancelled. ``Cloud.epsilon``
    is the resulting bound.

    Shape:
    ``max_size``: maximum distance of a billboard's leaves from the place where the billboard was found, fraction of R,
    at least ε; a larger leaf has a billboard of its own size. None: any distance. In :func:`build_chain` None is the
    distance whose billboards are cheapest to draw with four fifths of the level's triangles, at least 0.1 and twice the
    mean radius of the leaves (after level 1: of the previous billboards), but any distance with ``max_billboards`` and
    for the published methods (``density``, ``kmeans``, effort ``literal``).
    ``compact``: minimum gap, fraction of R, at which a billboard is split.
    ``trim``: outlines enclose only opaque texels, and leaves are weighted by their opaque area.

    Preferences, as factors of a plane's score:
    ``facing_views``: penalty for planes that face none of the directions ``views``.
    ``vertical``: penalty for horizontal planes, perpendicular to ``up``.

    ``image_epsilon`` (radians) with ``viewing_distance`` (fraction of R, above 1): a viewer at least that far from the
    center sees no vertex move by a larger angle, so nearby leaves move less than ε. Each level after the first has 2.5
    times the angle of the one before.

    ``penalty``: for ``density``: the weight that a leaf subtracts from planes that just miss it, relative
    to the weight that it adds to planes that hold it (10 in the paper).
    """

def start_fit(
    foliage: Foliage,
    **options: Unpack[FitOptions],
) -> Job[Cloud]: ...
def build_chain(
    foliage: Foliage,
    *,
    trunk: Foliage | None = None,
    progress: Progress | None = None,
    **options: Unpack[ChainOptions],
) -> Chain:
    """Fit, pack and bake every level.

    For the options of the fit see :func:`fit`, for ranges :data:`SETTINGS`. Each level has :data:`EPSILON_STEP` times
    the ε of the level before (fractions of the leaves' R; a budget applies to the first level).

    ``triangles``: maximum number of triangles of level 1, ``trunk`` included, which gets at most a quarter. If small
    billboards do not meet it, ε grows. ``None``: 15 % of the tree's triangles (10 % if no leaf is cut out of a
    texture), between 500 and 3000, at most three quarters of the leaves'; ε stays, and may need more. A later level has
    at most a third of the triangles of the level before it, unless its ε needs more.
    ``max_corners``: maximum number of corners of a billboard's polygons.
    ``min_visibility``: leaves of which less than this fraction is seen from outside are in no level (``Chain.kept``);
    0 keeps all. No effect with ``keep``. The cross impostor shows all leaves.
    ``texture_size``: columns of level 1's page, and rows unless ``texture_height`` is given. The page of level i has
    1/2^(i−1) of that. ``None``: pages are as small as texels of half a pixel, where the level takes over, allow, and
    level 1's has at most 2048 columns.
    ``trunk``: the trunk. The cross impostor shows all of it.
    ``every_level``: False leaves a level out if it saves less than a tenth of the cost of drawing the level before it,
    where it takes over (``Chain.left_out``, :func:`drawing_cost`). The last level stays if there is no other.
    ``pixels``: size at which a level's deviation appears where the level takes over.
    ``quality``: from 0 (fast) to 1 (exact), how little levels differ where they take over
    (:func:`allowed_difference`). Finds where each level takes over (``Chain.takes_over``), and chooses ``epsilon``,
    unless given, sizes and pages. A cloud after the first one then saves half of the cost of the level before.
    ``None``: the other options decide.
    ``scene``, with ``quality``: distance to the horizon of an even plantation that is cheap to draw, in R.
    ``memory_budget``, with ``quality``: MB of the levels' compressed textures.
    ``sizes``, with ``quality``: sizes of the crown where levels take over, as fractions of 1080 lines, descending.
    ``shares``, with ``quality``: levels are drawn with alpha as a share of a pixel, not cut out.
    ``twigs``, with ``quality``: clouds show the thin branches of ``trunk`` (``Chain.twigs``), unless the tree then
    costs more to draw. Draw their trunks without these.
    ``form``, with ``quality``: "billboards", "leaves" (level 1 is :class:`LeafLevel`, however little it saves), or
    "auto": leaves where they make the scene a tenth cheaper to draw, and fewer of the leaves where that is
    cheaper than a cloud.
    ``steps``: for each cloud its ε and the diameter of the crown in pixels where it takes over, in place of the ε that
    grow by :data:`EPSILON_STEP` and of ``pixels``.
    ``order_by_visibility``: prune less visible leaves sooner; takes renders of all leaves. Otherwise only position and
    chance decide ``Chain.ranks``.
    ``few_views``: measure in four views in place of 16, for a first look.
    ``back_sides``: separate textures for the two sides. ``None``: where leaves are single-sided.
    ``keep``: λ, the fraction of leaves kept where the first level takes over. All levels are made of these
    leaves, grown about their pivots by the factor at that distance (``Chain.kept``). ``None``: no pruning.
    ``leaf_pixels``: length of a leaf in pixels where pruning begins. ``prune_half``: h of :func:`keep`. With
    ``keep``, growth and contrast of kept leaves are measured at these sizes (``Chain.growth``, ``Chain.contrast``).
    ``contrast``: also measure the contrast.
    ``close_gaps``: close gaps between billboards: each also shows the parts of other billboards' leaves within ε of
    its plane.
    ``refine``: change the clouds until pictures of them look like those of the leaves, in some seconds ("short") or
    some tens of seconds ("long") for each cloud: the plane of each leaf, offset and tilt of the planes (only "long"),
    then color and alpha of the textures. Planes stay within the error bound. Planes, and then a texture, stay as they
    are if other pictures do not become better, or become worse at any size (``Level.refined_planes``,
    ``Level.refined``). Blended billboards are not refined.
    ``refine_parts``: the parts of the refinement, for measurements.
    ``blended``: alpha-blended billboards; ``Level.alpha_cutoff`` is 0. Draw them from back to front
    (:func:`blend_order`).

    Optional channels of the pages beside base color:
    ``normals``: bent toward the hull of the crown by this fraction.
    ``orm``: roughness and metallic.
    ``translucency``: color of the transmitted light.
    ``occlusion``: fraction of the sky visible from a place, in the red of ``orm``.
    ``bent_normal``: bent-normal occlusion, for self-shadowing of the crown; use it with ``occlusion``.
    ``leaf_map``: ``Level.leaf_uv`` and ``Level.leaf_id``.
    """

def cost_curve(
    foliage: Foliage,
    *,
    trunk: Foliage | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    **options: Unpack[LevelOptions],
) -> Curve:
    """Measure chains with many settings (minutes).

    The sweep varies ε, candidates, levels, page, samples, effort and method one at a time from the given options, and
    adds chains that are coarse or fine in all of them.

    ``quick``: few settings on a tenth of the leaves (3,500 to 9,000 triangles), grown to cover the same area, with two
    view directions instead of a bake's eight (seconds). Use its numbers only to predict and to compare.

    Raises ``LeafcloudError`` for settings out of range or without a cloud, and if nothing could be built;
    ``CancelledError``.
    """

def start_cost_curve(
    foliage: Foliage,
    *,
    trunk: Foliage | None = None,
    quick: bool = False,
    **options: Unpack[LevelOptions],
) -> Job[Curve]: ...
def share_pages(chains: Sequence[Chain]) -> list[Chain]:
    """Put the levels of several chains with the same number on one page: a forest needs one texture per level.

    Regions are copied texel by texel to the smallest page with sides that are multiples of 4. Each level keeps its own
    ``alpha_cutoff`` and appearance. Chains may have different numbers of levels; the cross impostor of a short chain
    then shares a page with clouds of the others.

    Raises ``LeafcloudError`` for levels with different channels, for a mix of alpha-blended and cut-out levels, and for
    pages above 16384 × 16384 texels.
    """

def start_chain(
    foliage: Foliage,
    *,
    trunk: Foliage | None = None,
    **options: Unpack[ChainOptions],
) -> Job[Chain]: ...

class Simplified:
    """Mesh simplified by :func:`simplify` from ``t`` to ``n`` ≤ ``t`` triangles."""
    @property
    def corners(self) -> NDArray[np.uint32]:
        """(n, 3) input corners of each triangle. Corner c is corner c % 3 of triangle c // 3.

        ``triangles.ravel()[corners]`` are the vertices, ``uvs.reshape(-1, 2)[corners]`` the texture coordinates if
        given per corner, ``material_ids[corners[:, 0] // 3]`` the materials. Triangles of a connected part are
        consecutive.
        """
    @property
    def change(self) -> float:
        """Fraction of the area that shows ``leaves`` or mesh that differs from the input's pictures."""

def simplify(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    leaves: Foliage | None = None,
    pixel: float,
    change: float,
    most: int | None = None,
    uvs: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    colors: ArrayLike | None = None,
    material_ids: ArrayLike | None = None,
) -> Simplified:
    """Simplify trunks and branches, or any mesh, to the fewest triangles found that look the same behind ``leaves``.

    ``leaves``: foliage that hides parts of the mesh; None for none. ``pixel``: side of a pixel on the tree, a length
    above 0 in the units of ``positions``. ``change``: maximum of ``Simplified.change``, in [0, 1]. ``most``: maximum
    number of triangles, which comes before ``change``; None for no limit.

    ``positions`` (v, 3) float32 or float64; ``triangles`` (t, 3) integers; ``uvs`` per vertex (v, 2) or per corner (t,
    3, 2); ``normals`` likewise (…, 3), of any length; ``colors`` likewise (…, 4); ``material_ids`` (t,) any integers.

    Corners of the result are corners of the input, without new values. Texture seams and borders between materials and
    colors are preserved, except in connected parts (by vertices, or by edges with coinciding ends) of so few triangles
    that seams prevent more. Sixteen pictures from all sides, in cells of two pixels, measure the change. Parts may be
    removed, so the result may be empty, (0, 3).

    The bytes are the same on any number of threads. Another kind of processor may round differently, because
    ``meshopt``, which orders the collapses, is C++. Raises ``LeafcloudError`` as :class:`Foliage` does, and for a
    ``pixel``, ``change`` or ``most`` out of range.
    """

def unrolled_uvs(positions: ArrayLike, triangles: ArrayLike, uvs: ArrayLike, repeats: ArrayLike) -> NDArray[np.float32]:
    """Return (t, 3, 2) texture coordinates that run on over the edges of triangles, for :func:`simplify`.

    Triangles move by whole numbers, which a texture that repeats does not show. Where coordinates turn back at a whole
    number, as in stems with v = 0, 1, 0, 1 … at their rings, they run on, and that part of the texture is no longer
    mirrored. A seam stays around a closed stem.

    ``positions``, ``triangles`` and ``uvs`` as for :func:`simplify`. ``repeats``: (t,) bool, whether the triangle's
    texture repeats outside [0, 1]; the others keep their coordinates. Raises ``LeafcloudError`` as :class:`Foliage`
    does.
    """

class BlendOrder:
    """Pieces of triangles, and a tree that gives their order from back to front; see :func:`blend_order`.

    ``c`` corners, ``p`` triangles, ``k`` nodes. Node 0 is the root; an empty tree has no nodes.
    """
    @property
    def sources(self) -> NDArray[np.uint32]:
        """(c,) index of the input triangle that contains each corner."""
    @property
    def weights(self) -> NDArray[np.float64]:
        """(c, 3) barycentric coordinates of each corner in that triangle: at least 0, with sum 1."""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(p, 3) corners, with the input's winding, in the order for an eye far away in the direction ``toward``."""
    @property
    def planes(self) -> NDArray[np.float64]:
        """(k, 4) unit normal n and distance d of each node's plane n · x = d."""
    @property
    def children(self) -> NDArray[np.int64]:
        """(k, 2) child nodes on the sides n · x > d and n · x < d; −1 for an empty side. Draw the child on the far side
        of the eye first, then the node's own triangles, then the child on the eye's side."""
    @property
    def ranges(self) -> NDArray[np.uint32]:
        """(k, 2) range of each node's own ``triangles``: index of the first, and one past the last."""

def blend_order(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    toward: Sequence[float] = (0.0, 0.0, 1.0),
    most: int | None = None,
) -> BlendOrder:
    """Build a binary space partition of blended triangles that may cross one another.

    ``positions``: (v, 3) floats.
    ``triangles``: (t, 3) integers.
    ``toward``: direction of the eye for the order of ``BlendOrder.triangles``.
    ``most``: maximum number of pieces. Triangles that cross a node's plane are cut in two until this number is reached;
    then the order is approximate. ``None``: the order is exact, with at most a million cuts. n triangles that cross one
    another need up to about n² cuts.

    Triangles without area are left out. The result is the same on any machine.

    Raises ``LeafcloudError`` for a position or direction that is not finite, for an index out of range, and if the
    exact order needs more than a million cuts: set ``most``.
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
    sun: Sequence[float] | None = None,
) -> NDArray[np.uint8]:
    """Render an orthographic picture (size, size, 4) in the world: the base colors, without light or under a sun.

    ``centre``: middle of the picture in the world, as ``Foliage.world_centre``. ``radius``: half its side, world units.
    ``direction``: from the center to the eye.
    ``samples``: along each side of a pixel, in [1, 16].
    ``filtered``: filter textures over the distance between samples, which is smooth with few samples. False: sample
    textures at points, with the renderers' interpolation between texels, which is accurate with many samples.
    ``sun``: direction to the sun. A surface of base color c with the normal n on the visible side then has the light
    c · (0.25 + 0.95 · max(n·l, 0)), in shadow c · 0.25; nothing nearer than R/96 casts a shadow, and no light shines
    through leaves."""

class DrawingCost(TypedDict):
    triangles: int
    area: float
    """Area of all sides that are drawn, world units squared: a double-sided triangle counts twice. So a pair of a front
    and a back billboard has the area of one double-sided billboard."""
    fragments: float
    """Fragments in quads of 2 × 2 pixels, without an early depth test, as the mean over six views."""
    layers: float
    """Mean number of triangles that cover a pixel, over the pixels that any triangle covers; 0 without such pixels."""
    total: float
    """``fragments`` + ``FRAGMENTS_PER_TRIANGLE`` · ``triangles``."""

def drawing_cost(parts: Sequence[Foliage], scale: float, *, up: Sequence[float] = (0.0, 0.0, 1.0)) -> DrawingCost:
    """Count what a graphics card draws of ``parts`` together, where a length of 1 in the world covers ``scale`` pixels.

    Backs of single-sided triangles are culled. Ctrl-C interrupts the call."""

def flip_map(base: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return (h, w) FLIP, in [0, 1], of each pixel of two images (h, w, 4) over mid-gray."""

def draw_text(text: str, size: float) -> NDArray[np.uint8]:
    """Draw a line of text in DejaVu Sans: (h, w) ink of each pixel, 255 for all.

    ``size``: pixels per em, in [4, 200]. All texts of a size have one height and one baseline."""

def encode_png(
    frames: Sequence[NDArray[np.uint8]], *, milliseconds: Sequence[int] = (), colors: int | None = None
) -> bytes:
    """Return sRGB images (h, w, 4) as a PNG file. More than one are an animation (APNG) that repeats without end.

    ``milliseconds``: duration of each frame of an animation, at most 65535.
    ``colors``: maximum number of colors, in [2, 256]; the file is then smaller and has no alpha. ``None``: all colors.

    The same frames give the same bytes."""

def decode_image(content: bytes) -> NDArray[np.uint8]:
    """Return the pixels (h, w, 4) of a PNG, JPEG or KTX2 file (Basis Universal, its largest level), top row first.

    Without an alpha channel, alpha is 255. Raises `LeafcloudError` for a file that is no image or broken, or that has
    more than 16,384 pixels on a side."""

def compress_rows(rows: NDArray[np.uint8]) -> bytes:
    """Return the bytes of vertices (v, stride) as a stream of glTF's ``EXT_meshopt_compression``, mode ATTRIBUTES.

    ``stride``: 4, 8, 12 or 16. Nothing is lost. Rows that resemble the row before them take the fewest bytes.

    Raises `LeafcloudError` for another stride. The same rows give the same stream."""

def compress_triangles(triangles: NDArray[np.uint32]) -> bytes:
    """Return triangles (t, 3) as a stream of ``EXT_meshopt_compression``, mode TRIANGLES, at about 1 to 3 bytes each.

    The triangles keep their order and orientation, but a triangle may begin at another of its corners. The same
    triangles give the same stream."""

def decompress(stream: bytes, count: int, stride: int, mode: str = "ATTRIBUTES", filter: str = "NONE") -> bytes:
    """Return the ``count`` elements of ``stride`` bytes of any stream of ``EXT_meshopt_compression``.

    ``mode``: ATTRIBUTES with a stride of a multiple of 4 up to 32, TRIANGLES or INDICES with 2 or 4; ``count`` counts
    indices then. ``filter``: NONE, OCTAHEDRAL or COLOR (strides 4 and 8), QUATERNION (8), or EXPONENTIAL.

    The indices of a foreign stream may be any. Raises `LeafcloudError` for a stream that is none, or that is too short
    for so many elements, and for other modes, filters and strides."""

def write_png(path: str, image: NDArray[np.uint8]) -> None:
    """Write an (h, w, 4) sRGB image as PNG. The same pixels give the same bytes."""

def fill_below(image: NDArray[np.uint8], cutoff: float) -> NDArray[np.uint8]:
    """Fill texels of an alpha below ``cutoff``, in [0, 1], with the mean color of the nearest other texels.

    ``image``: (h, w, 4) sRGB. Alpha stays unchanged. Mip levels then mix in no color of texels that are not drawn
    (push-pull, ``textures/dilate.rs``). Raises ``LeafcloudError`` for a cutoff out of range.
    """

def read_gltf(path: str, *, names: Sequence[str] | None = None) -> Foliage:
    """Read the foliage of a .glb or .gltf file without Blender. Z is up.

    ``names``: words to look for in the names of nodes, meshes and materials (default: leaf, leaves, foliage, needle,
    frond). Other meshes and materials are skipped.

    Reads the first UV set, colors, normals, and the materials' base color, alpha, roughness and metallic, and normal
    map. Textures always repeat, without texture transforms. For other contents (further UV sets, emission, extensions)
    use Blender's importer and ``bake.py``."""

def keep(distance: float, start: float, half: float = 0.5) -> float:
    """Return λ(d) = min((d₀/d)^(ln ½ / ln h), 1), the fraction of leaves drawn at ``distance`` d.

    ``start``: d₀ > 0. ``half``: h in (0, ½]."""

def leaf_ids(positions: ArrayLike, triangles: ArrayLike) -> NDArray[np.uint32]:
    """Return (t,) the leaf of each triangle, numbered by first appearance, as `Foliage` finds it without ``leaf_ids``.

    Triangles are of one leaf if they share a vertex, or an edge with exactly coinciding ends. One common position is
    not enough, so leaves that touch at their stems stay apart. ``positions``: (v, 3). ``triangles``: (t, 3), t ≥ 0.
    Raises `LeafcloudError` for an index out of range."""

def leaf_scale(rank: float, keep: float) -> float:
    """Return the scale r in [0, 1] of a leaf at λ = ``keep``: 1, then linear to 0 at rank = λ over the last
    min(0.05, 1 − λ) of the ranks."""

def area_scale(ranks: ArrayLike, areas: ArrayLike, keep: float) -> float:
    """Return s = √(ΣA / Σ A·r²): the linear growth that preserves the total area of leaves pruned to λ = ``keep``."""

def transition(distance: float, start: float, end: float) -> float:
    """Return a: 0 up to ``start``, 1 from ``end``, linear between."""

def switch_distance(deviation: float, pixels: float, resolution: float, field_of_view: float) -> float:
    """Return the distance beyond which ``deviation`` (world units) appears smaller than ``pixels``.

    ``resolution``: vertical, in pixels. ``field_of_view``: vertical, in radians, of a perspective camera."""
