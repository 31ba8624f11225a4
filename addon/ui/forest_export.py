"""Export of a planted forest for engines: the places of its trees, beside the trees' own files."""

from __future__ import annotations

import re

import bpy
import numpy as np
from bpy.props import StringProperty
from mathutils import Matrix
from numpy.typing import NDArray

from ..errors import ExportError, SceneError
from ..export.forest_file import write_forest
from ..export.staging import Staging
from ..nodes.forest import GROUP_NAME
from .job_operator import refuse
from .on_tree import mode_problem
from .operators import output_folder

_FOREST = re.compile(r"(.+)_forest(\.\d{3,})?")
"""Names of the collections with the variants of a tree."""


class LEAFCLOUD_OT_export_forest(bpy.types.Operator):
    """Write NAME_forest.glb for each kind of tree of the active object's forest: all of its trees, in their places"""

    bl_idname = "leafcloud.export_forest"
    bl_label = "Export Forest"
    bl_options = {"REGISTER"}

    directory: StringProperty(
        name="Folder",
        description="Folder with the files of all trees of the forest, exported for the same engine",
        subtype="DIR_PATH",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context) or ("" if planted(context) else "Make the object of a planted forest active")
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.directory = self.directory or context.scene.leafcloud.directory
        return set(context.window_manager.invoke_props_dialog(self, confirm_text="Export"))

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = planted(context)
        assert obj is not None, "poll refuses without a forest"
        places = places_of(obj, context.evaluated_depsgraph_get())
        try:
            folder = output_folder(self.directory)
            if folder is None:
                raise ExportError("no folder is chosen: choose the one with the trees' files")
            if not places:
                raise ExportError(f"{obj.name} shows no trees: set Far to 0, and show the object")
            with Staging(folder) as staging:
                for name, rows in places.items():
                    write_forest(folder / f"{name}.glb", staging.path(f"{name}_forest.glb"), rows)
                staging.commit()
        except (SceneError, OSError) as error:
            return refuse(self, error)
        trees = ", ".join(f"{len(rows):,} × {name}" for name, rows in places.items())
        self.report({"INFO"}, f"Wrote {trees} into {folder}")
        return {"FINISHED"}


def planted(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object if a forest is planted on it."""
    obj = context.view_layer.objects.active
    if obj is None or not any(each.name.startswith(GROUP_NAME) for each in obj.modifiers):
        return None
    return obj


def places_of(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> dict[str, NDArray[np.float64]]:
    """Return the places (n, 4, 4) of the trees that are drawn on `obj`, by the tree's name. A place moves, turns
    and scales a variant from the origin, beyond its own turn and scale."""
    variants = {
        variant.objects[0].name: (match[1], variant.objects[0])
        for collection in bpy.data.collections
        if (match := _FOREST.fullmatch(collection.name))
        for variant in collection.children
        if variant.objects
    }
    found: dict[str, list[Matrix]] = {}
    for instance in graph.object_instances:
        own = instance.is_instance and instance.parent.original == obj and instance.object.original.name in variants
        if own:
            name, variant = variants[instance.object.original.name]
            found.setdefault(name, []).append(instance.matrix_world @ variant.matrix_basis.inverted())
    return {name: np.array(rows, np.float64) for name, rows in found.items()}
