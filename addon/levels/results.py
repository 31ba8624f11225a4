"""Figures of each level of a bake, kept with the tree's collection for the sidebar."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import bpy

import leafcloud

_KEY = "leafcloud_results"
"""The custom property of a collection of levels: a list of results as JSON."""

_PIXELS = "leafcloud_pixels"
"""The custom property of a collection of levels: pixels of a unit at the distance of a unit in the view of the bake."""

_WARNINGS = "leafcloud_warnings"
"""The custom property of a collection of levels: a list of texts as JSON."""

IMPOSTORS = {"cross": "Cross impostor", "octahedral": "Octahedral impostor"}
"""Names of the last level by its method."""


def level_name(level: leafcloud.AnyLevel, number: int) -> str:
    """Return the name of level `number` in labels."""
    return IMPOSTORS.get(level.method, f"Level {number}")


@dataclass(frozen=True)
class LevelResult:
    """Figures of a level.

    triangles: with the trunk. cheaper: cost of drawing the leaves over that of the level, where it takes over.
    texture: width and height in texels; (0, 0) without an atlas page. image_error: at 128 pixels, 0 for the leaves.
    distance: from which the level is drawn, world units.
    """

    name: str
    triangles: int
    cheaper: float
    texture: tuple[int, int]
    image_error: float
    distance: float


def keep_results(collection: bpy.types.Collection, results: Iterable[LevelResult]) -> None:
    """Store the results of all levels, the leaves first."""
    collection[_KEY] = json.dumps([asdict(each) for each in results])


def keep_view(collection: bpy.types.Collection, pixels: float) -> None:
    """Store how large the view of the bake shows things: pixels of a unit at the distance of a unit."""
    collection[_PIXELS] = pixels


def magnification(collection: bpy.types.Collection, pixels: float) -> float:
    """Return how many times larger a view shows the tree than the view of its bake; 1 if that is unknown."""
    return pixels / float(collection.get(_PIXELS, pixels))


def keep_warnings(collection: bpy.types.Collection, warnings: Iterable[str]) -> None:
    """Store the warnings of the bake."""
    collection[_WARNINGS] = json.dumps(list(warnings))


def warnings_of(collection: bpy.types.Collection) -> tuple[str, ...]:
    """Return the stored warnings; empty if there are none."""
    return tuple(json.loads(collection.get(_WARNINGS, "[]")))


def results_of(collection: bpy.types.Collection) -> tuple[LevelResult, ...]:
    """Return the stored results; empty if there are none."""
    kept = json.loads(collection.get(_KEY, "[]"))
    return tuple(LevelResult(**{**each, "texture": tuple(each["texture"])}) for each in kept)
