"""Export of a baked tree for an engine, at any time after its bake."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, StringProperty

from ..errors import SceneError
from ..mesh.baked_levels import belongs_to_bake
from ..settings.choices import ENGINES
from .job_operator import refuse
from .on_tree import OnTree, active_tree
from .properties import ENGINE_LABELS

_ENGINES = [(name, ENGINE_LABELS.get(name, name.title()), "") for name in ENGINES]


class LEAFCLOUD_OT_export(OnTree, bpy.types.Operator):
    """Write this tree's files for an engine. The tree is baked again, because engines read different textures"""

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
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        if not self.directory:
            return refuse(self, SceneError("no folder is chosen: choose one for the files"))
        parts = set(tree.all_objects)
        for obj in context.selected_objects:
            obj.select_set(obj in parts and belongs_to_bake(obj))
        how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
        return set(bpy.ops.leafcloud.bake(how, directory=self.directory, engine=self.engine))
