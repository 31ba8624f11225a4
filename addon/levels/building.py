"""The context of a build: everything that the makers of levels and the effects need to know about one tree."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..geometry import Tree
from ..material.shading import USUAL_SPECULAR
from ..nodes.wind import WindSettings
from ..plan.effect import Effect
from ..plan.schedule import Schedule
from ..scene.light import Light
from .images import PackedImages
from .material import Page


@dataclass
class Costs:
    """Seconds and bytes spent on each effect so far, by effect name."""

    seconds: dict[str, float] = field(default_factory=dict)
    bytes: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def spent_on(self, effect: str, nbytes: int = 0) -> Iterator[None]:
        """Add the block's running time and `nbytes` to the costs of `effect`."""
        begin = time.perf_counter()
        yield
        self.add_seconds(effect, time.perf_counter() - begin)
        self.add_bytes(effect, nbytes)

    def add_seconds(self, effect: str, seconds: float) -> None:
        self.seconds[effect] = self.seconds.get(effect, 0.0) + seconds

    def add_bytes(self, effect: str, nbytes: int) -> None:
        self.bytes[effect] = self.bytes.get(effect, 0) + nbytes


@dataclass(frozen=True)
class LeafShading:
    """Roughness, metallic and highlights of the leaves, for clouds without textures of their own.

    specular: Specular IOR Level. share: the fraction of the light that the leaves transmit.
    """

    roughness: float = 1.0
    metallic: float = 0.0
    specular: float = USUAL_SPECULAR
    share: float = 0.0


@dataclass(frozen=True)
class Build:
    """One tree to build.

    name: of the collection; the names of the levels begin with it. effects: those that are on.
    light: baked light of the leaves; None without baked light. Materials multiply it by light_strength.
    unlit: the leaves' own materials show their colors without light.
    wind: wind and tree measurements; None without wind. The levels' own distances come from the schedule.
    owners: for each material number in the leaf map, the index of the leaf material; empty if the numbers are equal.
    """

    name: str
    tree: Tree
    foliage: leafcloud.Foliage
    chain: leafcloud.Chain
    schedule: Schedule
    effects: tuple[Effect, ...]
    costs: Costs = field(default_factory=Costs)
    shading: LeafShading = LeafShading()
    light: Light | None = None
    light_strength: float = 1.0
    unlit: bool = False
    wind: WindSettings | None = None
    owners: tuple[int, ...] = ()
    images: PackedImages = field(default_factory=PackedImages)

    @property
    def leaf_levels(self) -> list[leafcloud.LeafLevel]:
        """The first levels if they are leaves: simplified ones, then fewer ones."""
        return [level for level in self.chain.levels if isinstance(level, leafcloud.LeafLevel)]

    @property
    def first_cloud(self) -> int:
        """Number of the first level with an atlas page."""
        return 1 + len(self.leaf_levels)

    @property
    def emits(self) -> bool:
        """Whether levels show their colors without light."""
        return self.unlit or self.light is not None

    def has(self, effect: str) -> bool:
        """Return whether the effect is on."""
        return any(each.name == effect for each in self.effects)

    def charged(self) -> Iterator[Effect]:
        """Yield the effects that are on, and add the time until the next one is asked for to the costs of each."""
        for effect in self.effects:
            with self.costs.spent_on(effect.name):
                yield effect

    @property
    def centre(self) -> tuple[float, float, float]:
        """Center of the foliage's bounding sphere in the tree's coordinates. Distances are measured from it."""
        x, y, z = self.foliage.centre.astype(np.float32).tolist()
        return x, y, z

    @property
    def radius(self) -> float:
        """Radius of the foliage's bounding sphere in the tree's coordinates."""
        return self.foliage.radius / self.tree.scale

    @property
    def follows_camera(self) -> bool:
        return self.has("transitions") or self.has("pruning") or len(self.schedule.drawn) > 1

    @property
    def prunes_leaves(self) -> bool:
        """True if leaves are pruned while LOD 0 is drawn."""
        return self.schedule.pruning.start < self.schedule.lod_ranges[0].vanish

    @property
    def leaf_materials(self) -> Sequence[bpy.types.Material | None]:
        """The leaf materials by their number in the leaf map."""
        own = self.tree.leaves.materials
        return [own[owner] for owner in self.owners] or own

    def image(
        self, effect: str, name: str, pixels: NDArray[np.uint8] | None, level: leafcloud.Level, *, data: bool = True
    ) -> bpy.types.Image | None:
        """Create an image (h, w, 4) of a level and charge the effect for it; None without pixels.

        `data`: its values are not colors.
        """
        if pixels is None:
            return None
        self.costs.add_bytes(effect, own_bytes(level, pixels))
        return self.images.add(name, pixels, data=data)

    def with_orm(self, effect: str, page: Page, level: leafcloud.Level) -> Page:
        """Return the page with occlusion, roughness and metallic, if no other effect has added them."""
        if page.orm is not None:
            return page
        return replace(page, orm=self.image(effect, f"{page.name}_orm", level.orm, level))


@dataclass(frozen=True)
class BuiltLevel:
    """One level in Blender.

    triangles: triangles of the object, without the trunk.
    trunk_change: fraction of the level's picture that the trunk's simplification changes (see `Trunk`).
    two_sided: material of both sides, for pairs of front and back billboards (`nodes.sides`); None without pairs.
    trunk_corners: kept corners of LOD 0's trunk, as `Trunk.corners`.
    """

    number: int
    object: bpy.types.Object
    trunk: bpy.types.Object | None
    triangles: int
    trunk_triangles: int = 0
    trunk_change: float = 0.0
    two_sided: bpy.types.Material | None = None
    trunk_corners: NDArray[np.integer[Any]] | None = field(default=None, repr=False, compare=False)


def own_bytes(level: leafcloud.Level, pixels: NDArray[np.uint8]) -> int:
    """Return the level's share of an image's bytes. Other trees may share the atlas page."""
    return round(pixels.nbytes * level.page_share)


def y_up(vector: tuple[float, float, float]) -> list[float]:
    """Convert a vector from Blender's Z-up coordinates to glTF's Y-up coordinates, for extras."""
    x, y, z = vector
    return [x, z, 0.0 - y]  # Avoid −0.
