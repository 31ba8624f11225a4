"""The operators that plan and bake the selected objects."""

from __future__ import annotations

import itertools
from pathlib import Path

import bpy

import leafcloud

from ..build.rollback import removed_on_failure
from ..pipeline import file_name, finish, layer_of, plan, prepare, start, view_of, write
from ..scene.extract import extract
from .job_operator import REFUSALS, JobOperator, can_begin, refuse, show
from .measured import predicted, tell
from .properties import bake_settings, leaf_names, show_plan


class LEAFCLOUD_OT_plan(bpy.types.Operator):
    """Tell which effects a bake of the selected objects would carry, why, and what each would cost"""

    bl_idname = "leafcloud.plan"
    bl_label = "Plan Effects"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.leafcloud
        try:
            sources = tuple(context.selected_objects)
            tree = extract(context.evaluated_depsgraph_get(), sources, leaf_names=leaf_names(settings))
            effects = plan(tree, bake_settings(settings), layer_of(context.scene))
        except REFUSALS as error:
            return refuse(self, error)
        show_plan(context.window_manager.leafcloud, effects)
        return {"FINISHED"}


class LEAFCLOUD_OT_bake(JobOperator, bpy.types.Operator):
    """Bake the selected objects into levels of detail, in a new collection"""

    bl_idname = "leafcloud.bake"
    bl_label = "Bake Levels"
    bl_options = {"REGISTER", "UNDO"}

    def begin(self, context: bpy.types.Context) -> leafcloud.Job[leafcloud.Chain]:
        settings = context.scene.leafcloud
        self._sources = tuple(context.selected_objects)
        tree = extract(context.evaluated_depsgraph_get(), self._sources, leaf_names=leaf_names(settings))
        self._prepared = predicted(prepare(tree, bake_settings(settings), layer_of(context.scene)))
        return start(self._prepared)

    def end(self, context: bpy.types.Context, chain: leafcloud.Chain) -> set[str]:
        """Puts the levels into the scene in the sources' place, and writes them if a folder is given."""
        scene = context.scene
        name = _free_name(file_name((context.active_object or self._sources[0]).name))
        with removed_on_failure():
            baked = finish(self._prepared, chain, name, view_of(scene))
            scene.collection.children.link(baked.collection)
            if scene.leafcloud.directory:
                directory = Path(bpy.path.abspath(scene.leafcloud.directory))
                write(baked, directory, lambda stage, fraction: show(context, stage, fraction), blend=False)
        show_plan(context.window_manager.leafcloud, baked.effects)
        tell(self._prepared, chain)
        for obj in self._sources:
            obj.hide_set(True)
            obj.hide_render = True
        for warning in self._prepared.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"Baked {len(baked.levels)} levels into collection {name}, and hid their sources")
        return {"FINISHED"}


def _free_name(wanted: str) -> str:
    """`wanted`, with a number if the levels could not have their names under it."""
    taken = [item.name for item in (*bpy.data.collections, *bpy.data.objects)]

    def is_free(name: str) -> bool:
        return name not in bpy.data.collections and not any(other.startswith(f"{name}_LOD") for other in taken)

    numbered = (f"{wanted}_{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain([wanted], numbered) if is_free(name))
