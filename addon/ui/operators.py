"""The operators that plan and bake the selected objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.props import StringProperty

import leafcloud

from ..bake.drawing import left_out_reasons
from ..bake.pipeline import file_name, layer_of
from ..bake.tree_set import (
    ChainsJob,
    camera_notes,
    finish_tree_set,
    free_name,
    plan_tree_set,
    prepare_tree_set,
    start_tree_set,
)
from ..errors import SceneError
from ..export.files import write
from ..export.staging import Staging
from ..levels.earlier import levels_of, name_before, replaced
from ..levels.results import keep_warnings
from ..levels.rollback import removed_on_failure
from ..mesh.baked_levels import remember
from ..plan.effects import joint_effects
from ..settings.setting import SettingsError
from ..steps import Steps
from .draft import drawn_draft, is_draft, prepared_draft
from .job_operator import REFUSALS, JobOperator, can_begin, refuse
from .measured import predicted, tell
from .preferences import preference
from .progress import show
from .properties import LeafcloudSettings, bake_settings, show_plan, with_labels
from .selection import parts_of, select_only, selected_trees


class LEAFCLOUD_OT_plan(bpy.types.Operator):
    """Show which effects a bake of the selected objects would have, with reason and cost of each. Bakes nothing"""

    bl_idname = "leafcloud.plan"
    bl_label = "Plan Effects"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            settings = bake_settings(context.scene.leafcloud)
            with selected_trees(context) as trees:
                planned = plan_tree_set(trees, settings, layer_of(context.scene), with_labels).values()
        except REFUSALS as error:
            return refuse(self, error)
        effects = joint_effects([each.effects for each in planned])
        show_plan(context.window_manager.leafcloud, effects, camera_notes(planned))
        return {"FINISHED"}


class LEAFCLOUD_OT_bake(JobOperator, bpy.types.Operator):
    """Bake the selected objects into levels of detail in a new collection. Selected levels are baked again"""

    bl_idname = "leafcloud.bake"
    bl_label = "Bake Levels"
    bl_options = {"REGISTER", "UNDO"}

    viewer: StringProperty(
        name="Viewer",
        description="Value of the setting Viewer, set before the bake. Empty: keep the setting",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def begin(self, context: bpy.types.Context) -> ChainsJob:
        settings = context.scene.leafcloud
        if self.viewer:
            settings.viewer, self.viewer = self.viewer, ""
        self._directory = output_folder(settings.directory)
        wanted = bake_settings(settings)
        self._asked = self._seen = _asked(settings)
        with selected_trees(context) as trees:
            prepared = prepare_tree_set(trees, wanted, layer_of(context.scene), with_labels)
            self._drafted = prepared_draft(trees, wanted) if self.in_window else {}
        self._prepared = {name: predicted(each) for name, each in prepared.items()}
        return start_tree_set(self._prepared, self._drafted)

    def meanwhile(self, context: bpy.types.Context, job: ChainsJob) -> Steps[None]:
        return drawn_draft(context, self._drafted, job)

    def is_outdated(self, context: bpy.types.Context) -> bool:
        try:
            seen, self._seen = self._seen, _asked(context.scene.leafcloud)
        except SettingsError:
            return False  # It is being typed.
        return self._asked != self._seen == seen

    def end(self, context: bpy.types.Context, chains: list[leafcloud.Chain]) -> Steps[set[str]]:
        """Replace the sources in the scene by the levels, and write files if a folder is given.

        The new levels replace those of an earlier bake of the same sources.
        """
        scene, sources = context.scene, [obj for each in self._prepared.values() for obj in each.tree.sources]
        earlier = [each for each in levels_of(scene, sources) if not is_draft(each)]
        before = name_before(earlier, sources)
        with replaced(earlier), removed_on_failure():
            name = before or free_name(file_name(_tree_set_name(list(self._prepared))))
            tree_set = yield from finish_tree_set(self._prepared, chains, name, scene)
            if self._directory is not None:
                write(tree_set, self._directory, lambda stage, fraction: show(context, stage, fraction), blend=False)
            remember(tree_set.collection, sources)
            for tree in tree_set.trees:
                remember(tree.collection, tree.prepared.tree.sources)
                if not preference("vertex_groups"):
                    for level in tree.levels:
                        level.object.vertex_groups.clear()
            yield
            self.end_meanwhile()  # It shows the earlier levels again.
        effects = joint_effects([tree.effects for tree in tree_set.trees])
        show_plan(context.window_manager.leafcloud, effects, camera_notes(self._prepared.values()))
        for tree in tree_set.trees:
            tell(tree)
        yield
        for obj in sources:
            obj.hide_set(True)
            obj.hide_render = True
        select_only(context, parts_of(tree_set))
        for tree in tree_set.trees:
            keep_warnings(tree.collection, map(with_labels, tree.prepared.warnings))
        for warning in dict.fromkeys(warning for tree in tree_set.trees for warning in tree.prepared.warnings):
            self.report({"WARNING"}, with_labels(warning))
        for reason in dict.fromkeys(reason for chain in chains for reason in left_out_reasons(chain)):
            self.report({"INFO"}, with_labels(reason))
        levels = ", ".join(
            f"{len(tree.levels)} levels into collection {tree.collection.name}" for tree in tree_set.trees
        )
        files = "" if self._directory is None else f", wrote files into {self._directory}"
        self.report({"INFO"}, f"Baked {levels}{files}, and hid their sources")
        return {"FINISHED"}


def _asked(settings: LeafcloudSettings) -> tuple[object, ...]:
    """Return all that a bake reads from the sidebar."""
    return bake_settings(settings), settings.leaves, settings.trees, settings.directory


def output_folder(directory: str) -> Path | None:
    """Return the output folder of a bake; None for an empty path. Raise `SceneError` if it is not writable."""
    if not directory:
        return None
    if directory.startswith("//") and not bpy.data.filepath:
        raise SceneError(
            f"`out` is {directory!r}, relative to the .blend file, but this file is not saved: save it, or choose an "
            "absolute path"
        )
    folder = Path(bpy.path.abspath(directory))
    if not folder.is_absolute():
        raise SceneError(
            f"`out` is {directory!r}: begin it with // for a folder beside the .blend file, or choose an absolute path"
        )
    try:
        with Staging(folder):
            return folder
    except (FileExistsError, NotADirectoryError) as error:
        raise SceneError(f"`out` is {str(folder)!r}, but {error.filename} is not a folder: choose another") from error
    except OSError as error:
        raise SceneError(
            f"`out` is {str(folder)!r}, which cannot be written ({error.strerror or error}): choose another folder"
        ) from error


def _tree_set_name(trees: Sequence[str]) -> str:
    """Return the base name of the files: the tree's name, or the .blend file's for several trees."""
    return trees[0] if len(trees) == 1 else Path(bpy.data.filepath).stem or "trees"
