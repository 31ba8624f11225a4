"""Export of a baked tree for an engine, at any time after its bake. The scene stays as it is."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import bpy
from bpy.props import EnumProperty, StringProperty

import leafcloud

from ..bake.pipeline import layer_of
from ..bake.tree_set import ChainsJob, finish_tree_set, prepare_tree_set, start_tree_set
from ..errors import SceneError
from ..export.files import write
from ..levels.earlier import levels_of, replaced
from ..levels.rollback import removed_on_failure
from ..levels.shown import sources_of
from ..settings.choices import ENGINES
from ..steps import Steps
from .job_operator import JobOperator, refuse
from .on_tree import OnTree, active_tree
from .operators import output_folder
from .progress import show
from .properties import ENGINE_LABELS, bake_settings, with_labels
from .selection import trees_of

_ENGINES = [(name, ENGINE_LABELS.get(name, name.title()), "") for name in ENGINES]


class LEAFCLOUD_OT_export(OnTree, bpy.types.Operator):
    """Write this tree's files for an engine. Bakes the tree again with the settings of the panels, and keeps its levels in the scene"""  # noqa: E501

    bl_idname = "leafcloud.export"
    bl_label = "Export"
    bl_options = {"REGISTER"}

    engine: EnumProperty(name="For", description="Engine that reads the files", items=_ENGINES)
    directory: StringProperty(
        name="Folder", description="Folder for the files. Files of the same names are replaced", subtype="DIR_PATH"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        settings = context.scene.leafcloud
        self.engine, self.directory = settings.engine, self.directory or settings.directory
        return set(context.window_manager.invoke_props_dialog(self, confirm_text="Export"))

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.directory:
            return refuse(self, SceneError("no folder is chosen: choose one for the files"))
        how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
        try:
            result = bpy.ops.leafcloud.write_files(how, directory=self.directory, engine=self.engine)
        except RuntimeError as error:  # Blender raises what the operator reports.
            return refuse(self, SceneError(str(error).removeprefix("Error: ")))
        return {"CANCELLED"} if "CANCELLED" in result else {"FINISHED"}


class _Written(Exception):
    """Ends the block in which the levels for the files exist."""


class LEAFCLOUD_OT_write_files(OnTree, JobOperator, bpy.types.Operator):
    """Bake the tree of the active object for an engine, and write its files"""

    bl_idname = "leafcloud.write_files"
    bl_label = "Write Files"
    bl_options = {"INTERNAL"}

    engine: StringProperty(name="For", description="Engine that reads the files", default="generic")
    directory: StringProperty(name="Folder", description="Folder for the files")

    def begin(self, context: bpy.types.Context) -> ChainsJob:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        self._name = tree.name
        self._sources = sources_of(tree, context.view_layer)
        folder = output_folder(self.directory)
        assert folder is not None, "the folder has a name"
        self._folder = folder
        wanted = replace(bake_settings(context.scene.leafcloud), engine=self.engine, trees="one")
        with trees_of(context, self._sources, "one") as trees:
            [extracted] = trees.values()
            prepared = {self._name: extracted}
            self._prepared = prepare_tree_set(prepared, wanted, layer_of(context.scene), with_labels)
        return start_tree_set(self._prepared)

    def end(self, context: bpy.types.Context, chains: list[leafcloud.Chain]) -> Steps[set[str]]:
        """Make the levels for the engine under the names of the tree's own, write them, and take all of it back."""
        folder = self._folder
        own = levels_of(context.scene, self._sources)
        with suppress(_Written), replaced(own), removed_on_failure():
            tree_set = yield from finish_tree_set(self._prepared, chains, self._name, context.scene)
            write(tree_set, folder, lambda stage, fraction: show(context, stage, fraction), blend=False)
            raise _Written
        self.report({"INFO"}, f"Wrote the files of {self._name} into {folder}")
        return {"FINISHED"}
