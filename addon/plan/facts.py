"""What a scene is, as far as the plan of the effects asks. Plain values; `scene.survey` reads them from Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .reach import View
from .wind import Wind

Span = tuple[float, float]
"""The least and the greatest distance of the camera from the middle of a crown, over all frames; world units."""


@dataclass(frozen=True)
class Camera:
    """From where the scene's cameras see each of the trees, the baked one first, and with what.

    Distances from copies that are larger or smaller are those from which the baked tree would look like them.
    """

    spans: tuple[Span, ...]
    view: View
    moves: bool = False
    """Whether it moves, turns or zooms over the frames, or gives way to another camera."""

    @property
    def nearest(self) -> float:
        return min(near for near, _ in self.spans)

    @property
    def farthest(self) -> float:
        return max(far for _, far in self.spans)


@dataclass(frozen=True)
class Lights:
    """The lamps of a scene, and its world if that shines. `changing` is one that moves or changes, in words."""

    names: tuple[str, ...]
    changing: str | None = None


@dataclass(frozen=True)
class Facts:
    """What the plan looks at: who draws the tree, how much there is of it, who sees it, what lights do there."""

    engine: str
    leaves: int = 0
    vertices: int = 0
    triangles: int = 0
    """Both of the leaves."""
    wood: int = 0
    """Triangles of trunk and branches."""
    wood_seams: float = 0.0
    """The share of its vertices that are there only because its texture has a seam."""
    radius: float = 1.0
    """R, world units."""
    area: float = 0.0
    """Of the leaves' triangles, world units squared."""
    glossy: str | None = None
    """A leaf material in which lights are seen mirrored, other than in the others or all over it."""
    translucent: str | None = None
    """A leaf material through which light shines."""
    one_color: bool = False
    """Whether all leaves have one base colour, all over."""
    blended: tuple[str, ...] = ()
    """The leaf materials that are neither opaque nor cut out."""
    see_through: tuple[str, ...] = ()
    """Those of them through most of which what is behind them is seen; none where hardly a leaf has them."""
    camera: Camera | None = None
    """The camera that the levels are planned by. None: the viewer may be anywhere."""
    scene_camera: Camera | None = None
    """The scene's, whether or not the levels are planned by it."""
    lights: Lights = Lights(())
    wind: Wind | None = None
    """What the scene's force fields blow on the tree."""
    renderer: str = ""
    """The scene's render engine, as Blender names it."""

    @property
    def depth(self) -> float:
        """How many leaves a line of sight meets, about: their area over that of a disc around the crown."""
        return self.area / (math.pi * self.radius**2)

    @property
    def leaf_size(self) -> float:
        """The side of a square as large as a leaf is in the mean, world units."""
        return math.sqrt(self.area / self.leaves) if self.leaves else 0.0
