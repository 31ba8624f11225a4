"""The operators that plan and bake the selected objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

import leafcloud

from ..build.rollback import removed_on_failure
from ..export.files import write
from ..grove import ChainsJob, finish_grove, free_name, plan_grove, prepare_grove, start_grove
from ..pipeline import file_name, layer_of
from ..plan.effects import joint_effects
from .job_operator import REFUSALS, JobOperator, can_begin, refuse, selected_trees, show
from .measured import predicted, tell
from .properties import bake_settings, show_plan


class LEAFCLOUD_OT_plan(bpy.types.Operator):
    """Tell which effects a bake of the selected objects would carry, why, and what each would cost"""

    bl_idname = "leafcloud.plan"
    bl_label = "Plan Effects"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            settings = bake_settings(context.scene.leafcloud)
            effects = plan_grove(selected_trees(context), settings, layer_of(context.scene))
        except REFUSALS as error:
            return refuse(self, error)
        show_plan(context.window_manager.leafcloud, effects)
        return {"FINISHED"}


class LEAFCLOUD_OT_bake(JobOperator, bpy.types.Operator):
    """Bake the selected objects into levels of detail, in a new collection"""

    bl_idname = "leafcloud.bake"
    bl_label = "Bake Levels"
    bl_options = {"REGISTER", "UNDO"}

    def begin(self, context: bpy.types.Context) -> ChainsJob:
        trees = selected_trees(context)
        self._sources = tuple(obj for tree in trees.values() for obj in tree.sources)
        prepared = prepare_grove(trees, bake_settings(context.scene.leafcloud), layer_of(context.scene))
        self._prepared = {name: predicted(each) for name, each in prepared.items()}
        return start_grove(self._prepared)

    def end(self, context: bpy.types.Context, chains: list[leafcloud.Chain]) -> set[str]:
        """Puts the levels into the scene in the sources' place, and writes them if a folder is given."""
        scene = context.scene
        name = free_name(file_name(_grove_name(list(self._prepared))))
        with removed_on_failure():
            grove = finish_grove(self._prepared, chains, name, scene)
            if scene.leafcloud.directory:
                directory = Path(bpy.path.abspath(scene.leafcloud.directory))
                write(grove, directory, lambda stage, fraction: show(context, stage, fraction), blend=False)
        show_plan(context.window_manager.leafcloud, joint_effects([tree.effects for tree in grove.trees]))
        for prepared, chain in zip(self._prepared.values(), chains, strict=True):
            tell(prepared, chain)
        for obj in self._sources:
            obj.hide_set(True)
            obj.hide_render = True
        for warning in dict.fromkeys(warning for each in self._prepared.values() for warning in each.warnings):
            self.report({"WARNING"}, warning)
        levels = ", ".join(f"{len(tree.levels)} levels into collection {tree.collection.name}" for tree in grove.trees)
        self.report({"INFO"}, f"Baked {levels}, and hid their sources")
        return {"FINISHED"}


def _grove_name(trees: Sequence[str]) -> str:
    """What the files of the trees are named after: the tree, or of several the .blend file."""
    return trees[0] if len(trees) == 1 else Path(bpy.data.filepath).stem or "grove"
