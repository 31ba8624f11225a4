"""What the steps of the pipeline hand to one another."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

import leafcloud

from .build.levels import BuiltLevel, Costs
from .lighting import BakedLight
from .part import Part
from .placement import Placement
from .plan.effects import Effect, plan_levels
from .plan.facts import Facts
from .plan.reach import View
from .plan.thinning import Thinning
from .plan.wind import Wind
from .scene.extract import Tree
from .scene.shading import Gloss
from .scene.translucency import Translucent
from .settings import BakeSettings


@dataclass(frozen=True)
class Planned:
    """What a bake would do, and the facts that decide it."""

    settings: BakeSettings
    facts: Facts
    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class Prepared:
    """All that the core is given, and the plan of the effects."""

    tree: Tree
    settings: BakeSettings
    placement: Placement
    foliage: leafcloud.Foliage
    wood: leafcloud.Foliage | None
    gloss: Gloss
    translucent: Translucent
    facts: Facts
    effects: tuple[Effect, ...]
    warnings: tuple[str, ...]
    materials: tuple[str, ...]
    """The names of the leaves' own, which levels whose light is baked in do not keep."""
    light: BakedLight | None = None
    wind: Wind | None = None
    wood_part: Part | None = None
    """Of which the levels' own wood is made."""
    owners: tuple[int, ...] = ()
    """The number, among the leaves' own, of each material that the core knows."""
    predicted: leafcloud.Prediction | None = None
    """What a cost curve that was measured before says of these settings."""

    @property
    def levels(self) -> tuple[int, bool]:
        """How many clouds are made, and whether the cross is."""
        return plan_levels(self.settings, self.facts, self.effects)


@dataclass(frozen=True)
class Baked:
    """A finished bake: the core's chain, and the levels in Blender, LOD 0 first, each with its switch distance."""

    prepared: Prepared
    chain: leafcloud.Chain
    collection: bpy.types.Collection
    levels: tuple[BuiltLevel, ...]
    switch_distances: tuple[float, ...]
    view: View
    thinning: Thinning
    effects: tuple[Effect, ...]
    costs: Costs


@dataclass(frozen=True)
class Grove:
    """The trees of one bake, one or several that share their pages; `collection` is the one's own, or has theirs."""

    name: str
    """What the files are named after."""
    collection: bpy.types.Collection
    trees: tuple[Baked, ...]

    @staticmethod
    def of(tree: Baked) -> Grove:
        """A tree that stands alone."""
        return Grove(tree.collection.name, tree.collection, (tree,))
