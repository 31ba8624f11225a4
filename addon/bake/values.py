"""Values passed between the steps of the pipeline."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

import leafcloud

from ..geometry import Tree
from ..levels.building import BuiltLevel, Costs
from ..material.shading import Reflection
from ..material.translucency import Translucent
from ..plan.decision import Decision
from ..plan.effects import plan_levels
from ..plan.facts import Facts
from ..plan.lod_range import View
from ..plan.schedule import Schedule
from ..plan.wind import Wind
from ..settings.bake import BakeSettings
from .lighting import BakedLight
from .part import DescribedGeometry


@dataclass(frozen=True)
class Planned:
    """The plan of a bake, with the facts it is based on."""

    settings: BakeSettings
    facts: Facts
    effects: tuple[Decision, ...]


@dataclass(frozen=True)
class Prepared:
    """All input of the core, and the plan of the effects."""

    tree: Tree
    settings: BakeSettings
    foliage: leafcloud.Foliage
    trunk: leafcloud.Foliage | None
    reflection: Reflection
    translucent: Translucent
    facts: Facts
    effects: tuple[Decision, ...]
    warnings: tuple[str, ...]
    materials: tuple[str, ...]
    """Names of the leaves' own materials. Levels with baked light replace these materials."""
    light: BakedLight | None = None
    wind: Wind | None = None
    trunk_part: DescribedGeometry | None = None
    """The trunk from which the levels' own trunks are made."""
    owners: tuple[int, ...] = ()
    """For each material of the core, its index in the leaves' own materials."""
    predicted: leafcloud.Prediction | None = None
    """Prediction for these settings by a cost curve measured before the bake."""

    @property
    def levels(self) -> tuple[int, bool]:
        """The number of clouds, and whether there is a cross impostor."""
        return plan_levels(self.settings, self.facts, self.effects)


@dataclass(frozen=True)
class Baked:
    """A finished bake: the core's chain and the levels in Blender, LOD 0 first, with the distances of each."""

    prepared: Prepared
    chain: leafcloud.Chain
    collection: bpy.types.Collection
    levels: tuple[BuiltLevel, ...]
    schedule: Schedule
    view: View
    effects: tuple[Decision, ...]
    costs: Costs

    @property
    def switch_distances(self) -> tuple[float, ...]:
        """The switch distance of each level, LOD 0's 0 first, in world units."""
        return self.schedule.switch_distances


@dataclass(frozen=True)
class TreeSet:
    """The tree set of one bake: one tree, or several trees that share atlas pages.

    collection: the only tree's own collection, or the parent of the trees' collections.
    """

    name: str
    """Base name of the files."""
    collection: bpy.types.Collection
    trees: tuple[Baked, ...]

    @staticmethod
    def of(tree: Baked) -> TreeSet:
        """Return a tree set with one tree."""
        return TreeSet(tree.collection.name, tree.collection, (tree,))
