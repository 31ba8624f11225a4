"""Facts about the scene and the tree that the plan of the effects uses. `pipeline.describe` reads them from Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .lod_range import View
from .wind import Wind

Span = tuple[float, float]
"""The least and the greatest distance from the camera to a crown's center over all frames, in world units."""


@dataclass(frozen=True)
class Camera:
    """The distances from the scene's cameras to each tree, the baked tree first, and the view of the cameras.

    For a copy of another size it is the distance at which the baked tree would look as large.
    """

    spans: tuple[Span, ...]
    view: View
    moves: bool = False
    """True if the camera moves, turns or zooms over the frames, or another camera takes over."""

    @property
    def nearest(self) -> float:
        return min(near for near, _ in self.spans)

    @property
    def farthest(self) -> float:
        return max(far for _, far in self.spans)


@dataclass(frozen=True)
class Lights:
    """The names of a scene's shining lamps and world. `changing`: a phrase that names one that moves or changes."""

    names: tuple[str, ...]
    changing: str | None = None


@dataclass(frozen=True)
class Facts:
    """The facts: the engine, the size of the tree, its materials, the cameras, the lights and the wind."""

    engine: str
    leaves: int = 0
    vertices: int = 0
    triangles: int = 0
    """Vertices and triangles of the leaves."""
    trunk: int = 0
    """Triangles of trunk and branches."""
    radius: float = 1.0
    """R, the radius of the leaves' bounding sphere, in world units."""
    area: float = 0.0
    """Area of the leaf triangles in world units squared."""
    glossy: str | None = None
    """A leaf material with visible highlights whose roughness or metallic varies, or differs from other materials."""
    translucent: str | None = None
    """A translucent leaf material."""
    unlit: bool = False
    """True if all leaf materials show their colors without light."""
    one_color: bool = False
    """True if all leaves have the same uniform base color."""
    blended: tuple[str, ...] = ()
    """The leaf materials with alpha blending: neither opaque nor cut out."""
    see_through: tuple[str, ...] = ()
    """The blended materials that are mostly semi-transparent. Empty if they cover only a small share of the leaves."""
    camera: Camera | None = None
    """The camera that the plan uses. None: the viewer may be anywhere."""
    scene_camera: Camera | None = None
    """The scene's camera, used by the plan or not."""
    lights: Lights = Lights(())
    wind: Wind | None = None
    """The wind of the scene's force fields on the tree."""
    renderer: str = ""
    """Blender's name of the scene's render engine."""

    @property
    def depth(self) -> float:
        """The mean number of leaves along a line of sight: leaf area divided by the area of the crown's disc."""
        return self.area / (math.pi * self.radius**2)

    @property
    def leaf_size(self) -> float:
        """The side of a square with the mean area of a leaf, in world units."""
        return math.sqrt(self.area / self.leaves) if self.leaves else 0.0
