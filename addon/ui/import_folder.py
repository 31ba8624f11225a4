"""All trees of a folder of files, imported side by side, each into a collection of its own, ready to bake."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.props import StringProperty
from mathutils import Vector

from ..errors import SceneError
from ..scene.load import SUFFIXES, load_beside
from .job_operator import refuse
from .on_tree import mode_problem

_GAP = 1.2
"""Distance between two trees, as a multiple of the wider one's width."""


class LEAFCLOUD_OT_import_folder(bpy.types.Operator):
    """Import all .glb, .gltf and .obj files of a folder side by side, and select them. Bake Levels then bakes each"""

    bl_idname = "leafcloud.import_folder"
    bl_label = "Import Trees of a Folder"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(name="Folder", description="Folder of the files", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context)
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = Path(bpy.path.abspath(self.directory))
        try:
            files = tree_files(folder)
        except SceneError as error:
            return refuse(self, error)
        for obj in context.selected_objects:
            obj.select_set(False)
        trees: list[list[bpy.types.Object]] = []
        for path in files:
            try:
                trees.append(_imported(context, path))
            except SceneError as error:
                self.report({"WARNING"}, f"left out: {error}")
        if not trees:
            return refuse(
                self, SceneError(f"none of the {len(files)} files in {folder} can be read: export them again")
            )
        context.view_layer.update()
        _in_a_row(trees)
        for obj in (obj for tree in trees for obj in tree if obj.name in context.view_layer.objects):
            obj.select_set(True)
        context.view_layer.objects.active = trees[0][0]
        context.scene.leafcloud.trees = "collections"
        self.report({"INFO"}, f"Imported {len(trees)} trees, each into a collection of its own")
        return {"FINISHED"}


def tree_files(folder: Path) -> list[Path]:
    """Return the files of trees in a folder, by name. Raise `SceneError` if there are none."""
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    except OSError as error:
        raise SceneError(f"{folder} cannot be read: {error.strerror or error}; choose another folder") from error
    if not files:
        raise SceneError(f"{folder} has no {', '.join(SUFFIXES)} file: choose a folder with trees")
    return files


def _imported(context: bpy.types.Context, path: Path) -> list[bpy.types.Object]:
    """Import a file into a new collection with its name. Return the objects; none of them stays after a failure."""
    collection = bpy.data.collections.new(path.stem)
    try:
        objects = load_beside(path)
        if not any(obj.type == "MESH" for obj in objects):
            raise SceneError(f"{path} has no mesh; choose files of trees")
    except SceneError:
        bpy.data.collections.remove(collection)
        raise
    context.scene.collection.children.link(collection)
    for obj in objects:
        for other in list(obj.users_collection):
            other.objects.unlink(obj)
        collection.objects.link(obj)
    return objects


def _in_a_row(trees: Sequence[Sequence[bpy.types.Object]]) -> None:
    """Move the trees along x so that none stands in another."""
    edge, before = 0.0, 0.0
    for objects in trees:
        corners = [
            obj.matrix_world @ Vector(corner) for obj in objects if obj.type == "MESH" for corner in obj.bound_box
        ]
        low, high = min(corner.x for corner in corners), max(corner.x for corner in corners)
        gap = 0.0 if objects is trees[0] else (_GAP - 1.0) * max(high - low, before)
        move = edge + gap - low
        for obj in objects:
            if obj.parent not in objects:
                obj.matrix_world.translation.x += move
        edge, before = high + move, high - low
