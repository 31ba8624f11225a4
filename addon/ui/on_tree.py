"""The baked tree that operators and panels of the sidebar work on: the one of the active object."""

from __future__ import annotations

import bpy

from ..levels.shown import SOURCES, shown_level
from ..mesh.baked_levels import belongs_to_bake, record
from .job_operator import BUSY, running


def active_tree(context: bpy.types.Context) -> bpy.types.Collection | None:
    """Return the collection of the baked tree to which the active, selected object belongs; None if there is none.

    While the sources of a tree are shown, they belong to it, too.
    """
    obj = context.view_layer.objects.active
    if obj is None or not obj.select_get():
        return None
    collections = obj.users_collection if belongs_to_bake(obj) else _shown_as_sources(context.scene)
    made = ((each, record(each)) for each in collections)
    is_own = belongs_to_bake(obj)
    return next((each for each, by in made if by is not None and (is_own or obj.name_full in by.sources)), None)


def _shown_as_sources(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    return [each for each in scene.collection.children_recursive if shown_level(each) == SOURCES]


def mode_problem(context: bpy.types.Context) -> str:
    """Return why the scene cannot be changed now, with the remedy; empty if it can."""
    if context.mode != "OBJECT":
        return "Switch to Object Mode first"
    return BUSY if running else ""


class InObjectMode:
    """Mixin for operators that change the scene. Put it before `bpy.types.Operator` in the list of bases."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context)
        if problem:
            cls.poll_message_set(problem)  # type: ignore[attr-defined]
        return not problem


class OnTree:
    """Mixin for operators on the active baked tree. Put it before `bpy.types.Operator` in the list of bases."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = "Select a baked tree" if active_tree(context) is None else mode_problem(context)
        if problem:
            cls.poll_message_set(problem)  # type: ignore[attr-defined]
        return not problem
